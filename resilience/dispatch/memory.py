"""What an operator remembers of lines and units: since when each is down, which failed today."""

from __future__ import annotations

import numpy as np

from resilience.fragility.beliefs.history import LineHistory
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


class Memory:
    """Remembers line failures scenario by scenario.

    Its clock is the slot of the day where every day has a hazard of its own, else the slot of the
    horizon.

    Args:
        setting: where it is.
        daily: every day has a hazard of its own; otherwise the episode is one storm.
        overnight: outages run on past midnight; otherwise what is down then has failed anew.

    Attributes:
        lines: position among the case's elements of every line and unit that can fail.
        window: horizon of the case.
        since: (lines, scenarios) slot of the horizon in which a line that is down failed, -1 where
            it is up.
        spent: (lines, scenarios) whether a line has failed since the clock started.
        carried: (lines, scenarios) whether it was down by an earlier outage when the clock started.
        down: (scenarios, lines, slots of the clock) where lines were down since it started.
    """

    def __init__(self, setting: Setting, *, daily: bool = True, overnight: bool = True) -> None:
        case, self.daily, self.overnight = setting.case, daily, overnight
        self.lines = [case.element(name) for name in setting.lines]
        self.window, self.numbers = case.window, setting.numbers
        shape = (len(self.lines), setting.n)
        self.since = np.full(shape, -1)
        self.spent, self.carried = np.zeros((2, *shape), bool)
        remembered = case.window.slots_per_day if daily else case.slots
        self.down = np.zeros((setting.n, len(self.lines), remembered), bool)

    def update(self, observation: Observation) -> None:
        """Takes notice of the line status of a slot; to be called once in each."""
        t, clock = observation.t, self.clock(observation.t)
        down = ~observation.line_up[self.lines]
        if clock == 0:
            if not self.overnight:
                self.since[:] = -1
            self.carried = down & (self.since >= 0)
            self.spent[:], self.down[:] = False, False
        began = down & (self.since < 0)
        self.since[began] = t
        self.since[~down] = -1
        self.spent |= began
        self.down[:, :, clock] = down.T

    def clock(self, t: int) -> int:
        """Slot of the day of slot t, or of the storm."""
        return self.window.slot_of_day(t) if self.daily else t

    def day(self, t: int) -> int:
        """Number of the day of slot t, from 0; a storm is one."""
        return self.window.day_number(t) if self.daily else 0

    def history(self, observation: Observation, k: int) -> LineHistory:
        """What is known of the lines of scenario k in the slot last noticed."""
        t, since = observation.t, self.since[:, k]
        clock = self.clock(t)
        return LineHistory(
            clock,
            int(observation.centre[k]),
            np.where(since >= 0, t - since, -1),
            self.down[k, :, : clock + 1],
            self.carried[:, k],
            self.day(t),
            int(self.numbers[k]),
        )
