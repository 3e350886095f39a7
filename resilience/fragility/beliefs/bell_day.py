r"""What today's bell may be, given all that was seen of the lines so far, silence included.

A day is a storm peak $c$ and a shift $s_k$ of every line; given these, line $k$ fails in slot $t$
with the known probability $p_{kt} = p_t(c + s_k)$ if it is up and may fail. With $R_{kt}$ the slots
in which it stood at risk, and $F_{kt}$ those in which it failed, what was seen has the likelihood

$$ L_k(c, s) = \prod_{t:\, F_{kt}} p_t(c + s) \prod_{t:\, R_{kt}} \left(1 - p_t(c + s)\right) $$

so that by Bayes $P(c \mid \text{seen}) \propto P(c) \prod_k \frac{1}{|S|} \sum_s L_k(c, s)$ and
$P(s_k \mid c, \text{seen}) \propto L_k(c, s_k)$. A shift that all lines share is summed over
outside of the product. Where one random number per slot serves all lines, a slot in which the lines
$A$ failed and $B$ stood at risk has the likelihood
$\max(0, \min_{k \in A} p_{kt} - \max_{k \in B} p_{kt})$, with 1 for the least of none.

A peak that is told with an error of up to $e$ slots is one of those within $e$ of it, each as
likely as the telling of it is. When a line is back tells nothing of the peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import chosen
from resilience.fragility.outages.bell import REFERENCE_SLOTS, Bell

MAX_SHIFTS = 343
"""Combinations of shifts, above which as many are drawn: 7 each of three lines, as in ieee33."""


@dataclass(frozen=True)
class DayBelief:
    """What a day may be.

    Attributes:
        centre: (centres,) storm peaks, slots of 15 minutes.
        weight: (centres,) their probability.
        shifts: (kinds, lines) slots by which lines are shifted against the peak.
        shift_weight: (centres, lines, kinds) probability of each kind given the centre.
        joint: all lines have the same kind; otherwise each its own, independent given the centre.
    """

    centre: Ints
    weight: Floats
    shifts: Ints
    shift_weight: Floats
    joint: bool

    def drawn(self, u_centre: Floats, u_joint: Floats, u_own: Floats) -> Ints:
        """(lines, paths) slots at which each line's bell peaks, by uniform numbers.

        Args:
            u_centre: (paths,) of the storm peak.
            u_joint: (paths,) of the kind that all lines have.
            u_own: (lines, paths) of each line's own.
        """
        lines = len(u_own)
        drawn = chosen(self.weight, u_centre)
        cumulated = np.cumsum(self.shift_weight, axis=2)[drawn]
        u = np.broadcast_to(u_joint, u_own.shape) if self.joint else u_own
        kind = (cumulated <= u.T[:, :, None] * cumulated[:, :, -1:]).sum(axis=2)
        kind = np.minimum(kind, len(self.shifts) - 1)
        return (self.centre[drawn][:, None] + self.shifts[kind, np.arange(lines)]).T

    def peak_weights(self, lowest: int, peaks: int) -> Floats:
        """(lines, peaks) probability that a line's bell peaks in slot `lowest` and those after."""
        lines = self.shifts.shape[1]
        weight = self.weight[:, None, None] * self.shift_weight
        peak_index = self.centre[:, None, None] + self.shifts.T[None] - lowest
        weights = np.zeros((lines, peaks))
        np.add.at(weights, (np.arange(lines)[None, :, None], peak_index), weight)
        return weights


