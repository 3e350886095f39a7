"""The world of an evaluation: a microgrid, its simulator, and the storms that everybody faces."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case, Outage
from resilience.errors import UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.network.situation import Situation
from resilience.models.simulator import (
    MilpSimulator,
    NetworkSimulator,
    Simulator,
    needs_milp,
)
from resilience.models.simulator.simulator import RecourseRule
from resilience.simulation.forecast import Outlook
from resilience.simulation.observation import Forecast
from resilience.simulation.setting import CASE, Believed, Setting
from resilience.simulation.slots import Slot, Slots, Stepper, up_before


@dataclass(frozen=True)
class World:
    """The microgrid, its simulator, and the scenarios of an evaluation.

    Everybody who is compared acts in the same world. A dispatcher knows its `setting` alone: the
    case, the lines that can fail and what energy is worth. What happens is for the simulator.
    `compare` makes the usual world; `World.build` makes one from a microgrid and scenarios.

    Attributes:
        microgrid: the case at its physics; `world.microgrid.case` is the case.
        simulator: what steps it; `simulator.limits` says what storage can do.
        scenarios: outage paths over the horizon of the case, and their probabilities.
        end_value_per_mwh: credit for energy stored at the end, $ per MWh; everybody knows it.
        outlook: errors of the forecast; None: load and PV come as the profiles say.
        known_centre: operators are told at midnight where the day's hazard is forecast to peak.
        reset_daily: the state of charge starts anew every midnight.
        numbers: (scenarios,) what the scenarios are called where they are a part of more; None:
            0, 1, ... See `index`.
        recourse: how islands are closed, see `Simulator`; the bound's is always the cheapest.
        believed: what operators hold of outages to come; see `Setting.believed`.
    """

    microgrid: Microgrid
    simulator: Stepper
    scenarios: Scenarios
    end_value_per_mwh: float
    outlook: Outlook | None = None
    known_centre: bool = True
    reset_daily: bool = False
    numbers: Ints | None = None
    recourse: RecourseRule = "economic"
    believed: Believed = CASE

    @classmethod
    def build(
        cls,
        microgrid: Microgrid,
        scenarios: Scenarios,
        *,
        end_value_per_mwh: float | None = None,
        outlook: Outlook | None = None,
        known_centre: bool = True,
        reset_daily: bool = False,
        recourse: RecourseRule = "economic",
        believed: Believed = CASE,
    ) -> World:
        """The world of a microgrid, simulated at the microgrid's own physics.

        Args:
            microgrid: the microgrid.
            scenarios: outage paths, over the horizon of the microgrid's case.
            end_value_per_mwh: the case's terminal value if omitted.
            outlook: errors of the forecast; None: load and PV come as the profiles say.
            known_centre: operators are told where the day's hazard is forecast to peak.
            reset_daily: the state of charge starts anew every midnight.
            recourse: how islands are closed, see `Simulator`.
            believed: what operators hold of outages to come; see `Setting.believed`.

        Raises:
            UsageError: scenarios of another horizon, or physics that nothing simulates.
        """
        if end_value_per_mwh is None:
            end_value_per_mwh = microgrid.case.terminal_value_per_mwh
        for paths in (scenarios, believed):
            if isinstance(paths, Scenarios) and paths.slots != microgrid.case.slots:
                raise UsageError(
                    f"scenarios of {paths.slots} slots; "
                    f"allowed: {microgrid.case.slots}, as the case",
                    hint="draw them for the horizon of the evaluation, `held_out(case, days)`",
                )
        return cls(
            microgrid,
            stepper(microgrid, recourse),
            scenarios,
            end_value_per_mwh,
            outlook,
            known_centre,
            reset_daily,
            recourse=recourse,
            believed=believed,
        )

    @cached_property
    def setting(self) -> Setting:
        """What dispatchers may know of it beforehand."""
        return Setting(
            microgrid=self.microgrid,
            simulator=self.simulator,
            lines=self.scenarios.lines,
            numbers=self.index,
            end_value_per_mwh=self.end_value_per_mwh,
            known_centre=self.known_centre,
            reset_daily=self.reset_daily,
            error_correlation=None if self.outlook is None else self.outlook.correlation,
            ends=self.ends,
            believed=self.believed,
            error_law=None if self.outlook is None else self.outlook.law,
        )

    @property
    def index(self) -> Ints:
        """(scenarios,) number of every scenario in the whole comparison.

        Whoever draws random numbers takes a stream per scenario that is keyed by this number, such
        as `default_rng([seed, number])`, so that no split into parts changes what is drawn.
        """
        return np.arange(self.scenarios.n) if self.numbers is None else self.numbers

    def with_scenarios(self, places: Ints) -> World:
        """The same world with some of its scenarios; they keep their numbers."""
        outlook = self.outlook
        if outlook is not None:
            outlook = replace(outlook, error=outlook.error[:, :, places])
        chosen = self.scenarios.chosen(places)
        return replace(self, scenarios=chosen, outlook=outlook, numbers=self.index[places])

    def __getstate__(self) -> dict[str, Any]:
        # A simulator is made anew where it arrives: it may hold what cannot travel.
        state = {f.name: getattr(self, f.name) for f in fields(self)}
        return state | {"simulator": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        simulator = stepper(state["microgrid"], state["recourse"])
        self.__dict__.update(state | {"simulator": simulator})

    @cached_property
    def line_up(self) -> Bools:
        """(elements of the case, slots, scenarios) False where a line or unit is down."""
        return self.scenarios.status(self.microgrid.case.elements)

    def line_up_before(self, t: int) -> Bools:
        """(lines of the case, scenarios) status one slot before slot t; all up at the start."""
        return up_before(self.line_up, np.array([t]))[:, 0]

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
        """(len(slots), scenarios) what a profile really is; beyond the end its last slot."""
        slots = np.minimum(slots, self.microgrid.case.slots - 1)
        values = self.microgrid.case.profile(name)[slots]
        if self.outlook is None:
            return np.broadcast_to(values[:, None], (len(values), self.scenarios.n))
        return self.outlook.true(name, values, slots)

    def forecast(self, now: int) -> Forecast:
        """What is expected of profiles at slot `now`; see `Observation.forecast`."""
        case, outlook, n = self.microgrid.case, self.outlook, self.scenarios.n

        def expected(name: str | None, slots: Ints) -> Floats:
            slots = np.minimum(slots, case.slots - 1)
            values = case.profile(name)[slots]
            if outlook is None:
                return np.broadcast_to(values[:, None], (len(values), n))
            return outlook.expected(name, values, slots, now)

        return expected

    def situation(self, t: int) -> Situation:
        """Slot t in every scenario: the scenarios are the nodes."""
        now = np.array([t])
        return self.microgrid.situation(self.line_up[:, t], lambda name: self.profile(name, now)[0])

    @cached_property
    def _slots(self) -> Slots:
        return Slots(self.microgrid, self.simulator, self.line_up, self.profile)

    def slot(self, t: int, energy: Floats | None = None) -> Slot:
        """Data and islands of slot t in every scenario.

        Args:
            t: the slot.
            energy: (units, scenarios) MWh stored at its start: a storage without energy to give
                forms no island. If omitted, all have some.
        """
        return self._slots[t] if energy is None else self._slots.with_energy(t, energy)

    def centre(self, t: int) -> Ints:
        """(scenarios,) what operators know of the hazard's peak on slot t's day; -1: nothing."""
        centre, day = self.scenarios.centre, int(self.day[t])
        if centre is None or day >= len(centre) or not self.known_centre:
            return np.full(self.scenarios.n, -1)
        return centre[day]

    def start(self) -> Floats:
        """(units, scenarios) MWh stored at the start."""
        return self.setting.start()


def stepper(microgrid: Microgrid, recourse: RecourseRule = "economic") -> Stepper:
    """What simulates a microgrid at its physics: by arithmetic where lines carry anything, by a
    linear program per slot where they have ratings or voltages, and by a mixed-integer one where
    units are committed or ramped, lines switched, or costs curved.

    Raises:
        UsageError: physics, or devices, that nothing simulates, or the paper's recourse where lines
            do not carry anything, or where devices need more than it says.
    """
    dt, rated = microgrid.case.step_h, np.isfinite(microgrid.network.rating_mva).any()
    by_arithmetic = microgrid.physics == "copperplate" and not rated
    is_mixed = needs_milp(microgrid, dt, blocks=by_arithmetic)
    if by_arithmetic and not is_mixed:
        return Simulator(microgrid, dt, recourse)
    if recourse != "economic":
        raise UsageError(
            f"recourse {recourse!r} at {microgrid.physics}, with line ratings, commitment, ramps, "
            "curves or switchable lines; allowed there: 'economic'",
            hint="the paper's equations know islands and merit, no lines and no starts",
        )
    return MilpSimulator(microgrid, dt) if is_mixed else NetworkSimulator(microgrid, dt)


def microgrid_with_fallible_lines(case: Case, scenarios: Scenarios, physics: Physics) -> Microgrid:
    """The microgrid in which every line and unit of the scenarios can fail."""
    hit = {*case.fallible_units, *(outage.line for outage in case.outages)}
    more = tuple(Outage(line, 0, 1) for line in scenarios.lines if line not in hit)
    return Microgrid.build(case.replace(outages=(*case.outages, *more)) if more else case, physics)
