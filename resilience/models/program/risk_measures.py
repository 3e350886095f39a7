r"""Risk measures of a quantity over weighted scenarios.

$$ \text{CVaR}_\alpha(X) = \min_\eta \; \eta + \frac{\mathbb{E}[(X - \eta)^+]}{1 - \alpha} $$

(Rockafellar and Uryasev 2000).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.tolerances import PROBABILITY_TOLERANCE


def weights(probability: Floats | None, members: int) -> Floats:
    """(members,) probabilities, checked; equal ones for None.

    Raises:
        UsageError: another shape, a negative probability, a sum that is not 1.
    """
    if probability is None:
        return np.full(members, 1.0 / max(members, 1))
    p = np.asarray(probability, float)
    if p.shape != (members,):
        raise UsageError(f"probabilities have the shape {p.shape}; allowed: ({members},)")
    if (p < 0).any() or not np.isclose(p.sum(), 1.0):
        raise UsageError(
            f"probabilities add up to {p.sum():g}; allowed: 1, none negative",
            hint="divide the weights by their sum",
        )
    return p


def value_at_risk(values: ArrayLike, alpha: float, probability: Floats | None = None) -> float:
    """Smallest value that is not exceeded with probability `alpha` (0 <= alpha < 1).

    `probability` (members,) adds up to 1; None: all equally likely.

    Raises:
        UsageError: no values, alpha outside its range, probabilities that do not fit.
    """
    x = finite_values(values)
    if not 0 <= alpha < 1:
        raise UsageError(f"alpha is {alpha:g}; allowed: 0 <= alpha < 1")
    p = weights(probability, len(x))
    likely = p > 0
    order = np.argsort(x[likely])
    reached = np.cumsum(p[likely][order])
    # Sums of equal weights miss alpha by rounding: 0.1 * 9 is less than 0.9.
    k = int(np.searchsorted(reached, alpha - PROBABILITY_TOLERANCE))
    return float(x[likely][order][min(k, len(order) - 1)])


def conditional_value_at_risk(
    values: ArrayLike, alpha: float, probability: Floats | None = None
) -> float:
    """Mean of the worst 1 - `alpha` of the values; alpha = 0 is the mean.

    The minimum over η is at the value at risk. Arguments and errors as for `value_at_risk`.
    """
    eta = value_at_risk(values, alpha, probability)
    x = finite_values(values)
    excess = np.maximum(x - eta, 0.0)
    return eta + float(weights(probability, len(x)) @ excess) / (1.0 - alpha)


def worst(values: ArrayLike, probability: Floats | None = None) -> float:
    """Greatest of the values that can happen (probability above 0)."""
    x = finite_values(values)
    return float(x[weights(probability, len(x)) > 0].max())


def finite_values(values: ArrayLike) -> Floats:
    """The values as an array of at least one number.

    Raises:
        UsageError: none, or some that are not finite.
    """
    x: Floats = np.atleast_1d(np.asarray(values, float))
    if x.ndim != 1 or x.size == 0 or not np.isfinite(x).all():
        raise UsageError(
            f"values of the shape {x.shape}; allowed: one axis, at least one value, all finite",
            hint="leave failed episodes out of every method of the comparison",
        )
    return x
