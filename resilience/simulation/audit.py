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

from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import CertificateError
from resilience.models.program import gate
from resilience.models.program.referee import Audit
from resilience.models.simulator.arrays import array_ops
from resilience.models.simulator.plant import LEVEL, STATE
from resilience.simulation.slots import NODES, stretch_data
from resilience.simulation.stage_audit import StageAudit

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
        judged.judge_slots(np.arange(first, min(first + size, world.microgrid.case.slots)))
    if trajectory.left_mwh is not None and not world.reset_daily:
        apart = trajectory.left_mwh - trajectory.energy[:, -1].sum(0)
        judged.note("left_mwh", apart[None, None], np.array([world.microgrid.case.slots - 1]))
    return Audit(judged.worst, judged.where)


class _Judged(StageAudit):
    """A trajectory in its world.

    Args:
        world: where it happened.
        trajectory: what happened.
    """

    def __init__(self, world: World, trajectory: Trajectory) -> None:
        super().__init__(world.simulator, self._place)
        self.world, self.trajectory = world, trajectory

    def _place(self, slot: int, episode: int) -> str:
        label = self.world.microgrid.case.slot_label(slot)
        return f"{label}] in episode {int(self.world.index[episode])}"

    def judge_slots(self, slots: Ints) -> None:
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
        island = np.asarray(situation.island)
        if self.trajectory.decisions is not None:  # what flows on lines is known, too
            island = np.repeat(np.arange(len(island))[:, None], len(slots) * n, axis=1)
            self.judge_integers(z, slots, n)
            self._judge_states(slots)
        spill = self.trajectory.spill
        spilled = None if spill is None else spill[slots]
        self.judge(z, stacked, island, self.trajectory.cost[slots], spilled, slots)

    def _point(self, slots: Ints) -> Floats:
        """(columns of the form, slots * scenarios) what is known of the stage's columns, else 0."""
        run = self.trajectory
        nothing = np.empty((0, len(slots), run.n))
        fuel = nothing if run.fuel is None else run.fuel[:, slots]
        if run.decisions is not None:
            charge, discharge = (np.maximum(w * run.storage[:, slots], 0.0) for w in (-1.0, 1.0))
            parts = [*self._before(slots), charge, discharge, run.flows[:, slots]]
            return self.placed([*parts, run.decisions[:, slots]])
        parts = [
            run.energy[:, slots],
            fuel,
            self._after(slots),
            nothing if run.fuel is None else self._fuel_after(run.fuel, slots),
            np.maximum(-run.storage[:, slots], 0.0),
            np.maximum(run.storage[:, slots], 0.0),
            run.flows[:, slots],
        ]
        return self.placed(parts)

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
