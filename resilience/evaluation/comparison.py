"""What of a comparison can be drawn, whether it was just run or is read from a folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectories

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
        UsageError: the folder holds no comparison, or none with its case and trajectories.
    """
    import pandas as pd

    from resilience.case import load_case
    from resilience.fragility.outages.files import load_scenarios

    root = Path(folder)
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
    summary = json.loads((root / "summary.json").read_text(encoding="utf-8"))
    episodes = pd.read_parquet(root / "episodes.parquet")
    costs = {str(name): np.asarray(episodes[name], float) for name in episodes.columns}
    return Comparison(
        case=case,
        scenarios=load_scenarios(root / "scenarios.npz", case),
        trajectories={name: trajectories[name] for name in costs if name in trajectories},
        bound=costs.pop("bound"),
        objective=costs,
        end_value_per_mwh=summary["end_value_per_mwh"],
        forecast_error=summary.get("forecast_error", "none"),
    )
