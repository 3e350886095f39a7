"""Types of arrays: what an array holds; its shape stands in the docstring of whoever passes it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.intp]
Bools = NDArray[np.bool_]
Times = NDArray[np.datetime64]