class BellDays:
    """The days of a bell; see above.

    Args:
        bell: the process.
        per_day: slots of a day.
        lines: how many lines can fail; the first of them is never shifted.

    Attributes:
        lowest: the first slot of 15 minutes at which a line's bell may peak; it may be below 0.
        chance: (peaks, slots) of failing in a slot, of bells that peak in `lowest` and after.
    """

    def __init__(self, bell: Bell, per_day: int, lines: int) -> None:
        self.bell, self.lines = bell, lines
        self.lowest = -bell.shift_slots
        peaks = np.arange(self.lowest, REFERENCE_SLOTS + bell.shift_slots)
        self.chance = bell.slot_probability(peaks, DAY_MIN / per_day)
        self.later = self._prior(-1)
        self._told: dict[int, DayBelief] = {-1: self.later}

    @cached_property
    def log_stays(self) -> Floats:
        """(peaks, slots) log of the chance to stand through a slot."""
        return np.log1p(-self.chance)

    @cached_property
    def log_fails(self) -> Floats:
        """(peaks, slots) log of the chance to fail in a slot."""
        with np.errstate(divide="ignore"):
            return np.log(self.chance)

    def of_told_peak(self, storm_peak: int) -> DayBelief:
        """A day of which nothing but the told peak is known, -1: not even that."""
        if storm_peak not in self._told:
            self._told[storm_peak] = self._prior(storm_peak)
        return self._told[storm_peak]

    def today(self, history: LineHistory) -> DayBelief:
        """A day of which so much was seen.

        What cannot be, by this bell, leaves the probabilities as they were.
        """
        prior = self.of_told_peak(history.storm_peak)
        at_risk, failed = at_risk_slots(history, self.bell.refail)
        joint = self._common if self.bell.common_draw else self._apart
        log = joint(prior, at_risk, failed)
        if prior.joint:
            log = np.broadcast_to(log.sum(axis=1, keepdims=True), log.shape)
        highest_log = log.max(axis=2, keepdims=True, initial=-np.inf)
        likelihood = (
            np.exp(log - np.where(np.isfinite(highest_log), highest_log, 0.0)) * prior.shift_weight
        )
        of_line = likelihood.sum(axis=2, keepdims=True)
        with np.errstate(divide="ignore"):
            evidence = (np.log(of_line) + highest_log)[:, :, 0]
        total = np.log(prior.weight) + (evidence[:, 0] if prior.joint else evidence.sum(axis=1))
        if not np.isfinite(total).any():
            return prior
        weight = np.exp(total - total.max())
        possible = np.where(of_line > 0.0, of_line, 1.0)
        return DayBelief(
            prior.centre,
            weight / weight.sum(),
            prior.shifts,
            np.where(of_line > 0.0, likelihood / possible, prior.shift_weight),
            prior.joint,
        )

    def _apart(self, prior: DayBelief, at_risk: Bools, failed: Bools) -> Floats:
        """(centres, lines, kinds) log likelihood of each line, whose random numbers are its own."""
        slots_seen = at_risk.shape[1]
        log = self.log_stays[:, :slots_seen] @ at_risk.T.astype(float)
        line, slot = np.nonzero(failed)
        np.add.at(log.T, line, self.log_fails[:, slot].T)
        peak_index = prior.centre[:, None, None] + prior.shifts.T[None] - self.lowest
        return log[peak_index, np.arange(self.lines)[None, :, None]]

    def _common(self, prior: DayBelief, at_risk: Bools, failed: Bools) -> Floats:
        """(centres, 1, kinds) log likelihood of all lines, which share a random number per slot."""
        peak_index = prior.centre[:, None, None] + prior.shifts[None] - self.lowest
        log = np.zeros(peak_index.shape[:2])
        for slot in np.flatnonzero((at_risk | failed).any(axis=0)).tolist():
            chance = self.chance[peak_index, slot]
            highest = np.where(failed[:, slot], chance, 1.0).min(axis=2)
            lowest = np.where(at_risk[:, slot], chance, 0.0).max(axis=2)
            with np.errstate(divide="ignore"):
                log += np.log(np.maximum(highest - lowest, 0.0))
        return log[:, None, :]

    def _prior(self, storm_peak: int) -> DayBelief:
        bell = self.bell
        centre, weight = told_peaks(bell, storm_peak)
        own_shifts = np.arange(-bell.shift_slots, bell.shift_slots + 1)
        joint = bell.shared_shift or bell.common_draw
        shifts = np.repeat(own_shifts[:, None], self.lines, axis=1)
        if bell.common_draw and not bell.shared_shift:
            shifts = _combinations(own_shifts, self.lines)
        shifts[:, :1] = 0
        kinds = len(shifts)
        shift_weight = np.full((len(centre), self.lines, kinds), 1.0 / kinds)
        return DayBelief(centre, weight, shifts, shift_weight, joint)


def told_peaks(bell: Bell, storm_peak: int) -> tuple[Ints, Floats]:
    """Storm peaks that are possible, and their probability, given what is told of the peak.

    The peak that is told is off by -e to e slots, all alike likely, and kept within the day. One
    that is told and that the bell does not have is believed.

    Args:
        bell: the process.
        storm_peak: what is told, slot of 15 minutes; -1: nothing.
    """
    centre = bell.centre_slots()
    if storm_peak < 0:
        return centre, np.full(len(centre), 1.0 / len(centre))
    error = np.arange(-bell.centre_error_slots, bell.centre_error_slots + 1)
    forecasts = np.clip(np.add.outer(centre, error), 0, REFERENCE_SLOTS - 1)
    ways = (forecasts == storm_peak).sum(axis=1)
    possible = ways > 0
    if not possible.any():
        return np.array([storm_peak]), np.ones(1)
    return centre[possible], ways[possible] / ways.sum()


def at_risk_slots(history: LineHistory, refail: bool) -> tuple[Bools, Bools]:
    """(lines, t + 1) where lines stood although they might have failed, and where they failed."""
    failed = history.began
    stood = ~history.down
    if not refail:
        stood &= ~np.logical_or.accumulate(failed, axis=1)
    return stood, failed


def _combinations(own_shifts: Ints, lines: int) -> Ints:
    """(kinds, lines) shifts of all lines but the first: all there are, or a sample of them."""
    if lines < 2:
        return np.zeros((1, lines), np.intp)
    if len(own_shifts) ** (lines - 1) > MAX_SHIFTS:
        return np.random.default_rng(0).choice(own_shifts, (MAX_SHIFTS, lines))
    grid = np.meshgrid(*[own_shifts] * (lines - 1), indexing="ij")
    return np.column_stack([np.zeros(grid[0].size, np.intp), *(x.ravel() for x in grid)])
