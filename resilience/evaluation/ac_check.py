"""Could the wires have carried it? AC power flow of every slot of every scenario of a trajectory.

The powers are taken as they were dispatched. In every island the largest unit that forms
then gives what they left over: losses, which copperplate dispatch does not know, and all reactive
power. What it gives beyond its own limits is excess. Members without a solution are counted, and
nothing is read from them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.ac_check import Carried, carry, reactive_alone
from resilience.models.components import device_fleets
from resilience.simulation.powers import powers
from resilience.tolerances import AC_LIMIT_TOLERANCE

if TYPE_CHECKING:
    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import World

MEMBERS = 16_384  # power flows at once: some ten MB each array for a feeder of a hundred buses


@dataclass(frozen=True)
class WorstMember:
    """Where a trajectory is worst.

    Attributes:
        value: in the unit of what is worst, pu, MVA or MW.
        episode: number of the scenario.
        slot: of the horizon.
    """

    value: float
    episode: int
    slot: int


@dataclass(frozen=True)
class WorstValues:
    """The worst values of a trajectory; None where there is no such value.

    Attributes:
        undervoltage_pu: lowest voltage of a live bus, pu.
        overvoltage_pu: highest, pu.
        overload_mva: largest flow beyond a line's rating, MVA.
        root_excess_mw: most that forming units give or take beyond their ranges, MW.
        not_converged: number of slots, over all episodes, without a solution.
    """

    undervoltage_pu: WorstMember | None
    overvoltage_pu: WorstMember | None
    overload_mva: WorstMember | None
    root_excess_mw: WorstMember | None
    not_converged: int


@dataclass(frozen=True)
class TrajectoryACCheck:
    """What AC power flow says of a trajectory; arrays are (slots, scenarios).

    Attributes:
        members: what it says of every member, arrays (slots * scenarios,) slot by slot.
        slots, scenarios: their numbers.
        spill_mw: power that the dispatch had to take and could not use.
        planned_mw: losses that the dispatch reckoned with, 0 at copperplate.
        rated: whether any line has a rating.
        step_h: hours of a slot.
        cpu_seconds: of the processor for all power flows.
    """

    members: Carried = field(repr=False)
    slots: int
    scenarios: int
    planned_mw: Floats = field(repr=False)
    rated: bool
    step_h: float
    cpu_seconds: float = field(default=0.0, compare=False)

    def values(self, name: str) -> np.ndarray:
        """(slots, scenarios) one field of `Carried`."""
        array: np.ndarray = getattr(self.members, name)
        return array.reshape(self.slots, self.scenarios)

    @property
    def converged(self) -> Bools:
        """Members with a solution."""
        return self.values("converged")

    @property
    def outside(self) -> Bools:
        """Members in which a voltage, a rating, an angle or a forming unit's range is exceeded."""
        names = ("v_excess_pu", "overload_mva", "angle_excess_degree", "root_excess_mw")
        return np.any([self.values(name) > AC_LIMIT_TOLERANCE for name in names], axis=0)

    @property
    def lowest_pu(self) -> float:
        """Lowest voltage of all; NaN where nothing converged."""
        return _extreme(self.values("v_min_pu"), np.nanmin)

    @property
    def highest_pu(self) -> float:
        """Highest voltage of all; NaN where nothing converged."""
        return _extreme(self.values("v_max_pu"), np.nanmax)

    @property
    def worst_overload_mva(self) -> float:
        """Greatest excess over a rating; NaN without ratings."""
        return _extreme(self.values("overload_mva"), np.nanmax) if self.rated else float("nan")

    @property
    def worst_root_excess_mw(self) -> float:
        """Greatest power that one forming unit lacks to carry its island."""
        return _extreme(self.values("root_worst_mw"), np.nanmax)

    def outside_share(self, likely: Floats) -> float:
        """Expected share of the solved slots in which a limit is exceeded."""
        solved = self.converged.sum(0) @ likely
        return float(self.outside.sum(0) @ likely / solved) if solved else float("nan")

    def not_converged_share(self, likely: Floats) -> float:
        """Expected share of the slots without a solution."""
        return float((~self.converged).mean(0) @ likely)

    def loss_mwh(self, likely: Floats) -> float:
        """Expected losses of an episode."""
        return self._energy(self.values("loss_mw"), likely)

    def unfunded_mwh(self, likely: Floats) -> float:
        """Expected losses that the dispatch did not reckon with: the forming units gave them."""
        return self._energy(self.values("loss_mw") - self.planned_mw, likely)

    def excess_mwh(self, likely: Floats) -> float:
        """Expected energy that forming units give or take beyond their ranges."""
        return self._energy(self.values("root_excess_mw"), likely)

    def _energy(self, power_mw: Floats, likely: Floats) -> float:
        return float(np.nansum(power_mw, axis=0) @ likely) * self.step_h

    def worst(self) -> WorstValues:
        """Where the trajectory is worst."""
        overload = self.values("overload_mva")
        return WorstValues(
            undervoltage_pu=_member(self.values("v_min_pu"), np.nanargmin),
            overvoltage_pu=_member(self.values("v_max_pu"), np.nanargmax),
            overload_mva=_member(overload, np.nanargmax) if self.rated else None,
            root_excess_mw=_member(self.values("root_worst_mw"), np.nanargmax),
            not_converged=int((~self.converged).sum()),
        )


