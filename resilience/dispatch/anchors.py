"""Three actions that any storage policy can be measured in: serve, follow the rule, charge fully.

They are the kinks of the recourse: in an island storage should give exactly what is lacking, with a
grid exactly nothing or all. Arrays are (n, batch), NumPy or torch, as those of the simulator, and
gradients pass through.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.components import DeviceFleet, in_roles
from resilience.models.simulator.arrays import Array, ArrayOps, array_ops
from resilience.models.simulator.constants import Constant, Map, Matrix
from resilience.models.simulator.plant import Plant

LEAST_MW = 1e-12  # in place of no power at all, in a quotient


class Needs(NamedTuple):
    """What the island of every unit lacks and has, arrays (units, batch).

    Attributes:
        surplus: MW that PV has over.
        lack: MW of demand that PV leaves.
        lack_beyond: MW that generators leave of that.
        grid: whether it has a grid connection.
    """

    surplus: Array
    lack: Array
    lack_beyond: Array
    grid: Array


class Actions(NamedTuple):
    """Charging power of every unit, arrays (units, batch), MW; negative is discharging.

    Attributes:
        low, high: what a unit can do.
        serve: what PV leaves of the demand of its island, or less what PV has over. Units share in
            proportion to what each can give or take.
        spare: the same, but of the demand only what generators leave (the order of the paper's eqs.
            20-21), which keeps energy for later.
        rule: towards the level with a grid, maybe beyond limits; what generators leave without.
    """

    low: Array
    high: Array
    serve: Array
    spare: Array
    rule: Array


class Anchors:
    """The anchors of a plant.

    Args:
        plant: the stage as a step sees it.
        level: state of charge that the rule holds while the grid is there, one for all or
            (units,) one each.
    """

    def __init__(self, plant: Plant, level: float | Floats = 0.9) -> None:
        self.plant = plant
        fleets = list(plant.microgrid.fleets.values())
        size = [f.size_mwh() for f in in_roles(fleets, "storage")]
        target = np.concatenate([np.empty(0), *size]) * level
        self._target = Constant(target[:, None])
        self._per_gain = Constant(1.0 / plant.gain)
        self._per_drain = Constant(1.0 / plant.drain)
        has_grid = np.zeros((plant.n_buses, 1))
        for fleet in in_roles(fleets, "exchange"):
            has_grid[fleet.bus] = 1.0
        self._has_grid = Constant(has_grid)
        self._one, self._least = Constant(np.ones((1, 1))), Constant(np.full((1, 1), LEAST_MW))
        bus, units = plant.storage_bus, np.arange(len(plant.units))
        entries = (np.ones(len(units)), (bus, units))
        self._at_bus = Matrix(sp.csr_array(entries, shape=(plant.n_buses, len(units))))

    @cached_property
    def net(self) -> Map:
        """From data to (buses, batch) MW of demand that can be served, less what PV offers."""
        fleets = self.plant.microgrid.fleets.values()
        loads, weather = in_roles(fleets, "load"), in_roles(fleets, "weather")
        terms = [(f, f.demand, 1.0) for f in loads] + [(f, f.shed_min, -1.0) for f in loads]
        return self._sums([*terms, *((f, f.limit, -1.0) for f in weather)])

    @cached_property
    def dispatchable(self) -> Map:
        """From data to (buses, batch) MW that generators can give."""
        fleets = self.plant.microgrid.fleets.values()
        return self._sums([(f, f.limit, 1.0) for f in in_roles(fleets, "dispatchable")])

    def needs(self, data: Array, island: Array) -> Needs:
        """What the islands of the units lack and have, which storage has no part in.

        Args:
            data: (n_data, batch) from `stacked`.
            island: (buses, batch) number of the island of every bus.
        """
        ops, batch = array_ops(data), island.shape[-1]
        maps = (self.net(ops, data), self.dispatchable(ops, data), self._has_grid.as_array(ops))
        net, able, grid = (self._of_units(ops, values, island, batch) for values in maps)
        lack = ops.positive(net)
        return Needs(ops.positive(-net), lack, ops.positive(lack - able), grid > 0)

    def actions(
        self, energy: Array, data: Array, island: Array, needs: Needs | None = None
    ) -> Actions:
        """The three anchors and the rule's action within limits.

        Args:
            energy: (units, batch) stored energy, MWh.
            data: (n_data, batch) from `stacked`.
            island: (buses, batch) number of the island of every bus.
            needs: as `needs` gives them, where they are known already.
        """
        ops = array_ops(energy)
        needs = needs or self.needs(data, island)
        low, high = self.plant.limits(energy, data)
        give, take = self._shared(ops, -low, high, island)
        charging = high * ops.minimum(needs.surplus / take, self._one.as_array(ops))
        serve = low * ops.minimum(needs.lack / give, self._one.as_array(ops)) + charging
        spare = low * ops.minimum(needs.lack_beyond / give, self._one.as_array(ops)) + charging
        away = self._target.as_array(ops) - energy
        gain, drain = self._per_gain.as_array(ops), self._per_drain.as_array(ops)
        hold = ops.where(away > 0, away * gain, away * drain)
        rule = ops.where(needs.grid, hold, spare)
        return Actions(low, high, serve, spare, rule)

    def _shared(self, ops: ArrayOps, give: Array, take: Array, island: Array) -> list[Array]:
        """(units, batch) what the units of the island can give and take together, never 0."""
        smallest, place = self._least.as_array(ops), self._at_bus.as_matrix(ops)
        return [
            ops.maximum(self._of_units(ops, place @ power, island, power.shape[-1]), smallest)
            for power in (give, take)
        ]

    def _of_units(self, ops: ArrayOps, values: Array, island: Array, batch: int) -> Array:
        """(units, batch) the sum over the unit's island of values (buses, batch)."""
        total = ops.island_sums(ops.wide(values, batch), island)
        return ops.rows(ops.at_buses(total, island), self.plant.storage_bus)

    def _sums(self, terms: list[tuple[DeviceFleet, str, float]]) -> Map:
        """From data to sums over the devices of every bus, (buses, batch)."""
        form, n = self.plant.form, self.plant.n_buses
        slices = {block.name: block.slice for block in form.stage.datums}
        matrix = sp.csr_array((n, form.n_data))
        for fleet, name, sign in terms:
            columns = np.arange(form.n_data)[slices[name]]
            entries = (np.full(len(columns), sign), (fleet.bus, columns))
            matrix = matrix + sp.csr_array(entries, shape=(n, form.n_data))
        return Map(np.zeros(n), sp.csr_array(matrix))
