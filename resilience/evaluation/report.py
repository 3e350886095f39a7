"""`Report`: every method on the same episodes, and what can be said of them with confidence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.clairvoyant import relaxes_integers
from resilience.evaluation.columns import row
from resilience.evaluation.judged import Judged
from resilience.evaluation.measures import statistics
from resilience.evaluation.measures.measures import infrastructure
from resilience.evaluation.saving import save_report
from resilience.evaluation.verdict import few_events
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import worth
from resilience.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


RESET_WARNING = (
    "the state of charge is reset every midnight: energy kept for tomorrow is taken away and "
    "energy used up is given back, at the end credit, so that gaps do not measure skill"
)
RECOURSE_WARNING = (
    "islands are closed by the paper's equations, those of the bound for least cost: gaps hold the "
    "difference, and say nothing of whether the case can tell methods apart"
)
RELAXED_WARNING = (
    "the bound lets units run and lines close by shares: it is proven, but perhaps nobody reaches "
    "it, so that a part of every gap may be no lack of skill"
)


@dataclass(frozen=True, repr=False)
class Report(Shown, Judged):
    """What is printed and saved of a comparison; see `Judged` for what it holds."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know before comparing numbers."""
        warnings = [RESET_WARNING] if self.world.reset_daily else []
        if self.world.recourse == "paper":
            warnings.append(RECOURSE_WARNING)
        if relaxes_integers(self.world):
            warnings.append(RELAXED_WARNING)
        if self.triviality.trivial:
            warnings.append(
                "a battery kept full is within 1 % of the bound: the case cannot rank methods"
            )
        if events := few_events(self):
            warnings.append(events)
        return tuple(warnings)

    @property
    def setting(self) -> tuple[str, ...]:
        """The rules of the comparison, in words, for the head of a table."""
        forecast = "told at midnight" if self.world.known_centre else "unknown"
        centre = () if self.scenarios.centre is None else (f"storm centre: {forecast}",)
        n, days = self.scenarios.n, self.days
        length = f"{n} episode{'s' * (n != 1)} of {days:g} day{'s' * (days != 1)}"
        weights = worth(self.scenarios.probability)
        return (
            f"{length} from {self.case.start:%Y-%m-%d}",
            *((f"weighted, {weights}",) if weights else ()),
            self.physics,
            f"energy left worth {self.end_value_per_mwh:g} $/MWh",
            f"forecast errors: {self.forecast_error}",
            *centre,
            *((f"believed: {self.belief}",) if self.belief else ()),
            *(() if self.world.recourse == "economic" else ("the paper's recourse",)),
            *(("bound: commitment and switches relaxed",) if relaxes_integers(self.world) else ()),
        )

    @property
    def belief(self) -> str:
        """What operators hold of outages to come, in words; empty where it goes without saying:
        where storms are drawn from the process that is believed, or where nobody holds anything.
        """
        believed, storms = self.world.believed, self.scenarios
        if isinstance(believed, Scenarios):
            is_same = np.array_equal(believed.down, storms.down)
            return "the storms that come, in-sample" if is_same else f"{believed.n} other scenarios"
        return "" if believed is None or storms.seed is not None else "the case's own process"

    @property
    def dual_per_day(self) -> float | None:
        """The dual bound, $ per day; None where it was not asked for."""
        return None if self.dual is None else self.dual.mean(self.objective) / self.days

    @property
    def triviality(self) -> statistics.Triviality:
        """Whether the case tells methods apart at all."""
        likely = self.scenarios.probability
        rule, best = (
            statistics.expected(v, likely) for v in (self.objective[REFERENCE], self.bound)
        )
        return statistics.triviality([rule], [best])

    def frame(self) -> pd.DataFrame:
        """A row per method, the cheapest first; `columns.COLUMNS` says what the columns are."""
        return self._frame.copy()

    @cached_property
    def _frame(self) -> pd.DataFrame:
        import pandas as pd

        rows = [{"method": name, **row(self, name)} for name in self.objective]
        return pd.DataFrame(rows).set_index("method").sort_values("cost_per_day")

    def summary(self) -> dict[str, Any]:
        """The report as plain data; what is not defined is None."""
        likely = self.scenarios.probability
        lines = infrastructure(self.world)
        room = self.triviality.room_share
        summary = {
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
            "belief": self.belief,
            "reset_daily": self.world.reset_daily,
            "recourse": self.world.recourse,
            "warnings": list(self.warnings),
            "bound_per_day": statistics.expected(self.bound, likely) / self.days,
            "bound_seconds": self.bound_seconds,
            "comb_per_day": None if self.comb is None else self.comb / self.days,
            "dual_bound_per_day": self.dual_per_day,
            "triviality_percent": 100.0 * room,
            "trivial": self.triviality.trivial,
            "infrastructure": {
                "lambda_share": statistics.expected(lines.lambda_share, likely),
                "e_h": statistics.expected(lines.e_h, likely),
                "area_share": statistics.expected(lines.area_h, likely) / (24.0 * self.days),
            },
            "methods": self.frame().reset_index().to_dict(orient="records"),
            "differences": self.differences().to_dict(orient="records"),
            "value_of_stochastic_solution": self.value_of_stochastic_solution(),
        }
        if self.certificates is not None:
            summary["certificates"] = {k: asdict(v.worst()) for k, v in self.certificates.items()}
        return _clean(summary)

    def save(self, folder: str | Path) -> Path:
        """Writes the report, all or nothing; see `evaluation.saving` for the files.

        Raises:
            UsageError: the folder holds something that is no earlier report.
            FileError: the system refuses, as where a disk is full.
        """
        return save_report(self, self.frame(), self.summary(), Path(folder))


def _clean(value: Any) -> Any:
    """Plain data without numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_clean(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
