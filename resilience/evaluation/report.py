"""`Report`: every method on the same episodes, and what can be said of them with confidence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.ac_check import TrajectoryCertificate
from resilience.evaluation.columns import expected, row
from resilience.evaluation.measures import statistics
from resilience.evaluation.measures.measures import Measures, infrastructure
from resilience.evaluation.measures.metrics import Adequacy
from resilience.evaluation.measures.statistics import MeanInterval
from resilience.evaluation.runs import BOUND
from resilience.fragility.outages.scenarios import Scenarios

if TYPE_CHECKING:
    import pandas as pd

    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import World

DETERMINISTIC = ("mpc-blind", "mpc")
"""Those that plan for one future."""
HEDGING = ("stochastic", "sddp")
"""Those that plan for many."""
RESET = (
    "the state of charge is reset every midnight: energy kept for tomorrow is taken away and "
    "energy used up is given back, at the end credit, so that gaps do not measure skill"
)


@dataclass(frozen=True)
class Report:
    """Every dispatcher on the same episodes; an episode is one scenario over all days.

    Attributes:
        world: case, storms and rules of the comparison.
        trajectories: method to what it did; the clairvoyant is among them.
        measures: method to what is measured of it.
        certificates: method to what AC power flow says, where asked for.
        forecast_error: how load and PV differ from their forecast, in words.
        bound_seconds: wall-clock seconds for the bound.
    """

    world: World = field(repr=False)
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    measures: Mapping[str, Measures] = field(repr=False)
    certificates: Mapping[str, TrajectoryCertificate] | None = field(default=None, repr=False)
    forecast_error: str = "none"

    reference = REFERENCE

    @property
    def case(self) -> Case:
        """The case, over the days of an episode."""
        return self.world.grid.case

    @property
    def scenarios(self) -> Scenarios:
        """The storms: an episode is one scenario."""
        return self.world.scenarios

    @property
    def end_value_per_mwh(self) -> float:
        """Worth of the energy left, $/MWh."""
        return self.world.end_value_per_mwh

    @property
    def physics(self) -> str:
        """The physics of everybody, the bound included."""
        return self.world.grid.physics

    @property
    def days(self) -> float:
        """Days of an episode."""
        return self.case.slots * self.case.step_h / 24.0

    @property
    def objective(self) -> Mapping[str, Floats]:
        """Method to (episodes,) $: cost less the worth of the energy left."""
        return {name: found.objective for name, found in self.measures.items()}

    @property
    def adequacy(self) -> Mapping[str, Adequacy]:
        """Method to its reliability indices."""
        return {name: found.adequacy for name, found in self.measures.items()}

    @property
    def seconds(self) -> Mapping[str, float]:
        """Method to wall-clock seconds for all of its decisions."""
        return {name: run.seconds for name, run in self.trajectories.items()}

    @property
    def bound(self) -> Floats:
        """(episodes,) $: the clairvoyant optimum, which no dispatcher can beat."""
        proven = self.trajectories[BOUND].proven
        assert proven is not None
        return proven

    @property
    def bound_seconds(self) -> float:
        """Wall-clock seconds for the slowest part of the bound."""
        return self.trajectories[BOUND].build_seconds

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know before comparing numbers."""
        found = [RESET] if self.world.reset_daily else []
        if self.triviality.trivial:
            found.append(
                "a battery kept full is within 1 % of the bound: the case cannot rank methods"
            )
        return tuple(found)

    @property
    def setting(self) -> tuple[str, ...]:
        """The rules of the comparison, in words, for the head of a table."""
        told = "told at midnight" if self.world.known_centre else "unknown"
        centre = () if self.scenarios.centre is None else (f"storm centre: {told}",)
        n, days = self.scenarios.n, self.days
        length = f"{n} episode{'s' * (n != 1)} of {days:g} day{'s' * (days != 1)}"
        return (
            f"{length} from {self.case.start:%Y-%m-%d}",
            self.physics,
            f"energy left worth {self.end_value_per_mwh:g} $/MWh",
            f"forecast errors: {self.forecast_error}",
            *centre,
        )

    @property
    def triviality(self) -> statistics.Triviality:
        """Whether the case tells methods apart at all."""
        likely = self.scenarios.probability
        rule, best = (expected(v, likely) for v in (self.objective[REFERENCE], self.bound))
        return statistics.triviality([rule], [best])

    def difference(self, name: str, other: str, seed: int = 0) -> MeanInterval:
        """What `name` costs more per day than `other`, on the same episodes, with its interval.

        Ends are NaN where a single episode allows none.
        """
        apart = (self.objective[name] - self.objective[other]) / self.days
        likely, n = self.scenarios.probability, self.scenarios.n
        mean = expected(apart, likely)
        if name == other:
            return MeanInterval(0.0, 0.0, 0.0, 0.95, n)
        if n == 1:
            return MeanInterval(mean, math.nan, math.nan, 0.95, n)
        # Weights enter the values, so that their plain mean is the expectation.
        rng = np.random.default_rng(seed)
        return statistics.mean_interval(apart * likely * n, rng)

    def differences(self, seed: int = 0) -> pd.DataFrame:
        """Any two methods: what the first costs more per day, its interval, and if it is luck.

        An interval is that of its pair alone: of many, one in twenty misses.
        """
        import pandas as pd

        order = sorted(self.objective, key=lambda name: float(np.mean(self.objective[name])))
        rows = []
        for other, name in combinations(order, 2):
            more = self.difference(name, other, seed)
            sure = more.excludes_zero
            ends = {"low": more.low, "high": more.high, "excludes_zero": sure}
            rows.append({"method": name, "other": other, "per_day": more.mean, **ends})
        names = ["method", "other", "per_day", "low", "high", "excludes_zero"]
        return pd.DataFrame(rows, columns=names)

    def value_of_stochastic_solution(self, seed: int = 0) -> list[dict[str, Any]]:
        """What planning for one future costs more per day than planning for many.

        Textbooks compare two first decisions; here both plan anew in every slot, and what is
        compared is what they end up paying. A row per pair that was run, with its interval.
        """
        rows = []
        for one in (name for name in DETERMINISTIC if name in self.objective):
            for many in (name for name in HEDGING if name in self.objective):
                more = self.difference(one, many, seed)
                pair = {"deterministic": one, "stochastic": many}
                rows.append({**pair, "per_day": more.mean, "low": more.low, "high": more.high})
        return rows

    def frame(self, seed: int = 0) -> pd.DataFrame:
        """A row per method, the cheapest first; `columns.COLUMNS` says what the columns are.

        Args:
            seed: of the bootstrap.
        """
        return self._rows(seed) if seed else self._frame.copy()

    @cached_property
    def _frame(self) -> pd.DataFrame:
        return self._rows(0)

    def _rows(self, seed: int) -> pd.DataFrame:
        import pandas as pd

        rows = [{"method": name, **row(self, name, seed)} for name in self.objective]
        return pd.DataFrame(rows).set_index("method").sort_values("cost_per_day")

    def summary(self) -> dict[str, Any]:
        """The report as plain data; what is not defined is None."""
        likely = self.scenarios.probability
        lines = infrastructure(self.world)
        room = self.triviality.room_share
        found = {
            "case": self.case.name,
            "start": self.case.start.isoformat(),
            "slots": self.case.slots,
            "days": self.days,
            "episodes": self.scenarios.n,
            "seed": self.scenarios.seed,
            "process": self.scenarios.process,
            "physics": self.physics,
            "end_value_per_mwh": self.end_value_per_mwh,
            "forecast_error": self.forecast_error,
            "known_centre": self.world.known_centre,
            "reset_daily": self.world.reset_daily,
            "warnings": list(self.warnings),
            "bound_per_day": expected(self.bound, likely) / self.days,
            "bound_seconds": self.bound_seconds,
            "triviality_percent": 100.0 * room,
            "trivial": self.triviality.trivial,
            "infrastructure": {
                "lambda_share": expected(lines.lambda_share, likely),
                "e_h": expected(lines.e_h, likely),
                "area_share": expected(lines.area_h, likely) / (24.0 * self.days),
            },
            "methods": self.frame().reset_index().to_dict(orient="records"),
            "differences": self.differences().to_dict(orient="records"),
            "value_of_stochastic_solution": self.value_of_stochastic_solution(),
        }
        if self.certificates is not None:
            found["certificates"] = {k: asdict(v.worst()) for k, v in self.certificates.items()}
        return _clean(found)

    def save(self, folder: str | Path) -> Path:
        """Writes the report, all or nothing; see `dispatch.saving` for the files.

        Raises:
            UsageError: the folder holds something that is no earlier report.
        """
        from resilience.evaluation.saving import save_report

        return save_report(self, Path(folder))


def _clean(value: Any) -> Any:
    """Plain data without numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_clean(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
