"""Outage paths from here on, given what an operator knows: what is down, since when, and today's
storm peak. Failure times are stratified line by line, so that few paths already show rare hours.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.outages.bell import Bell
from resilience.tolerances import SLOT_TOLERANCE


@dataclass(frozen=True)
class LineHistory:
    """What an operator has observed of the lines that can fail, up to slot `t` of the day.

    Attributes:
        t: slot of the day, now.
        storm_peak: slot of 15 minutes at which today's hazard peaks, -1 where unknown.
        since: (lines,) slot of the day in which a line that is down failed, -1 where it is up.
        spent: (lines,) True where a line has failed today already.
        day: number of the day, from 0.
        first: (lines,) slot of a line's first failure, -1 where it has none; None: not remembered.
        down: (lines, t + 1) where lines were seen down, slot by slot; None: not remembered.
    """

    t: int
    storm_peak: int
    since: Ints
    spent: Bools
    day: int = 0
    first: Ints | None = None
    down: Bools | None = None


@dataclass(frozen=True)
class DayDraw:
    """Uniform numbers behind the paths of one day; the same ones serve in every slot of it.

    Attributes:
        fail, length, remaining: (lines, paths) of the time of failure, of the length of an outage,
            and of what remains of one that runs.
        storm_peak, shared: (paths,) of the slot in which the bell peaks, and of a shift common to
            all lines.
        shift: (lines, paths) of each line's own.
    """

    fail: Floats
    length: Floats
    remaining: Floats
    storm_peak: Floats
    shared: Floats
    shift: Floats

    @classmethod
    def draw(cls, lines: int, paths: int, rng: np.random.Generator) -> DayDraw:
        """Draws a day; every row is stratified over the paths."""

        def rows(n: int) -> Floats:
            return np.array([strata(paths, rng) for _ in range(n)]).reshape(n, paths)

        storm_peak, shared = rows(2)  # the order of the draws is part of every recorded result
        return cls(rows(lines), rows(lines), rows(lines), storm_peak, shared, rows(lines))


def strata(n: int, rng: np.random.Generator) -> Floats:
    """(n,) uniform numbers, one in every n-th of the unit interval, in random order."""
    return (rng.permutation(n) + rng.random(n)) / n


def futures(
    bell: Bell, history: LineHistory, slots: int, per_day: int, days: list[DayDraw]
) -> Bools:
    """(lines, slots, paths) where lines are down after slot t, on equally likely paths.

    The present day's storm peak is known or drawn alike; that of days to come is drawn. Slots of
    one line's failure are stratified; so are the lengths of outages that have begun.

    Args:
        bell: the process.
        history: what is known now.
        slots: how far to look, slots of the case.
        per_day: slots of a day.
        days: draws of today and of every later day that the slots reach.
    """
    lines, paths = days[0].fail.shape
    down = np.zeros((lines, slots, paths), bool)
    for k in np.flatnonzero(history.since >= 0).tolist():
        elapsed = history.t - int(history.since[k])
        remaining = _remaining(bell, elapsed, per_day, days[0].remaining[k])
        _mark(down[k], np.zeros(paths, np.intp), np.minimum(remaining, per_day - history.t - 1))
    for day, draw in enumerate(days[: days_reached(history.t, slots, per_day)]):
        start = day * per_day - history.t - 1  # of the day, in `down`, whose first slot is t + 1
        storm_peak = _storm_peaks(bell, history.storm_peak if day == 0 else -1, draw.storm_peak)
        for k in range(lines):
            if day == 0 and _cannot_fail(bell, history)[k]:
                continue
            u_shift = draw.shared if bell.shared_shift else draw.shift[k]
            shift = _shift(bell, u_shift) if k else 0
            chance = bell.slot_probability(storm_peak + shift, DAY_MIN / per_day)
            if day == 0:
                chance[:, : history.t + 1] = 0.0  # the line has stood so far
            first, fails = _first(chance, draw.fail[k])
            length = _pick(bell.lengths(DAY_MIN / per_day), draw.length[k])
            length = np.where(fails, np.minimum(length, per_day - first), 0)
            _mark(down[k], start + first, length)
    return down


def chances(bell: Bell, history: LineHistory, slots: int, per_day: int) -> Floats:
    """(lines, slots) probability that a line's outage begins in each of the `slots` after slot t.

    Averaged over the shift, and over the storm peak where it is not known.
    """
    begins = np.zeros((len(history.since), slots))
    for day in range(days_reached(history.t, slots, per_day)):
        begin = day * per_day - history.t - 1
        columns = np.arange(max(begin, 0), min(begin + per_day, slots))
        may = ~_cannot_fail(bell, history) if day == 0 else np.ones(len(begins), bool)
        storm_peak = history.storm_peak if day == 0 else -1
        # The first line follows the peak, all others are shifted alike.
        for k in np.flatnonzero(may).tolist():
            shift = bell.shift_slots if k else 0
            first = history.t + 1 if day == 0 else 0
            begins[k, columns] += _starts(bell, storm_peak, shift, per_day, first)[columns - begin]
    return begins


@lru_cache(maxsize=4096)
def _starts(bell: Bell, storm_peak: int, shift_slots: int, per_day: int, first: int) -> Floats:
    """(per_day,) probability that an outage begins in a slot, of a line up at `first`."""
    candidates = np.array([storm_peak]) if storm_peak >= 0 else bell.centre_slots()
    peaks = np.add.outer(candidates, np.arange(-shift_slots, shift_slots + 1)).ravel()
    chance = bell.slot_probability(peaks, DAY_MIN / per_day)
    chance[:, :first] = 0.0
    before = np.ones_like(chance)
    np.cumprod(1.0 - chance[:, :-1], axis=1, out=before[:, 1:])
    return (chance * before).mean(0)


def days_reached(t: int, slots: int, per_day: int) -> int:
    """Days that the `slots` after slot t of a day touch, today included."""
    return (t + slots) // per_day + 1


def expected_left(bell: Bell, elapsed: int, per_day: int) -> int:
    """Slots after the present one that an outage of that age lasts: their mean, rounded up."""
    return int(np.ceil(_lengths_left(bell, elapsed, per_day).mean() - SLOT_TOLERANCE))


def _cannot_fail(bell: Bell, history: LineHistory) -> Bools:
    """(lines,) True where a line cannot fail any more today."""
    return (history.since >= 0) | (history.spent & (not bell.refail))


def _storm_peaks(bell: Bell, storm_peak: int, u: Floats) -> Ints:
    """(paths,) slots in which the hazard peaks: the one that is known, or all that are possible."""
    slots = bell.centre_slots()
    return _pick(slots, u) if storm_peak < 0 else np.full(len(u), storm_peak)


def _shift(bell: Bell, u: Floats) -> Ints:
    """(paths,) slots by which a line's bell is shifted."""
    return (u * (2 * bell.shift_slots + 1)).astype(np.intp) - bell.shift_slots


