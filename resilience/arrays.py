"""Types of arrays, and rounding; a shape stands in the docstring of whoever passes the array."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
Times = NDArray[np.datetime64]


def rounded(values: Floats, digits: int) -> Floats:
    """Values to so many significant digits of the largest of them.

    >>> rounded(np.array([1234.56, 0.0123]), 3)
    array([1230.,    0.])
    """
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return values
    return np.round(values, digits - 1 - int(np.floor(np.log10(largest))))
