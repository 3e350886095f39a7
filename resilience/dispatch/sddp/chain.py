r"""The lines as a Markov chain of modes: which of them are down.

Given the slot in which today's hazard peaks, lines fail and come back independently of each other
(unless one random number is common to all), so a mode's transition is a product over lines of

$$ P(\text{fails in } t \mid \text{up in } t - 1) = \frac{f_t}{1 - D_{t-1}}, \qquad
   P(\text{back in } t \mid \text{down in } t - 1) = \frac{r_t}{D_{t-1}} $$

with $f_t$, $r_t$ and $D_t$ the exact probabilities that a line fails in slot $t$, is back in it,
and is down in it, over all peaks, shifts and lengths that are possible. A line's chance of being
down is then exact in every slot. What the mode does not tell is averaged over: since when a line
is down, and whether a line that is up has failed before today.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.outages.bell import Bell

MIN_FAILURE_PROBABILITY = 1e-4  # per slot: failures less likely than this are left out
MIN_MODE_PROBABILITY = 1e-7  # of being in a mode: modes less likely than this are left out


@dataclass(frozen=True)
class Moves:
    """How one line fails and comes back in the course of a day.

    Attributes:
        fails: (slots,) probability that a line which was up fails in the slot.
        back: (slots,) probability that a line which was down is back in it.
        at_midnight: probability that it is down before the first slot.
    """

    fails: Floats
    back: Floats
    at_midnight: float


@dataclass(frozen=True)
class ModeChain:
    """The modes of one day.

    Attributes:
        down: by slot, (modes, lines) which lines are down.
        transition: by slot, (modes of the slot before, modes); the first has one row.
    """

    down: list[Bools]
    transition: list[Floats]

    def mode(self, t: int, down: Bools) -> int:
        """The mode of slot t with these lines down, (lines,), or the one most alike."""
        return int(np.argmin((self.down[t] != down).sum(axis=1)))


def storm_chain(bell: Bell, lines: int, peaks: Ints, per_day: int) -> ModeChain:
    """The chain of a day whose hazard peaks in one of `peaks`, equally likely.

    Args:
        bell: the outage process.
        lines: number of lines that can fail; the first of them is never shifted.
        peaks: (n,) slots of 15 minutes.
        per_day: slots of a day.
    """
    kinds = [_moves(bell, peaks, shift, per_day) for shift in (0, bell.shift_slots)]
    moves = [kinds[min(k, 1)] for k in range(lines)]
    sets = (np.arange(2**lines)[:, None] >> np.arange(lines)) % 2 == 1
    begin = np.ones(len(sets))
    for down, line in zip(sets.T, moves, strict=True):
        begin *= np.where(down, line.at_midnight, 1.0 - line.at_midnight)
    joint = []
    for t in range(per_day):
        fails = np.array([line.fails[t] for line in moves])
        back = np.array([line.back[t] for line in moves])
        joint.append(_joint(bell, sets, fails, back))
    return _pruned(sets, begin, joint)


def _moves(bell: Bell, peaks: Ints, shift: int, per_day: int) -> Moves:
    shifts = np.arange(-shift, shift + 1)
    usual = (bell.centre_slots()[:, None] + shifts).ravel()
    before = np.zeros(per_day)
    if bell.overnight:
        failed, _, _ = _renewal(bell, usual, np.zeros(per_day), per_day)
        before = failed.mean(axis=0)
    today = (np.asarray(peaks)[:, None] + shifts).ravel()
    failed, returned, down = (x.mean(axis=0) for x in _renewal(bell, today, before, per_day))
    chance = bell.slot_probability(today, DAY_MIN / per_day).mean(axis=0)
    carried = _before_midnight(bell, before, per_day)
    was = np.append(carried, down[:-1])
    fails = chance if bell.refail else failed / (1.0 - was)
    stays = 1.0 - chance if bell.refail else 1.0
    back = np.divide(returned * stays, was, out=np.ones(per_day), where=was > MIN_MODE_PROBABILITY)
    fails = np.where(fails < MIN_FAILURE_PROBABILITY, 0.0, fails)
    return Moves(fails, np.clip(back, 0.0, 1.0), carried)


def _before_midnight(bell: Bell, failed: Floats, per_day: int) -> float:
    """Chance that a line which fails with (slots,) `failed` is down when the day ends."""
    lengths = bell.lengths(DAY_MIN / per_day)
    lasting = sum(np.arange(per_day) + d >= per_day for d in lengths)
    return float(failed @ lasting / len(lengths)) if failed.any() else 0.0


def _renewal(
    bell: Bell, peaks: Ints, before: Floats, per_day: int
) -> tuple[Floats, Floats, Floats]:
    """(peaks, slots) chance of failing in, being back in, and being down in a slot.

    `before` are the chances, (slots,), of a failure in the slots of the day before.
    """
    # Slot by slot: a line is back in t if it failed in t - d and the outage lasts d slots, for each
    # length d alike. `failed` holds the day before in its first half, so that t - d is an index.
    # With repeated failures whoever is up may fail. Otherwise a line fails once a day: `fresh` is
    # the chance that it has not failed today, `carried` that it is still down from yesterday, and
    # both at once is what `carried` counts, so fresh - carried can fail.
    chance = bell.slot_probability(peaks, DAY_MIN / per_day)
    n, lengths = len(peaks), bell.lengths(DAY_MIN / per_day)
    failed = np.concatenate([np.tile(before, (n, 1)), np.zeros((n, per_day))], axis=1)
    returned, down = np.zeros((n, per_day)), np.zeros((n, per_day))
    carried = np.full(n, _before_midnight(bell, before, per_day))
    is_down, fresh = carried.copy(), np.ones(n)
    for t in range(per_day):
        slot = per_day + t
        began = [slot - d for d in lengths if slot >= d]
        returned[:, t] = failed[:, began].sum(axis=1) / len(lengths)
        carried -= np.sum([before[k] for k in began if k < per_day], initial=0.0) / len(lengths)
        can = 1.0 - is_down + returned[:, t] if bell.refail else fresh - carried
        failed[:, slot] = chance[:, t] * np.maximum(can, 0.0)
        fresh -= failed[:, slot]
        is_down = is_down - returned[:, t] + failed[:, slot]
        down[:, t] = is_down
    return failed[:, per_day:], returned, down


def _joint(bell: Bell, sets: Bools, fails: Floats, back: Floats) -> Floats:
    """(sets, sets) chance of going from one set of lines that are down to another."""
    chance = np.ones((len(sets), len(sets)))
    for k, down in enumerate(sets.T):
        was, now = down[:, None], down[None]
        up = 1.0 if bell.common_draw else np.where(now, fails[k], 1.0 - fails[k])
        chance *= np.where(was, np.where(now, 1.0 - back[k], back[k]), up)
    if bell.common_draw:
        was, now = sets[:, None], sets[None]
        # One number u for all lines: those with a probability above u fail, the others do not.
        highest_u = np.where(~was & now, fails, 1.0).min(axis=2, initial=1.0)
        lowest_u = np.where(~was & ~now, fails, 0.0).max(axis=2, initial=0.0)
        chance *= np.maximum(highest_u - lowest_u, 0.0)
    return chance


def _pruned(sets: Bools, begin: Floats, joint: list[Floats]) -> ModeChain:
    """Without modes that are next to impossible; what led to them goes to the others."""
    chance, before = np.ones(1), np.array([0])
    down, transition = [], []
    for moves in [(begin @ joint[0])[None], *joint[1:]]:
        chance = chance @ moves
        likely = chance >= MIN_MODE_PROBABILITY
        likely[np.argmax(moves[before], axis=1)] = True
        after = np.flatnonzero(likely)
        rows = moves[np.ix_(before, after)]
        transition.append(rows / rows.sum(axis=1, keepdims=True))
        down.append(sets[after])
        before = after
    return ModeChain(down, transition)
