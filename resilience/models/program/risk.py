r"""Expected cost and conditional value at risk, as an objective over the leaves of a tree.

$$ \rho = (1 - w)\, \mathbb{E}[c] + w \min_\eta \Big\{ \eta
   + \frac{1}{1 - \alpha} \sum_s p_s\, u_s \Big\}, \qquad u_s \ge c_s - \eta, \quad u_s \ge 0 $$

(Rockafellar and Uryasev 2000), where $c_s$ is what the path to leaf $s$ costs. The rows
$c_s^\top z - \eta - u_s \le -c_s^0$ hold prices, the one place where data enters a matrix; a model
that is solved again has them updated in place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.errors import UsageError, check_range
from resilience.inputs import to_number
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Standard, Values
from resilience.tolerances import PROBABILITY_TOLERANCE

RISK_FORM = "cvar:ALPHA:WEIGHT"


@dataclass(frozen=True)
class Risk:
    """Weights of the mean and of the mean of the worst costs.

    Attributes:
        alpha: the worst are those beyond this share of the probability.
        weight: of the mean of the worst; the mean of all has the rest.

    Raises:
        UsageError: alpha or weight out of range.
    """

    alpha: float = 0.95
    weight: float = 0.0

    def __post_init__(self) -> None:
        hint = "cvar:0.95:0.5 is half the mean, half the mean of the worst 5 %"
        check_range("alpha of the risk", self.alpha, 0.0, 1.0, hint=hint, below=True)
        check_range("weight of the risk", self.weight, 0.0, 1.0, hint=hint)

    @classmethod
    def parse(cls, text: str) -> Risk:
        """`mean`, or `cvar:ALPHA:WEIGHT`.

        Raises:
            UsageError: any other text.
        """
        if text.strip().lower() in ("mean", "expected"):
            return cls()
        kind, *numbers = text.strip().lower().split(":")
        match kind, *(to_number(number.strip()) for number in numbers):
            case "cvar", float(alpha), float(weight):
                return cls(alpha, weight)
        raise UsageError(
            f"risk {text!r} is unknown; allowed: mean, {RISK_FORM}",
            hint="cvar:0.95:0.5 is half the mean, half the mean of the worst 5 %",
        )

    @property
    def averse(self) -> bool:
        """Whether anything but the mean counts."""
        return self.weight > 0.0

    def value(self, cost: Floats, probability: Floats) -> float:
        """The objective of costs (scenarios,) in $; the probabilities add up to 1."""
        mean = float(probability @ cost)
        if not self.averse:
            return mean
        order = np.argsort(cost)
        reached = np.cumsum(probability[order])
        k = int(np.searchsorted(reached, self.alpha - PROBABILITY_TOLERANCE))
        eta = float(cost[order][min(k, len(cost) - 1)])
        tail = eta + float(probability @ np.maximum(cost - eta, 0.0)) / (1.0 - self.alpha)
        return (1.0 - self.weight) * mean + self.weight * tail

    def __str__(self) -> str:
        if not self.averse:
            return "expected cost"
        return f"{1 - self.weight:g} of the expected cost, {self.weight:g} of CVaR {self.alpha:g}"


def node_prices(standard: Standard, data: Values) -> tuple[sp.csr_array, Floats]:
    """What every node costs, not weighted: prices (nodes, columns) and an offset (nodes,), in $.

    The future cost of a leaf belongs to the leaf, what is built to the first node.
    """
    rows, columns, values = [], [], []
    offset = np.zeros(standard.tree.n)
    for stage in standard.copies:
        d = standard.stacked_data(data, stage)
        rows.append(np.repeat(stage.nodes, stage.form.n_columns))
        columns.append(stage.columns.ravel())
        values.append(stage.form.prices(d).T.ravel())
        offset[stage.nodes] = stage.form.offsets(d)
    built, _, _, price, _ = standard.form.design_numbers
    rows.append(np.zeros(len(built), np.intp))
    columns.append(built)
    values.append(price)
    leaves = standard.tree.leaves
    rows.append(leaves)
    columns.append(standard.future)
    values.append(np.ones(len(leaves)))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    prices = sp.csr_array(entries, shape=(standard.tree.n, standard.n_columns))
    prices.eliminate_zeros()
    return prices, offset


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
