"""What a dispatcher believes of outages to come, given what an operator has seen.

`BellBelief` believes in the paper's bell (`conditional.py`), `StormBelief` in a storm on its track
(`storm_belief.py`); `case_belief` gives a case its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.beliefs.conditional import (
    DayDraw,
    LineHistory,
    chances,
    days_reached,
    expected_left,
    futures,
)
from resilience.fragility.outages.bell import Bell, case_bell

if TYPE_CHECKING:
    from resilience.case import Case


class Belief(Protocol):
    """Outages to come, as a dispatcher expects them.

    Attributes:
        daily: every midnight ends all outages, and what failed may fail again.
        longest_slots: how long an outage may last, slots of the case.
    """

    @property
    def daily(self) -> bool:
        """Whether days are independent of each other."""

    @property
    def longest_slots(self) -> int:
        """Slots of a long outage."""

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot, on equally likely paths.

        The same random numbers serve in every slot of an episode.
        """

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one that a line which is down stays so, on average."""


class BellBelief:
    """The bell, days independent of each other.

    Args:
        bell: the process.
        per_day: slots of a day.
        lines: how many lines can fail.
        seed: of the sampled futures; they have nothing to do with the storms to come.
    """

    daily = True

    def __init__(self, bell: Bell, per_day: int, lines: int, seed: int = 0) -> None:
        self.bell, self.per_day, self.lines, self.seed = bell, per_day, lines, seed
        self.longest_slots = int(bell.lengths(DAY_MIN / per_day)[-1])
        self._days: dict[tuple[int, int], DayDraw] = {}

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down; see `conditional.futures`."""
        reach = days_reached(history.t, slots, self.per_day)
        draws = [self._draw(history.day + later, n) for later in range(reach)]
        return futures(self.bell, history, slots, self.per_day, draws)

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probabilities; see `conditional.chances`."""
        return chances(self.bell, history, slots, self.per_day)

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots, cut at midnight."""
        remaining = np.zeros(len(history.since), np.intp)
        for k in np.flatnonzero(history.since >= 0).tolist():
            mean = expected_left(self.bell, history.t - int(history.since[k]), self.per_day)
            remaining[k] = min(mean, self.per_day - 1 - history.t)
        return remaining

    def _draw(self, day: int, n: int) -> DayDraw:
        """The draws of a day, the same in all of its slots and in every scenario."""
        if (day, n) not in self._days:
            rng = np.random.default_rng([self.seed, day])
            self._days[day, n] = DayDraw.draw(self.lines, n, rng)
        return self._days[day, n]


def case_belief(
    case: Case, lines: tuple[str, ...], *, bell: Bell | None = None, seed: int = 0
) -> Belief:
    """What the operator of a case believes: its storm, or its bell where there is none.

    Args:
        case: the case.
        lines: that can fail, in the order of what is known of them.
        bell: believed in, whatever the case says.
        seed: of sampled futures.

    Raises:
        CaseError: the case does not say where its lines are.
        UsageError: a setting out of range.
    """
    if bell is None and case.storm is not None and case.storm.points:
        from resilience.fragility.beliefs.storm_belief import StormBelief
        from resilience.fragility.chain import storm

        return StormBelief.from_storm(storm(case), lines, seed=seed)
    return BellBelief(bell or case_bell(case), case.window.slots_per_day, len(lines), seed)
