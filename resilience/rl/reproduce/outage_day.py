"""What storage does on a day with an outage: the proposed method, hour by hour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from resilience.case import Case
from resilience.evaluation.compare import evaluate
from resilience.evaluation.comparison import day_spans
from resilience.models.components import in_roles
from resilience.parts import load_part, save_part
from resilience.progress import phase
from resilience.rl.reproduce.experiments import METHODS, PROPOSED, Effort
from resilience.rl.reproduce.outcomes import (
    FIGURES_FOLDER,
    entrant,
    experiment_digest,
    world,
)
from resilience.simulation.powers import demand, powers
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World


@dataclass(frozen=True)
class OutageDay:
    """The day of the first storm on which lines are out for longest.

    Attributes:
        folder: name of that of the comparison, for `resilience plot`.
        label: whose day it is, a method there.
        day: number from 1.
        hours: an entry per hour: `time`, `lines_out` (the most in a slot of it), the means
            `load_mw`, `pv_mw`, `storage_mw` (discharging positive) and `shed_mw`, and `soc`, the
            share of all capacity stored when it ends.
    """

    folder: str
    label: str
    day: int
    hours: tuple[Mapping[str, Any], ...]


def outage_day(case: Case, scale: Effort, folder: Path) -> OutageDay:
    """The day, simulated or read.

    Args:
        case: the case.
        scale: how much is spent.
        folder: where trainings and figures are.
    """
    contender = entrant(case, PROPOSED, METHODS, replace(scale, seeds=1), folder)
    digest = experiment_digest(case, METHODS, scale, [contender])
    name, target = f"storm-{digest}", folder / FIGURES_FOLDER / f"storm-{digest}.json"
    if (stored := load_part(target)) is not None:
        return OutageDay(**{**stored, "hours": tuple(stored["hours"])})
    first_storm = world(case, METHODS, scale, episodes=1)
    makers = {PROPOSED.label: next(iter(contender.factories.values()))}
    with phase("day with an outage"):
        report = evaluate(first_storm, makers, out=folder / name)
    down = first_storm.scenarios.down[:, :, 0]
    spans = day_spans(report.case)
    worst = int(np.argmax([down[:, span].sum() for span in spans]))
    hours = _hours(first_storm, report.trajectories[PROPOSED.label], spans[worst])
    result = OutageDay(name, PROPOSED.label, worst + 1, hours)
    save_part(target, asdict(result))
    return result


def _hours(world: World, trajectory: Trajectory, span: slice) -> tuple[dict[str, Any], ...]:
    """The hours of a span of the only scenario; a slot that is longer counts as one."""
    case = world.microgrid.case
    weather = in_roles(world.microgrid.fleets.values(), "weather")
    power = powers(world, trajectory)
    capacity = sum(unit.e_mwh for unit in case.ess)
    means = {
        "load_mw": demand(world)[:, :, 0].sum(0),
        "pv_mw": sum((power[f.kind][:, :, 0].sum(0) for f in weather), np.zeros(case.slots)),
        "storage_mw": trajectory.storage[:, :, 0].sum(0),
        "shed_mw": trajectory.shed[:, :, 0].sum(0),
    }
    out = world.scenarios.down[:, :, 0].sum(0)
    stored = trajectory.energy[:, :, 0].sum(0)
    per_hour = max(round(1.0 / case.step_h), 1)
    hours = []
    for first in range(span.start, span.stop, per_hour):
        slots = slice(first, min(first + per_hour, span.stop))
        hours.append(
            {
                "time": f"{case.window.time(first):%H:%M}",
                "lines_out": int(out[slots].max()),
                **{name: float(values[slots].mean()) for name, values in means.items()},
                "soc": float(stored[slots.stop] / capacity),
            }
        )
    return tuple(hours)
