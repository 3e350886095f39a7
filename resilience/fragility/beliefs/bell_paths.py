"""Outage paths from here on, of a bell of which so much was seen. Failure times are stratified line
by line, so that few paths already show rare hours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.beliefs.bell_day import BellDays
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import strata
from resilience.fragility.outages.bell import Bell


@dataclass(frozen=True)
class DayDraw:
    """Uniform numbers behind the paths of one day; the same ones serve in every slot of it.

    Attributes:
        fail, length, remaining: (lines, paths) of the time of failure, of the length of an outage,
            and of what remains of one that runs.
        storm_peak, shared: (paths,) of the slot in which the bell peaks, and of a shift common to
            all lines.
        shift: (lines, paths) of each line's own.
        common: (slots, paths) that all lines share; no slots where each line has its own numbers.
    """

    fail: Floats
    length: Floats
    remaining: Floats
    storm_peak: Floats
    shared: Floats
    shift: Floats
    common: Floats

    @classmethod
    def draw(
        cls, lines: int, paths: int, rng: np.random.Generator, common_slots: int = 0
    ) -> DayDraw:
        """Draws a day; every row is stratified over the paths."""

        def rows(n: int) -> Floats:
            return np.array([strata(paths, rng) for _ in range(n)]).reshape(n, paths)

        storm_peak, shared = rows(2)  # the order of the draws is part of every recorded result
        return cls(
            rows(lines), rows(lines), rows(lines), storm_peak, shared, rows(lines),
            rows(common_slots),
        )  # fmt: skip


@dataclass
class Lane:
    """One line on all paths of a look-ahead, day after day.

    Attributes:
        down: (slots, paths) where it is down, in slots after the present one.
        free: (paths,) first slot of the day in which it may fail.
        over: (paths,) first slot of the day after its latest outage.
    """

    down: Bools
    free: Ints
    over: Ints


def bell_paths(
    days: BellDays, history: LineHistory, slots: int, per_day: int, draws: list[DayDraw]
) -> Bools:
    """(lines, slots, paths) where lines are down after slot t, on equally likely paths.

    Storm peak and shifts of the present day are drawn from what was seen so far, those of later
    days from the bell. Slots of one line's failure are stratified; so are the lengths of outages.

    Args:
        days: of the bell.
        history: what was seen.
        slots: how far to look, slots of the case.
        per_day: slots of a day.
        draws: of today and of every later day that the slots reach.
    """
    bell, (lines, paths) = days.bell, draws[0].fail.shape
    down = np.zeros((lines, slots, paths), bool)
    lanes = [_present(bell, history, k, down[k], draws[0], per_day) for k in range(lines)]
    for day, draw in enumerate(draws[: days_reached(history.t, slots, per_day)]):
        belief = days.later if day else days.today(history)
        peaks = belief.drawn(draw.storm_peak, draw.shared, draw.shift)
        start = day * per_day - history.t - 1  # of the day, in `down`, whose first slot is t + 1
        for k, lane in enumerate(lanes):
            if day:
                lane.over = np.maximum(lane.over - per_day, 0) if bell.overnight else 0 * lane.over
                lane.free = lane.over
            chance = days.chance[peaks[k] - days.lowest]
            _fail(bell, lane, chance, draw, k, start)
    return down


def days_reached(t: int, slots: int, per_day: int) -> int:
    """Days that the `slots` after slot t of a day touch, today included."""
    return (t + slots) // per_day + 1


def lengths_left(bell: Bell, elapsed: int, per_day: int) -> Ints:
    """(lengths,) slots after the present one that an outage of that age may last, equally likely.

    Ascending; where slots are long, several lengths of the bell are the same number of slots.
    """
    lengths = bell.lengths(DAY_MIN / per_day)
    remaining = lengths[lengths > elapsed] - elapsed - 1
    return remaining if len(remaining) else np.zeros(1, np.intp)


def _present(
    bell: Bell, history: LineHistory, k: int, down: Bools, draw: DayDraw, per_day: int
) -> Lane:
    """The line with the outage that it has now, and when it may fail next."""
    paths, now = down.shape[1], history.t + 1
    remaining = np.zeros(paths, np.intp)
    if history.is_down[k]:
        slots_left = lengths_left(bell, int(history.age[k]), per_day)
        remaining = _pick(slots_left, draw.remaining[k])[0]
    over = now + remaining
    if not bell.overnight:
        over = np.minimum(over, per_day)
    _mark(down, 0 * over, over - now)
    may_fail = bell.refail or not history.spent[k]
    return Lane(down, over if may_fail else np.full(paths, per_day), over)


def _fail(bell: Bell, lane: Lane, chance: Floats, draw: DayDraw, k: int, start: int) -> None:
    """Lets a line fail in the course of a day, once or as often as the bell lets it.

    Args:
        bell: the process.
        lane: of the line; it is moved on.
        chance: (paths, slots) of failing in a slot.
        draw: of the day.
        k: number of the line.
        start: of the day in `lane.down`.
    """
    per_day = chance.shape[1]
    lengths = bell.lengths(DAY_MIN / per_day)
    slot = np.arange(per_day)
    u, u_length = draw.fail[k], draw.length[k]
    while (lane.free < per_day).any():
        at_risk = np.where(slot >= lane.free[:, None], chance, 0.0)
        if bell.common_draw:
            first, fails = _first_common(at_risk, draw.common)
        else:
            first, fails, u = _first(at_risk, u)
        length, u_length = _pick(lengths, u_length)
        over = first + length
        if not bell.overnight:
            over = np.minimum(over, per_day)
        _mark(lane.down, start + first, np.where(fails, over - first, 0))
        lane.over = np.where(fails, over, lane.over)
        if not (bell.refail and fails.any()):
            return
        lane.free = np.where(fails, over, per_day)


def _first(chance: Floats, u: Floats) -> tuple[Ints, Bools, Floats]:
    """Slot in which the probability of having failed first reaches u, whether it does, and what u
    says beyond that: a uniform number again, of what follows.
    """
    stands = np.cumsum(np.log1p(-chance), axis=1)
    failed = -np.expm1(stands)
    hit = failed >= u[:, None]
    first, fails = np.argmax(hit, axis=1), hit.any(axis=1)
    path = np.arange(len(u))
    before = np.where(first > 0, failed[path, first - 1], 0.0)
    within = np.where(fails, failed[path, first] - before, 1.0)
    u_left = np.clip((u - before) / np.where(within > 0.0, within, 1.0), 0.0, 1.0)
    return first, fails, u_left


def _first_common(chance: Floats, u: Floats) -> tuple[Ints, Bools]:
    """First slot in which the number (slots, paths) of all lines is below the chance, if any."""
    hit = chance > u.T
    return np.argmax(hit, axis=1), np.asarray(hit.any(axis=1))


def _pick(values: Ints, u: Floats) -> tuple[Ints, Floats]:
    """(paths,) equally likely values, by uniform numbers, and what these say beyond that."""
    place = u * len(values)
    index = np.minimum(place.astype(np.intp), len(values) - 1)
    return values[index], place - index


def _mark(down: Bools, first: Ints, length: Ints) -> None:
    """Marks outages (paths,) in `down` (slots, paths)."""
    slots = np.arange(down.shape[0])[:, None]
    down |= (slots >= first) & (slots < first + length)
