"""Slots held against the stage's own numbers, whoever stepped them: limits, rows of which all is
known, balances, structures and costs.

Violations are scaled as in `models.program.referee`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.program.referee import Audit
from resilience.models.simulator import MilpSimulator, Step
from resilience.models.simulator.plant import DELIVERY, LEVEL, STATE
from resilience.models.structures import Adjacent, Disc, Largest, Split
from resilience.simulation.observation import Observation
from resilience.simulation.slots import Stepper
from resilience.tolerances import AUDIT_TOLERANCE, BOUND_TOLERANCE

Shape = tuple[int, ...]


class _RowsBySize:
    """Some rows of a matrix, and their absolute values."""

    def __init__(self, a: sp.csr_array) -> None:
        self.a, self.size = a, abs(a)


@dataclass
class StageAudit:
    """What was found of some slots so far.

    Attributes:
        plant: the stage, as it is stepped.
        place: where an element of the arrays is, in words, by its slot and episode.
        worst: largest scaled violation, by name.
        where: likewise, in which element, slot and episode that is.
        places: columns of the form that are known, in the order of `placed`.
    """

    plant: Stepper
    place: Callable[[int, int], str]
    worst: dict[str, float] = field(default_factory=dict)
    where: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        plant = self.plant
        self.form, stored = plant.form, [*plant.stored]
        now, none = np.arange(self.form.n_now), np.empty(0, np.intp)
        energy = plant.positions(STATE) if plant.units else none
        level = plant.positions(LEVEL) if plant.tanks else none
        if isinstance(plant, MilpSimulator):
            self.places = np.concatenate([now, *stored, plant.sources, plant.decided])
        else:
            self.places = np.concatenate([now, energy, level, *stored, plant.sources])
        self.fixed_by_data = self._fixed_by_data()
        hidden = np.ones(self.form.n_columns, bool)
        hidden[self.places] = hidden[self.fixed_by_data] = False
        self.matrix = self.form.a.tocsr()
        touches: Floats = abs(self.matrix) @ hidden.astype(float)
        balance = np.zeros(self.form.n_rows, bool)
        balance[plant.balance_rows] = True
        self.rows: Ints = np.flatnonzero((touches == 0) & ~balance)
        self._known_rows = _RowsBySize(self.matrix[self.rows])
        self._balance_rows = _RowsBySize(self.matrix[plant.balance_rows])
        self.structures = [
            (structure, matrices)
            for structure, matrices in self.form.structures
            if isinstance(structure, Split | Largest | Adjacent | Disc)
            and not any((abs(m) @ hidden.astype(float)).any() for m in matrices)
        ]

    def _fixed_by_data(self) -> Ints:
        """Columns that data hold at a value, as deliveries."""
        form = self.form
        columns = [form.columns(block) for block in form.own_blocks if block.name == DELIVERY]
        return np.concatenate([np.empty(0, np.intp), *columns])

    def note(self, name: str, violation: Floats, slots: Ints, labels: tuple[str, ...] = ()) -> None:
        """Takes in violations (elements, slots, scenarios) of one name."""
        if not violation.size:
            return
        k, t, episode = np.unravel_index(int(np.argmax(np.abs(violation))), violation.shape)
        value = float(np.abs(violation[k, t, episode]))
        if value >= self.worst.get(name, -1.0):
            label = f"{labels[k]}, " if labels else ""
            self.worst[name] = value
            self.where[name] = f"{name}[{label}{self.place(int(slots[t]), int(episode))}"

    def placed(self, parts: list[Floats]) -> Floats:
        """(columns of the form, nodes) parts of `places`, (rows, ..., scenarios), else 0."""
        nodes = int(np.prod(parts[0].shape[1:]))
        z = np.zeros((self.form.n_columns, nodes))
        z[self.places] = np.concatenate(parts).reshape(len(self.places), nodes)
        return z

    def judge(
        self,
        z: Floats,
        stacked: Floats,
        island: Ints,
        cost: Floats,
        spill: Floats | None,
        slots: Ints,
    ) -> None:
        """Judges some slots of all scenarios, slot by slot in every array.

        Args:
            z: (columns of the form, nodes) what is known, as of `placed`.
            stacked: (data of the form, nodes).
            island: (buses, nodes) whose balances are judged together.
            cost: (slots, scenarios) $ as stated.
            spill: (slots, scenarios) MW as stated; None: not told.
            slots: which.
        """
        low, high, sides, prices = self.form.numbers(stacked)
        z[self.fixed_by_data] = low[self.fixed_by_data - self.form.n_now]
        shape = (-1, *cost.shape)
        self._judge_bounds(z, low, high, slots, shape)
        self._judge_rows(z, sides, slots, shape)
        self._judge_balance(z, sides, island, spill, slots, shape)
        for structure, matrices in self.structures:
            args = [m @ z + a.const[:, None] for m, a in zip(matrices, structure.args, strict=True)]
            limits = [np.asarray(limit)[:, None] for limit in structure.limits]
            violation = structure.violation(args, limits).reshape(shape)
            self.note(structure.name, violation, slots, tuple(structure.labels))
        spent = (prices * z).sum(0) + self.form.offsets(stacked)
        reach = np.abs(prices).max(axis=0, initial=0.0) * np.abs(z).max(axis=0, initial=0.0)
        allowed = BOUND_TOLERANCE * np.maximum(np.maximum(np.abs(spent), reach), 1e-300)
        off = AUDIT_TOLERANCE * np.abs(cost.ravel() - spent) / allowed
        self.note("cost", off.reshape(shape), slots)

    def judge_integers(self, z: Floats, slots: Ints, n: int) -> None:
        """What is decided whole is whole; `z` (columns of the form, slots * n)."""
        columns = self.form.n_now + np.flatnonzero(self.form.integer)
        off = np.abs(z[columns] - np.round(z[columns]))
        self.note("integrality", off.reshape(len(columns), len(slots), n), slots)

    def _judge_bounds(
        self, z: Floats, low: Floats, high: Floats, slots: Ints, shape: Shape
    ) -> None:
        """Limits of what is known, by variable."""
        for block in self.form.own_blocks:
            columns = self.form.columns(block)
            # Of voltages those alone are known at which something flows to earth.
            inside = np.flatnonzero(np.isin(columns, self.places))
            if not len(inside):
                continue
            rows, x = columns[inside] - self.form.n_now, z[columns[inside]]
            excess = np.maximum(_beyond(x, high[rows]), _beyond(-x, -low[rows]))
            violation = np.maximum(excess, 0.0).reshape(shape)
            self.note(block.name, violation, slots, tuple(block.labels[k] for k in inside))

    def _judge_rows(self, z: Floats, sides: Floats, slots: Ints, shape: Shape) -> None:
        """Rows of which everything is known, as the dynamics of storage."""
        if not len(self.rows):
            return
        equality = self.form.equality[self.rows]
        violation = _row_violations(self._known_rows, z, sides[self.rows], equality)
        starts = self.form.row_start
        owner = np.searchsorted(starts, self.rows, side="right") - 1
        for r in np.unique(owner):
            row, mine = self.form.stage.rows[r], owner == r
            labels = tuple(row.labels[i - starts[r]] for i in self.rows[mine])
            self.note(row.name, violation[mine].reshape(shape), slots, labels)

    def _judge_balance(
        self,
        z: Floats,
        sides: Floats,
        island: Ints,
        spill: Floats | None,
        slots: Ints,
        shape: Shape,
    ) -> None:
        """What is fed into every island is taken there, but for what is spilled."""
        rows, sides = self._balance_rows, sides[self.plant.balance_rows]
        bus = rows.a @ z - sides
        terms = rows.size @ np.abs(z) + np.abs(sides)
        surplus, scale = _island_sums(bus, island), 1.0 + _island_sums(terms, island)
        left_over = np.maximum(surplus, 0.0)
        self.note("balance.p", (np.minimum(surplus, 0.0) / scale).reshape(shape), slots)
        if spill is not None:
            off = (left_over.sum(0) - spill.ravel()) / scale.max(0)
            self.note("spill", off.reshape(shape), slots)


def _beyond(x: Floats, limit: Floats) -> Floats:
    finite = np.isfinite(limit)
    return np.where(finite, (x - limit) / (1.0 + np.abs(np.where(finite, limit, 0.0))), 0.0)


def _row_violations(rows: _RowsBySize, z: Floats, sides: Floats, equality: Bools) -> Floats:
    """(rows, n) scaled violation of rows a z = sides, or <= where they are no equations."""
    off = rows.a @ z - sides
    scale = 1.0 + np.maximum(rows.size @ np.abs(z), np.abs(sides))
    return np.where(equality[:, None], np.abs(off), np.maximum(off, 0.0)) / scale


def _island_sums(values: Floats, island: Ints) -> Floats:
    """(islands, n) sums of values (buses, n) by the number of each bus's island, from 0."""
    sums = np.zeros_like(values)
    np.add.at(sums, (island, np.arange(values.shape[1])[None, :]), values)
    return sums


