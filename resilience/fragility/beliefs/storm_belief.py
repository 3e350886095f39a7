r"""Belief in a storm on its track: what is known of the lines tells of the storm's strength.

Lines are independent given the member $j$ of the forecast and the common factor $Z$ of all
capacities, so a storm is a mixture over pairs $c = (j, Z)$ of known weight. A line that is up in
slot $t$ has stood in the strongest wind so far; one that failed in slot $s$ stood until $s - 1$.
With $S_k(t \mid c)$, the chance that line $k$ stands through slot $t$, the weights become

$$ w_c' \propto w_c \prod_{k\ \text{up}} S_k(t \mid c)
   \prod_{k\ \text{failed}} \left(S_k(s_k - 1 \mid c) - S_k(s_k \mid c)\right) $$

which is exact, and failures to come follow from $S_k(t + m \mid c) / S_k(t \mid c)$. A line that
was mended is believed to hold for the rest of the storm; the wind itself is not observed, only what
it does to lines.

Where crews are few, the queue is known from what was seen: when lines failed, which are back since
when, and in which slots there was work. A line whose crew has worked for $d$ slots takes the work
that is left of those repairs that take $d$ or more; a line that waits takes all of its work.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.conditional import Known, strata
from resilience.fragility.lines.damage import accumulated
from resilience.fragility.lines.spans import factor_nodes, scores, span_speed
from resilience.fragility.outages.repair import Begun, Repair, crew_since, ranks, repaired
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.fragility.chain import Storm

LEAST = 1e-7  # weight of a value of Z that is kept
CERTAIN = 700.0  # e^-700 never happens
COMONOTONE = 400  # values of Z where correlation is 1
GRID = 1000  # for the distribution of work
USUAL = 200  # paths that the length of outages is taken from
LONG = 0.95


class StormBelief:
    """Belief in a storm; see above.

    Args:
        fallen: (components, lines, slots + 1) minus log of the chance to stand through slot t - 1.
        weight: (components,) before anything is seen.
        calm: (lines, slots) where crews may work, in most members of the forecast.
        repair: how lines are mended.
        step_h: length of a slot.
        seed: of sampled futures.
        order: (lines,) rank of each line in the queue for a crew, lowest first; all alike if
            omitted. The first of equals goes first.
    """

    daily = False

    def __init__(
        self,
        fallen: Floats,
        weight: Floats,
        calm: Bools,
        repair: Repair,
        step_h: float,
        seed: int = 0,
        order: Ints | None = None,
    ) -> None:
        self.fallen, self.weight, self.calm, self.seed = fallen, weight, calm, seed
        work = repair.work_slots((np.arange(GRID) + 0.5) / GRID, step_h)
        self.work, self.crews = np.sort(work), repair.crews
        self.order = np.zeros(len(calm), np.intp) if order is None else order
        self._drawn: dict[int, tuple[Floats, Floats, Floats]] = {}

    @classmethod
    def of(cls, storm: Storm, names: tuple[str, ...], *, seed: int = 0) -> StormBelief:
        """The belief of somebody who knows track, lines and repair of a storm.

        Args:
            storm: the storm.
            names: lines, in the order of what is known of them; others than the storm's never fail.
            seed: of sampled futures.
        """
        z, weight = _factor(storm.lines.correlation)
        at = [k for k, name in enumerate(names) if name in storm.lines.names]
        of = [storm.lines.names.index(names[k]) for k in at]
        shape = (len(storm.winds), len(z), len(names), storm.case.slots + 1)
        fallen = np.zeros(shape)
        for j, wind in enumerate(storm.winds):
            score = scores(storm.lines, span_speed(storm.lines, wind))
            found = accumulated(storm.lines, score, z, storm.timing)[of]
            fallen[j, :, at, 1:] = np.minimum(found, CERTAIN).transpose(0, 2, 1)
        calm = np.ones((len(names), storm.case.slots), bool)
        calm[at] = np.mean([storm.calm(wind)[of] for wind in storm.winds], axis=0) >= 0.5
        every = np.tile(weight, len(storm.winds))
        joined, step_h = fallen.reshape(-1, *shape[2:]), storm.timing.step_h
        order = ranks(storm.repair.priority, names)
        return cls(joined, every / every.sum(), calm, storm.repair, step_h, seed, order)

    @property
    def slots(self) -> int:
        """Slots of the horizon."""
        return int(self.calm.shape[1])

    @cached_property
    def longest_slots(self) -> int:
        """Slots that 19 in 20 outages stay below, as foreseen before the storm; 1 if none is."""
        none = np.full(len(self.calm), -1)
        before = Known(-1, -1, none, none >= 0, 0, none)
        length = self.paths(before, self.slots, USUAL).sum(axis=1)
        length = length[length > 0]
        return int(np.ceil(np.quantile(length, LONG))) if len(length) else 1

    def posterior(self, known: Known) -> Floats:
        """(components,) probability of every pair of member and common factor, given what is known.

        What cannot be leaves the weights as they were.
        """
        first = known.first if known.first is not None else known.since
        now = known.t + 1
        fresh = first < 0
        log = -self.fallen[:, fresh, now].sum(axis=1)
        at = np.flatnonzero(~fresh)
        one, two = self.fallen[:, at, first[at]], self.fallen[:, at, first[at] + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            log += (np.log(-np.expm1(one - two)) - one).sum(axis=1)
        log = np.where(np.isnan(log), -np.inf, log)
        if not np.isfinite(log).any():
            return self.weight
        found = self.weight * np.exp(log - log.max())
        return found / found.sum()

    def chances(self, known: Known, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""
        weight, now = self.posterior(known), known.t + 1
        ahead = self.fallen[:, :, now : now + slots + 1]
        stands = np.exp(-(ahead - ahead[:, :, :1]))
        begins = np.einsum("c,cks->ks", weight, -np.diff(stands, axis=2))
        found = np.zeros((len(self.calm), slots))
        found[:, : begins.shape[1]] = np.where(self._may(known)[:, None], begins, 0.0)
        return found

    def paths(self, known: Known, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot."""
        u, length, which = self._draws(n)
        weight, now, lines = self.posterior(known), known.t + 1, len(self.calm)
        component = np.minimum(np.searchsorted(np.cumsum(weight), which), len(weight) - 1)
        left = min(slots, self.slots - now)
        down = np.zeros((lines, slots, n), bool)
        if left <= 0:
            return down
        ahead = self.fallen[:, :, now : now + left + 1]
        first = np.full((lines, n), left)
        for k in np.flatnonzero(self._may(known)):
            rise = ahead[:, k, 1:] - ahead[:, k, :1]
            reached = rise[component] >= -np.log1p(-u[k])[:, None]
            first[k] = np.where(reached.any(axis=1), reached.argmax(axis=1), left)
        work = self.work[(length * GRID).astype(np.intp)]

        def lengths(line: Ints, path: Ints, _: Ints) -> Ints:
            return work[line, path]

        def calm(slot: int) -> Bools:
            return self.calm[:, now + slot, None]

        down[:, :left] = repaired(
            first, lengths, calm, left, crews=self.crews, order=self.order,
            begun=self._begun(known, length, work),
        ).down  # fmt: skip
        return down

    def expected_left(self, known: Known) -> Ints:
        """(lines,) slots after the present one, the mean over sampled futures, rounded up."""
        is_down = known.since >= 0
        if not is_down.any():
            return np.zeros(len(is_down), np.intp)
        down = self.paths(known, self.slots - known.t - 1, USUAL)
        run = np.logical_and.accumulate(down, axis=1).sum(axis=1).mean(axis=1)
        return np.where(is_down, np.ceil(run - SLOT_TOLERANCE), 0).astype(np.intp)

    def _may(self, known: Known) -> Bools:
        """(lines,) lines that have not failed yet."""
        return (known.since < 0) & ~known.spent

    def _begun(self, known: Known, u: Floats, work: Ints) -> Begun | None:
        """Outages of the present: who waits, and the work left on each path.

        Args:
            known: what is known.
            u: (lines, paths) uniform numbers, of the work of lines whose crew has come.
            work: (lines, paths) of lines that wait.
        """
        is_down, now = known.since >= 0, known.t + 1
        if not is_down.any():
            return None
        came = known.since
        if self.crews is not None:
            came = crew_since(_seen(known), self.calm[:, :now], self.crews, self.order)
        left = np.where(is_down[:, None], work, 0)
        for k in np.flatnonzero(came >= 0).tolist():
            done = int(self.calm[k, came[k] : now].sum())
            least = int(np.searchsorted(self.work, done))
            possible = self.work[least:] if least < len(self.work) else np.array([done])
            left[k] = possible[(u[k] * len(possible)).astype(np.intp)] - done
        return Begun(left, np.where(is_down, known.since - now, 0), is_down & (came < 0))

    def _draws(self, n: int) -> tuple[Floats, Floats, Floats]:
        """Stratified numbers: failure and length of work (lines, n), and component (n,)."""
        if n not in self._drawn:
            rng = np.random.default_rng([self.seed, n])
            u, length = (np.array([strata(n, rng) for _ in self.calm]) for _ in range(2))
            shape = (len(self.calm), n)
            self._drawn[n] = u.reshape(shape), length.reshape(shape), strata(n, rng)
        return self._drawn[n]


def _seen(known: Known) -> Bools:
    """(lines, t + 1) where lines were seen down: of those that are, where no more is remembered."""
    if known.down is not None:
        return known.down
    slot = np.arange(known.t + 1)
    return (known.since[:, None] >= 0) & (slot >= known.since[:, None])


def _factor(correlation: float) -> tuple[Floats, Floats]:
    """(k,) values of the common factor and their weights."""
    if correlation == 1.0:
        return ndtri((np.arange(COMONOTONE) + 0.5) / COMONOTONE), np.ones(COMONOTONE)
    z, weight = factor_nodes(correlation)
    kept = weight > LEAST
    return z[kept], weight[kept]
