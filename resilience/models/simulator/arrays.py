"""The few array operations of the simulator, for NumPy and for torch (differentiable).

Arrays are (n, batch). No operation changes an argument, on either library: gradients need the
values that went in, and a caller need not know which library it is on. Where NumPy would make a
new array per term, one operation holds the whole expression and works in an array of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints

# A NumPy array or a torch tensor. The union of both would need a cast at every operator.
Array: TypeAlias = Any


class ArrayOps(Protocol):
    """The operations that a step needs, on arrays of one library, number type and device.

    None changes its arguments. A result may share memory with them.
    """

    def array(self, value: Floats) -> Array:
        """A constant."""

    def matrix(self, value: sp.csr_array) -> Array:
        """A constant matrix, for `matrix @ array`."""

    def minimum(self, x: Array, y: Array) -> Array:
        """The smaller value at every place."""

    def maximum(self, x: Array, y: Array) -> Array:
        """The larger value at every place."""

    def where(self, condition: Array, x: Array, y: Array) -> Array:
        """Takes x where the condition holds, y elsewhere."""

    def joined(self, arrays: Sequence[Array]) -> Array:
        """Arrays one below the other."""

    def positive(self, x: Array) -> Array:
        """max(x, 0)."""

    def at_least(self, x: Array, number: float) -> Array:
        """max(x, number)."""

    def above(self, x: Array) -> Array:
        """max(x, 0), without a gradient where x is 0."""

    def positive_up_to(self, x: Array, limit: Array) -> Array:
        """min(max(x, 0), limit), as wide as x."""

    def within(self, x: Array, low: Array, high: Array) -> Array:
        """max(min(x, high), low)."""

    def clipped(self, x: Array, *limits: Array) -> Array:
        """max(min(x, *limits), 0)."""

    def scaled_difference(self, x: Array, y: Array, scale: Array) -> Array:
        """(x - y) scale, as wide as x - y."""

    def weighted_sum(self, a: Array, x: Array, b: Array, y: Array, offset: Array) -> Array:
        """(a x + offset) + b y, as wide as x."""

    def scaled_rows(self, x: Array, index: Ints, scale: Array, offset: Array) -> Array:
        """x[index] scale + offset, as wide as x."""

    def wide(self, x: Array, batch: int) -> Array:
        """The array (..., 1) or (..., batch) as (..., batch)."""

    def stacked(self, arrays: Sequence[Array]) -> Array:
        """Arrays of one shape along a new first axis."""

    def cumulated(self, x: Array) -> Array:
        """(n + 1, ...) sums of the first 0, 1, ..., n along the first axis."""

    def priced(self, prices: Array, x: Array) -> Array:
        """(batch,) sums of x (tiers, buses, batch), each tier at its price, (tiers, batch) or
        (tiers, 1).
        """

    def priced_above(self, prices: Array, x: Array, levels: Array) -> Array:
        """(batch,) sums of max(x - levels, 0), x (buses, batch) and levels as the x of `priced`."""

    def sums(self, x: Array, island: Array, n: int) -> Array:
        """(..., n, batch) sums of the rows of x (..., rows, batch) over islands, of which `island`
        (rows, batch) has the numbers, below n.
        """

    def at_islands(self, x: Array, island: Array) -> Array:
        """(..., rows, batch) what x (..., n, batch) is in the row of each row's island; where n is
        1, x itself.
        """

    def rows(self, x: Array, index: Ints) -> Array:
        """Some rows of x."""

    def index(self, places: Ints) -> Array:
        """Places along an axis, to index arrays with."""

    def beside(self, arrays: Sequence[Array]) -> Array:
        """Arrays one beside the other, along the batch."""

    def may_exceed(self, x: Array, threshold: float) -> bool:
        """False only if no abs(x) exceeds the threshold; what only then matters may be left out."""

    def as_numpy(self, x: Array) -> np.ndarray:
        """The array as a NumPy array."""


@lru_cache(maxsize=64)
def _ops(dtype: Any, device: Any) -> ArrayOps:
    from resilience.models.simulator.numpy_ops import NumPyOps
    from resilience.models.simulator.torch_ops import TorchOps

    return NumPyOps(dtype) if device is None else TorchOps(dtype, device)


def array_ops(x: Array) -> ArrayOps:
    """The operations for arrays such as x."""
    return _ops(x.dtype, None if isinstance(x, np.ndarray) else x.device)
