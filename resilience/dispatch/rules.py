"""Rules that need no optimiser: idle, self-consumption, and holding a state of charge."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.simulation.observation import Observation
from resilience.simulation.world import World


class Idle:
    """Never moves the storage."""

    def __init__(self, world: World) -> None:
        self.name = "idle"

    def act(self, seen: Observation) -> Floats:
        """Nothing."""
        return np.zeros_like(seen.energy)


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

    def act(self, seen: Observation) -> Floats:
        """Discharge by the net demand of the island, charge by its surplus."""
        world, simulator = self.world, self.world.simulator
        now = world.slot(seen.t)
        data = now.data
        low, high = simulator.limits(seen.energy, now.stacked)
        net = np.zeros(seen.island.shape)
        loads, plants = world.microgrid.case.load, world.microgrid.case.pv
        np.add.at(net, world.microgrid.at(loads), data["load.demand"] - data["load.shed_min"])
        if plants:
            np.add.at(net, world.microgrid.at(plants), -data["pv.available"])
        need = self._at_units(net, seen)
        units = world.microgrid.case.generator
        if units and self.generators_first:
            able = np.zeros(seen.island.shape)
            np.add.at(able, world.microgrid.at(units), data["generator.p_max"])
            need = np.where(need > 0, np.maximum(need - self._at_units(able, seen), 0.0), need)
        give, take = self._at_units(-low, seen, True), self._at_units(high, seen, True)
        share_out = np.minimum(np.maximum(need, 0.0) / np.maximum(give, 1e-12), 1.0)
        share_in = np.minimum(np.maximum(-need, 0.0) / np.maximum(take, 1e-12), 1.0)
        return low * share_out + high * share_in

    def _at_units(self, values: Floats, seen: Observation, of_units: bool = False) -> Floats:
        """(units, batch) the sum over the unit's island of values per bus, or per unit."""
        bus, batch = self.world.simulator.storage_bus, np.arange(seen.island.shape[1])
        total = np.zeros(seen.island.shape)
        rows = seen.island[bus] if of_units else seen.island
        np.add.at(total, (rows, np.broadcast_to(batch, rows.shape)), values)
        return total[seen.island[bus], batch]


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

    def act(self, seen: Observation) -> Floats:
        """Towards the level with a grid; what generators leave without."""
        simulator = self.world.simulator
        gap = self.target - seen.energy
        hold = np.where(gap > 0, gap / simulator.gain, gap / simulator.drain)
        return np.where(self._with_grid(seen), hold, self.islanded.act(seen))

    def _with_grid(self, seen: Observation) -> np.ndarray:
        """(units, batch) whether the unit's island holds a grid connection."""
        microgrid = self.world.microgrid
        found = np.zeros((len(microgrid.case.ess), seen.island.shape[1]), bool)
        for bus in microgrid.at(microgrid.case.grid):
            found |= seen.island[self.world.simulator.storage_bus] == seen.island[bus]
        return found
