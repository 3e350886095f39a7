"""What an operator remembers of the lines: since when each is down, and which failed today."""

from __future__ import annotations

import numpy as np

from resilience.fragility.beliefs.conditional import LineHistory
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


class Memory:
    """Remembers line failures scenario by scenario.

    Its clock is the slot of the day where every day starts anew, else the slot of the horizon.

    Args:
        setting: where it is.
        daily: every day starts anew; otherwise the episode is one storm.

    Attributes:
        lines: position in the case's network of every line that can fail.
        window: horizon of the case.
        since: (lines, scenarios) clock at which a line that is down failed, -1 where it is up.
        spent: (lines, scenarios) whether a line has failed since the clock started.
        failed: (lines, scenarios) clock of a line's first failure, -1 where it has none.
        down: (scenarios, lines, slots) where lines were down; no slots where every day starts anew.
    """

    def __init__(self, setting: Setting, daily: bool = True) -> None:
        case, self.daily = setting.case, daily
        self.lines = [case.network.line(name) for name in setting.lines]
        self.window = case.window
        shape = (len(self.lines), setting.n)
        self.since = np.full(shape, -1)
        self.spent = np.zeros(shape, bool)
        self.failed = np.full(shape, -1)
        # Only the queue of a storm's crews needs to know who was back when.
        remembered = 0 if daily else case.slots
        self.down = np.zeros((setting.n, len(self.lines), remembered), bool)

    def update(self, observation: Observation) -> None:
        """Takes notice of the line status of a slot; to be called once in each."""
        clock = self.clock(observation.t)
        if clock == 0:
            self.since[:], self.spent[:], self.failed[:] = -1, False, -1
        down = ~observation.line_up[self.lines]
        began = down & (self.since < 0)
        self.since[began] = clock
        self.since[~down] = -1
        self.failed[began & ~self.spent] = clock
        self.spent |= down
        if not self.daily:
            self.down[:, :, observation.t] = down.T

    def clock(self, t: int) -> int:
        """Slot of the day of slot t, or of the storm."""
        return self.window.slot_of_day(t) if self.daily else t

    def day(self, t: int) -> int:
        """Number of the day of slot t, from 0; a storm is one."""
        return self.window.day_number(t) if self.daily else 0

    def history(self, observation: Observation, k: int) -> LineHistory:
        """What is known of the lines of scenario k in the slot last noticed."""
        t = observation.t
        return LineHistory(
            self.clock(t),
            int(observation.centre[k]),
            self.since[:, k],
            self.spent[:, k],
            self.day(t),
            self.failed[:, k],
            None if self.daily else self.down[k, :, : t + 1],
        )
