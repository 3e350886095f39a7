"""Rules that need no optimiser: idle, self-consumption, and holding a state of charge."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.components import in_roles
from resilience.simulation.observation import Observation
from resilience.simulation.world import World


class Idle:
    """Never moves the storage."""

    def __init__(self, world: World) -> None:
        self.name = "idle"

    def act(self, observation: Observation) -> Floats:
        """Nothing."""
        return np.zeros_like(observation.energy)


class Greedy:
    """Serves what PV leaves of the demand of its island, and stores what PV has over.

    Units of an island share in proportion to what each can give or take.

    Args:
        world: where it acts.
        generators_first: storage gives only what the generators of its island cannot (the order of
            the paper's eqs. 20-21), which keeps it for later.
    """

    def __init__(self, world: World, generators_first: bool = False) -> None:
        self.name, self.world, self.generators_first = "greedy", world, generators_first

    def act(self, observation: Observation) -> Floats:
        """Discharge by the net demand of the island, charge by its surplus."""
        world, simulator = self.world, self.world.simulator
        now = world.slot(observation.t, observation.energy)
        low, high = simulator.limits(observation.energy, now.stacked)
        fleets = world.microgrid.fleets.values()
        net = np.zeros(observation.island.shape)
        for fleet in in_roles(fleets, "load"):
            np.add.at(net, fleet.bus, now.data[fleet.demand] - now.data[fleet.shed_min])
        for fleet in in_roles(fleets, "weather"):
            np.add.at(net, fleet.bus, -now.data[fleet.limit])
        need = self._at_units(net, observation)
        if self.generators_first:
            output_max = np.zeros(observation.island.shape)
            for fleet in in_roles(fleets, "dispatchable"):
                np.add.at(output_max, fleet.bus, now.data[fleet.limit])
            lack = np.maximum(need - self._at_units(output_max, observation), 0.0)
            need = np.where(need > 0, lack, need)
        discharge_max = self._over_units(-low, observation)
        charge_max = self._over_units(high, observation)
        share_out = np.minimum(np.maximum(need, 0.0) / np.maximum(discharge_max, 1e-12), 1.0)
        share_in = np.minimum(np.maximum(-need, 0.0) / np.maximum(charge_max, 1e-12), 1.0)
        return low * share_out + high * share_in

    def _at_units(self, values: Floats, observation: Observation) -> Floats:
        """(units, batch) the sum over the unit's island of values (buses, batch)."""
        return self._summed(values, observation.island, observation)

    def _over_units(self, values: Floats, observation: Observation) -> Floats:
        """(units, batch) the sum over the units of the unit's island of values (units, batch)."""
        islands = observation.island[self.world.simulator.storage_bus]
        return self._summed(values, islands, observation)

    def _summed(self, values: Floats, rows: Ints, observation: Observation) -> Floats:
        bus, batch = self.world.simulator.storage_bus, np.arange(observation.island.shape[1])
        total = np.zeros(observation.island.shape)
        np.add.at(total, (rows, np.broadcast_to(batch, rows.shape)), values)
        return total[observation.island[bus], batch]


class Rule:
    """Holds a state of charge while the grid is there; without it, serves what its island's
    generators and PV cannot. The paper's rule has the level 0.5.

    Args:
        world: where it acts.
        level: state of charge, one for all or (units,) one each.
    """

    def __init__(self, world: World, level: float | Floats = 0.5) -> None:
        self.world, self.islanded = world, Greedy(world, generators_first=True)
        self.name = f"rule-{level:g}" if np.ndim(level) == 0 else "rule-levels"
        size = np.array([unit.e_mwh for unit in world.microgrid.case.ess])
        self.target = (size * level)[:, None]

    def act(self, observation: Observation) -> Floats:
        """Towards the level with a grid; what generators leave without."""
        simulator = self.world.simulator
        gap = self.target - observation.energy
        hold = np.where(gap > 0, gap / simulator.gain, gap / simulator.drain)
        return np.where(self._with_grid(observation), hold, self.islanded.act(observation))

    def _with_grid(self, observation: Observation) -> Bools:
        """(units, batch) whether the unit's island holds a grid connection."""
        microgrid = self.world.microgrid
        islands = observation.island[self.world.simulator.storage_bus]
        has_grid = np.zeros(islands.shape, bool)
        for fleet in in_roles(microgrid.fleets.values(), "exchange"):
            for bus in fleet.bus:
                has_grid |= islands == observation.island[bus]
        return has_grid
