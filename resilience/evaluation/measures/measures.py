"""What is measured of one method's trajectory, episode by episode and day by day."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.case.critical import critical_loads
from resilience.case.schema import LoadTable
from resilience.evaluation.measures import metrics
from resilience.evaluation.measures.metrics import Adequacy, InterruptionIndices, Service
from resilience.evaluation.measures.trapezoid import Trapezoid, lines_up_ratio, trapezoid

if TYPE_CHECKING:
    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import World


@dataclass(frozen=True)
class Measures:
    """Measures of one method; arrays are (episodes,), of days (days, episodes).

    Attributes:
        objective: $, operating cost less what the energy left is worth.
        daily_cost: $, operating cost of every day.
        daily_shed_mwh: MWh not served on every day.
        service: what every episode had to go without.
        adequacy: its expectations.
        indices: interruptions by load.
        shape: the trapezoid of the load served.
        has_critical: whether any load counts as critical.
        trajectory: what was measured.
    """

    objective: Floats
    daily_cost: Floats
    daily_shed_mwh: Floats
    service: Service
    adequacy: Adequacy
    indices: InterruptionIndices
    shape: Trapezoid
    has_critical: bool
    trajectory: Trajectory = field(repr=False)

    @cached_property
    def worst_day(self) -> tuple[float, int, int]:
        """Operating cost in $ of the dearest day of any episode, its day and its episode."""
        day, episode = np.unravel_index(np.argmax(self.daily_cost), self.daily_cost.shape)
        return float(self.daily_cost[day, episode]), int(day), int(episode)


def measure(world: World, trajectory: Trajectory, demand_mw: Floats) -> Measures:
    """What can be measured of a trajectory.

    Args:
        world: where it happened.
        trajectory: what happened.
        demand_mw: `demand` of the world.
    """
    case = world.microgrid.case
    # The recourse sheds to within rounding of 0 and of the demand.
    shed = np.clip(trajectory.shed, 0.0, demand_mw)
    critical = critical_loads(case)
    priority = np.array([load.priority for load in case.tables_of(LoadTable)])
    weights = {"critical": critical, "priority": priority}
    likely = world.scenarios.probability
    first = np.flatnonzero(np.diff(world.day, prepend=world.day[0] - 1))
    return Measures(
        objective=trajectory.objective(world.end_value_per_mwh),
        daily_cost=np.add.reduceat(trajectory.cost, first, axis=0),
        daily_shed_mwh=np.add.reduceat(shed.sum(0), first, axis=0) * case.step_h,
        service=metrics.service(demand_mw, shed, case.step_h, **weights),
        adequacy=metrics.adequacy(demand_mw, shed, case.step_h, probability=likely, **weights),
        indices=metrics.interruption_indices(demand_mw, shed, case.step_h),
        shape=trapezoid(metrics.served_ratio(demand_mw, shed), case.step_h),
        has_critical=bool(critical.any()),
        trajectory=trajectory,
    )


def infrastructure(world: World) -> Trapezoid:
    """The trapezoid of the lines that are up, of those in service without a storm."""
    network = world.microgrid.case.network
    up = world.line_up[: len(network.line_names)][network.in_service]
    return trapezoid(lines_up_ratio(up), world.microgrid.case.step_h)
