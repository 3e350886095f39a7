"""The expected cost and its conditional value at risk, minimised over the leaves of a tree.

See `resilience.models.program.risk` for the equations.
"""

from __future__ import annotations

from dataclasses import replace
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
    eta and u stand behind the program's own, the scenario-cost rows behind its rows.
    """

    def __init__(self, standard: Standard | Lowered, risk: Risk, **options: Any) -> None:
        super().__init__(standard, **options)
        self.risk = risk
        tree = self.standard.tree
        self._paths, self._probability = paths(tree), tree.probability[tree.leaves]
        self._sent_prices: sp.csr_array | None = None

    def price(self, data: Values, end_costs: sp.sparray | None = None) -> None:
        """Takes the prices of the scenario-cost rows.

        Args:
            data: as for `Standard.vectors`.
            end_costs: (leaves, columns) $ that each leaf costs beyond its nodes, as is minus the
                worth of the energy stored at its end; nothing if omitted.
        """
        prices, offset = node_prices(self.standard, data)
        path_prices = self._paths @ prices
        self._prices = sp.csr_array(path_prices if end_costs is None else path_prices + end_costs)
        self._offsets = self._paths @ offset

    def weigh(self, probability: Floats) -> None:
        """Gives the leaves other probabilities than the tree; to be called before `update`."""
        self._probability = probability
        if self._sent_prices is not None:
            columns = self._first_column + 1 + np.arange(len(probability))
            self.model.change_costs(columns, self._largest_weights)

    @property
    def _largest_weights(self) -> Floats:
        """(leaves,) costs of the excesses u, which bound the weights that the risk allows."""
        return self.risk.weight * self._probability / (1.0 - self.risk.alpha)

    def update(self, vectors: Vectors) -> None:
        """As `Highs.update`; the cost vector is the mean's, as `Standard.vectors` makes it."""
        mean = 1.0 - self.risk.weight
        super().update(replace(vectors, cost=mean * vectors.cost, offset=mean * vectors.offset))
        self._price_rows()

    def _pass(self, v: Vectors) -> None:
        super()._pass(v)
        n = len(self._probability)
        self._first_row, self._first_column = self._matrix().shape[0], len(v.cost)
        self.model.add_columns(
            np.append(self.risk.weight, self._largest_weights),
            np.append(-np.inf, np.zeros(n)),
            np.full(1 + n, np.inf),
        )
        eta_and_excess = self._first_column + np.array([np.zeros(n, int), 1 + np.arange(n)]).T
        self.model.add_rows(eta_and_excess, np.full((n, 2), -1.0), -np.inf, 0.0)
        self._sent_prices = sp.csr_array(self._prices.shape)

    def _price_rows(self) -> None:
        """Sends the prices that differ from those sent last."""
        assert self._sent_prices is not None
        prices, changes = self._prices, (self._prices - self._sent_prices).tocoo()
        for row, column in zip(changes.row, changes.col, strict=True):
            value = float(prices[row, column])
            self.model.change_coefficient(self._first_row + int(row), int(column), value)
        self._sent_prices = prices
        rows = self._first_row + np.arange(len(self._offsets))
        self.model.change_sides(rows, np.full(len(rows), -np.inf), -self._offsets)

    def certified_bound(self, solution: Solution) -> float:
        """A bound that holds whatever the solver's tolerances, from its multipliers.

        Those of the scenario-cost rows are weights of the scenarios, and any weights that the risk
        allows give a mean that is never above it.
        """
        if solution.duals is None or self._later_cuts.cuts or self._sent is None:
            return solution.bound
        rows, n = solution.duals.rows, len(self._probability)
        largest = self._largest_weights
        weight = np.clip(rows[self._first_row : self._first_row + n], 0.0, largest)
        # What they add up to is made right where there is room, or by a common factor.
        spare = self.risk.weight - weight.sum()
        room = largest - weight if spare > 0.0 else weight
        weight = weight + spare * room / max(float(room.sum()), 1e-300)
        v = self._with_extra_rows(self.lowered.vectors(self._sent))
        v.cost[: self._prices.shape[1]] += self._prices.T @ weight
        v.offset += float(self._offsets @ weight)
        return safe_bound(self._matrix(), v, rows[: self._first_row])
