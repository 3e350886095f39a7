r"""The first stage of a decomposed program: the trunk, and what its scenarios cost behind it.

Columns are those of the trunk, then $\theta_s$ per chain, held up by the cuts, and with a `Risk`
what was spent up to every node of the trunk, $\eta$, and the excess $u_s$ of every scenario. A
scenario that never leaves the trunk costs what the trunk costs, and comes last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError
from resilience.models.backends.lower import lower
from resilience.models.backends.plain import Plain
from resilience.models.program.risk import node_prices
from resilience.models.program.standard import Vectors, reach
from resilience.models.structures import Discs
from resilience.planning.two_stage.recourse import Second
from resilience.planning.two_stage.two_stage import TwoStage


@dataclass(frozen=True)
class Trial:
    """A point of the first stage.

    Attributes:
        z: values of the trunk's columns.
        states: (chains, states) with which every chain begins.
        spent: (scenarios,) $ spent on the trunk; that of the one that stays is its whole cost.
        bound: what the master proves, $; -inf where it had no cuts.
    """

    z: Floats
    states: Floats
    spent: Floats
    bound: float


class Master:
    """The first stage.

    Args:
        two: the program.
        held: columns of the trunk to hold at zero (modes to keep to).
        discs: polygons within the discs or around them.
    """

    def __init__(self, two: TwoStage, *, held: Ints | None = None, discs: Discs = "outer") -> None:
        self.two, first = two, two.first
        self.chance = np.append([c.probability for c in two.chains], two.staying)
        self.starts = np.array([c.leaves for c in two.chains], np.intp)
        ends = np.array([first.state_columns(node) for node in range(two.trunk)], np.intp)
        ends = np.vstack([ends.reshape(two.trunk, -1), np.arange(first.n_states)])
        self.ends, self.links = ends, ends[self.starts].reshape(len(two.chains), first.n_states)
        prices, self._offset = node_prices(first, two.first_data)
        self._future = int(first.future[0])
        prices = prices.tolil()
        prices[:, [self._future]] = 0.0
        self._prices = sp.csr_array(prices)
        lowered = lower(first, integer="none", modes={}, discs=discs)
        v = first.vectors(two.first_data, two.x0)
        if held is not None:
            v = v.fixed(held, np.zeros(len(held)))
        self._n, chains = lowered.a.shape[1], len(two.chains)
        self._theta = self._n + np.arange(chains)
        self._after = self._n + chains
        self.program = Plain(*self._arrays(lowered.a, lowered.vectors(v)))
        self._theta_box = (np.full(chains, -np.inf), np.full(chains, -np.inf))

    def _arrays(self, a: sp.csr_array, v: Vectors) -> tuple[sp.csr_array, Vectors]:
        """The trunk's rows and numbers with those of theta and of risk behind them."""
        risk, trunk, chains = self.two.risk, self.two.trunk, len(self.two.chains)
        mean = (1.0 - risk.weight) * np.append(self.two.share, self.two.staying)
        cost = np.zeros(self._n)
        cost[: self._prices.shape[1]] = mean[:trunk] @ self._prices
        cost[self._future] = mean[trunk]
        extra = trunk + 1 + chains + 1 if risk.averse else 0
        rows = [sp.hstack([a, sp.csr_array((a.shape[0], chains + extra))])]
        low, high = [v.row_lower], [v.row_upper]
        costs = [cost, (1.0 - risk.weight) * self.chance[:chains]]
        lower_, upper = [v.lower, np.zeros(chains)], [v.upper, np.zeros(chains)]
        if risk.averse:
            blocks, sides = self._risk_rows()
            rows += blocks
            low += sides[0]
            high += sides[1]
            tail = risk.weight * self.chance / (1.0 - risk.alpha)
            costs += [np.zeros(trunk), np.array([risk.weight]), tail]
            lower_ += [np.full(trunk + 1, -np.inf), np.zeros(chains + 1)]
            upper += [np.full(trunk + 1 + chains + 1, np.inf)]
        offset = float(mean[:trunk] @ self._offset)
        joined = [np.concatenate(part) for part in (costs, lower_, upper, low, high)]
        vectors = Vectors(joined[0], offset, *joined[1:])
        return sp.csr_array(sp.vstack(rows, format="csr")), vectors

    def _risk_rows(self) -> tuple[list[sp.csr_array], tuple[list[Floats], list[Floats]]]:
        """spent_t = spent_(t-1) + prices z + offset;  spent + theta - eta - u <= 0."""
        trunk, chains = self.two.trunk, len(self.two.chains)
        width = self._after + trunk + 1 + chains + 1
        step = sp.eye_array(trunk) - sp.eye_array(trunk, k=-1)
        gap = sp.csr_array((trunk, self._after - self._prices.shape[1]))
        tail = sp.csr_array((trunk, 1 + chains + 1))
        spending = sp.hstack([-self._prices, gap, step, tail])
        leaving = np.flatnonzero(self.starts >= 0)
        each, eta = np.arange(chains + 1), self._after + trunk
        entries = [
            (each[:-1], self._theta, 1.0),
            (each[-1:], np.array([self._future]), 1.0),
            (leaving, self._after + self.starts[leaving], 1.0),
            (each[-1:], np.array([eta - 1]), 1.0),
            (each, np.full(chains + 1, eta), -1.0),
            (each, eta + 1 + each, -1.0),
        ]
        row = np.concatenate([r for r, _, _ in entries])
        column = np.concatenate([c for _, c, _ in entries])
        value = np.concatenate([np.full(len(r), x) for r, _, x in entries])
        excess = sp.csr_array((value, (row, column)), shape=(chains + 1, width))
        none, zero = np.full(chains + 1, -np.inf), np.zeros(chains + 1)
        if not self.two.staying:
            zero[-1] = np.inf
        return [spending, excess], ([self._offset, none], [self._offset, zero])

    def held_at(self, states: Floats) -> Trial | None:
        """The cheapest trunk that passes through states (trunk nodes, states); None: there is none.

        Only to be asked before the first cuts.
        """
        at = self.ends[: self.two.trunk].ravel()
        v = self.program.vectors
        low, high = v.lower[at].copy(), v.upper[at].copy()
        inside = np.clip(states.ravel(), low, high)
        self.program.set_bounds(at, inside, inside)
        found = self.program.solve()
        self.program.set_bounds(at, low, high)
        return None if found is None else self._trial(found[0], -np.inf)

    def solve(self) -> Trial:
        """The best trunk by the cuts so far.

        Raises:
            InfeasibleError: the trunk has no point.
        """
        found = self.program.solve()
        if found is None:
            raise InfeasibleError(
                "nothing satisfies the model in the slots common to all scenarios",
                hint="`--method lp` with the outages common to all names what conflicts",
            )
        cut = np.isfinite(self._theta_box[1]).all()
        return self._trial(found[0], self._bound(found[1]) if cut else -np.inf)

    def add(self, second: Second) -> None:
        """Adds the cuts of all chains."""
        chains = len(self._theta)
        if not chains:
            return
        v, n = self.program.vectors, len(self.program.vectors.cost)
        width = self.links.shape[1]
        columns = np.hstack([self.links, self._theta[:, None]])
        values = np.hstack([second.beta, -np.ones((chains, 1))])
        starts = np.arange(chains + 1) * (width + 1)
        block = sp.csr_array((values.ravel(), columns.ravel(), starts), shape=(chains, n))
        self.program.add_rows(block, np.full(chains, -np.inf), -second.alpha)
        low, high = reach(second.beta, v.lower[self.links], v.upper[self.links])
        old = self._theta_box
        self._theta_box = (
            np.maximum(old[0], second.alpha + low),
            np.maximum(old[1], second.alpha + high),
        )
        free = np.full(chains, np.inf)
        self.program.set_bounds(self._theta, -free, free)

    def _trial(self, z: Floats, bound: float) -> Trial:
        first = z[: self._prices.shape[1]]
        spent = np.cumsum(self._prices @ first + self._offset)
        up_to = np.append(spent, 0.0)[self.starts]
        stays = spent[-1] + first[self._future]
        return Trial(first, z[self.links], np.append(up_to, stays), bound)

    def _bound(self, multipliers: Floats) -> float:
        """A bound over a box that holds an optimum: theta within its cuts' reach, and so on."""
        v = self.program.vectors
        low, high = v.lower.copy(), v.upper.copy()
        low[self._theta], high[self._theta] = self._theta_box
        if self.two.risk.averse:
            self._risk_box(low, high)
        return self.program.bound(multipliers, low, high)

    def _risk_box(self, low: Floats, high: Floats) -> None:
        trunk, chains = self.two.trunk, len(self.two.chains)
        n = self._prices.shape[1]
        dear, cheap = self._prices.maximum(0.0), self._prices.minimum(0.0)
        least = np.cumsum(dear @ low[:n] + cheap @ high[:n] + self._offset)
        most = np.cumsum(dear @ high[:n] + cheap @ low[:n] + self._offset)
        spent = slice(self._after, self._after + trunk)
        low[spent], high[spent] = least, most
        ends = [np.append(least, 0.0)[self.starts], np.append(most, 0.0)[self.starts]]
        bottom = np.append(ends[0] + low[self._theta], least[-1] + low[self._future])
        top = np.append(ends[1] + high[self._theta], most[-1] + high[self._future])
        eta = self._after + trunk
        low[eta], high[eta] = bottom.min(), top.max()
        high[eta + 1 : eta + 2 + chains] = top.max() - bottom.min()
