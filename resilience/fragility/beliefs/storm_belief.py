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
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import strata
from resilience.fragility.lines.damage import accumulated
from resilience.fragility.lines.spans import factor_nodes, scores, span_speed
from resilience.fragility.outages.repair import (
    OngoingOutages,
    Repair,
    crew_since,
    ranks,
    repair_outcome,
)
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.fragility.chain import Storm

NEGLIGIBLE_WEIGHT = 1e-7  # of a value of Z, which is left out
MAX_HAZARD = 700.0  # minus log of a chance: e^-700 never happens
COMONOTONE_NODES = 400  # values of Z where correlation is 1
WORK_QUANTILES = 1000  # for the distribution of work
LENGTH_PATHS = 200  # paths that the length of outages is taken from
LONG_QUANTILE = 0.95  # of the lengths of outages: what counts as a long one


class StormBelief:
    """Belief in a storm; see above.

    Args:
        fallen: (components, lines, slots + 1) minus log of the chance to stand through slot t - 1.
        weight: (components,) before anything is seen.
        calm: (lines, slots) where crews may work, in half the members of the forecast or more.
        repair: how lines are mended.
        step_h: length of a slot.
        seed: of sampled futures.
        order: (lines,) rank of each line in the queue for a crew, lowest first; all alike if
            omitted. The first of equals goes first.
    """

    daily, overnight = False, True

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
        work = repair.work_slots((np.arange(WORK_QUANTILES) + 0.5) / WORK_QUANTILES, step_h)
        self.work, self.crews = np.sort(work), repair.crews
        self.order = np.zeros(len(calm), np.intp) if order is None else order
        self._drawn: dict[tuple[int, int], tuple[Floats, Floats, Floats]] = {}

    @classmethod
    def from_storm(cls, storm: Storm, names: tuple[str, ...], *, seed: int = 0) -> StormBelief:
        """The belief of somebody who knows track, lines and repair of a storm.

        Args:
            storm: the storm.
            names: lines, in the order of what is known of them; others than the storm's never fail.
            seed: of sampled futures.
        """
        z, weight = _factor(storm.lines.correlation)
        rows = [k for k, name in enumerate(names) if name in storm.lines.names]
        lines = [storm.lines.names.index(names[k]) for k in rows]
        shape = (len(storm.winds), len(z), len(names), storm.case.slots + 1)
        fallen = np.zeros(shape)
        for j, wind in enumerate(storm.winds):
            score = scores(storm.lines, span_speed(storm.lines, wind))
            hazard = accumulated(storm.lines, score, z, storm.timing)[lines]
            fallen[j, :, rows, 1:] = np.minimum(hazard, MAX_HAZARD).transpose(0, 2, 1)
        calm = np.ones((len(names), storm.case.slots), bool)
        calm[rows] = np.mean([storm.calm(wind)[lines] for wind in storm.winds], axis=0) >= 0.5
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
        before = LineHistory.quiet(len(self.calm))
        length = self.paths(before, self.slots, LENGTH_PATHS).sum(axis=1)
        length = length[length > 0]
        return int(np.ceil(np.quantile(length, LONG_QUANTILE))) if len(length) else 1

    def posterior(self, history: LineHistory) -> Floats:
        """(components,) probability of every pair of member and common factor, given what is known.

        What cannot be leaves the weights as they were.
        """
        first, now = history.first, history.t + 1
        stands = first < 0
        log = -self.fallen[:, stands, now].sum(axis=1)
        failed = np.flatnonzero(~stands)
        before = self.fallen[:, failed, first[failed]]
        after = self.fallen[:, failed, first[failed] + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            log += (np.log(-np.expm1(before - after)) - before).sum(axis=1)
        log = np.where(np.isnan(log), -np.inf, log)
        if not np.isfinite(log).any():
            return self.weight
        posterior = self.weight * np.exp(log - log.max())
        return posterior / posterior.sum()

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""
        weight, now = self.posterior(history), history.t + 1
        ahead = self.fallen[:, :, now : now + slots + 1]
        stands = np.exp(-(ahead - ahead[:, :, :1]))
        begins = np.einsum("c,cks->ks", weight, -np.diff(stands, axis=2))
        chances = np.zeros((len(self.calm), slots))
        chances[:, : begins.shape[1]] = np.where(self._may_fail(history)[:, None], begins, 0.0)
        return chances

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot."""
        u, length, component_u = self._draws(n, history.number)
        weight, now, lines = self.posterior(history), history.t + 1, len(self.calm)
        component = np.minimum(np.searchsorted(np.cumsum(weight), component_u), len(weight) - 1)
        horizon = min(slots, self.slots - now)
        down = np.zeros((lines, slots, n), bool)
        if horizon <= 0:
            return down
        ahead = self.fallen[:, :, now : now + horizon + 1]
        first = np.full((lines, n), horizon)
        for k in np.flatnonzero(self._may_fail(history)):
            rise = ahead[:, k, 1:] - ahead[:, k, :1]
            reached = rise[component] >= -np.log1p(-u[k])[:, None]
            first[k] = np.where(reached.any(axis=1), reached.argmax(axis=1), horizon)
        work = self.work[(length * WORK_QUANTILES).astype(np.intp)]

        def lengths(line: Ints, path: Ints, _: Ints) -> Ints:
            return work[line, path]

        def calm(slot: int) -> Bools:
            return self.calm[:, now + slot, None]

        down[:, :horizon] = repair_outcome(
            first, lengths, calm, horizon, crews=self.crews, order=self.order,
            ongoing=self._ongoing(history, length, work),
        ).down  # fmt: skip
        return down

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one, the mean over sampled futures, rounded up."""
        is_down = history.is_down
        if not is_down.any():
            return np.zeros(len(is_down), np.intp)
        # What is mended holds, so all slots in which a line is down are of the present outage.
        mean = (
            self.paths(history, self.slots - history.t - 1, LENGTH_PATHS).sum(axis=1).mean(axis=1)
        )
        return np.where(is_down, np.ceil(mean - SLOT_TOLERANCE), 0).astype(np.intp)

    def _may_fail(self, history: LineHistory) -> Bools:
        """(lines,) True where a line has not failed yet."""
        return ~history.is_down & ~history.spent

    def _ongoing(self, history: LineHistory, u: Floats, work: Ints) -> OngoingOutages | None:
        """Outages of the present: who waits, and the work left on each path.

        Args:
            history: of the lines.
            u: (lines, paths) uniform numbers, of the work of lines whose crew has come.
            work: (lines, paths) of lines that wait.
        """
        is_down, now = history.is_down, history.t + 1
        if not is_down.any():
            return None
        came = history.since
        if self.crews is not None:
            came = crew_since(history.down, self.calm[:, :now], self.crews, self.order)
        remaining = np.where(is_down[:, None], work, 0)
        for k in np.flatnonzero(came >= 0).tolist():
            done = int(self.calm[k, came[k] : now].sum())
            shortest = int(np.searchsorted(self.work, done))
            possible = self.work[shortest:] if shortest < len(self.work) else np.array([done])
            remaining[k] = possible[(u[k] * len(possible)).astype(np.intp)] - done
        return OngoingOutages(
            remaining, np.where(is_down, history.since - now, 0), is_down & (came < 0)
        )

    def _draws(self, n: int, number: int) -> tuple[Floats, Floats, Floats]:
        """Stratified numbers: failure and length of work (lines, n), and component (n,)."""
        if (n, number) not in self._drawn:
            rng = np.random.default_rng([self.seed, n, number])
            u, length = (np.array([strata(n, rng) for _ in self.calm]) for _ in range(2))
            shape = (len(self.calm), n)
            self._drawn[n, number] = u.reshape(shape), length.reshape(shape), strata(n, rng)
        return self._drawn[n, number]


def _factor(correlation: float) -> tuple[Floats, Floats]:
    """(k,) values of the common factor and their weights."""
    if correlation == 1.0:
        share = (np.arange(COMONOTONE_NODES) + 0.5) / COMONOTONE_NODES
        return ndtri(share), np.ones(COMONOTONE_NODES)
    z, weight = factor_nodes(correlation)
    weighty = weight > NEGLIGIBLE_WEIGHT
    return z[weighty], weight[weighty]
