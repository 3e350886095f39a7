"""Repair: how long it takes, by how many crews, in which order, and not in the wind.

Time is in slots, as in a case: a repair takes whole slots, rounded up, and a slot in which a line
is down at all is down. A crew goes to the waiting line with the highest priority (the one that
failed first among equals), stays until it is done, and is free in the slot after. No work starts
and none goes on at a line in a slot whose wind there is above the limit: the work clock stands
still.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.special import ndtri

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import LAW_PARAMETERS
from resilience.errors import UsageError
from resilience.tolerances import SLOT_TOLERANCE

LAWS: dict[str, Callable[..., Floats]] = {
    "fixed": np.full_like,
    "uniform": lambda u, low, high: low + u * (high - low),
    "lognormal": lambda u, median, sigma: median * np.exp(sigma * ndtri(u)),
    "exponential": lambda u, mean: -mean * np.log1p(-u),
}
"""Hours of uniform numbers u and the parameters of a law, `LAW_PARAMETERS`."""

MAX_SIGMA = 3.0
"""Of a lognormal: one repair in six would take twenty times the median or more."""


@dataclass(frozen=True)
class Repair:
    """How lines are repaired.

    Attributes:
        law: of the hours of work: `fixed`, `uniform`, `lognormal` or `exponential`.
        hours: its parameters: (hours,), (shortest, longest), (median, sigma) with sigma of the log,
            or (mean,).
        crews: how many work at a time; as many as needed if None.
        wind_limit_mps: no work at a line while the wind at any of its spans is above it, m/s in the
            measure of the wind that is given.
        priority: of lines by name, higher first; 0 where not given.

    Raises:
        UsageError: a value out of range; all of them are listed.
    """

    law: str = "uniform"
    hours: tuple[float, ...] = (3.0, 3.75)
    crews: int | None = None
    wind_limit_mps: float = 20.0
    priority: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise UsageError(
                f"repair: law {self.law!r}; allowed: {', '.join(LAWS)}",
                hint="uniform from 3 to 3.75 h is the paper's",
            )
        names = LAW_PARAMETERS[self.law]
        rules = [
            (len(self.hours) == len(names), f"hours {self.hours}; allowed: {', '.join(names)}"),
            (all(0.0 <= h < np.inf for h in self.hours), f"hours {self.hours}; allowed: 0 or more"),
            (
                self.law != "uniform" or tuple(sorted(self.hours)) == tuple(self.hours),
                f"hours {self.hours}; allowed: shortest, then longest",
            ),
            (
                self.crews is None or (self.crews > 0 and self.crews == int(self.crews)),
                f"{self.crews} crews; allowed: a whole number, 1 or more",
            ),
            (self.wind_limit_mps > 0.0, f"wind limit {self.wind_limit_mps}; allowed: above 0 m/s"),
        ]
        if self.law == "lognormal" and len(self.hours) == 2:
            sigma = self.hours[1]
            rules.append((sigma <= MAX_SIGMA, f"sigma {sigma:g}; allowed: up to {MAX_SIGMA:g}"))
        wrong = [text for good, text in rules if not good]
        if wrong:
            raise UsageError(
                "repair: " + "; ".join(wrong),
                hint="hours of work; from 6 to 30 of them are uniform, a median of 6 with most "
                "between 4 and 10 is lognormal with sigma 0.5",
            )

    def __str__(self) -> str:
        crews = "any number of crews" if self.crews is None else f"{self.crews} crews"
        crews = "1 crew" if self.crews == 1 else crews
        hours = ", ".join(
            f"{name} {value:g}"
            for name, value in zip(LAW_PARAMETERS[self.law], self.hours, strict=True)
        )
        first = ", ".join(sorted(self.priority, key=lambda name: -self.priority[name]))
        order = f", {first} first" if first else ""
        limit = f"none above {self.wind_limit_mps:g} m/s"
        return f"{crews}, {self.law} hours ({hours}), {limit}{order}"

    def work_slots(self, u: Floats, step_h: float) -> Ints:
        """(...) slots of work, 1 or more, of uniform random numbers (...)."""
        hours = LAWS[self.law](u, *self.hours)
        return np.maximum(np.ceil(hours / step_h - SLOT_TOLERANCE), 1.0).astype(np.intp)

    def order(self, lines: tuple[str, ...]) -> Ints:
        """(lines,) rank of each line, equal priorities alike, 0 first.

        Raises:
            UsageError: a priority of a line that does not exist.
        """
        unknown = [name for name in self.priority if name not in lines]
        if unknown:
            raise UsageError(
                f"repair: priority of line {', '.join(unknown)}; allowed: {', '.join(lines)}",
                hint="a line is named by its ends, like 6-26",
            )
        return ranks(self.priority, lines)


def ranks(priority: Mapping[str, float], lines: Sequence[str]) -> Ints:
    """(lines,) rank of each line by its priority, 0 where not given; equal ones alike, 0 first."""
    negated = [-priority.get(name, 0.0) for name in lines]
    return np.unique(negated, return_inverse=True)[1].ravel()


Lengths = Callable[[Ints, Ints, Ints], Ints]
"""(events,) slots of work of lines, in scenarios, for the so-many-th time."""
Again = Callable[[Ints, Ints, Ints, int], Ints]
"""(events,) next slot of failure of lines, in scenarios, for the so-many-th time, new at a slot."""


@dataclass(frozen=True, eq=False)
class OngoingOutages:
    """Outages that have begun before the first slot.

    Attributes:
        work_left: (lines, scenarios) slots of work; 0 where a line is up.
        since: (lines,) slot of failure, below 0 where a line is down.
        waiting: (lines,) True where no crew has come yet.
    """

    work_left: Ints
    since: Ints
    waiting: Bools


@dataclass(frozen=True, eq=False)
class RepairOutcome:
    """What became of the lines.

    Attributes:
        down: (lines, slots, scenarios) True where a line is down.
        work: (slots, scenarios) crews at work.
        work_left: (lines, scenarios) slots of work at the end.
    """

    down: Bools
    work: Ints
    work_left: Ints


def repair_outcome(
    first: Ints,
    length: Lengths,
    calm: Callable[[int], Bools],
    slots: int,
    *,
    crews: int | None = None,
    order: Ints | None = None,
    again: Again | None = None,
    ongoing: OngoingOutages | None = None,
) -> RepairOutcome:
    """What becomes of lines that fail and are repaired, slot by slot, all scenarios at once.

    Args:
        first: (lines, scenarios) slot of the first failure; `slots` or more: never.
        length: of a repair, slots of work.
        calm: (lines, scenarios) or (lines, 1), of a slot: True where there is work at a line.
        slots: how many.
        crews: see `Repair`.
        order: (lines,) rank of each line, lowest first; all alike if omitted.
        again: of a line that was repaired; it does not fail again if omitted.
        ongoing: outages that have begun already; those lines fail at no slot of `first`.
    """
    lines, n = first.shape
    queue = _Queue(crews, np.zeros(lines, np.intp) if order is None else order, first.shape)
    work_left, times = np.zeros(first.shape, np.int32), np.zeros(first.shape, np.intp)
    if ongoing is not None:
        work_left[:] = ongoing.work_left
        queue.resume(ongoing)
    failing = _by_slot(first, slots)
    down, work = np.zeros((lines, slots, n), bool), np.zeros((slots, n), np.intp)
    for t in range(slots):
        for event in failing[t]:
            line, scenario = np.divmod(event, n)
            work_left.ravel()[event] = length(line, scenario, times.ravel()[event])
            times.ravel()[event] += 1
            queue.join(event, t)
        out = work_left > 0
        if not out.any():
            continue
        down[:, t] = out
        working = calm(t) & out
        queue.serve(working, out)
        working &= ~queue.waiting
        work_left -= working
        work[t] = working.sum(axis=0)
        event = np.flatnonzero(working & (work_left == 0))
        if again is not None and len(event) and t + 1 < slots:
            line, scenario = np.divmod(event, n)
            following = again(line, scenario, times.ravel()[event], t + 1)
            for slot in np.unique(following[following < slots]).tolist():
                failing[slot].append(event[following == slot])
    return RepairOutcome(down, work, work_left.astype(np.intp))


def crew_since(down: Bools, calm: Bools, crews: int, order: Ints) -> Ints:
    """(lines,) slot in which a crew came to each line that is down at last; -1: none is there.

    The queue of `repair_outcome`, told from outages that were observed. It changes only where a
    line fails or is back, or may be worked at again, so that other slots are passed over.

    Args:
        down: (lines, slots) where lines were seen down; at least one slot.
        calm: (lines, slots) where there is work at a line.
        crews: how many.
        order: (lines,) rank of each line, lowest first.
    """
    queue, came = _Queue(crews, order, (len(down), 1)), np.full(len(down), -1)
    before = np.zeros_like(down)
    before[:, 1:] = down[:, :-1]
    failed, can = down & ~before, down & calm
    changes = (down != before).any(axis=0)
    changes[1:] |= (can[:, 1:] != can[:, :-1]).any(axis=0)
    for t in np.flatnonzero(changes).tolist():
        queue.waiting &= down[:, t, None]
        queue.join(np.flatnonzero(failed[:, t]), t)
        waited = queue.waiting.copy()
        queue.serve(can[:, t, None], down[:, t, None])
        came[(waited & ~queue.waiting)[:, 0]] = t
    return np.where(down[:, -1] & ~queue.waiting[:, 0], came, -1)


def _by_slot(first: Ints, slots: int) -> list[list[Ints]]:
    """Of every slot: the flat indices of what fails first in it."""
    flat = np.minimum(first.ravel(), slots)
    order = np.argsort(flat.astype(np.int16 if slots < 2**15 else np.intp), kind="stable")
    bounds = np.searchsorted(flat[order], np.arange(slots + 1))
    return [[order[a:b]] if b > a else [] for a, b in pairwise(bounds.tolist())]


class _Queue:
    """Who waits for a crew, and since when.

    Args:
        crews: how many; nobody waits if None.
        rank: (lines,) of each line, lowest first.
        shape: lines and scenarios.

    Attributes:
        waiting: (lines, scenarios) True where a line that is down has no crew yet.
        since: (lines, scenarios) slots from `before` on in which it failed.
        before: slots before the first in which the earliest outage that waits began, so that
            `since` is never negative.
    """

    def __init__(self, crews: int | None, rank: Ints, shape: tuple[int, int]) -> None:
        self.crews, self.rank = crews, rank
        self.waiting = np.zeros(shape, bool)
        self.since = np.zeros(shape, np.intp)
        self.before = 0

    def resume(self, ongoing: OngoingOutages) -> None:
        """Takes over outages that have begun: those who wait have waited since their failure."""
        if self.crews is not None:
            self.before = -int(ongoing.since.min(initial=0))
            self.since[:] = ongoing.since[:, None] + self.before
            self.waiting[:] = ongoing.waiting[:, None] & (ongoing.work_left > 0)

    def join(self, event: Ints, t: int) -> None:
        """Lines that failed in slot t; each has its crew at once where crews are not short."""
        if self.crews is not None:
            self.waiting.ravel()[event] = True
            self.since.ravel()[event] = t + self.before

    def serve(self, calm: Bools, out: Bools) -> None:
        """Sends the crews that are free to lines where they can start."""
        if self.crews is None:
            return
        candidates = self.waiting & calm
        idle = self.crews - (out & ~self.waiting).sum(axis=0)
        served = candidates & (idle > 0)
        short = np.flatnonzero((candidates.sum(axis=0) > idle) & (idle > 0))
        if len(short):
            served[:, short] = self._foremost(candidates[:, short], short, idle[short])
        self.waiting &= ~served

    def _foremost(self, candidates: Bools, short: Ints, idle: Ints) -> Bools:
        """(lines, short) True for the `idle` foremost of the candidates for a crew.

        Args:
            candidates: (lines, short) who waits where there can be work.
            short: scenarios in which crews are short.
            idle: (short,) crews that are free.
        """
        lines, span = len(candidates), int(self.since.max()) + 1
        number = np.arange(lines)[:, None]
        # Rank, then time of failure, then number, as the digits of one integer: one sort for all.
        key = (self.rank[:, None] * span + self.since[:, short]) * lines + number
        key = np.where(candidates, key, np.iinfo(np.intp).max)
        order = np.argsort(key, axis=0)
        place = np.empty_like(order)
        np.put_along_axis(place, order, np.broadcast_to(number, order.shape), axis=0)
        return candidates & (place < idle)
