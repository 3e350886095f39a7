"""From a state that was told to what a dispatcher observes, by the simulator's own path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.simulator import Decision, MilpSimulator, Step
from resilience.operation.state import State, carried_labels
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.slots import Slot, Slots
from resilience.simulation.stepping import stepped


@dataclass(frozen=True)
class CarriedOver:
    """What goes from one decision to the next, beside what the dispatcher remembers.

    Attributes:
        t: slot last decided; -1: none.
        line_up: (elements of the case, 1) what was in order then.
        energy: (units, 1) MWh stored at its end, as decided.
        fuel: (tanks, 1) m³ likewise; None without tanks.
        devices: what devices carry likewise, (devices, 1) by name of the state.
    """

    t: int
    line_up: Bools
    energy: Floats
    fuel: Floats | None
    devices: Mapping[str, Floats] = field(default_factory=dict)

    @classmethod
    def at_start(cls, setting: Setting) -> CarriedOver:
        """What a case says of its start."""
        up = np.ones((len(setting.case.elements), 1), bool)
        return cls(-1, up, setting.start(), setting.start_fuel(), setting.start_states())

    @classmethod
    def after(cls, observation: Observation, step: Step) -> CarriedOver:
        """What is carried on from a slot that was decided."""
        return cls(observation.t, observation.line_up, step.energy, step.fuel, step.states)


class Present:
    """Makes observations of states, and steps decisions, in one setting.

    Args:
        setting: where decisions are made.
    """

    def __init__(self, setting: Setting) -> None:
        self.setting, self.simulator = setting, setting.simulator
        self.labels = carried_labels(setting)
        self.tanks = [tank.name for tank in setting.case.tank]
        self._rows = dict[str, list[int]]()
        if isinstance(self.simulator, MilpSimulator):
            self.simulator.restart()

    def observed(self, state: State, carried: CarriedOver) -> tuple[Observation, Slot]:
        """What is observed of a state; what it does not tell is as carried."""
        fuel = carried.fuel
        if fuel is not None:
            levels = [state.fuel.get(name, fuel[k, 0]) for k, name in enumerate(self.tanks)]
            fuel = np.array(levels, float)[:, None]
        devices = {
            name: self._told(state.devices.get(name, {}), labels, carried.devices[name])
            for name, labels in self.labels.items()
        }
        before = carried.line_up if state.line_up_before is None else state.line_up_before
        return self._observation(state, before, fuel, devices)

    @staticmethod
    def _told(values: Mapping[str, float], labels: tuple[str, ...], carried: Floats) -> Floats:
        """(devices, 1) what is told of a state, else what is carried."""
        rows = [values.get(name, carried[k, 0]) for k, name in enumerate(labels)]
        return np.array(rows, float)[:, None]

    def missed(self, t: int, carried: CarriedOver) -> Observation:
        """What is taken for slot `t` of which nothing was told: lines and storage as before."""
        state = State(
            t, carried.energy, carried.line_up, None, {}, {}, -1, {}, (), {}
        )  # fmt: skip
        return self.observed(state, carried)[0]

    def ahead(self, observation: Observation, carried: CarriedOver) -> tuple[Observation, Slot]:
        """The slot after the one carried from, if all comes as `observation` forecast it."""
        before = carried.line_up
        slots = self._slots(carried.t + 1, before, before, observation)
        return self._seen(carried.t + 1, carried.energy, slots, before, observation, carried)

    def _observation(
        self,
        state: State,
        before: Bools,
        fuel: Floats | None,
        devices: Mapping[str, Floats],
    ) -> tuple[Observation, Slot]:
        case, t = self.setting.case, state.t

        def forecast(name: str | None, slots: Ints) -> Floats:
            slots = np.minimum(slots, case.slots - 1)
            values = case.profile(name)[slots]
            stated = None if name is None else state.forecast.get(name)
            if stated is not None:
                within = (slots >= t) & (slots < t + len(stated))
                values[within] = stated[slots[within] - t]
            return values[:, None]

        blank = Observation(
            t,
            state.energy,
            state.line_up,
            np.empty(0, np.intp),
            np.array([state.centre]),
            forecast,
            np.empty(0),
        )
        slots = self._slots(t, before, state.line_up, blank)
        carried = CarriedOver(t - 1, before, state.energy, fuel, devices)
        return self._seen(t, state.energy, slots, state.line_up, blank, carried)

    def _slots(self, t: int, before: Bools, now: Bools, observation: Observation) -> Slots:
        """Slot `t` as the simulator has it, and nothing of those behind it."""
        microgrid = self.setting.microgrid
        line_up = np.ones((len(now), self.setting.case.slots, 1), bool)
        line_up[:, t] = now
        if t > 0:
            line_up[:, t - 1] = before
        return Slots(microgrid, self.simulator, line_up, observation.forecast, length=1)

    def _seen(
        self,
        t: int,
        energy: Floats,
        slots: Slots,
        line_up: Bools,
        observation: Observation,
        carried: CarriedOver,
    ) -> tuple[Observation, Slot]:
        slot = slots.with_energy(t, energy)
        before = carried.line_up if t > 0 else np.ones_like(line_up)
        complete = replace(
            observation,
            t=t,
            energy=energy,
            line_up=line_up,
            island=slot.island,
            data=slot.stacked,
            fuel=carried.fuel,
            states=carried.devices,
            line_up_before=before,
        )
        return complete, slot

    def flow(self, slot: Slot, step: Step, name: str) -> Floats:
        """(devices,) MW of a flow in a step, or a datum of its slot."""
        moved = {"ess.charge": step.charge, "ess.discharge": step.discharge}
        if name in moved:
            return moved[name][:, 0]
        if name not in self._rows:
            columns = enumerate(self.simulator.columns)
            self._rows[name] = [k for k, column in columns if column.startswith(name + "[")]
        rows = self._rows[name]
        return step.flows[rows, 0] if rows else slot.data[name][:, 0]

    def step(self, observation: Observation, decision: Decision) -> Step:
        """What a decision leads to, as simulated."""
        return stepped(self.simulator, observation, decision)


def by_name(names: Sequence[str], values: Floats) -> dict[str, float]:
    """Values (units,) as plain numbers, by the names of the units."""
    return {name: float(x) + 0.0 for name, x in zip(names, values, strict=True)}
