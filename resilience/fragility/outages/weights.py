"""What weighted scenarios are worth: no percentage of them is surer than one of so many alike."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats

ROUNDING = 1e-6  # of weights that are alike


def effective_number(probability: Floats) -> float:
    """Kish's effective sample size of weights (scenarios,) that add up to 1: 1 / sum of squares."""
    return float(1.0 / (probability**2).sum())


def worth(probability: Floats) -> str:
    """What weights (scenarios,) are worth, in words; empty where all are alike."""
    size, n = effective_number(probability), len(probability)
    return "" if size > n * (1.0 - ROUNDING) else f"worth {size:.3g} of {n} equally likely ones"


def standard_error(values: Floats, probability: Floats) -> float:
    """Of the mean of values (scenarios,) by weights that add up to 1; NaN of a single one."""
    n = effective_number(probability)
    if n <= 1.0 + ROUNDING:
        return float("nan")
    apart = probability * (values - probability @ values)
    return float(np.sqrt(n / (n - 1.0) * (apart**2).sum()))
