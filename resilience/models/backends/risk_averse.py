"""The expected cost and its conditional value at risk, minimised over the leaves of a tree.

See `resilience.models.program.risk` for the equations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Lowered
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.risk import Risk, node_prices, paths
from resilience.models.program.standard import Standard, Values, Vectors


class RiskAverse(Highs):
    """HiGHS with the objective of a `Risk` in place of the mean.

    `price` is to be called with the data before every `update` whose prices are new. The columns
    eta and u stand behind the problem's own, the scenario-cost rows behind its rows.
    """

    def __init__(self, standard: Standard | Lowered, risk: Risk, **options: Any) -> None:
        super().__init__(standard, **options)
        self.risk = risk
        tree = self.standard.tree
        self._paths, self._chance = paths(tree), tree.probability[tree.leaves]
        self._sent_prices: sp.csr_array | None = None

    def price(self, data: Values, left: sp.sparray | None = None) -> None:
        """Takes the prices of the scenario-cost rows.

        Args:
            data: as for `Standard.vectors`.
            left: (leaves, columns) $ that each leaf costs beyond its nodes: less the worth of what
                is left at its end.
        """
        prices, offset = node_prices(self.standard, data)
        whole = self._paths @ prices
        self._prices = sp.csr_array(whole if left is None else whole + left)
        self._offsets = self._paths @ offset

    def weigh(self, probability: Floats) -> None:
        """Gives the leaves other probabilities than the tree; to be called before `update`."""
        self._chance = probability
        if self._sent_prices is not None:
            tail = self.risk.weight * probability / (1.0 - self.risk.alpha)
            at = self._first_column + 1 + np.arange(len(tail), dtype=np.int32)
            self.model.changeColsCost(len(tail), at.astype(np.int32), tail)

    def update(self, vectors: Vectors) -> None:
        """As `Highs.update`; the cost vector is the mean's, as `Standard.vectors` makes it."""
        mean = 1.0 - self.risk.weight
        scaled = Vectors(
            mean * vectors.cost,
            mean * vectors.offset,
            vectors.lower,
            vectors.upper,
            vectors.row_lower,
            vectors.row_upper,
        )
        super().update(scaled)
        self._price_rows()

    def _pass(self, v: Vectors) -> None:
        super()._pass(v)
        n, rest = len(self._chance), self.risk.weight
        self._first_row, self._first_column = self._matrix().shape[0], len(v.cost)
        tail = rest * self._chance / (1.0 - self.risk.alpha)
        none = np.empty(0, np.int32)
        self.model.addCols(
            1 + n,
            np.append(rest, tail),
            np.append(-np.inf, np.zeros(n)),
            np.full(1 + n, np.inf),
            0,
            none,
            none,
            np.empty(0),
        )
        both = self._first_column + np.array([np.zeros(n, int), 1 + np.arange(n)]).T
        starts = 2 * np.arange(n, dtype=np.int32)
        self.model.addRows(
            n,
            np.full(n, -np.inf),
            np.zeros(n),
            2 * n,
            starts,
            both.ravel().astype(np.int32),
            np.full(2 * n, -1.0),
        )
        self._sent_prices = sp.csr_array(self._prices.shape)

    def _price_rows(self) -> None:
        """Sends the prices that differ from those sent last."""
        assert self._sent_prices is not None
        change = (self._prices - self._sent_prices).tocoo()
        now = self._prices
        for row, column in zip(change.row, change.col, strict=True):
            value = float(now[row, column])
            self.model.changeCoeff(self._first_row + int(row), int(column), value)
        self._sent_prices = now
        n = len(self._offsets)
        at = (self._first_row + np.arange(n)).astype(np.int32)
        self.model.changeRowsBounds(n, at, np.full(n, -np.inf), -self._offsets)

    def certified_bound(self, solution: Solution) -> float:
        """A bound that holds whatever the solver's tolerances, from its multipliers.

        Those of the scenario-cost rows are weights of the scenarios, and any weights that the risk
        allows give a mean that is never above it.
        """
        if solution.duals is None or self._late.cuts or self._sent is None:
            return solution.bound
        rows, n = solution.duals.rows, len(self._chance)
        most = self.risk.weight * self._chance / (1.0 - self.risk.alpha)
        weight = np.clip(rows[self._first_row : self._first_row + n], 0.0, most)
        # What rounding has left over goes where there is room, so that the weights add up.
        room = most - weight
        weight += (self.risk.weight - weight.sum()) * room / max(float(room.sum()), 1e-300)
        if (weight < 0.0).any() or (weight > most * (1.0 + 1e-12)).any():
            return solution.bound
        v = self.lowered.vectors(self._sent)
        v.cost[: self._prices.shape[1]] += self._prices.T @ weight
        v.offset += float(self._offsets @ weight)
        low, high = self._sides(v)
        return safe_bound(self._matrix(), v, low, high, rows[: self._first_row])
