"""Belief in the paper's bell: days independent of each other, but for outages that run on."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.beliefs.bell_day import BellDays
from resilience.fragility.beliefs.bell_paths import (
    DayDraw,
    bell_paths,
    days_reached,
    lengths_left,
)
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.outages.bell import Bell
from resilience.tolerances import SLOT_TOLERANCE


class BellBelief:
    """The bell, given all that was seen of it; see `bell_day.py`.

    Args:
        bell: the process.
        per_day: slots of a day.
        lines: how many lines can fail.
        seed: of the sampled futures; they have nothing to do with the storms to come.
    """

    daily = True

    def __init__(self, bell: Bell, per_day: int, lines: int, seed: int = 0) -> None:
        self.bell, self.per_day, self.lines, self.seed = bell, per_day, lines, seed
        self.days = BellDays(bell, per_day, lines)
        self.lengths = bell.lengths(DAY_MIN / per_day)
        self.longest_slots = int(self.lengths[-1])
        self._draws: dict[tuple[int, int, int], DayDraw] = {}

    @property
    def overnight(self) -> bool:
        """Whether outages run on past midnight."""
        return self.bell.overnight

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down; see `bell_paths`."""
        reach = days_reached(history.t, slots, self.per_day)
        draws = [self._draw(history.number, history.day + later, n) for later in range(reach)]
        return bell_paths(self.days, history, slots, self.per_day, draws)

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one.

        Exact, but that outages which follow each other in one slot count as one.
        """
        days, per_day = self.days, self.per_day
        begins = np.zeros((self.lines, slots))
        free = self._free(history)
        for day in range(days_reached(history.t, slots, per_day)):
            belief = days.later if day else days.today(history)
            weight = belief.peak_weights(days.lowest, len(days.chance))
            start = day * per_day - history.t - 1
            columns = np.arange(max(start, 0), min(start + per_day, slots))
            began = self._begins(weight, free, slots - start)
            begins[:, columns] = began[:, columns - start]
            free = self._carried(began, free)
        return begins

    def next_down(self, history: LineHistory) -> Floats:
        """(lines,) probability that each line is down in the next slot."""
        stays = np.zeros(self.lines)
        if self.overnight or history.t < self.per_day - 1:
            for k in np.flatnonzero(history.is_down).tolist():
                slots_left = lengths_left(self.bell, int(history.age[k]), self.per_day)
                stays[k] = (slots_left > 0).mean()
        return stays + self.chances(history, 1)[:, 0]

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one that a line which is down stays so, on average.

        Rounded up, and cut at midnight where that ends all outages.
        """
        remaining = np.zeros(self.lines, np.intp)
        for k in np.flatnonzero(history.is_down).tolist():
            slots_left = lengths_left(self.bell, int(history.age[k]), self.per_day).mean()
            mean = int(np.ceil(slots_left - SLOT_TOLERANCE))
            ends = self.per_day - 1 - history.t
            remaining[k] = mean if self.overnight else min(mean, ends)
        return remaining

    def _free(self, history: LineHistory) -> Floats:
        """(lines, slots of two days and more) chance that a line may fail from a slot on.

        Counted from midnight; a line that has failed and may not again today is free tomorrow.
        """
        per_day, now = self.per_day, history.t + 1
        free = np.zeros((self.lines, 2 * per_day + self.longest_slots))
        for k in range(self.lines):
            slots_left = np.zeros(1, np.intp)
            if history.is_down[k]:
                slots_left = lengths_left(self.bell, int(history.age[k]), per_day)
            slot = now + slots_left
            if not self.overnight:
                slot = np.minimum(slot, per_day)
            if history.spent[k] and not self.bell.refail:
                slot = np.maximum(slot, per_day)
            np.add.at(free[k], slot, 1.0 / len(slot))
        return free

    def _begins(self, weight: Floats, free: Floats, slots: int) -> Floats:
        """(lines, slots of the day) chance that an outage begins in each of the first `slots`.

        Args:
            weight: (lines, peaks) probability of where a line's bell peaks.
            free: (lines, slots) chance that a line may fail from a slot on.
            slots: of the day, how many are asked for.
        """
        lengths, chance = self.lengths, self.days.chance
        began = np.zeros((self.lines, self.per_day))
        by_peak = np.zeros((self.per_day, *weight.shape))
        at_risk = np.zeros_like(weight)
        anybody = np.flatnonzero(free[:, : self.per_day].any(axis=0))
        for slot in range(int(anybody[0]) if len(anybody) else slots, min(slots, self.per_day)):
            at_risk += weight * free[:, slot, None]
            if self.bell.refail:
                for length in lengths[lengths <= slot].tolist():
                    at_risk += by_peak[slot - length] / len(lengths)
            by_peak[slot] = at_risk * chance[:, slot]
            at_risk -= by_peak[slot]
            began[:, slot] = by_peak[slot].sum(axis=1)
        return began

    def _carried(self, began: Floats, free: Floats) -> Floats:
        """(lines, slots) chance that a line may fail from a slot of the next day on."""
        per_day, later = self.per_day, np.zeros_like(free)
        later[:, :-per_day] = free[:, per_day:]
        if self.overnight:
            for length in self.lengths.tolist():
                tail = began[:, per_day - length + 1 :] if length <= per_day else began
                shift = 1 if length <= per_day else length - per_day
                later[:, shift : shift + tail.shape[1]] += tail / len(self.lengths)
        later[:, 0] += 1.0 - later.sum(axis=1)
        return later

    def _draw(self, number: int, day: int, n: int) -> DayDraw:
        """The draws of a day, the same in all of its slots."""
        if (number, day, n) not in self._draws:
            rng = np.random.default_rng([self.seed, day, number])
            common = self.per_day if self.bell.common_draw else 0
            self._draws[number, day, n] = DayDraw.draw(self.lines, n, rng, common)
        return self._draws[number, day, n]
