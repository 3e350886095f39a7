"""What an operator has observed of the lines that can fail."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Ints


@dataclass(frozen=True, eq=False)
class LineHistory:
    """What was seen of the lines in one scenario, since a clock started: today's, or a storm's.

    Attributes:
        t: slot of the clock, now; -1: it has not started.
        storm_peak: slot of 15 minutes at which today's hazard is told to peak, -1 where unknown.
        age: (lines,) slots that a line which is down has been so before the present one, -1 where
            it is up. An outage that began before the clock started is older than `t`.
        down: (lines, t + 1) where lines were seen down, slot by slot.
        carried: (lines,) which lines came into the first slot with an outage from before it.
        day: number of the day, from 0.
        number: of the scenario among all that are judged together.
    """

    t: int
    storm_peak: int
    age: Ints
    down: Bools
    carried: Bools
    day: int = 0
    number: int = 0

    @classmethod
    def quiet(cls, lines: int, t: int = -1, storm_peak: int = -1) -> LineHistory:
        """Nothing has failed by slot t."""
        down = np.zeros((lines, t + 1), bool)
        return cls(t, storm_peak, np.full(lines, -1), down, np.zeros(lines, bool))

    @property
    def n(self) -> int:
        """Number of lines."""
        return len(self.age)

    @cached_property
    def is_down(self) -> Bools:
        """(lines,) which lines are down now."""
        return self.age >= 0

    @cached_property
    def since(self) -> Ints:
        """(lines,) slot in which a line that is down failed, below 0 before the clock started; -1
        where it is up.
        """
        return np.where(self.is_down, self.t - self.age, -1)

    @cached_property
    def began(self) -> Bools:
        """(lines, t + 1) where an outage was seen to begin.

        Where one outage follows another in the very next slot, nobody can see it.
        """
        began = self.down.copy()
        began[:, 1:] &= ~self.down[:, :-1]
        began[:, :1] &= ~self.carried[:, None]
        return began

    @cached_property
    def spent(self) -> Bools:
        """(lines,) which lines have failed since the clock started."""
        return np.asarray(self.began.any(axis=1))

    @cached_property
    def first(self) -> Ints:
        """(lines,) slot of a line's first failure, -1 where it has none."""
        if self.t < 0:
            return np.full(self.n, -1)
        return np.where(self.spent, self.began.argmax(axis=1), -1)

    def of_lines(self, rows: Ints) -> LineHistory:
        """The same of some of the lines, in this order; -1 stands for one that never fails."""
        stands_for_line = rows >= 0
        return replace(
            self,
            age=np.where(stands_for_line, self.age[rows], -1),
            down=self.down[rows] & stands_for_line[:, None],
            carried=self.carried[rows] & stands_for_line,
        )