def ac_check_trajectory(world: World, trajectory: Trajectory) -> TrajectoryACCheck:
    """AC power flow of all slots and scenarios, in batch.

    Args:
        world: where it happened.
        trajectory: what happened.
    """
    began = time.process_time()
    case, n = world.microgrid.case, world.scenarios.n
    fleets = world.microgrid.fleets
    power = {
        name: rows
        for kind, values in powers(world, trajectory).items()
        for name, rows in zip(fleets[kind].names, values, strict=True)
    }
    total = sum(power.values(), np.zeros((case.slots, n)))
    spill = np.zeros_like(total) if trajectory.spill is None else trajectory.spill
    closed, running = _closed(world, trajectory), _running(world, trajectory)
    alone = reactive_alone(case, device_fleets(case).values())
    size = max(MEMBERS // max(n, 1), 1)
    parts = []
    for first in range(0, case.slots, size):
        slots = slice(first, first + size)
        some = {name: values[slots].ravel() for name, values in power.items()}
        shut = closed[:, slots].reshape(len(closed), -1)
        runs = {name: on[slots].ravel() for name, on in running.items()}
        energy = trajectory.energy[:, :-1][:, slots].reshape(len(trajectory.energy), -1)
        parts.append(carry(case, some, shut, energy, np.repeat(alone[:, slots], n, axis=1), runs))
    arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in vars(parts[0])}
    return TrajectoryACCheck(
        members=Carried(**arrays),
        slots=case.slots,
        scenarios=n,
        planned_mw=total - spill,
        rated=bool(np.isfinite(case.network.rating_mva).any()),
        step_h=case.step_h,
        cpu_seconds=time.process_time() - began,
    )


def _running(world: World, trajectory: Trajectory) -> dict[str, Floats]:
    """By name, (slots, scenarios) 1 where a unit with commitment runs, and where it is in order."""
    case = world.microgrid.case
    running = {
        name: trajectory.decided("generator.on")[k]
        for k, name in enumerate(trajectory.names_decided("generator.on"))
    }
    in_order = world.line_up[len(case.network.line_names) :]
    for name, up in zip(case.fallible_units, in_order, strict=True):
        running[name] = running.get(name, 1.0) * up
    return running


def _closed(world: World, trajectory: Trajectory) -> Bools:
    """(lines of the case, slots, scenarios) where a line carries power."""
    network = world.microgrid.case.network
    closed = world.line_up[: len(network.line_names)] & network.in_service[:, None, None]
    switched = [network.line(name) for name in trajectory.names_decided("line.closed")]
    closed[switched] = trajectory.decided("line.closed") > 0.5
    return closed


def _extreme(values: Floats, choose: Callable[[Floats], Any]) -> float:
    return float(choose(values)) if np.isfinite(values).any() else float("nan")


def _member(values: Floats, choose: Callable[[Floats], Any]) -> WorstMember | None:
    if not np.isfinite(values).any():
        return None
    slot, episode = np.unravel_index(int(choose(values)), values.shape)
    return WorstMember(float(values[slot, episode]), int(episode), int(slot))
