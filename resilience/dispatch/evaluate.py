"""`compare`: every dispatcher on the same storms, measured against the clairvoyant bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.case import Case, load_case
from resilience.dispatch import statistics
from resilience.dispatch.base import Dispatcher, Trajectory, World, simulate
from resilience.dispatch.metrics import Adequacy, adequacy
from resilience.dispatch.mpc import MPC, Replay, clairvoyant
from resilience.dispatch.rules import Greedy, Idle, Rule
from resilience.dispatch.stochastic import Stochastic
from resilience.errors import UsageError
from resilience.fragility.bell import Bell, case_bell
from resilience.fragility.outages import sample_bell
from resilience.fragility.scenarios import Scenarios
from resilience.models.algebra import Floats
from resilience.models.microgrid import microgrid
from resilience.progress import phase

if TYPE_CHECKING:
    import pandas as pd

TEST_SHARE = 0.25  # of the days of the profiles, the last ones: nothing is tuned on them
REFERENCE = "rule-0.9"  # always reported: a battery kept full is the method to beat

DISPATCHERS: dict[str, Callable[[World, float], Dispatcher]] = {
    "idle": lambda world, _: Idle(world),
    "greedy": lambda world, _: Greedy(world),
    "rule": lambda world, _: Rule(world, 0.5),
    REFERENCE: lambda world, _: Rule(world, 0.9),
    "mpc-blind": lambda world, _: MPC(world),
    "mpc": lambda world, value: MPC(world, value_per_mwh=value, name="mpc"),
    "stochastic": lambda world, value: Stochastic(world, belief(world), value_per_mwh=value),
}
"""Each dispatcher by name, made from the world and the worth of stored energy in $/MWh."""


def belief(world: World) -> Bell:
    """The outage process of the case, which is all that a dispatcher knows of storms to come."""
    return case_bell(world.grid.case)


@dataclass(frozen=True)
class Report:
    """Every dispatcher on the same episodes; an episode is one scenario over all days.

    Attributes:
        objective: method to (episodes,) $: cost less the worth of the energy left at the end.
        bound: (episodes,) $: the clairvoyant optimum, which no dispatcher can beat.
        trajectories: method to what it did.
        adequacy: method to its reliability indices.
        seconds: method to CPU seconds for all of its decisions.
    """

    case: Case
    scenarios: Scenarios
    end_value_per_mwh: float
    objective: Mapping[str, Floats]
    bound: Floats
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    adequacy: Mapping[str, Adequacy] = field(repr=False)
    seconds: Mapping[str, float]
    bound_seconds: float

    @property
    def triviality(self) -> statistics.Triviality:
        """Whether the case tells methods apart at all."""
        return statistics.triviality(self.objective[REFERENCE], self.bound)

    def frame(self, seed: int = 0) -> pd.DataFrame:
        """A row per method: cost per day, gap, score, their intervals, shedding, worst, time."""
        import pandas as pd

        days = self.case.slots * self.case.step_h / 24.0
        rows = [self._row(name, days, seed) for name in self.objective]
        return pd.DataFrame(rows).set_index("method").sort_values("cost_per_day")

    def _row(self, name: str, days: float, seed: int) -> dict[str, Any]:
        cost, rule = self.objective[name], self.objective[REFERENCE]
        score = statistics.score(cost, rule, self.bound)
        found: dict[str, Any] = {
            "method": name,
            "cost_per_day": cost.mean() / days,
            "gap_percent": 100.0 * statistics.gap_to_bound(cost, self.bound).mean(),
            "score": score.mean(),
            "cvar95_per_day": statistics.conditional_value_at_risk(cost, 0.95) / days,
            "worst_per_day": cost.max() / days,
            "shed_mwh_per_day": self.trajectories[name].shed_mwh.mean() / days,
            "lolp": self.adequacy[name].lolp_slots,
            "ms_per_decision": 1e3 * self.seconds[name] / (self.case.slots * len(cost)),
        }
        if len(cost) > 1 and name != REFERENCE:
            rng = np.random.default_rng(seed)
            more = statistics.paired_difference(cost / days, rule / days, rng)
            found |= {"over_rule_low": more.low, "over_rule_high": more.high}
        return found

    def save(self, folder: str | Path) -> Path:
        """Writes report.parquet, report.csv, episodes.parquet and summary.json, all or nothing."""
        import json

        import pandas as pd

        from resilience.results import replacing

        with replacing(Path(folder), "summary.json") as target:
            self.frame().to_parquet(target / "report.parquet")
            self.frame().to_csv(target / "report.csv")
            episodes = pd.DataFrame({**self.objective, "bound": self.bound})
            episodes.to_parquet(target / "episodes.parquet")
            text = json.dumps(self.summary(), indent=2, allow_nan=False)
            (target / "summary.json").write_text(text + "\n", encoding="utf-8")
            self.scenarios.save(target / "scenarios.npz")
        return Path(folder)

    def summary(self) -> dict[str, Any]:
        """The report as plain data; what is not defined is None."""
        rows = self.frame().reset_index().to_dict(orient="records")
        clean = [{k: None if _missing(v) else v for k, v in row.items()} for row in rows]
        room = self.triviality.room_share
        return {
            "case": self.case.name,
            "start": self.case.start.isoformat(),
            "slots": self.case.slots,
            "episodes": self.scenarios.n,
            "seed": self.scenarios.seed,
            "process": self.scenarios.process,
            "end_value_per_mwh": self.end_value_per_mwh,
            "bound_per_day": float(self.bound.mean() / (self.case.slots * self.case.step_h / 24)),
            "bound_seconds": self.bound_seconds,
            "triviality_percent": None if _missing(room) else 100.0 * room,
            "methods": clean,
        }


def _missing(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def compare(
    case: Case | str | Path,
    methods: Sequence[str] = ("rule", "mpc-blind", "mpc"),
    *,
    days: int = 16,
    draws: int = 8,
    seed: int = 0,
    end_value_per_mwh: float | None = None,
    scenarios: Scenarios | None = None,
) -> Report:
    """Runs dispatchers over the test days, every one of them on the same outage draws.

    State of charge is carried over the days; energy left at the end is worth the same to all.

    Args:
        case: a case, its file, or the name of an installed one.
        methods: names from `DISPATCHERS`; rule 0.9 is always added.
        days: days of an episode, the last ones of the profiles.
        draws: how many outage paths; every one is an episode.
        seed: of the outage paths.
        end_value_per_mwh: worth of energy left, $/MWh; the case's terminal value if omitted.
        scenarios: outage paths to use in place of draws; `days` must be theirs.

    Raises:
        UsageError: an unknown method, or more days than the profiles keep for tests.
    """
    unknown = [name for name in methods if name not in DISPATCHERS]
    if unknown:
        raise UsageError(
            f"dispatcher {unknown[0]!r} is unknown; allowed: {', '.join(DISPATCHERS)}",
            hint="`clairvoyant` is the bound and always there",
        )
    case = held_out(case if isinstance(case, Case) else load_case(case), days)
    scenarios = scenarios or sample_bell(case, case_bell(case), draws, seed)
    world = World.of(microgrid(case, "copperplate"), scenarios)
    value = case.terminal_value_per_mwh if end_value_per_mwh is None else end_value_per_mwh
    began = time.perf_counter()
    with phase("clairvoyant bound"):
        bound = clairvoyant(world, value)
    spent = time.perf_counter() - began
    runs: dict[str, Trajectory] = {}
    for name in dict.fromkeys([*methods, REFERENCE]):
        with phase("dispatch", name):
            runs[name] = simulate(world, DISPATCHERS[name](world, case.terminal_value_per_mwh))
    runs["clairvoyant"] = simulate(world, Replay("clairvoyant", bound.charging))
    return Report(
        case=case,
        scenarios=scenarios,
        end_value_per_mwh=value,
        objective={name: run.objective(value) for name, run in runs.items()},
        bound=bound.objective,
        trajectories=runs,
        adequacy={name: _adequacy(world, run) for name, run in runs.items()},
        seconds={name: run.seconds for name, run in runs.items()},
        bound_seconds=spent,
    )


def _adequacy(world: World, run: Trajectory) -> Adequacy:
    case, n = world.grid.case, world.scenarios.n
    demand = np.array([t.p_max_mw * case.profile(t.profile) for t in case.load])
    shape = (*demand.shape, n)
    full = np.broadcast_to(demand[:, :, None], shape)
    return adequacy(
        full, run.flow("load.shed"), case.step_h, probability=world.scenarios.probability
    )


def held_out(case: Case, days: int) -> Case:
    """The case over the last `days` days of its profiles, which nothing is tuned on.

    Raises:
        UsageError: more days than the last quarter of the profiles has; a case without a profile
            file keeps its own horizon and must have as many days.
    """
    file = case.source.get("profiles", {}).get("file")
    per_day = round(24 * 60 / case.step_min)
    if file is None:
        if case.slots != days * per_day:
            raise UsageError(
                f"case {case.name!r} has {case.slots / per_day:g} days and no profile file; "
                f"allowed: --days {case.slots // per_day}",
                hint="name a profile file in [profiles] to evaluate on more days",
            )
        return case
    from resilience.case.profiles import read_profile_file

    times = read_profile_file(Path(file)).times
    whole = len(times) // per_day
    most = math.ceil(TEST_SHARE * whole)
    if not 0 < days <= most:
        raise UsageError(
            f"{days} days; allowed: 1 to {most}, the last quarter of the {whole} in the profiles",
            hint="the days before are for tuning and training",
        )
    first: datetime = times[(whole - days) * per_day].astype("datetime64[s]").item()
    return case.replace(start=first, slots=days * per_day, outages=())
