"""What is measured of a contender, each figure with its interval, as plain data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.measures.intervals import MeanInterval, mean_interval
from resilience.evaluation.measures.statistics import gap_values
from resilience.evaluation.paired import bound_by_day, cost_by_day, varies_days
from resilience.evaluation.report import Report
from resilience.rl.reproduce.published import Published

STATISTICS = {
    "average": "operating cost of a day, $",
    "highest": "that of the dearest day of an episode, $",
    "lowest": "that of the cheapest day of an episode, $",
    "shed_mwh": "energy not served on a day, MWh",
    "shed_mw_slots": "the same as the paper adds it up: MW over the slots of a day",
    "net": "operating cost of a day less the worth of the energy left, $",
    "gap_percent": "the same above the bound of the economic recourse, %",
    "over_rule": "the same above rule 0.9 on the same storms, $",
}
"""Figure to meaning; all are means over episodes and trainings."""
IN_THE_PAPER: Mapping[str, Callable[[Published], float | None]] = {
    "average": lambda paper: paper.average,
    "highest": lambda paper: paper.highest,
    "lowest": lambda paper: paper.lowest,
    "shed_mw_slots": lambda paper: paper.shed_mw,
}
"""Figure to what the paper prints of it."""


@dataclass(frozen=True)
class Figures:
    """A row of a table.

    Attributes:
        label: whose.
        runs: trainings, or 1.
        statistics: by name, see `STATISTICS`.
        training_cpu_s: of one training, or before the first decision, mean.
        decision_ms: of the processor per decision of one episode.
        power_flow_ms: the same of AC power flow per slot.
        outside_percent: share of the slots in which it finds a limit exceeded.
        v_min_pu: lowest voltage that it finds.
        paper: what the paper prints.
    """

    label: str
    runs: int
    statistics: Mapping[str, MeanInterval]
    training_cpu_s: float
    decision_ms: float
    power_flow_ms: float
    outside_percent: float
    v_min_pu: float
    paper: Published | None = None

    def plain(self) -> dict[str, Any]:
        """As plain data for JSON; what is not defined is None."""
        return _finite(asdict(self))

    @classmethod
    def of_plain(cls, data: Mapping[str, Any]) -> Figures:
        """From what `plain` gave."""
        values: dict[str, Any] = _numbers(data)
        paper = data["paper"]
        values["paper"] = None if paper is None else Published(**paper)
        values["statistics"] = {
            name: MeanInterval(**entry) for name, entry in values["statistics"].items()
        }
        return cls(**values)

    def published(self, name: str) -> float | None:
        """What the paper prints of a figure; None: nothing."""
        if self.paper is None or name not in IN_THE_PAPER:
            return None
        return IN_THE_PAPER[name](self.paper)


def figures(
    report: Report,
    label: str,
    names: Sequence[str],
    training_cpu_s: float | None = None,
    paper: Published | None = None,
) -> Figures:
    """A row from a comparison with AC power flow.

    Args:
        report: the comparison.
        label: of the row.
        names: of its methods there, one per training.
        training_cpu_s: of one training; None: what making the dispatcher took.
        paper: what the paper prints.
    """
    assert report.certificates is not None
    values = [episode_values(report, name) for name in names]
    trajectories = [report.trajectories[name] for name in names]
    checks = [report.certificates[name] for name in names]
    likely = report.scenarios.probability
    decisions = trajectories[0].cost.size
    built = [trajectory.build_cpu_seconds for trajectory in trajectories]
    return Figures(
        label=label,
        runs=len(names),
        statistics={
            name: mean_interval(np.array([value[name] for value in values]), likely)
            for name in STATISTICS
        },
        training_cpu_s=float(np.mean(built)) if training_cpu_s is None else training_cpu_s,
        decision_ms=1e3 * float(np.mean([t.cpu_seconds for t in trajectories])) / decisions,
        power_flow_ms=1e3 * float(np.mean([c.cpu_seconds for c in checks])) / decisions,
        outside_percent=100.0 * float(np.mean([c.outside_share(likely) for c in checks])),
        v_min_pu=min(check.lowest_pu for check in checks),
        paper=paper,
    )


def episode_values(report: Report, name: str) -> dict[str, Floats]:
    """Every figure of a method, (episodes, days); (episodes, 1) of extremes, and where days are not
    varied, see `varies_days`.
    """
    measures, step_h = report.measures[name], report.case.step_h
    cost, shed_mwh = measures.daily_cost.T, measures.daily_shed_mwh.T
    net, rule = (cost_by_day(report, key) for key in (name, REFERENCE))
    bound, scale = bound_by_day(report), net.shape[1] / report.days

    def varied(by_day: Floats) -> Floats:
        return by_day if varies_days(report) else by_day.mean(1, keepdims=True)

    gap = gap_values(varied(net), varied(bound), report.scenarios.probability)
    return {
        "average": varied(cost),
        "highest": cost.max(1, keepdims=True),
        "lowest": cost.min(1, keepdims=True),
        "shed_mwh": varied(shed_mwh),
        "shed_mw_slots": varied(shed_mwh / step_h),
        "net": scale * varied(net),
        "gap_percent": 100.0 * gap,
        "over_rule": scale * varied(net - rule),
    }


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _numbers(value: Any) -> Any:
    """The same with NaN for None."""
    if isinstance(value, Mapping):
        return {key: _numbers(item) for key, item in value.items()}
    return math.nan if value is None else value
