"""What a step needs to know of a stage, read once from its rows, bounds and prices.

Nothing of a device is written here:

- storage is what moves the state: its dynamics row gives the change per MW;
- a source feeds or loads a bus at a price: whatever stands in the balance and is no flow;
- demand must be fed in any case: the balance's right-hand side.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError
from resilience.models.algebra import Labels
from resilience.models.microgrid import Microgrid
from resilience.models.network.situation import Situation
from resilience.models.program.form import Form
from resilience.models.simulator.arrays import Array, Constant, Map, Matrix, namespace

STATE = "ess.energy"
STORAGE = ("ess.charge", "ess.discharge")


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
    """

    def __init__(self, microgrid: Microgrid, dt: float) -> None:
        self.microgrid, self.dt = microgrid, dt
        self.form = Form(microgrid.stage(dt))
        k = self.form.row("balance.p")
        rows = slice(int(self.form.row_start[k]), int(self.form.row_start[k + 1]))
        self.balance_rows = rows
        self._balance = self.form.a.tocsr()[rows]
        self.n_buses = int(self._balance.shape[0])
        self.demand = Map(self.form.rhs[rows], self.form.rhs_data[rows])
        self._read_storage()
        self._read_sources()

    def positions(self, name: str) -> Ints:
        """Columns of a variable in the stage's form."""
        return np.asarray(self.form.position[self.form.block(name).slice], np.intp)

    def bound(self, side: str, columns: Ints) -> Map:
        """`lower` or `upper` bounds of columns, from data."""
        own = columns - self.form.n_now
        const: Floats = getattr(self.form, side)
        return Map(const[own], getattr(self.form, side + "_data")[own])

    def _read_storage(self) -> None:
        blocks = [b for _, b in self.form.stage.states if b.name == STATE]
        self.units: Labels = blocks[0].labels if blocks else ()
        n = len(self.units)
        self.storage_bus = np.empty(0, np.intp)
        self.stored = self.stored_from = np.empty(0, np.intp), np.empty(0, np.intp)
        self.gain = self.drain = self.low = self.high = np.empty((0, 1))
        if blocks:
            energy, columns = self.positions(STATE), [self.positions(name) for name in STORAGE]
            k = self.form.row("ess.dynamics")
            moves = self.form.a.tocsr()[self.form.row_start[k] : self.form.row_start[k + 1]]
            moves, each = moves.toarray(), np.arange(n)
            scale = -moves[each, energy]
            self.gain = (moves[each, columns[0]] / scale)[:, None]
            self.drain = -(moves[each, columns[1]] / scale)[:, None]
            self.storage_bus = np.argmax(self._balance[:, columns[1]].toarray() > 0, axis=0)
            own = energy - self.form.n_now
            self.low, self.high = self.form.lower[own][:, None], self.form.upper[own][:, None]
            self.stored = columns[0], columns[1]
        place = (np.ones(n), (self.storage_bus, np.arange(n)))
        self._at_bus = Matrix(sp.csr_array(place, shape=(self.n_buses, n)))
        self.most = [self.bound("upper", columns) for columns in self.stored]
        self.most_price = [self._priced(columns) for columns in self.stored]
        self._per_gain, self._per_drain = Constant(1.0 / self.gain), Constant(1.0 / self.drain)
        self._gain, self._drain = Constant(self.gain), Constant(self.drain)
        self._low, self._high = Constant(self.low), Constant(self.high)

    def _read_sources(self) -> None:
        own = [b for b in self.form.own if b.name not in STORAGE and not b.name.startswith("line.")]
        at = np.concatenate([self.form.position[b.slice] for b in own] or [np.empty(0, np.intp)])
        names = [f"{b.name}[{label}]" for b in own for label in b.labels]
        entries = self._balance[:, at].tocsc()
        feeds = np.flatnonzero(np.diff(entries.indptr))
        self.columns: Labels = tuple(names[k] for k in feeds)
        self.kinds = np.array([name.split("[")[0] for name in self.columns], str)
        self.sources = np.asarray(at[feeds], np.intp)
        self.bus = np.asarray(entries.indices[entries.indptr[feeds]], np.intp)
        self.sign = entries.data[entries.indptr[feeds]][:, None]
        self.lower, self.upper = (
            self.bound("lower", self.sources),
            self.bound("upper", self.sources),
        )
        self.price = self._priced(self.sources)
        priced = [self.price, *self.most_price]
        self._moving = np.unique(np.concatenate([p.coefficients.indices for p in priced]))

    def _priced(self, columns: Ints) -> Map:
        costs = self.form.costs
        const = sum((c.columns[columns] for c in costs), np.zeros(len(columns)))
        width = (self.form.n_columns, self.form.n_data)
        data = sum((c.columns_data for c in costs), sp.csr_array(width))
        return Map(const, sp.csr_array(data)[columns])

    def data(self, situation: Situation, node: int) -> Floats:
        """(n_data, 1) the data of one node of a situation."""
        return self.stacked(self.microgrid.data(situation))[:, [node]]

    def stacked(self, data: Mapping[str, Any]) -> Floats:
        """(n_data, n) the stage's data from named arrays (labels, n)."""
        width = max((np.shape(value)[-1] for value in data.values()), default=1)
        found = np.empty((self.form.n_data, width))
        for block in self.form.stage.datums:
            found[block.slice] = data[block.name]
        return found

    def prices(self, data: Array) -> tuple[Floats, Floats]:
        """(columns,) and (2, units) $ per MW and step: of the sources, of charging, discharging.

        Raises:
            UsageError: they differ within the batch.
        """
        ops = namespace(data)
        if len(self._moving):
            moving = ops.plain(data[self._moving])
            if (moving != moving[:, :1]).any():
                raise UsageError(
                    "prices differ within a batch", hint="step scenarios of the same slot together"
                )
        first = np.asarray(ops.plain(data[:, 0]), float)
        found = [p.constant + p.coefficients @ first for p in (self.price, *self.most_price)]
        return found[0], np.array(found[1:])

    def limits(self, energy: Array, data: Array) -> tuple[Array, Array]:
        """(units, batch) least and most charging power, MW, that keep every unit in its band.

        Efficiencies are in it; negative is discharging.
        """
        ops = namespace(energy)
        charge, discharge = (most(ops, data) for most in self.most)
        room, stock = self._room(ops, energy), self._stock(ops, energy)
        return -ops.between(stock, discharge), ops.between(room, charge)

    def masked(self, ops: Any, energy: Array, action: Array, data: Array) -> tuple[Array, Array]:
        """(units, batch) charging and discharging power, MW: the action within `limits`."""
        most = [limit(ops, data) for limit in self.most]
        charge = ops.between(self._room(ops, energy), action, most[0])
        return charge, ops.between(self._stock(ops, energy), -action, most[1])

    def _room(self, ops: Any, energy: Array) -> Array:
        """(units, batch) charging power that fills the unit, MW."""
        return ops.times(self._high.of(ops) - energy, self._per_gain.of(ops))

    def _stock(self, ops: Any, energy: Array) -> Array:
        """(units, batch) discharging power that empties the unit, MW."""
        return ops.times(energy - self._low.of(ops), self._per_drain.of(ops))

    def after(self, energy: Array, charge: Array, discharge: Array) -> Array:
        """(units, batch) stored energy at the end of the step, MWh."""
        ops = namespace(energy)
        found: Array = ops.plus(self._gain.of(ops) * charge, energy)
        return ops.less(found, self._drain.of(ops) * discharge)
