"""What of a comparison can be drawn, whether it was just run or is read from a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import CertificateError, UsageError
from resilience.files import reading
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.case_program import case_cost_scale
from resilience.models.program import gate
from resilience.models.program.gate import of_file
from resilience.results import steady
from resilience.simulation.audit import check_trajectory
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectories
from resilience.simulation.world import World, microgrid_with_fallible_lines

if TYPE_CHECKING:
    from resilience.case import Case


BOUND = "clairvoyant"
"""What the bound is called among the methods."""


class Compared(Protocol):
    """What of a comparison is drawn; `Report` and `Comparison` have it."""

    @property
    def case(self) -> Case:
        """The case, over the days of an episode."""

    @property
    def scenarios(self) -> Scenarios:
        """The storms: an episode is one scenario."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """What each method did."""

    @property
    def objective(self) -> Mapping[str, Floats]:
        """Cost of every episode less the worth of the energy left, $."""

    @property
    def bound(self) -> Floats:
        """The least that any method can reach in every episode, $."""

    @property
    def end_value_per_mwh(self) -> float:
        """Worth of the energy left."""


@dataclass(frozen=True)
class Comparison:
    """A comparison that was read from a folder, as far as it is drawn.

    Attributes:
        case: the case, over the days of an episode.
        scenarios: the storms: an episode is one scenario.
        trajectories: method to what it did; the clairvoyant is among them.
        objective: method to (episodes,) $: cost less the worth of the energy left.
        bound: (episodes,) $ that no method can stay below.
        end_value_per_mwh: worth of the energy left, $/MWh.
        forecast_error: how load and PV differ from their forecast, in words.
    """

    case: Case
    scenarios: Scenarios
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    objective: Mapping[str, Floats]
    bound: Floats
    end_value_per_mwh: float
    forecast_error: str = "none"


def check_bound(
    objective: Mapping[str, Floats], bound: Floats, scale: float, numbers: Ints | None = None
) -> None:
    """Refuses methods that cost less than what is proven to be the least.

    Args:
        objective: method to (episodes,) $; the clairvoyant is among them.
        bound: (episodes,) $.
        scale: what rounding is relative to, $, see `gate.cost_scale`.
        numbers: (episodes,) what they are called; 0, 1, ... if omitted.

    Raises:
        CertificateError: one does, or a number is none; method, episode, cost and bound are named.
    """
    for name, costs in objective.items():
        room = gate.rounding(costs, scale)
        wrong = np.flatnonzero(~(np.isfinite(costs) & (bound - costs <= room)))
        if len(wrong):
            k = int(wrong[0])
            episode = k if numbers is None else int(numbers[k])
            raise CertificateError(
                f"{name} costs {costs[k]:.9g} $ in episode {episode}, where {bound[k]:.9g} $ are "
                f"proven to be the least: {gate.FAULT}",
                hint=gate.HINT,
            )


def day_spans(case: Case) -> list[slice]:
    """The slots of every day of the horizon, midnight to midnight."""
    dates = [case.window.time(t).date() for t in range(case.slots)]
    first = [t for t, date in enumerate(dates) if t == 0 or date != dates[t - 1]]
    return [slice(a, b) for a, b in zip(first, [*first[1:], case.slots], strict=True)]


def is_comparison(folder: Path) -> bool:
    """Whether a folder holds what `Report.save` writes."""
    return (folder / "episodes.parquet").is_file()


def load_comparison(folder: str | Path) -> Comparison:
    """Reads what `Report.save` wrote, as far as it is drawn.

    Raises:
        UsageError: the folder holds no comparison, a damaged one, or none with its case and
            trajectories.
        CertificateError: its costs, bound and trajectories contradict each other.
    """
    root = Path(folder)
    with steady(root):
        return _load_comparison(root)


def _load_comparison(root: Path) -> Comparison:
    import pandas as pd

    from resilience.case import load_case
    from resilience.fragility.outages.files import load_scenarios

    if not is_comparison(root):
        raise UsageError(
            f"{root} holds no comparison: there is no episodes.parquet in it",
            hint="name the folder given to `resilience compare --out`",
        )
    trajectories = load_trajectories(root)
    if not trajectories or not (root / "case.toml").is_file():
        raise UsageError(
            f"{root} holds a comparison without its case or its trajectories",
            hint="run `resilience compare --out` again",
        )
    case = load_case(root / "case.toml")
    scenarios = load_scenarios(root / "scenarios.npz", case)
    with reading(root, "comparison"):
        summary = json.loads((root / "summary.json").read_text(encoding="utf-8"))
        episodes = pd.read_parquet(root / "episodes.parquet")
        costs = {str(name): np.asarray(episodes[name], float) for name in episodes.columns}
        if odd := trajectories.keys() ^ (costs.keys() - {"bound"}):
            raise ValueError(f"{', '.join(sorted(odd))} in one of its costs and its trajectories")
        comparison = Comparison(
            case=case,
            scenarios=scenarios,
            bound=costs.pop("bound"),
            trajectories={name: trajectories[name] for name in costs},
            objective=costs,
            end_value_per_mwh=float(summary["end_value_per_mwh"]),
            forecast_error=summary.get("forecast_error", "none"),
        )
        with of_file(root):
            _check(comparison, summary)
    return comparison


def _check(comparison: Comparison, summary: Mapping[str, Any]) -> None:
    """Holds costs, bound and trajectories of a folder against each other, and against the case
    where all that happened follows from it: forecast errors are not kept.

    Raises:
        CertificateError: they contradict each other.
    """
    scale = case_cost_scale(comparison.case)
    check_bound(comparison.objective, comparison.bound, scale)
    for name, trajectory in comparison.trajectories.items():
        for stated, spent in zip(
            comparison.objective[name],
            trajectory.objective(comparison.end_value_per_mwh),
            strict=True,
        ):
            gate.check_costs(float(stated), {f"trajectory of {name}": float(spent)}, scale)
    if comparison.forecast_error == "none":
        world = World.build(
            microgrid_with_fallible_lines(
                comparison.case, comparison.scenarios, summary["physics"]
            ),
            comparison.scenarios,
            end_value_per_mwh=comparison.end_value_per_mwh,
            reset_daily=bool(summary["reset_daily"]),
        )
        for trajectory in comparison.trajectories.values():
            check_trajectory(world, trajectory)