def _first(chance: Floats, u: Floats) -> tuple[Ints, Bools]:
    """Slot in which the probability of having failed first reaches u, and whether it does."""
    failed = -np.expm1(np.cumsum(np.log1p(-chance), axis=1))
    hit = failed >= u[:, None]
    return np.argmax(hit, axis=1), hit.any(axis=1)


def _pick(values: Ints, u: Floats) -> Ints:
    """(paths,) equally likely values, by uniform numbers."""
    return values[(u * len(values)).astype(np.intp)]


def _lengths_left(bell: Bell, elapsed: int, per_day: int) -> Ints:
    """(lengths,) slots after the present one that an outage of that age may last, ascending."""
    lengths = np.unique(bell.lengths(DAY_MIN / per_day))
    remaining = lengths[lengths > elapsed] - elapsed - 1
    return remaining if len(remaining) else np.zeros(1, np.intp)


def _remaining(bell: Bell, elapsed: int, per_day: int, u: Floats) -> Ints:
    """(paths,) slots after the present one that an outage of that age still lasts."""
    remaining = _lengths_left(bell, elapsed, per_day)
    return _pick(remaining, u)


def _mark(down: Bools, first: Ints, length: Ints) -> None:
    """Marks outages (paths,) in `down` (slots, paths)."""
    slots = np.arange(down.shape[0])[:, None]
    down |= (slots >= first) & (slots < first + length)