def audit_step(audit: StageAudit, observation: Observation, stacked: Floats, step: Step) -> Audit:
    """Worst scaled violations of one slot, by name.

    Args:
        audit: of the stage; what it holds of earlier slots is forgotten.
        observation: of the slot: what its states were at the start.
        stacked: (n_data, batch) data of the slot.
        step: what is said to follow.
    """
    audit.worst, audit.where = {}, {}
    slots, n = np.array([observation.t]), observation.energy.shape[1]
    storage = step.discharge - step.charge
    moved = [np.maximum(-storage, 0.0), np.maximum(storage, 0.0), step.flows]
    before: Mapping[str, Floats] = {**observation.states, STATE: observation.energy}
    levels = [] if observation.fuel is None else [observation.fuel]
    island = observation.island
    if isinstance(audit.plant, MilpSimulator):
        before = {**before, **({LEVEL: levels[0]} if levels else {})}
        assert step.decisions is not None  # of such a simulator
        states = [before[after.name] for _, after in audit.form.stage.states]
        z = audit.placed([*states, *moved, step.decisions])
        island = np.repeat(np.arange(len(island))[:, None], n, axis=1)
        audit.judge_integers(z, slots, n)
    else:
        after = [] if step.fuel is None else [step.fuel]
        z = audit.placed([observation.energy, *levels, step.energy, *after, *moved])
    spill = step.spill.sum(0)[None]
    audit.judge(z, stacked, island, np.reshape(step.cost, (1, n)), spill, slots)
    return Audit(dict(audit.worst), dict(audit.where))
