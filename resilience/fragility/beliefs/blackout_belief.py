r"""Belief in a blackout of unknown length: the law of its length, given how long it has lasted.

What has lasted $a$ slots lasts $n \ge a$ with probability $p_n / \sum_{m \ge a} p_m$. Nothing fails
before its start, which is known, and nothing fails again.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import chosen, strata
from resilience.fragility.outages.blackout import Blackout
from resilience.tolerances import SLOT_TOLERANCE

LONG_QUANTILE = 0.95  # of the lengths: what counts as a long one


class BlackoutBelief:
    """A blackout over the horizon of the case; see above.

    Args:
        blackout: what is believed in.
        lines: that can fail, in the order of what is known of them; those that the blackout does
            not take never fail.
        seed: of the sampled futures.
    """

    daily, overnight = False, True

    def __init__(self, blackout: Blackout, lines: tuple[str, ...], seed: int = 0) -> None:
        self.blackout, self.seed = blackout, seed
        self.lost = np.isin(lines, blackout.lines)
        self._drawn: dict[tuple[int, int], Floats] = {}

    @property
    def longest_slots(self) -> int:
        """Slots that 19 in 20 blackouts stay below or at."""
        return 1 + int(np.searchsorted(np.cumsum(self.blackout.chance), LONG_QUANTILE))

    def remaining(self, history: LineHistory) -> Floats:
        """(slots,) probability that 0, 1, ... more slots are down after the present one.

        Before the start it is of the slots from there on.
        """
        chance, now = self.blackout.chance, history.t
        if now < self.blackout.first:
            return np.append(0.0, chance)
        lasted = now - self.blackout.first + 1
        if not history.is_down[self.lost].any() or lasted > len(chance):
            return np.ones(1)
        ahead = chance[lasted - 1 :]
        total = ahead.sum()
        # What was believed impossible, as in scenarios that are not its own, ends at once.
        return ahead / total if total > 0.0 else np.eye(len(ahead))[0]

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot, on paths alike likely."""
        length = chosen(self.remaining(history), self._draws(n, history.number))
        wait = max(self.blackout.first - history.t - 1, 0)
        slot = np.arange(slots)[:, None]
        down = (slot >= wait) & (slot < wait + length)
        return self.lost[:, None, None] & down

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""
        chances, wait = np.zeros((len(self.lost), slots)), self.blackout.first - history.t - 1
        if 0 <= wait < slots:
            chances[self.lost, wait] = 1.0
        return chances

    def next_down(self, history: LineHistory) -> Floats:
        """(lines,) probability that each line is down in the next slot."""
        if history.t + 1 < self.blackout.first:
            return np.zeros(len(self.lost))
        return self.lost * (1.0 - self.remaining(history)[0])

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one that a line which is down stays so, on average."""
        chance = self.remaining(history)
        mean = float(chance @ np.arange(len(chance)))
        slots_left = np.where(history.is_down & self.lost, mean, 0.0)
        return np.ceil(slots_left - SLOT_TOLERANCE).astype(np.intp)

    def _draws(self, n: int, number: int) -> Floats:
        """(n,) stratified numbers, the same in all slots of an episode."""
        if (n, number) not in self._drawn:
            self._drawn[n, number] = strata(n, np.random.default_rng([self.seed, n, number]))
        return self._drawn[n, number]
