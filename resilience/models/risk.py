r"""Expected cost and conditional value at risk, as an objective over the leaves of a tree.

$$ \rho = (1 - w)\, \mathbb{E}[c] + w \min_\eta \Big\{ \eta
   + \frac{1}{1 - \alpha} \sum_s p_s\, u_s \Big\}, \qquad u_s \ge c_s - \eta, \quad u_s \ge 0 $$

(Rockafellar and Uryasev 2000), where $c_s$ is what the path to leaf $s$ costs. The rows
$c_s^\top z - \eta - u_s \le -c_s^0$ hold prices, the one place where data enters a matrix; a model
that is solved again has them updated in place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Lowered
from resilience.models.language.tree import Tree
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Standard, Values, Vectors

FORM = "cvar:ALPHA:WEIGHT"


@dataclass(frozen=True)
class Risk:
    """Weight `weight` on the mean of the worst 1 - `alpha` of the costs, the rest on the mean.

    Raises:
        UsageError: alpha or weight out of range.
    """

    alpha: float = 0.95
    weight: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.alpha < 1.0 and 0.0 <= self.weight <= 1.0):
            raise UsageError(
                f"risk has alpha {self.alpha:g} and weight {self.weight:g}; "
                "allowed: 0 <= alpha < 1, 0 <= weight <= 1",
                hint="cvar:0.95:0.5 is half the mean, half the mean of the worst 5 %",
            )

    @classmethod
    def parse(cls, text: str) -> Risk:
        """`mean`, or `cvar:ALPHA:WEIGHT`.

        Raises:
            UsageError: any other text.
        """
        if text.strip().lower() in ("mean", "expected"):
            return cls()
        kind, *numbers = text.strip().lower().split(":")
        try:
            alpha, weight = (float(number) for number in numbers)
            known = kind == "cvar"
        except ValueError:
            known = False
        if not known:
            raise UsageError(
                f"risk {text!r} is unknown; allowed: mean, {FORM}",
                hint="cvar:0.95:0.5 is half the mean, half the mean of the worst 5 %",
            )
        return cls(alpha, weight)

    @property
    def averse(self) -> bool:
        """Whether anything but the mean counts."""
        return self.weight > 0.0

    def of(self, cost: Floats, probability: Floats) -> float:
        """The objective of costs (scenarios,) in $; the probabilities add up to 1."""
        mean = float(probability @ cost)
        if not self.averse:
            return mean
        order = np.argsort(cost)
        reached = np.cumsum(probability[order])
        at = min(int(np.searchsorted(reached, self.alpha - 1e-12)), len(cost) - 1)
        eta = float(cost[order][at])
        tail = eta + float(probability @ np.maximum(cost - eta, 0.0)) / (1.0 - self.alpha)
        return (1.0 - self.weight) * mean + self.weight * tail

    def __str__(self) -> str:
        if not self.averse:
            return "expected cost"
        return f"{1 - self.weight:g} of the expected cost, {self.weight:g} of CVaR {self.alpha:g}"


def node_prices(problem: Standard, data: Values) -> tuple[sp.csr_array, Floats]:
    """What every node costs, not weighted: prices (nodes, columns) and an offset (nodes,), in $.

    The future cost of a leaf belongs to the leaf.
    """
    rows, columns, values = [], [], []
    offset = np.zeros(problem.tree.n)
    for form, table, nodes in zip(problem.forms, problem.tables, problem.members, strict=True):
        d = problem.data_matrix(data, form, nodes)
        start = form.parts[-1]
        prices = form.fixed[start:, None] + form.moving[start:] @ d
        rows.append(np.repeat(nodes, form.n_columns))
        columns.append(table.ravel())
        values.append(prices.T.ravel())
        offset[nodes] = form.offset + form.offset_data @ d
    leaves = problem.tree.leaves
    rows.append(leaves)
    columns.append(problem.future)
    values.append(np.ones(len(leaves)))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    found = sp.csr_array(entries, shape=(problem.tree.n, problem.n_columns))
    found.eliminate_zeros()
    return found, offset


def paths(tree: Tree) -> sp.csr_array:
    """(leaves, nodes) 1 where a node lies on the way to a leaf."""
    rows, columns = [], []
    for k, leaf in enumerate(tree.leaves):
        node = int(leaf)
        while node >= 0:
            rows.append(k)
            columns.append(node)
            node = int(tree.parent[node])
    return sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(tree.leaves), tree.n))


class RiskAverse(Highs):
    """HiGHS with the objective of a `Risk` in place of the mean.

    `price` is to be called with the data before every `update` whose prices are new. The columns
    eta and u stand behind the problem's own, the scenario-cost rows behind its rows.
    """

    def __init__(self, problem: Standard | Lowered, risk: Risk, **options: Any) -> None:
        super().__init__(problem, **options)
        self.risk = risk
        tree = self.problem.tree
        self._paths, self._chance = paths(tree), tree.probability[tree.leaves]
        self._sent_prices: sp.csr_array | None = None

    def price(self, data: Values, left: sp.sparray | None = None) -> None:
        """Takes the prices of the scenario-cost rows.

        Args:
            data: as for `Standard.vectors`.
            left: (leaves, columns) $ that each leaf costs beyond its nodes: less the worth of what
                is left at its end.
        """
        prices, offset = node_prices(self.problem, data)
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
