r"""Weights of few scenarios that keep means of many, at the least transport of probability.

With $\pi_{ji}$ the probability that scenario j gives to the kept one i, and m the means to keep,

$$ \min_{\pi \ge 0} \; \sum_{ji} d(j, i)\, \pi_{ji} \quad \text{s.t.} \quad
   \sum_i \pi_{ji} = p_j, \quad \sum_{ji} m_i \pi_{ji} = \sum_j p_j m_j $$

and the weight of i is $\sum_j \pi_{ji}$. Without the means this is the nearest one's weight. There
may be no such weights: then a scenario is kept as well that brings the means nearer, the one of the
least reduced cost of the least slack, until they hold. All scenarios together have them, so this
ends; those added that a vertex does not need go again, so that no more stay than there are means,
and one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.optimize import OptimizeResult, linprog

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError

HOLDS = 1e-10
"""Slack of means, in units of their spread, that is a solver's rounding."""

VARIES = 1e-9
"""Spread of values, relative to the largest, below which they are alike but for rounding."""


@dataclass(frozen=True)
class Transport:
    """Probability moved from many scenarios to few.

    Attributes:
        weight: (kept,) of each.
        distance: mean distance that probability was moved by.
    """

    weight: Floats
    distance: float


def in_units_of_spread(values: Floats, probability: Floats) -> Floats:
    """(means, scenarios) values less their mean, over their standard deviation; 0 where alike."""
    apart = values - (values @ probability)[:, None]
    spread = np.sqrt(apart**2 @ probability)[:, None]
    varies = spread > VARIES * np.abs(values).max(axis=1, initial=0.0, keepdims=True)
    return np.divide(apart, spread, out=np.zeros_like(apart), where=varies)


def with_means_in_reach(selected: Ints, apart: Floats) -> Ints:
    """The selected scenarios, and those that some weights need as well to have all means.

    Args:
        selected: scenarios that are kept.
        apart: (means, scenarios) as `in_units_of_spread`; the means are 0.
    """
    n, chosen = len(selected), list(selected)
    while (answer := _least_slack(apart[:, chosen])).fun > HOLDS:
        price = answer.eqlin.marginals
        reduced_cost = -price[:-1] @ apart - price[-1]
        reduced_cost[chosen] = 0.0
        if reduced_cost.min() >= 0.0:
            raise SolverError(
                f"no weights were found that keep the means: {answer.fun:.2g} of their spread lack",
                hint="keep more scenarios, or report the case",
            )
        chosen.append(int(np.argmin(reduced_cost)))
    added = answer.x[n : len(chosen)] > 0.0  # a vertex has no more weights than there are rows
    return np.array([*chosen[:n], *np.array(chosen[n:], np.intp)[added]], np.intp)


def _least_slack(apart: Floats) -> OptimizeResult:
    """Weights (kept,) that add up to 1 and leave the means off by the least in sum."""
    m, n = apart.shape
    rows = np.vstack([np.hstack([apart, np.eye(m), -np.eye(m)]), np.repeat([1.0, 0.0], [n, 2 * m])])
    cost, right = np.repeat([0.0, 1.0], [n, 2 * m]), np.append(np.zeros(m), 1.0)
    return _solved(cost, rows, right)


def least_transport(distance: Floats, probability: Floats, apart: Floats) -> Transport | None:
    """The weights of kept scenarios that move least probability and keep all means.

    Args:
        distance: (scenarios, kept) from each to each that is kept.
        probability: (scenarios,).
        apart: (means, kept) as `in_units_of_spread`.

    Returns:
        None where no weights keep all means.
    """
    n, k = distance.shape
    gives = sp.kron(sp.eye_array(n), np.ones((1, k)), format="csr")
    means = sp.csr_array(np.tile(apart, n))
    right = np.append(probability, np.zeros(len(apart)))
    answer = linprog(
        distance.ravel(), A_eq=sp.vstack([gives, means]), b_eq=right,
        options={"primal_feasibility_tolerance": HOLDS},
    )  # fmt: skip
    if answer.status == 2:
        return None
    if answer.x is None:
        raise SolverError(f"HiGHS found no weights: {answer.message}", hint="keep more scenarios")
    return Transport(_exact(answer.x.reshape(n, k).sum(axis=0), apart), float(answer.fun))


def _solved(cost: Floats, rows: Floats, right: Floats) -> OptimizeResult:
    answer = linprog(cost, A_eq=rows, b_eq=right, options={"primal_feasibility_tolerance": HOLDS})
    if answer.x is None:
        raise SolverError(f"HiGHS found no weights: {answer.message}", hint="keep more scenarios")
    return answer


def _exact(weight: Floats, apart: Floats) -> Floats:
    """The weights with a solver's rounding taken out: by the least change that keeps all means."""
    weighty = weight > HOLDS
    rows = np.vstack([apart, np.ones(len(weight))])[:, weighty]
    right = np.append(np.zeros(len(apart)), 1.0)
    weight = np.where(weighty, weight, 0.0)
    weight[weighty] += np.linalg.lstsq(rows, right - rows @ weight[weighty], rcond=None)[0]
    return weight
