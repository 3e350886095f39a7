"""Uniform numbers spread evenly, and what they choose."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats, Ints


def strata(n: int, rng: np.random.Generator) -> Floats:
    """(n,) uniform numbers, one in every n-th of the unit interval, in random order."""
    return (rng.permutation(n) + rng.random(n)) / n


def chosen(weight: Floats, u: Floats) -> Ints:
    """(paths,) which of some values belongs to each uniform number, by their weights (values,)."""
    cumulated = np.cumsum(weight)
    places = np.searchsorted(cumulated, u * cumulated[-1], side="right")
    return np.minimum(places, len(weight) - 1)
