"""What an operator remembers of the lines: since when each is down, and which failed today."""

from __future__ import annotations

import numpy as np

from resilience.fragility.beliefs.conditional import Known
from resilience.simulation.world import Observation, World


class Memory:
    """Remembers line failures scenario by scenario.

    Args:
        world: where it is.
        daily: every day starts anew, and `t` of what is known is the slot of the day; otherwise
            the episode is one storm, and `t` is its slot.

    Attributes:
        lines: index in the case's network of every line that can fail.
        per_day: slots of a day.
    """

    def __init__(self, world: World, daily: bool = True) -> None:
        case, self.daily = world.microgrid.case, daily
        self.lines = [case.network.line(name) for name in world.scenarios.lines]
        self.per_day = round(24.0 / case.step_h)
        self.first = round((case.start.hour + case.start.minute / 60) / case.step_h)
        shape = (len(self.lines), world.scenarios.n)
        self.since = np.full(shape, -1)
        self.spent = np.zeros(shape, bool)
        self.failed = np.full(shape, -1)
        # Only the queue of a storm's crews needs to know who was back when.
        past = 0 if daily else case.slots
        self.down = np.zeros((world.scenarios.n, len(self.lines), past), bool)

    def update(self, seen: Observation) -> None:
        """Takes notice of the line status of a slot; to be called once in each."""
        clock = self.clock(seen.t)
        if clock == 0:
            self.since[:], self.spent[:], self.failed[:] = -1, False, -1
        down = ~seen.line_up[self.lines]
        began = down & (self.since < 0)
        self.since[began] = clock
        self.since[~down] = -1
        self.failed[began & ~self.spent] = clock
        self.spent |= down
        if not self.daily:
            self.down[:, :, seen.t] = down.T

    def clock(self, t: int) -> int:
        """Slot of the day of slot t, or of the storm."""
        return (self.first + t) % self.per_day if self.daily else t

    def day(self, t: int) -> int:
        """Number of the day of slot t, from 0; a storm is one."""
        return (self.first + t) // self.per_day if self.daily else 0

    def known(self, seen: Observation, k: int) -> Known:
        """What is known of scenario k in the slot last noticed."""
        centre = int(seen.centre[k])
        since, spent, failed = (of[:, k] for of in (self.since, self.spent, self.failed))
        past = None if self.daily else self.down[k, :, : seen.t + 1]
        return Known(self.clock(seen.t), centre, since, spent, self.day(seen.t), failed, past)
