r"""The same stage, stepped: arrays with a trailing batch axis, NumPy or torch from one source.

Nothing of a device is written here. From the stage's rows and bounds the simulator reads

- which columns move a state (storage): its dynamics row gives the change per MW;
- which columns feed or load a bus at a price: everything else in the balance that is no flow;
- what must be fed at a bus in any case: the balance's right-hand side (demand).

A step masks the storage action so that no state leaves its bounds, closes every island by recourse,
and prices what was done with the stage's own cost terms. With storage fixed, the cheapest recourse
of a lossless island is a continuous knapsack: its columns in merit order, cheapest first, is the
optimum of the one-slot linear program (a test proves it). What even that cannot close is closed by
cutting back charging (a deficit) or discharging (a surplus); a surplus of power that must be taken
is then spilled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.errors import UsageError
from resilience.models.algebra import Floats, Ints, Labels
from resilience.models.arrays import Array, Map, namespace
from resilience.models.form import Form
from resilience.models.microgrid import Microgrid
from resilience.models.situation import Situation

TINY = 1e-12
STORAGE = ("ess.charge", "ess.discharge")


@dataclass(frozen=True)
class Step:
    """What one step did, arrays (n, batch), powers in MW.

    Attributes:
        energy: (units, batch) stored energy at the end, MWh.
        cost: (batch,) $ of the step.
        charge, discharge: (units, batch) after masking and cutting back.
        flows: (columns, batch) every other column that feeds or loads a bus; their names are
            `Simulator.columns`.
        spill: (buses, batch) power that had to be taken and could not be used, in the row of the
            island's number.
    """

    energy: Array
    cost: Array
    charge: Array
    discharge: Array
    flows: Array
    spill: Array


class Simulator:
    """Steps a microgrid at copperplate physics, on its merged graph.

    Args:
        grid: the microgrid, with copperplate physics.
        dt: length of a step, h.

    Raises:
        UsageError: the physics is not copperplate, or the stage needs decisions (commitment,
            blocks, switching) or ratings that a step does not hold.
    """

    def __init__(self, grid: Microgrid, dt: float) -> None:
        if grid.physics != "copperplate":
            raise UsageError(
                f"the simulator steps copperplate physics, not {grid.physics}",
                hint="use microgrid(case, 'copperplate'); AC power flow certifies afterwards",
            )
        self.grid = grid
        self.form = Form(grid.stage(dt))
        self._refuse_decisions()
        self._balance = self._rows("balance.p")
        self._read_storage()
        self._read_sources()

    def _refuse_decisions(self) -> None:
        whole = [b.name for b in self.form.own if self.form.integer[self._own(b.name)].any()]
        if whole:
            raise UsageError(
                f"the simulator does not decide {whole[0]!r}",
                hint="it steps cases without commitment, blocks and switchable lines",
            )
        if np.isfinite(self.grid.network.rating_mva).any():
            raise UsageError(
                "the simulator does not hold line ratings", hint="leave `rating_mva` out"
            )

    def _columns(self, name: str) -> Ints:
        block = next(b for b in self.form.own if b.name == name)
        return np.asarray(self.form.position[block.slice], np.intp)

    def _own(self, name: str) -> Ints:
        return self._columns(name) - self.form.n_now

    def _rows(self, name: str) -> sp.csr_array:
        k = next(i for i, row in enumerate(self.form.stage.rows) if row.name == name)
        rows = slice(int(self.form.row_start[k]), int(self.form.row_start[k + 1]))
        self._last = rows
        return self.form.a.tocsr()[rows]

    def _bound(self, side: str, own: Ints) -> Map:
        const: Floats = getattr(self.form, side)
        return const[own][:, None], getattr(self.form, side + "_data")[own]

    def _read_storage(self) -> None:
        self.demand: Map = self.form.rhs[self._last][:, None], self.form.rhs_data[self._last]
        after = [b for _, b in self.form.stage.states if b.name == "ess.energy"]
        self.units: Labels = after[0].labels if after else ()
        if not after:
            self.storage_bus = np.empty(0, np.intp)
            self.gain = self.drain = self.low = self.high = np.empty((0, 1))
            self._most = [(np.empty((0, 1)), sp.csr_array((0, self.form.n_data)))] * 2
            return
        moves = self._rows("ess.dynamics").toarray()
        charge, discharge = (self._columns(name) for name in STORAGE)
        each, energy = np.arange(len(self.units)), self._columns("ess.energy")
        scale = -moves[each, energy]
        self.gain = (moves[each, charge] / scale)[:, None]
        self.drain = -(moves[each, discharge] / scale)[:, None]
        self.storage_bus = np.argmax(self._balance.toarray()[:, discharge] > 0, axis=0)
        own = energy - self.form.n_now
        self.low, self.high = self.form.lower[own][:, None], self.form.upper[own][:, None]
        self._most = [self._bound("upper", self._own(name)) for name in STORAGE]

    def _read_sources(self) -> None:
        balance = self._balance.toarray()
        apart = ("line.p", *STORAGE) if self.units else ("line.p",)
        own = [b for b in self.form.own if b.name not in apart]
        at = np.concatenate([self.form.position[b.slice] for b in own])
        names = [f"{b.name}[{label}]" for b in own for label in b.labels]
        feeds = np.flatnonzero(np.abs(balance[:, at]).sum(0) > 0)
        self.columns: Labels = tuple(names[k] for k in feeds)
        self._at = np.asarray(at[feeds], np.intp)
        self.bus = np.argmax(np.abs(balance[:, self._at]), axis=0)
        self.sign = balance[self.bus, self._at][:, None]
        self.n_buses = balance.shape[0]
        index = self._at - self.form.n_now
        self._lower, self._upper = self._bound("lower", index), self._bound("upper", index)
        self._price = self._price_map(self._at)
        stored = [self._columns(name) for name in STORAGE] if self.units else [self.storage_bus] * 2
        self._storage_price = [self._price_map(columns) for columns in stored]
        self._place = _places(self.bus, self.n_buses)
        self._storage_place = _places(self.storage_bus, self.n_buses)
        self._known: dict[bytes, tuple[list[sp.csr_array], Ints]] = {}

    def data(self, situation: Situation, node: int) -> Floats:
        """(n_data, 1) the data of one node of a situation."""
        return self.stacked(self.grid.data(situation))[:, [node]]

    def stacked(self, data: Mapping[str, Any]) -> Floats:
        """(n_data, n) the stage's data from named arrays (labels, n)."""
        width = max(np.shape(value)[-1] for value in data.values())
        found = np.empty((self.form.n_data, width))
        for block in self.form.stage.datums:
            found[block.slice] = data[block.name]
        return found

    def limits(self, energy: Array, data: Array) -> tuple[Array, Array]:
        """(units, batch) least and most charging power, MW, that keep every unit in its band.

        Efficiencies are in it; negative is discharging.
        """
        ops = namespace(energy)
        charge, discharge = (ops.affine(most, data) for most in self._most)
        room = (ops.array(self.high) - energy) / ops.array(self.gain)
        stock = (energy - ops.array(self.low)) / ops.array(self.drain)
        return -ops.positive(ops.minimum(discharge, stock)), ops.positive(ops.minimum(charge, room))

    def step(self, energy: Array, action: Array, data: Array, island: Array) -> Step:
        """One step.

        Args:
            energy: (units, batch) stored energy, MWh.
            action: (units, batch) charging power asked for, MW; negative is discharging.
            data: (n_data, batch) or (n_data, 1) from `stacked`, of the kind of `energy`.
            island: (buses, batch) number of the island of every bus.
        """
        ops = namespace(energy)
        low, high = self.limits(energy, data)
        wanted = ops.minimum(ops.maximum(action, low), high)
        charge, discharge = ops.positive(wanted), ops.positive(-wanted)
        lower, upper = ops.affine(self._lower, data), ops.affine(self._upper, data)
        sign = ops.array(self.sign)
        least = ops.where(sign > 0, lower, upper)
        stored = ops.mapped(self._storage_place, discharge - charge)
        fed = ops.mapped(self._place, sign * least)
        need = ops.segment(ops.affine(self.demand, data) - fed - stored, island)
        share, need = self._merit(ops, upper - lower, need, data, island)
        flows = least + sign * (upper - lower) * share
        charge, need = self._cut_back(ops, charge, need, island, 1.0)
        discharge, need = self._cut_back(ops, discharge, need, island, -1.0)
        energy = energy + ops.array(self.gain) * charge - ops.array(self.drain) * discharge
        cost = self._cost(ops, flows, charge, discharge, data)
        return Step(energy, cost, charge, discharge, flows, ops.positive(-need))

    def _merit(
        self, ops: Any, room: Array, need: Array, data: Array, island: Array
    ) -> tuple[Array, Array]:
        """(columns, batch) share of each column's room that is used, and (buses, batch) the need
        left, in the row of the island's number. Columns of equal cost share in proportion.
        """
        shares = []
        places, index = self._tiers(self.prices(data))
        for place in places:
            there = ops.segment(ops.mapped(place, room), island)
            taken = ops.minimum(ops.positive(need), there)
            need = need - taken
            some = ops.maximum(there, ops.array(np.array(TINY)))
            shares.append(ops.spread(taken / some, island))
        return ops.joined(shares)[index], need

    def _tiers(self, prices: Floats) -> tuple[list[sp.csr_array], Ints]:
        """Columns by what one more MW of supply costs, cheapest first.

        Returns:
            Per tier the matrix (buses, columns) that adds up its columns at their buses; and for
            every column the row of its bus and tier in the tiers' results stacked.
        """
        marginal = prices / self.sign
        if np.ptp(marginal, axis=1).max(initial=0.0) > TINY:
            raise UsageError(
                "prices differ within a batch", hint="step scenarios of the same slot together"
            )
        values, tier = np.unique(np.round(marginal[:, 0], 9), return_inverse=True)
        key = tier.tobytes()
        if key not in self._known:
            places = [self._place @ sp.diags_array((tier == k) * 1.0) for k in range(len(values))]
            index = tier * self.n_buses + self.bus
            self._known[key] = [sp.csr_array(place) for place in places], index
        return self._known[key]

    def _cut_back(
        self, ops: Any, power: Array, need: Array, island: Array, sign: float
    ) -> tuple[Array, Array]:
        """Charging cut back by a deficit (sign 1), discharging by a surplus (sign -1), pro rata."""
        there = ops.segment(ops.mapped(self._storage_place, power), island)
        cut = ops.minimum(ops.positive(sign * need), there)
        share = ops.spread(cut / ops.maximum(there, ops.array(np.array(TINY))), island)
        return power * (1.0 - share[self.storage_bus]), need - sign * cut

    def prices(self, data: Array) -> Floats:
        """(columns, batch) $ per MW and step of the columns in `flows`."""
        const, coefficients = self._price
        found: Floats = const + coefficients @ _plain(data) if coefficients.nnz else const
        return found

    def _price_map(self, columns: Ints) -> Map:
        costs = self.form.costs
        const = sum((c.columns[columns] for c in costs), np.zeros(len(columns)))
        width = (self.form.n_columns, self.form.n_data)
        data = sum((c.columns_data for c in costs), sp.csr_array(width))
        return const[:, None], sp.csr_array(data)[columns]

    def _cost(self, ops: Any, flows: Array, charge: Array, discharge: Array, data: Array) -> Array:
        total = (ops.affine(self._price, data) * flows).sum(0)
        for price, power in zip(self._storage_price, (charge, discharge), strict=True):
            total = total + (ops.affine(price, data) * power).sum(0)
        return total + sum(float(term.offset) for term in self.form.costs)


def _places(bus: Ints, n: int) -> sp.csr_array:
    return sp.csr_array((np.ones(len(bus)), (bus, np.arange(len(bus)))), shape=(n, len(bus)))


def _plain(data: Array) -> Floats:
    found: Floats = data if isinstance(data, np.ndarray) else data.detach().cpu().numpy()
    return found
