"""What a step needs to know of a stage, read once from its rows, bounds and prices.

Nothing of a device is written here:

- storage is what moves the state: its dynamics row gives the change per MW;
- a source feeds or loads a bus at a price: whatever stands in the balance and is no flow;
- a tank is a level and what burns from it: its own row says how much per MW;
- demand must be fed in any case: the balance's right-hand side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.components.generator import BOUND
from resilience.models.language.stage import Stage
from resilience.models.microgrid import Microgrid
from resilience.models.network.situation import Situation
from resilience.models.program.form import stage_form
from resilience.models.simulator.arrays import Array, ArrayOps, array_ops
from resilience.models.simulator.constants import Constant, Map

STATE = "ess.energy"
STORAGE = ("ess.charge", "ess.discharge")
CHARGED = ("line.from_sq", "line.to_sq")
LEVEL, DELIVERY = "tank.level", "tank.delivery"
SPILLED = ".spilled"


@dataclass(frozen=True)
class MemberPrices:
    """Prices that some members of a batch have in common, $ per MW and step.

    Attributes:
        members: (members,) which they are; None: all of them.
        sources: (columns,).
        storage: (2, units) of charging and of discharging.
    """

    members: Ints | None
    sources: Floats
    storage: Floats


class StorageSlot(NamedTuple):
    """What a slot is to storage, whatever is stored.

    Attributes:
        power_limits: (2, units, batch) from `Plant.power_limits`.
        island: (units, batch) number of the island of every unit.
    """

    power_limits: Array
    island: Array


def _is_inner(name: str) -> bool:
    """Whether a variable in the balance is storage, a flow, or what is spilled, and no source."""
    # What flows to earth at a line is a source, with its voltage for a power.
    is_flow = name.startswith("line.") and name not in CHARGED
    return name in STORAGE or is_flow or name.endswith(SPILLED)


class Plant:
    """A stage seen from a step.

    Args:
        microgrid: the microgrid.
        dt: length of a step, h.

    Attributes:
        units: names of the storage units.
        storage_bus: (units,) their buses.
        gain, drain: (units, 1) MWh stored per MW charged, and lost per MW discharged, in a step.
        low, high: (units, 1) band of the stored energy, MWh.
        columns: names of the sources, as `load.shed[load1]`.
        bus: (columns,) where they stand.
        sign: (columns, 1) 1 where a source feeds its bus, -1 where it takes.
        n_buses: number of buses.
        demand: map from data to (buses, batch) MW.
        power_max: map from data to (2 · units, batch) MW, of charging above those of discharging.
        price: map from data to (columns, batch) $ per MW and step.
        storage_price: maps from data to (units, batch) $ per MW and step, likewise for both.
        stored: columns of the form in which charging and discharging stand, (units,) each.
        tanks: names of the tanks.
        tank_capacity: (tanks, 1) m³.
        fuel_per_mw: (tanks, columns) m³ burnt in a step per MW of every source.
        delivered: map from data to (tanks, batch) m³ that arrive in a step.
        decision_columns: names of what a step decides beside storage and sources; see
            `MilpSimulator`.
        charges_at_zero: which one-sided gradient an order of zero has.
    """

    charges_at_zero = False
    decision_columns: Labels = ()

    def __init__(self, microgrid: Microgrid, dt: float) -> None:
        self.microgrid, self.dt = microgrid, dt
        self.form = stage_form(self._stage())
        self.balance_rows = rows = self.form.rows("balance.p")
        self._balance = self.form.a.tocsr()[rows]
        self.n_buses = int(self._balance.shape[0])
        sides, slopes = self.form.right_sides
        self.demand = Map(sides[rows], slopes[rows])
        self._read_storage()
        self._read_sources()
        self._read_tanks()

    def _stage(self) -> Stage:
        """The stage that is stepped: energy, and with it which islands are alive, is known."""
        return self.microgrid.stage(self.dt, energy_known=True)

    def positions(self, name: str) -> Ints:
        """Columns of a variable in the stage's form."""
        return self.form.columns(self.form.block(name))

    def bound(self, side: Literal["lower", "upper"], columns: Ints) -> Map:
        """The lower or upper bounds of columns, from data."""
        form, variables = self.form, columns - self.form.n_now
        constants, slopes = form.lower_bounds if side == "lower" else form.upper_bounds
        return Map(constants[variables], slopes[variables])

    def _read_storage(self) -> None:
        """Reads units, their bands, and what a MW does to them, from the row of their dynamics."""
        blocks = [b for _, b in self.form.stage.states if b.name == STATE]
        self.units: Labels = blocks[0].labels if blocks else ()
        n = len(self.units)
        self.storage_bus = np.empty(0, np.intp)
        self.stored = np.empty(0, np.intp), np.empty(0, np.intp)
        self.gain = self.drain = self.low = self.high = np.empty((0, 1))
        if blocks:
            energy, columns = self.positions(STATE), [self.positions(name) for name in STORAGE]
            moves = self.form.a.tocsr()[self.form.rows("ess.dynamics")]
            moves, rows = moves.toarray(), np.arange(n)
            scale = -moves[rows, energy]
            self.gain = (moves[rows, columns[0]] / scale)[:, None]
            self.drain = -(moves[rows, columns[1]] / scale)[:, None]
            self.storage_bus = np.argmax(self._balance[:, columns[1]].toarray() > 0, axis=0)
            variables = energy - self.form.n_now
            (lower, _), (upper, _) = self.form.lower_bounds, self.form.upper_bounds
            self.low, self.high = lower[variables][:, None], upper[variables][:, None]
            self.stored = columns[0], columns[1]
        self.power_max = self.bound("upper", np.concatenate(self.stored))
        self.storage_price = [self._priced(columns) for columns in self.stored]
        self._gain, self._negative_drain = Constant(self.gain), Constant(-self.drain)
        self._edges = Constant(np.array([self.high, self.low]))
        self._per_edge = Constant(1.0 / np.array([self.gain, -self.drain]))

    def _read_sources(self) -> None:
        """Reads what feeds or loads a bus, with its sign, bounds and price."""
        form = self.form
        blocks = [b for b in form.own_blocks if not _is_inner(b.name)]
        none = np.empty(0, np.intp)
        positions = np.concatenate([form.columns(b) for b in blocks] or [none])
        names = [f"{b.name}[{label}]" for b in blocks for label in b.labels]
        entries = self._balance[:, positions].tocsc()
        entries.eliminate_zeros()  # of what flows to earth without taking power
        feeds = np.flatnonzero(np.diff(entries.indptr))
        self.columns: Labels = tuple(names[k] for k in feeds)
        self.kinds = np.array([name.split("[")[0] for name in self.columns], str)
        self.sources = np.asarray(positions[feeds], np.intp)
        self.bus = np.asarray(entries.indices[entries.indptr[feeds]], np.intp)
        self.sign = entries.data[entries.indptr[feeds]][:, None]
        self.lower, self.upper = (
            self.bound("lower", self.sources),
            self.bound("upper", self.sources),
        )
        self.price = self._priced(self.sources)
        priced = [self.price, *self.storage_price]
        self._moving = np.unique(np.concatenate([p.coefficients.indices for p in priced]))

    def _read_tanks(self) -> None:
        """Reads tanks, and what burns from them, from the rows of their levels."""
        form = self.form
        blocks = [b for _, b in form.stage.states if b.name == LEVEL]
        self.tanks: Labels = blocks[0].labels if blocks else ()
        n, self.tank_capacity = len(self.tanks), np.empty((0, 1))
        self.fuel_per_mw = sp.csc_array((n, len(self.columns)))
        self.delivered = Map(np.zeros(n), sp.csr_array((n, form.n_data)))
        if blocks:
            upper, _ = form.upper_bounds
            self.tank_capacity = upper[self.positions(LEVEL) - form.n_now][:, None]
            moves = form.a.tocsr()[form.rows("tank.dynamics")]
            self.fuel_per_mw = sp.csc_array(moves[:, self.sources])
            self.fuel_per_mw.eliminate_zeros()
            if self.has_deliveries:
                columns = self.positions(DELIVERY)
                rate, per_rate = self.bound("upper", columns), -moves[:, columns]
                amount = sp.csr_array(per_rate @ rate.coefficients)
                self.delivered = Map(per_rate @ rate.constant, amount)
        self._tank_capacity = Constant(self.tank_capacity)

    def available_fuel(self, fuel: Array | None, delivered: Array) -> Array:
        """(tanks, batch) m³ that is there in a step.

        Raises:
            ValueError: nobody told how much is in the tanks.
        """
        if fuel is None:
            raise ValueError(f"no fuel of the tanks {', '.join(self.tanks)} was told")
        return fuel + delivered

    def fuel_after(self, available: Array, burnt: Array) -> Array:
        """(tanks, batch) fuel at the end of a step, m³.

        Args:
            available: (tanks, batch) m³ at its start and delivered in it.
            burnt: (tanks, batch) m³ burnt in it.
        """
        ops = array_ops(available)
        return ops.positive_up_to(available - burnt, self._tank_capacity.as_array(ops))

    @property
    def burners(self) -> Ints:
        """(burners,) which of the sources burn from a tank."""
        return np.flatnonzero(np.diff(self.fuel_per_mw.indptr))

    @property
    def needs_outage_begins(self) -> bool:
        """Whether data of a slot depend on which lines were up the slot before."""
        return any(datum.name == BOUND for datum in self.form.stage.datums)

    @property
    def has_deliveries(self) -> bool:
        """Whether fuel is delivered to any tank."""
        return any(block.name == DELIVERY for block in self.form.own_blocks)

    def _priced(self, columns: Ints) -> Map:
        costs = self.form.costs
        const = sum((c.columns[columns] for c in costs), np.zeros(len(columns)))
        width = (self.form.n_columns, self.form.n_data)
        data = sum((c.columns_data for c in costs), sp.csr_array(width))
        return Map(const, sp.csr_array(data)[columns])

    def data(self, situation: Situation, node: int) -> Floats:
        """(n_data, 1) the data of one node of a situation."""
        return self.stacked(self.microgrid.data(situation))[:, [node]]

    def stacked(self, data: Mapping[str, Floats]) -> Floats:
        """(..., n_data, n) the stage's data from named arrays (..., labels, n)."""
        shapes = [(*np.shape(value)[:-2], np.shape(value)[-1]) for value in data.values()]
        *leading, width = np.broadcast_shapes(*shapes) if shapes else (1,)
        stacked = np.empty((*leading, self.form.n_data, width))
        for block in self.form.stage.datums:
            stacked[..., block.slice, :] = data[block.name]
        return stacked

    def prices(self, data: Array) -> list[MemberPrices]:
        """What the members of a batch pay: one entry for all where prices are equal, else as many
        as there are different prices. Reads the data back from their device.
        """
        ops = array_ops(data)
        moving = ops.as_numpy(data[self._moving])
        if (moving == moving[:, :1]).all():
            return [self._prices(ops.as_numpy(data[:, 0]), None)]
        _, first, group = np.unique(moving, axis=1, return_index=True, return_inverse=True)
        return [
            self._prices(ops.as_numpy(data[:, k]), np.flatnonzero(group.ravel() == number))
            for number, k in enumerate(first.tolist())
        ]

    def _prices(self, data: Floats, members: Ints | None) -> MemberPrices:
        data = np.asarray(data, float)
        sources, *storage = (
            price.constant + price.coefficients @ data
            for price in (self.price, *self.storage_price)
        )
        return MemberPrices(members, sources, np.array(storage))

    def power_limits(self, ops: ArrayOps, data: Array, batch: int) -> Array:
        """(2, units, batch) MW that units can charge and discharge with, whatever they hold."""
        limits = ops.wide(self.power_max(ops, data), batch)
        return limits.reshape(2, len(self.units), batch)

    def storage_slot(self, data: Array, island: Array) -> StorageSlot:
        """What a slot is to storage.

        Args:
            data: (n_data, batch) or (n_data, 1) from `stacked`.
            island: (buses, batch) number of the island of every bus.
        """
        ops = array_ops(data)
        limits = self.power_limits(ops, data, island.shape[-1])
        return StorageSlot(limits, ops.rows(island, self.storage_bus))

    def possible(self, ops: ArrayOps, energy: Array, power_limits: Array) -> Array:
        """(2, units, batch) MW that units can charge and discharge with now, within their bands."""
        edges, per_edge = self._edges.as_array(ops), self._per_edge.as_array(ops)
        return ops.clipped(ops.scaled_difference(edges, energy, per_edge), power_limits)

    def limits(self, energy: Array, data: Array) -> tuple[Array, Array]:
        """(units, batch) lowest and highest charging power, MW, that keep every unit in its band.

        Efficiencies are in it; negative is discharging.
        """
        ops = array_ops(energy)
        power_limits = self.power_limits(ops, data, energy.shape[-1])
        take, give = self.possible(ops, energy, power_limits)
        return -give, take

    def masked_action(
        self, ops: ArrayOps, energy: Array, action: Array, power_limits: Array
    ) -> tuple[Array, Array]:
        """(units, batch) charging and discharging power, MW: the action within `limits`.

        At zero the gradient is that of one side alone, not the sum of both: of discharging, which
        in an island that sheds all it has tells that storage helps, or, where `charges_at_zero`,
        of charging.
        """
        take, give = self.possible(ops, energy, power_limits)
        if self.charges_at_zero:
            charge = ops.positive_up_to(action, take)
            return charge, ops.positive_up_to(charge - action, give)
        discharge = ops.positive_up_to(-action, give)
        return ops.positive_up_to(action + discharge, take), discharge

    def after(self, energy: Array, charge: Array, discharge: Array) -> Array:
        """(units, batch) stored energy at the end of the step, MWh."""
        ops = array_ops(energy)
        loss = self._negative_drain.as_array(ops)
        return ops.weighted_sum(self._gain.as_array(ops), charge, loss, discharge, energy)
