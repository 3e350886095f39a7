"""Dispatchers and episodes: everybody faces the same storms, and sees what an operator sees."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case, Outage
from resilience.errors import UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.network.situation import Situation
from resilience.models.simulator import NetworkSimulator, Simulator
from resilience.simulation.forecast import Outlook
from resilience.simulation.slots import Slot, Slots, Stepper
from resilience.simulation.trajectory import Trajectory

__all__ = ["Dispatcher", "Forecast", "Observation", "Trajectory", "World", "simulate", "stepper"]
Forecast = Callable[[str | None, Ints], Floats]


@dataclass(frozen=True)
class Observation:
    """What an operator sees at the start of a slot, for a batch of scenarios.

    Attributes:
        t: the slot.
        energy: (units, batch) stored energy, MWh.
        line_up: (lines of the case, batch) which lines are up now; a failure is seen in its slot.
        island: (buses of the merged graph, batch) number of each bus's island.
        centre: (batch,) slot of 15 minutes at which today's hazard is forecast to peak, -1 where
            unknown.
        forecast: per-unit values of a profile by its name (None: constant 1) and slots from `t`
            on, (len(slots), batch): true now, expected later.
    """

    t: int
    energy: Floats
    line_up: Bools
    island: Ints
    centre: Ints
    forecast: Forecast

    def forecast_of(self, k: int) -> Forecast:
        """The forecast of scenario k alone, (len(slots),)."""
        return lambda name, slots: self.forecast(name, slots)[:, k]


class Dispatcher(Protocol):
    """Decides the storage power; the rest of the island follows by recourse."""

    name: str

    def act(self, seen: Observation) -> Floats:
        """(units, batch) charging power in MW, negative when discharging."""


@dataclass(frozen=True)
class World:
    """The microgrid, its simulator, and the storms of an evaluation.

    Attributes:
        end_value_per_mwh: credit for energy left at the end; everybody knows it.
        outlook: errors of the forecast; None: load and PV come as the profiles say.
        known_centre: operators are told at midnight where the day's hazard is forecast to peak.
        reset_daily: the state of charge starts anew every midnight.
        numbers: (scenarios,) what the scenarios are called where they are a part of more; None:
            0, 1, ... See `index`.
    """

    microgrid: Microgrid
    simulator: Stepper
    scenarios: Scenarios
    end_value_per_mwh: float
    outlook: Outlook | None = None
    known_centre: bool = True
    reset_daily: bool = False
    numbers: Ints | None = None

    @classmethod
    def of(
        cls,
        microgrid: Microgrid,
        scenarios: Scenarios,
        *,
        end_value_per_mwh: float | None = None,
        outlook: Outlook | None = None,
        known_centre: bool = True,
        reset_daily: bool = False,
    ) -> World:
        """The world of a microgrid, simulated at the microgrid's own physics.

        Args:
            microgrid: the microgrid.
            scenarios: its storms.
            end_value_per_mwh: the case's terminal value if omitted.
            outlook: errors of the forecast.
            known_centre: operators are told where the day's hazard is forecast to peak.
            reset_daily: the state of charge starts anew every midnight.

        Raises:
            UsageError: storms of another horizon, or physics that nothing simulates.
        """
        if end_value_per_mwh is None:
            end_value_per_mwh = microgrid.case.terminal_value_per_mwh
        if scenarios.slots != microgrid.case.slots:
            raise UsageError(
                f"scenarios of {scenarios.slots} slots; "
                f"allowed: {microgrid.case.slots}, as the case",
                hint="draw them for the horizon of the evaluation, `held_out(case, days)`",
            )
        stepped = stepper(microgrid)
        return cls(
            microgrid, stepped, scenarios, end_value_per_mwh, outlook, known_centre, reset_daily
        )

    @property
    def index(self) -> Ints:
        """(scenarios,) number of every scenario in the whole comparison.

        Whoever draws random numbers takes a stream per scenario that is keyed by this number, such
        as `default_rng([seed, number])`, so that no split into parts changes what is drawn.
        """
        return np.arange(self.scenarios.n) if self.numbers is None else self.numbers

    def part(self, at: Ints) -> World:
        """The same world with some of its scenarios; they keep their numbers."""
        outlook = self.outlook
        if outlook is not None:
            outlook = replace(outlook, error=outlook.error[:, :, at])
        storms = self.scenarios.chosen(at)
        return replace(self, scenarios=storms, outlook=outlook, numbers=self.index[at])

    def __getstate__(self) -> dict[str, Any]:
        # A simulator is made anew where it arrives: it may hold what cannot travel.
        kept = {f.name: getattr(self, f.name) for f in fields(self)}
        return kept | {"simulator": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state | {"simulator": stepper(state["microgrid"])})

    @cached_property
    def line_up(self) -> Bools:
        """(lines of the case, slots, scenarios) False where a line is down."""
        return self.scenarios.line_up(self.microgrid.case.network.line_names)

    @cached_property
    def day(self) -> Ints:
        """(slots,) number of the day of every slot; days begin at midnight."""
        window = self.microgrid.case.window
        return (window.slots_before_start + np.arange(window.slots)) // window.slots_per_day

    @cached_property
    def ends(self) -> Ints:
        """Slots at whose end the energy left is credited: the last, or the last of every day."""
        last = self.microgrid.case.slots - 1
        if not self.reset_daily:
            return np.array([last])
        return np.append(np.flatnonzero(np.diff(self.day)), last)

    def profile(self, name: str | None, slots: Ints) -> Floats:
        """(len(slots), scenarios) what a profile really is."""
        values = self.microgrid.case.profile(name)[slots]
        if self.outlook is None:
            return np.broadcast_to(values[:, None], (len(values), self.scenarios.n))
        return self.outlook.true(name, values, slots)

    def forecast(self, now: int) -> Forecast:
        """What is expected of profiles at slot `now`; see `Observation.forecast`."""
        outlook = self.outlook
        if outlook is None:
            return self.profile
        case = self.microgrid.case
        return lambda name, slots: outlook.expected(name, case.profile(name)[slots], slots, now)

    def situation(self, t: int) -> Situation:
        """Slot t in every scenario: the scenarios are the nodes."""
        now = np.array([t])
        return self.microgrid.situation(self.line_up[:, t], lambda name: self.profile(name, now)[0])

    @cached_property
    def _slots(self) -> Slots:
        return Slots(self.microgrid, self.simulator, self.line_up, self.profile)

    def slot(self, t: int) -> Slot:
        """Data and islands of slot t in every scenario."""
        return self._slots[t]

    def centre(self, t: int) -> Ints:
        """(scenarios,) what operators know of the hazard's peak on slot t's day; -1: nothing."""
        centre, day = self.scenarios.centre, int(self.day[t])
        if centre is None or day >= len(centre) or not self.known_centre:
            return np.full(self.scenarios.n, -1)
        return centre[day]

    def start(self) -> Floats:
        """(units, scenarios) MWh stored at the start."""
        energy = self.microgrid.start()["ess.energy"] if self.microgrid.case.ess else np.empty(0)
        return np.repeat(energy[:, None], self.scenarios.n, axis=1)


def stepper(microgrid: Microgrid) -> Stepper:
    """What simulates a microgrid at its physics: by arithmetic where lines carry anything, by a
    linear program per slot where they have ratings or voltages.

    Raises:
        UsageError: physics, or devices, that nothing simulates.
    """
    if microgrid.physics == "copperplate" and not np.isfinite(microgrid.network.rating_mva).any():
        return Simulator(microgrid, microgrid.case.step_h)
    return NetworkSimulator(microgrid, microgrid.case.step_h)


def simulate(
    world: World, dispatcher: Dispatcher, on_slot: Callable[[], None] | None = None
) -> Trajectory:
    """Runs a dispatcher through all scenarios at once.

    Args:
        world: the storms.
        dispatcher: a fresh one; it may remember what it has seen.
        on_slot: called after every slot.
    """
    case, simulator, n = world.microgrid.case, world.simulator, world.scenarios.n
    energy = start = world.start()
    left = np.zeros(n)
    run = Trajectory.blank(dispatcher.name, simulator.columns, case, n)
    run.energy[:, 0] = energy
    seconds = cpu = 0.0
    ends = set(world.ends.tolist())
    for t in range(case.slots):
        now, up = world.slot(t), world.line_up[:, t]
        seen = Observation(t, energy, up, now.island, world.centre(t), world.forecast(t))
        began = time.perf_counter(), time.process_time()
        action = dispatcher.act(seen)
        seconds += time.perf_counter() - began[0]
        cpu += time.process_time() - began[1]
        step = simulator.step(energy, action, now.stacked, now.island)
        run.record(t, step)
        energy = step.energy
        if t in ends:
            left += energy.sum(0)
            energy = start if t + 1 < case.slots else energy
        run.energy[:, t + 1] = energy
        if on_slot is not None:
            on_slot()
    return replace(run, left_mwh=left, seconds=seconds, cpu_seconds=cpu)


def grid_with_fallible_lines(case: Case, scenarios: Scenarios, physics: Physics) -> Microgrid:
    """The microgrid in which every line of the scenarios can fail."""
    hit = {outage.line for outage in case.outages}
    more = tuple(Outage(line, 0, 1) for line in scenarios.lines if line not in hit)
    return Microgrid.of(case.replace(outages=(*case.outages, *more)) if more else case, physics)
