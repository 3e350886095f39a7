r"""Belief in scenarios: those that agree with what was seen so far, more than those that do not.

Scenario $m$ of probability $p_m$ disagrees with what was seen by

$$ d_m = \sum_k \sum_{s \le t} 2^{-(t - s) \Delta / H}\,
   |\text{down}_{mks} - \text{seen}_{ks}|\, \Delta $$

line-hours, what is long past counting less ($H$ hours halve it), and is believed with the weight

$$ w_m \propto p_m e^{-\beta d_m} $$

with the largest $\beta$ up to `SHARPEST` per hour for which the weights are worth at least
$\sqrt{n}$ scenarios of equal weight, $1 / \sum_m w_m^2$, where $n$ is what all are worth. So no
history is impossible, and a thousand scenarios are believed more sharply than ten.

A line that is down although a believed scenario has it up comes back after what was left of some
outage of the scenarios that lasted longer than this one has; one that is up although a scenario has
it down stays up until that scenario's next outage.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import chosen, strata
from resilience.fragility.outages.scenarios import Scenarios
from resilience.tolerances import SLOT_TOLERANCE

HALVING_H = 6.0  # what was that long ago counts half
SHARPEST = 8.0  # per line-hour: a quarter of an hour of one line makes a scenario e^-2 as likely
HALVINGS = 24  # of the interval in which the sharpness is looked for
LONG_QUANTILE = 0.95  # of the lengths of outages: what counts as a long one


class ScenarioBelief:
    """Belief in scenarios over the horizon of the case; see above.

    Args:
        scenarios: what is believed in.
        lines: that can fail, in the order of what is known of them; those that the scenarios do not
            know never fail.
        step_h: length of a slot.
        seed: of the sampled futures.
    """

    daily, overnight = False, True

    def __init__(
        self, scenarios: Scenarios, lines: tuple[str, ...], step_h: float, seed: int = 0
    ) -> None:
        self.seed, self.step_h = seed, step_h
        self.probability = scenarios.probability
        self.down = ~scenarios.line_up(lines)
        self._drawn: dict[tuple[int, int], tuple[Floats, Floats]] = {}

    @property
    def slots(self) -> int:
        """Slots of the horizon."""
        return int(self.down.shape[1])

    @cached_property
    def _begins(self) -> Bools:
        """(lines, slots, scenarios) where an outage begins."""
        begins = self.down.copy()
        begins[:, 1:] &= ~self.down[:, :-1]
        return begins

    @cached_property
    def _left(self) -> Ints:
        """(lines, slots, scenarios) slots that a line stays down from here on, 0 where it is up."""
        slots_left = np.zeros(self.down.shape, np.intp)
        run = np.zeros((self.down.shape[0], self.down.shape[2]), np.intp)
        for slot in reversed(range(self.slots)):
            run = np.where(self.down[:, slot], run + 1, 0)
            slots_left[:, slot] = run
        return slots_left

    @cached_property
    def _outages(self) -> tuple[Ints, Floats]:
        """Lengths of all outages, ascending, and the probability of each's scenario."""
        length = self._left[self._begins]
        weight = np.broadcast_to(self.probability, self._begins.shape)[self._begins]
        order = np.argsort(length, kind="stable")
        return length[order], weight[order]

    @cached_property
    def longest_slots(self) -> int:
        """Slots that 19 in 20 outages stay below; 1 if there is none."""
        length, weight = self._outages
        if not len(length):
            return 1
        share = np.cumsum(weight) / weight.sum()
        return int(length[min(int(np.searchsorted(share, LONG_QUANTILE)), len(length) - 1)])

    def weights(self, history: LineHistory) -> Floats:
        """(scenarios,) how much each is believed, given what was seen."""
        slots_seen = min(history.t + 1, self.slots)
        if slots_seen <= 0:
            return self.probability
        ago_h = (history.t - np.arange(slots_seen)) * self.step_h
        hours = self.step_h * 2.0 ** (-ago_h / HALVING_H)
        differs = self.down[:, :slots_seen] != history.down[:, :slots_seen, None]
        distance = np.einsum("s,ksm->m", hours, differs)
        distance = distance - distance[self.probability > 0.0].min()
        least_worth = math.sqrt(worth(self.probability))

        def weight(sharpness: float) -> Floats:
            tilted = self.probability * np.exp(-sharpness * distance)
            return np.asarray(tilted / tilted.sum())

        low, high = 0.0, SHARPEST
        if worth(weight(high)) >= least_worth:
            return weight(high)
        for _ in range(HALVINGS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if worth(weight(middle)) >= least_worth else (low, middle)
        return weight(low)

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot, on paths alike likely."""
        u, u_left = self._draws(n, history.number)
        scenario = chosen(self.weights(history), u)
        now, lines = history.t + 1, len(self.down)
        ahead = max(min(slots, self.slots - now), 0)
        down = np.zeros((lines, slots, n), bool)
        down[:, :ahead] = self.down[:, now : now + ahead][:, :, scenario]
        slot, is_within = np.arange(slots)[:, None], 0 <= history.t < self.slots
        now_left = self._left[:, history.t] if is_within else 0 * self._left[:, 0]
        for k in range(lines):
            believed = now_left[k, scenario]
            if history.is_down[k]:
                slots_left = np.where(
                    believed > 0, believed - 1, self._pooled(history, k, u_left[k])
                )
                down[k] |= slot < slots_left
            else:
                down[k] &= ~(slot < believed - 1)
        return down

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""
        now = history.t + 1
        ahead = max(min(slots, self.slots - now), 0)
        chances = np.zeros((len(self.down), slots))
        begins = self._begins[:, now : now + ahead]
        chances[:, :ahead] = begins @ self.weights(history)
        return chances

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one that a line which is down stays so, on average."""
        weight, mean = self.weights(history), np.zeros(len(self.down))
        for k in np.flatnonzero(history.is_down).tolist():
            slots_left = (
                self._left[k, history.t] if history.t < self.slots else np.zeros(0, np.intp)
            )
            agrees = slots_left > 0
            share = float(weight[agrees].sum()) if len(slots_left) else 0.0
            length, chance = self._longer(int(history.age[k]))
            pooled = float(chance @ (length - int(history.age[k]) - 1)) if len(length) else 0.0
            own_mean = float(weight[agrees] @ (slots_left[agrees] - 1)) if share else 0.0
            mean[k] = own_mean + (1.0 - share) * pooled
        return np.ceil(mean - SLOT_TOLERANCE).astype(np.intp)

    def _longer(self, age: int) -> tuple[Ints, Floats]:
        """Lengths of outages that last longer than this age, and their probability."""
        length, weight = self._outages
        first = int(np.searchsorted(length, age, side="right"))
        total = weight[first:].sum()
        return length[first:], weight[first:] / (total or 1.0)

    def _pooled(self, history: LineHistory, k: int, u: Floats) -> Ints:
        """(paths,) slots that line k stays down, of all outages that lasted longer."""
        age = int(history.age[k])
        length, chance = self._longer(age)
        if not len(length):
            return np.zeros(len(u), np.intp)
        return length[chosen(chance, u)] - age - 1

    def _draws(self, n: int, number: int) -> tuple[Floats, Floats]:
        """Stratified numbers: of the scenario (n,), and of what is left of outages (lines, n)."""
        if (n, number) not in self._drawn:
            rng = np.random.default_rng([self.seed, n, number])
            slots_left = np.array([strata(n, rng) for _ in self.down]).reshape(len(self.down), n)
            self._drawn[n, number] = strata(n, rng), slots_left
        return self._drawn[n, number]


def worth(weight: Floats) -> float:
    """How many scenarios of equal weight these are worth (Kish's effective sample size)."""
    return float(1.0 / np.sum(weight**2))
