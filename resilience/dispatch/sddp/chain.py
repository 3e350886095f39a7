r"""The lines as a Markov chain of modes: which of them are down.

Given today's centre, lines fail and come back independently of each other (unless one random number
is common to all), so a mode's transition is a product over lines of

$$ P(\text{fails in } t \mid \text{up in } t - 1) = \frac{f_t}{1 - D_{t-1}}, \qquad
   P(\text{back in } t \mid \text{down in } t - 1) = \frac{r_t}{D_{t-1}} $$

with $f_t$, $r_t$ and $D_t$ the exact probabilities that a line fails in slot $t$, is back in it,
and is down in it, over all centres, shifts and lengths that are possible. A line's chance of being
down is then exact in every slot. What the mode does not tell is averaged over: since when a line
is down, and whether a line that is up has failed before today.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.window import DAY_MIN
from resilience.fragility.outages.bell import Bell

RARE = 1e-4  # per slot: failures less likely than this are left out
UNLIKELY = 1e-7  # of being in a mode: modes less likely than this are left out


@dataclass(frozen=True)
class Moves:
    """(slots,) chance that a line which is up fails, and that one which is down is back; and the
    chance that it is down before the first slot.
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


def storm_chain(bell: Bell, lines: int, centres: Ints, per_day: int) -> ModeChain:
    """The chain of a day whose hazard peaks in one of `centres`, equally likely.

    Args:
        bell: the outage process.
        lines: number of lines that can fail; the first of them is never shifted.
        centres: (n,) slots of 15 minutes.
        per_day: slots of a day.
    """
    kinds = [_moves(bell, centres, shift, per_day) for shift in (0, bell.shift_slots)]
    each = [kinds[min(k, 1)] for k in range(lines)]
    sets = (np.arange(2**lines)[:, None] >> np.arange(lines)) % 2 == 1
    begin = np.ones(len(sets))
    for down, line in zip(sets.T, each, strict=True):
        begin *= np.where(down, line.at_midnight, 1.0 - line.at_midnight)
    joint = []
    for t in range(per_day):
        fails, back = (np.array([getattr(x, k)[t] for x in each]) for k in ("fails", "back"))
        joint.append(_joint(bell, sets, fails, back))
    return _pruned(sets, begin, joint)


def _moves(bell: Bell, centres: Ints, shift: int, per_day: int) -> Moves:
    shifts = np.arange(-shift, shift + 1)
    usual = (bell.centre_slots()[:, None] + shifts).ravel()
    before = np.zeros(per_day)
    if bell.overnight:
        failed, _, _ = _renewal(bell, usual, np.zeros(per_day), per_day)
        before = failed.mean(axis=0)
    today = (np.asarray(centres)[:, None] + shifts).ravel()
    failed, returned, down = (x.mean(axis=0) for x in _renewal(bell, today, before, per_day))
    chance = bell.slot_probability(today, DAY_MIN / per_day).mean(axis=0)
    carried = _before_midnight(bell, before, per_day)
    was = np.append(carried, down[:-1])
    fails = chance if bell.refail else failed / (1.0 - was)
    stays = 1.0 - chance if bell.refail else 1.0
    back = np.divide(returned * stays, was, out=np.ones(per_day), where=was > UNLIKELY)
    return Moves(np.where(fails < RARE, 0.0, fails), np.clip(back, 0.0, 1.0), carried)


def _before_midnight(bell: Bell, failed: Floats, per_day: int) -> float:
    """Chance that a line which fails with (slots,) `failed` is down when the day ends."""
    lengths = bell.lengths(DAY_MIN / per_day)
    left = sum(np.arange(per_day) + d >= per_day for d in lengths)
    return float(failed @ left / len(lengths)) if failed.any() else 0.0


def _renewal(
    bell: Bell, centres: Ints, before: Floats, per_day: int
) -> tuple[Floats, Floats, Floats]:
    """(centres, slots) chance of failing in, being back in, and being down in a slot.

    `before` are the chances, (slots,), of a failure in the slots of the day before.
    """
    chance = bell.slot_probability(centres, DAY_MIN / per_day)
    n, lengths = len(centres), bell.lengths(DAY_MIN / per_day)
    failed = np.concatenate([np.tile(before, (n, 1)), np.zeros((n, per_day))], axis=1)
    returned, down = np.zeros((n, per_day)), np.zeros((n, per_day))
    carried = np.full(n, _before_midnight(bell, before, per_day))
    is_down, fresh = carried.copy(), np.ones(n)
    for t in range(per_day):
        at = per_day + t
        began = [at - d for d in lengths if at >= d]
        returned[:, t] = failed[:, began].sum(axis=1) / len(lengths)
        carried -= np.sum([before[k] for k in began if k < per_day], initial=0.0) / len(lengths)
        can = 1.0 - is_down + returned[:, t] if bell.refail else fresh - carried
        failed[:, at] = chance[:, t] * np.maximum(can, 0.0)
        fresh -= failed[:, at]
        is_down = is_down - returned[:, t] + failed[:, at]
        down[:, t] = is_down
    return failed[:, per_day:], returned, down


def _joint(bell: Bell, sets: Bools, fails: Floats, back: Floats) -> Floats:
    """(sets, sets) chance of going from one set of lines that are down to another."""
    found = np.ones((len(sets), len(sets)))
    for k, down in enumerate(sets.T):
        was, now = down[:, None], down[None]
        up = 1.0 if bell.common_draw else np.where(now, fails[k], 1.0 - fails[k])
        found *= np.where(was, np.where(now, 1.0 - back[k], back[k]), up)
    if bell.common_draw:
        was, now = sets[:, None], sets[None]
        least = np.where(~was & now, fails, 1.0).min(axis=2, initial=1.0)
        most = np.where(~was & ~now, fails, 0.0).max(axis=2, initial=0.0)
        found *= np.maximum(least - most, 0.0)
    return found


def _pruned(sets: Bools, begin: Floats, joint: list[Floats]) -> ModeChain:
    """Without modes that are next to impossible; what led to them goes to the others."""
    chance, kept, joint[0] = np.ones(1), np.array([0]), (begin @ joint[0])[None]
    down, transition = [], []
    for moves in joint:
        chance = chance @ moves
        likely = chance >= UNLIKELY
        likely[np.argmax(moves[kept], axis=1)] = True
        after = np.flatnonzero(likely)
        rows = moves[np.ix_(kept, after)]
        transition.append(rows / rows.sum(axis=1, keepdims=True))
        down.append(sets[after])
        kept = after
    return ModeChain(down, transition)
