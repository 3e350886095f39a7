"""Outage paths from here on, given what an operator knows: what is down, since when, and today's
centre. Failure times are stratified line by line, so that few paths already show rare hours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.fragility.bell import REFERENCE_MIN, Bell
from resilience.fragility.scenarios import Bools, Floats, Ints


@dataclass(frozen=True)
class Known:
    """What is known of the lines that can fail, at slot `t` of the day.

    Attributes:
        t: slot of the day, now.
        centre: slot of 15 minutes at which today's hazard peaks, -1 where unknown.
        since: (lines,) slot of the day in which a line that is down failed, -1 where it is up.
        spent: (lines,) True where a line has failed today already.
    """

    t: int
    centre: int
    since: Ints
    spent: Bools


def strata(n: int, rng: np.random.Generator) -> Floats:
    """(n,) uniform numbers, one in every n-th of the unit interval, in random order."""
    found: Floats = (rng.permutation(n) + rng.random(n)) / n
    return found


def futures(
    bell: Bell, known: Known, slots: int, per_day: int, n: int, rng: np.random.Generator
) -> Bools:
    """(lines, slots, n) where lines are down in the `slots` after slot t, on equally likely paths.

    The present day's centre is known or drawn alike; that of days to come is drawn. Slots of one
    line's failure are stratified; so are the lengths of outages that have begun.
    """
    lines = len(known.since)
    down = np.zeros((lines, slots, n), bool)
    for k in range(lines):
        if known.since[k] >= 0:
            left = _remaining(bell, known.t - int(known.since[k]), per_day, n, rng)
            _mark(down[k], np.zeros(n, np.intp), np.minimum(left, per_day - known.t - 1))
    for day in range(0, (known.t + slots) // per_day + 1):
        start = day * per_day - known.t - 1
        centre = _centres(bell, known.centre if day == 0 else -1, n, rng)
        shared = rng.integers(-bell.shift_slots, bell.shift_slots + 1, n)
        for k in range(lines):
            if day == 0 and (known.since[k] >= 0 or (known.spent[k] and not bell.refail)):
                continue
            own = rng.integers(-bell.shift_slots, bell.shift_slots + 1, n)
            shift = 0 if k == 0 else shared if bell.shared_shift else own
            chance = bell.slot_probability(centre + shift, 24 * 60 / per_day)
            if day == 0:
                chance[:, : known.t + 1] = 0.0
            first, fails = _first(chance, strata(n, rng))
            length = _lengths(bell, per_day, n, rng)
            length = np.where(fails, np.minimum(length, per_day - first), 0)
            _mark(down[k], start + first, length)
    return down


def _centres(bell: Bell, known: int, n: int, rng: np.random.Generator) -> Ints:
    slots = bell.centre_slots()
    drawn = slots[(strata(n, rng) * len(slots)).astype(int)]
    return drawn if known < 0 else np.full(n, known)


def _first(chance: Floats, u: Floats) -> tuple[Ints, Bools]:
    """Slot in which the probability of having failed first reaches u, and whether it does."""
    failed = -np.expm1(np.cumsum(np.log1p(-chance), axis=1))
    hit = failed >= u[:, None]
    return np.argmax(hit, axis=1), hit.any(axis=1)


def _lengths(bell: Bell, per_day: int, n: int, rng: np.random.Generator) -> Ints:
    ratio = REFERENCE_MIN * per_day / (24 * 60)
    short, long = bell.duration_slots
    drawn = short + (strata(n, rng) * (long - short + 1)).astype(int)
    found: Ints = np.ceil(drawn * ratio - 1e-9).astype(np.intp)
    return found


def _remaining(bell: Bell, elapsed: int, per_day: int, n: int, rng: np.random.Generator) -> Ints:
    """(n,) slots after the present one for which an outage that began `elapsed` slots ago lasts."""
    ratio = REFERENCE_MIN * per_day / (24 * 60)
    short, long = bell.duration_slots
    total = np.unique(np.ceil(np.arange(short, long + 1) * ratio - 1e-9).astype(np.intp))
    left = total[total > elapsed] - elapsed - 1
    if not len(left):
        left = np.zeros(1, np.intp)
    found: Ints = left[(strata(n, rng) * len(left)).astype(int)]
    return found


def _mark(down: Bools, first: Ints, length: Ints) -> None:
    slots = np.arange(down.shape[0])[:, None]
    down |= (slots >= first) & (slots < first + length)
