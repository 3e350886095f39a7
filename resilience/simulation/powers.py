"""What every device fed in along a trajectory, whatever kinds of devices there are."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.components import DeviceFleet, in_roles
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World


def powers(world: World, trajectory: Trajectory) -> dict[str, Floats]:
    """(devices, slots, scenarios) MW fed in, for every kind of device; loads are negative.

    Raises:
        UsageError: a kind of which the simulation tells too little.
    """
    power = {}
    for kind, fleet in world.microgrid.fleets.items():
        if fleet.role == "storage":
            power[kind] = trajectory.storage
        elif fleet.role == "load":
            power[kind] = trajectory.flow(fleet.shed) - expected_power(world, fleet, -1.0)
            if len(fleet.cold):
                power[kind][fleet.cold] -= trajectory.flow(fleet.surplus)
        else:
            power[kind] = fleet.power(trajectory.flow)
        if len(power[kind]) != len(fleet.tables):
            raise UsageError(
                f"a simulation tells the power of {len(power[kind])} of {len(fleet.tables)} "
                f"[[{kind}]]",
                hint=f"{', '.join(fleet.flows)} have to be variables that feed a bus",
            )
    return power


def demand(world: World) -> Floats:
    """(loads, slots, scenarios) MW that all loads ask for."""
    case = world.microgrid.case
    loads = in_roles(world.microgrid.fleets.values(), "load")
    nothing = np.empty((0, case.slots, world.scenarios.n))
    return np.concatenate([nothing, *(expected_power(world, fleet, -1.0) for fleet in loads)])


def expected_power(world: World, fleet: DeviceFleet, sign: float) -> Floats:
    """(devices, slots, scenarios) `sign` times what a fleet's profiles make of it, MW."""
    every = np.arange(world.microgrid.case.slots)
    rows = [sign * size_mw * world.profile(profile, every) for profile, size_mw in fleet.expected()]
    return np.array(rows).reshape(len(rows), len(every), world.scenarios.n)
