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
from resilience.models.simulator.constants import Constant, Map
from resilience.models.simulator.fuel import FuelLimits
from resilience.models.simulator.plant import Plant, StorageSlot

LEAST_MW = 1e-12  # in place of no power at all, in a quotient


class Needs(NamedTuple):
    """What the island of every unit lacks and has, arrays (units, batch), or (1, batch) where all
    is one island.

    Attributes:
        surplus: MW that PV has over.
        lack: MW of demand that PV leaves.
        lack_beyond: MW that generators leave of that, with the fuel that they have.
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
        self._per_gain, self._per_drain = Constant(1.0 / plant.gain), Constant(1.0 / plant.drain)
        self._has_grid = np.zeros(plant.n_buses)
        for fleet in in_roles(fleets, "exchange"):
            self._has_grid[fleet.bus] = 1.0
        self._one = Constant(np.ones((1, 1)))

    @cached_property
    def of_buses(self) -> Map:
        """From data to (3 · buses, batch): `net`, then `dispatchable`, then where grids are."""
        n, net, able = self.plant.n_buses, self.net, self.dispatchable
        none = sp.csr_array((n, self.plant.form.n_data))
        matrix = sp.vstack([net.coefficients, able.coefficients, none], format="csr")
        constant = np.concatenate([net.constant, able.constant, self._has_grid])
        return Map(constant, sp.csr_array(matrix))

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

    @cached_property
    def _fuel(self) -> FuelLimits:
        return FuelLimits(self.plant)

    def needs(
        self, data: Array, island: Array, slot: StorageSlot, fuel: Array | None = None
    ) -> Needs:
        """What the islands of the units lack and have, which storage has no part in.

        Args:
            data: (n_data, batch) from `stacked`.
            island: (buses, batch) number of the island of every bus.
            slot: what it is to storage, from `Plant.storage_slot`.
            fuel: (tanks, batch) m³ in every tank; None: generators have all they may burn.
        """
        ops, shape = array_ops(data), island.shape
        values = ops.wide(self.of_buses(ops, data), shape[-1]).reshape(3, *shape)
        if fuel is not None:
            net, able, grid = values
            values = ops.stacked([net, able - self._fuel.lost(ops, data, fuel), grid])
        net, able, grid = ops.at_islands(ops.sums(values, island, len(island)), slot.island)
        lack = ops.positive(net)
        return Needs(ops.positive(-net), lack, ops.positive(lack - able), grid > 0)

    def actions(self, energy: Array, slot: StorageSlot, needs: Needs) -> Actions:
        """The three anchors and the rule's action within limits.

        Args:
            energy: (units, batch) stored energy, MWh.
            slot: what it is to storage, from `Plant.storage_slot`.
            needs: of its islands.
        """
        ops = array_ops(energy)
        possible = self.plant.possible(ops, energy, slot.power_limits)
        take, give = possible
        total = ops.at_least(self._of_islands(ops, possible, slot.island), LEAST_MW)
        all_take, all_give = total
        whole_share = self._one.as_array(ops)
        charging = take * ops.minimum(needs.surplus / all_take, whole_share)
        serve = charging - give * ops.minimum(needs.lack / all_give, whole_share)
        spare = charging - give * ops.minimum(needs.lack_beyond / all_give, whole_share)
        away = self._target.as_array(ops) - energy
        gain, drain = self._per_gain.as_array(ops), self._per_drain.as_array(ops)
        hold = away * ops.where(away > 0, gain, drain)
        return Actions(-give, take, serve, spare, ops.where(needs.grid, hold, spare))

    def _of_islands(self, ops: ArrayOps, values: Array, island: Array) -> Array:
        """(..., units, batch) the sum over the unit's island of values of the same shape."""
        return ops.at_islands(ops.sums(values, island, self.plant.n_buses), island)

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
