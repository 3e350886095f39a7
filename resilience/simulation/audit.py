"""The referee of trajectories: what was simulated, replayed or read from a file, judged by the
stage and not by what stepped it.

Every slot of every scenario is held against the stage's own numbers: limits of what was dispatched,
the dynamics of storage and tanks, the balance of every island, and the price of it all. Violations
are scaled as in `models.program.referee`. What flows on lines, voltages and reactive power are not
part of a trajectory without `decisions`; rows that need them are not judged there, AC power flow
(`--ac`) does. With them every row of the stage is judged, minimum times, ramps and radiality
included, every structure, and that what is whole is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import CertificateError
from resilience.models.program import gate
from resilience.models.program.referee import Audit
from resilience.models.simulator import MilpSimulator
from resilience.models.simulator.arrays import array_ops
from resilience.models.simulator.plant import DELIVERY, LEVEL, STATE
from resilience.models.structures import Adjacent, Disc, Largest, Split
from resilience.simulation.slots import NODES, stretch_data
from resilience.tolerances import AUDIT_TOLERANCE, BOUND_TOLERANCE

if TYPE_CHECKING:
    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import World


def check_trajectory(world: World, trajectory: Trajectory) -> None:
    """Refuses a trajectory that cannot have happened in a world.

    Args:
        world: where it is said to have happened.
        trajectory: what is said to have happened.

    Raises:
        CertificateError: shapes or numbers that are none, or the worst of what does not hold: a
            limit, a balance, the dynamics of storage, a cost.
    """
    check_shapes(world, trajectory)
    try:
        gate.check_audit(audit_trajectory(world, trajectory), ())
    except CertificateError as error:
        raise CertificateError(
            f"the trajectory of {trajectory.name!r}: {error.message}", hint=error.hint
        ) from None


def check_shapes(world: World, trajectory: Trajectory) -> None:
    """Refuses arrays that are not of a world's slots, scenarios and devices, or hold no numbers.

    Raises:
        CertificateError: likewise; the first is named.
    """
    simulator, n = world.simulator, world.scenarios.n
    slots, units = world.microgrid.case.slots, len(simulator.units)
    tanks = len(simulator.tanks)
    shapes = {
        "cost": (slots, n),
        "energy": (units, slots + 1, n),
        "storage": (units, slots, n),
        "flows": (len(simulator.columns), slots, n),
        "spill": (slots, n),
        "left_mwh": (n,),
        "proven": (n,),
        "fuel": (tanks, slots + 1, n),
        "decisions": (len(simulator.decision_columns), slots, n),
    }
    for name, shape in shapes.items():
        array = getattr(trajectory, name)
        if array is None:
            continue
        if np.shape(array) != shape or np.asarray(array).dtype.kind != "f":
            raise _impossible(trajectory, f"{name} has the shape {np.shape(array)}, not {shape}")
        if not np.isfinite(array).all():
            raise _impossible(trajectory, f"{name} holds values that are no numbers")
    if tanks and trajectory.fuel is None:
        raise _impossible(trajectory, "it tells nothing of fuel")
    if simulator.decision_columns and trajectory.decisions is None:
        raise _impossible(trajectory, "it tells nothing of commitment, ramps, curves or switches")
    if trajectory.decision_columns != simulator.decision_columns:
        raise _impossible(trajectory, f"it decides {', '.join(trajectory.decision_columns)}")
    if trajectory.columns != simulator.columns:
        raise _impossible(trajectory, f"its sources are {', '.join(trajectory.columns)}")
    if trajectory.step_h != world.microgrid.case.step_h:
        raise _impossible(trajectory, f"its slots last {trajectory.step_h:g} h")


def _impossible(trajectory: Trajectory, reason: str) -> CertificateError:
    return CertificateError(
        f"the trajectory of {trajectory.name!r} is none of this world: {reason}", hint=gate.HINT
    )


def audit_trajectory(world: World, trajectory: Trajectory) -> Audit:
    """Worst scaled violations of a trajectory of the right shapes, by name.

    Args:
        world: where it happened.
        trajectory: what happened.
    """
    judged = _Judged(world, trajectory)
    judged.note("start", (trajectory.energy[:, 0] - world.start())[:, None], np.zeros(1, np.intp))
    fuel = world.setting.start_fuel()
    if fuel is not None and trajectory.fuel is not None:
        judged.note("start", (trajectory.fuel[:, 0] - fuel)[:, None], np.zeros(1, np.intp))
    size = max(NODES // max(world.scenarios.n, 1), 1)
    for first in range(0, world.microgrid.case.slots, size):
        judged.judge(np.arange(first, min(first + size, world.microgrid.case.slots)))
    if trajectory.left_mwh is not None and not world.reset_daily:
        apart = trajectory.left_mwh - trajectory.energy[:, -1].sum(0)
        judged.note("left_mwh", apart[None, None], np.array([world.microgrid.case.slots - 1]))
    return Audit(judged.worst, judged.where)


@dataclass
class _Judged:
    """What was found so far.

    Attributes:
        world: where it happened.
        trajectory: what happened.
        worst: largest scaled violation, by name.
        where: likewise, in which element, slot and episode that is.
    """

    world: World
    trajectory: Trajectory
    worst: dict[str, float] = field(default_factory=dict)
    where: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        plant = self.world.simulator
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
            slot = self.world.microgrid.case.slot_label(int(slots[t]))
            self.worst[name] = value
            number = int(self.world.index[episode])
            self.where[name] = f"{name}[{label}{slot}] in episode {number}"

    def judge(self, slots: Ints) -> None:
        """Judges some slots of all scenarios."""
        world, n = self.world, self.world.scenarios.n
        data, situation = stretch_data(
            world.microgrid,
            world.line_up,
            world.profile,
            slots,
            self.trajectory.energy[:, slots],
            with_before=world.simulator.needs_outage_begins,
        )
        stacked = np.broadcast_to(world.simulator.stacked(data), (self.form.n_data, len(slots) * n))
        z = self._point(slots)
        low, high, sides, prices = self.form.numbers(stacked)
        z[self.fixed_by_data] = low[self.fixed_by_data - self.form.n_now]
        shape = (-1, len(slots), n)
        self._judge_bounds(z, low, high, slots)
        self._judge_rows(z, sides, slots)
        island = np.asarray(situation.island)
        if self.trajectory.decisions is not None:  # what flows on lines is known, too
            island = np.repeat(np.arange(len(island))[:, None], len(slots) * n, axis=1)
            self._judge_integers(z, slots)
            self._judge_states(slots)
        self._judge_balance(z, sides, island, slots)
        for structure, matrices in self.structures:
            args = [m @ z + a.const[:, None] for m, a in zip(matrices, structure.args, strict=True)]
            limits = [np.asarray(limit)[:, None] for limit in structure.limits]
            violation = structure.violation(args, limits).reshape(shape)
            self.note(structure.name, violation, slots, tuple(structure.labels))
        spent = (prices * z).sum(0) + self.form.offsets(stacked)
        reach = np.abs(prices).max(axis=0, initial=0.0) * np.abs(z).max(axis=0, initial=0.0)
        stated = self.trajectory.cost[slots].ravel()
        allowed = BOUND_TOLERANCE * np.maximum(np.maximum(np.abs(spent), reach), 1e-300)
        off = AUDIT_TOLERANCE * np.abs(stated - spent) / allowed
        self.note("cost", off.reshape(shape), slots)

    def _point(self, slots: Ints) -> Floats:
        """(columns of the form, slots * scenarios) what is known of the stage's columns, else 0."""
        run = self.trajectory
        nothing = np.empty((0, len(slots), run.n))
        fuel = nothing if run.fuel is None else run.fuel[:, slots]
        if run.decisions is not None:
            charge, discharge = (np.maximum(w * run.storage[:, slots], 0.0) for w in (-1.0, 1.0))
            parts = [*self._before(slots), charge, discharge, run.flows[:, slots]]
            return self._placed([*parts, run.decisions[:, slots]], slots)
        parts = [
            run.energy[:, slots],
            fuel,
            self._after(slots),
            nothing if run.fuel is None else self._fuel_after(run.fuel, slots),
            np.maximum(-run.storage[:, slots], 0.0),
            np.maximum(run.storage[:, slots], 0.0),
            run.flows[:, slots],
        ]
        return self._placed(parts, slots)

    def _placed(self, parts: list[Floats], slots: Ints) -> Floats:
        """(columns of the form, slots * scenarios) parts (n, slots, scenarios) in their places."""
        z = np.zeros((self.form.n_columns, len(slots) * self.trajectory.n))
        z[self.places] = np.concatenate(parts).reshape(len(self.places), -1)
        return z

    def _before(self, slots: Ints) -> list[Floats]:
        """(labels, slots, scenarios) of every state at the start of some slots."""
        run, start = self.trajectory, self.world.setting.start_states()
        before = []
        begins = np.isin(slots - 1, [-1, *self.world.ends[:-1]])
        for _, after in self.form.stage.states:
            if after.name == STATE:
                before.append(run.energy[:, slots])
            elif after.name == LEVEL and run.fuel is not None:
                before.append(run.fuel[:, slots])
            else:
                first = start[after.name][:, None]
                before.append(
                    np.where(begins[None, :, None], first, run.decided(after.name)[:, slots - 1])
                )
        return before

    def _judge_integers(self, z: Floats, slots: Ints) -> None:
        """What is decided whole is whole."""
        columns = self.form.n_now + np.flatnonzero(self.form.integer)
        off = np.abs(z[columns] - np.round(z[columns]))
        self.note("integrality", off.reshape(len(columns), len(slots), self.trajectory.n), slots)

    def _judge_states(self, slots: Ints) -> None:
        """Energy and fuel of the next slot are those that this one ends with."""
        run = self.trajectory
        goes_on = slots[~np.isin(slots, self.world.ends[:-1])]
        for name, level in ((STATE, run.energy), (LEVEL, run.fuel)):
            if level is not None and len(goes_on):
                apart = level[:, goes_on + 1] - run.decided(name)[:, goes_on]
                self.note(name, apart / (1.0 + np.abs(level[:, goes_on + 1])), goes_on)

    def _after(self, slots: Ints) -> Floats:
        """(units, slots, scenarios) energy at the end; where the state is reset, what the dynamics
        make of the slot, since the trajectory goes on with the energy of the new day.
        """
        run, plant = self.trajectory, self.world.simulator
        after: Floats = run.energy[:, slots + 1].copy()
        reset = np.isin(slots, self.world.ends[:-1])
        charge, discharge = (np.maximum(sign * run.storage[:, slots], 0.0) for sign in (-1.0, 1.0))
        filled = run.energy[:, slots] + plant.gain[:, :, None] * charge
        after[:, reset] = (filled - plant.drain[:, :, None] * discharge)[:, reset]
        return after

    def _fuel_after(self, fuel: Floats, slots: Ints) -> Floats:
        """(tanks, slots, scenarios) fuel at the end; where it is reset, what was burnt leaves."""
        run, plant = self.trajectory, self.world.simulator
        after: Floats = fuel[:, slots + 1].copy()
        for k in np.flatnonzero(np.isin(slots, self.world.ends[:-1])):
            data = self.world.slot(int(slots[k])).stacked
            available = fuel[:, slots[k]] + plant.delivered(array_ops(data), data)
            after[:, k] = plant.fuel_after(available, plant.fuel_per_mw @ run.flows[:, slots[k]])
        return after

    def _judge_bounds(self, z: Floats, low: Floats, high: Floats, slots: Ints) -> None:
        """Limits of what is known, by variable."""
        places = set(self.places.tolist())
        for block in self.form.own_blocks:
            columns = self.form.columns(block)
            if not block.n or columns[0] not in places:
                continue
            rows, x = columns - self.form.n_now, z[columns]
            excess = np.maximum(_beyond(x, high[rows]), _beyond(-x, -low[rows]))
            violation = np.maximum(excess, 0.0).reshape(block.n, len(slots), -1)
            self.note(block.name, violation, slots, tuple(block.labels))

    def _judge_rows(self, z: Floats, sides: Floats, slots: Ints) -> None:
        """Rows of which everything is known, as the dynamics of storage."""
        if not len(self.rows):
            return
        violation = _row_violations(
            self.matrix[self.rows], z, sides[self.rows], self.form.equality[self.rows]
        )
        starts = self.form.row_start
        owner = np.searchsorted(starts, self.rows, side="right") - 1
        for r in np.unique(owner):
            row, mine = self.form.stage.rows[r], owner == r
            labels = tuple(row.labels[i - starts[r]] for i in self.rows[mine])
            self.note(row.name, violation[mine].reshape(mine.sum(), len(slots), -1), slots, labels)

    def _judge_balance(self, z: Floats, sides: Floats, island: Ints, slots: Ints) -> None:
        """What is fed into every island is taken there, but for what is spilled."""
        rows = self.world.simulator.balance_rows
        bus = self.matrix[rows] @ z - sides[rows]
        terms = np.abs(self.matrix[rows]) @ np.abs(z) + np.abs(sides[rows])
        surplus, scale = _island_sums(bus, island), 1.0 + _island_sums(terms, island)
        shape = (-1, len(slots), self.world.scenarios.n)
        spill = self.trajectory.spill
        left_over = np.maximum(surplus, 0.0)
        self.note("balance.p", (np.minimum(surplus, 0.0) / scale).reshape(shape), slots)
        if spill is not None:
            off = (left_over.sum(0) - spill[slots].ravel()) / scale.max(0)
            self.note("spill", off.reshape(shape), slots)


def _beyond(x: Floats, limit: Floats) -> Floats:
    finite = np.isfinite(limit)
    return np.where(finite, (x - limit) / (1.0 + np.abs(np.where(finite, limit, 0.0))), 0.0)


def _row_violations(a: sp.csr_array, z: Floats, sides: Floats, equality: Bools) -> Floats:
    """(rows, n) scaled violation of rows a z = sides, or <= where they are no equations."""
    off = a @ z - sides
    scale = 1.0 + np.maximum(abs(a) @ np.abs(z), np.abs(sides))
    return np.where(equality[:, None], np.abs(off), np.maximum(off, 0.0)) / scale


def _island_sums(values: Floats, island: Ints) -> Floats:
    """(islands, n) sums of values (buses, n) by the number of each bus's island, from 0."""
    sums = np.zeros_like(values)
    np.add.at(sums, (island, np.arange(values.shape[1])[None, :]), values)
    return sums
