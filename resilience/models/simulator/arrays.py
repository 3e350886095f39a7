"""The few array operations of the simulator, for NumPy and for torch (differentiable).

Arrays are (n, batch). No operation changes an argument, on either library: gradients need the
values that went in, and a caller need not know which library it is on. Where NumPy would make a
new array per term, one operation holds the whole expression and works in an array of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints

if TYPE_CHECKING:
    import torch

# A NumPy array or a torch tensor. The union of both would need a cast at every operator.
Array: TypeAlias = Any
SPARSE_FROM_ENTRIES = 100_000  # entries, zeros included, from which torch gets a matrix sparse


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

    def positive_up_to(self, x: Array, limit: Array) -> Array:
        """min(max(x, 0), limit), as wide as x."""

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

    def island_sums(self, x: Array, island: Array) -> Array:
        """(..., buses, batch) sums over islands, in the row of the island's number."""

    def at_buses(self, x: Array, island: Array) -> Array:
        """(..., buses, batch) the island's value at each of its buses."""

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


@dataclass(frozen=True)
class Grouped:
    """A matrix with many columns alike: these are added up before anything is multiplied.

    Attributes:
        outer: (rows, distinct columns) the distinct columns.
        inner: (distinct columns, columns) ones: which columns go into which distinct one.
    """

    outer: sp.csr_array
    inner: sp.csr_array

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return int(self.outer.nnz + self.inner.nnz)

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        return self.outer @ (self.inner @ x)


def grouped(matrix: sp.csr_array) -> Grouped:
    """The matrix as one of its distinct columns times one that adds up what they multiply."""
    columns = matrix.tocsc()
    columns.sort_indices()
    spans = [slice(a, b) for a, b in pairwise(columns.indptr)]
    keys = [(columns.indices[s].tobytes(), columns.data[s].tobytes()) for s in spans]
    filled = [k for k, s in enumerate(spans) if s.stop > s.start]
    group = {key: n for n, key in enumerate(dict.fromkeys(keys[k] for k in filled))}
    rows = [group[keys[k]] for k in filled]
    first = [keys.index(key) for key in group]
    ones = np.ones(len(filled), matrix.dtype)
    inner = sp.csr_array((ones, (rows, filled)), shape=(len(group), matrix.shape[1]))
    return Grouped(sp.csr_array(columns[:, first]), inner)


@dataclass(frozen=True)
class NumPyOps:
    """Operations on NumPy arrays.

    Attributes:
        dtype: number type.
    """

    dtype: np.dtype[Any]

    def array(self, value: Floats) -> np.ndarray:
        """A constant."""
        return np.asarray(value, self.dtype)

    def matrix(self, value: sp.csr_array) -> Grouped | sp.csr_array:
        """A constant matrix: in two steps where these are fewer entries."""
        in_two_steps = grouped(value.astype(self.dtype))
        return in_two_steps if in_two_steps.nnz < value.nnz else value.astype(self.dtype)

    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    where = staticmethod(np.where)
    joined = staticmethod(np.concatenate)

    @staticmethod
    def positive(x: np.ndarray) -> np.ndarray:
        """max(x, 0)."""
        return np.maximum(x, 0.0)

    @staticmethod
    def positive_up_to(x: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """min(max(x, 0), limit), as wide as x."""
        result = np.maximum(x, 0.0)
        return np.minimum(result, limit, out=result)

    @staticmethod
    def clipped(x: np.ndarray, *limits: np.ndarray) -> np.ndarray:
        """max(min(x, *limits), 0)."""
        result = np.minimum(x, limits[0])
        for limit in limits[1:]:
            np.minimum(result, limit, out=result)
        return np.maximum(result, 0.0, out=result)

    @staticmethod
    def scaled_difference(x: np.ndarray, y: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """(x - y) scale, as wide as x - y."""
        result = x - y
        return np.multiply(result, scale, out=result)

    @staticmethod
    def weighted_sum(
        a: np.ndarray, x: np.ndarray, b: np.ndarray, y: np.ndarray, offset: np.ndarray
    ) -> np.ndarray:
        """(a x + offset) + b y, as wide as x."""
        result = a * x
        np.add(result, offset, out=result)
        return np.add(result, b * y, out=result)

    @staticmethod
    def scaled_rows(
        x: np.ndarray, index: Ints, scale: np.ndarray, offset: np.ndarray
    ) -> np.ndarray:
        """x[index] scale + offset, as wide as x."""
        result = np.take(x, index, axis=0)
        np.multiply(result, scale, out=result)
        return np.add(result, offset, out=result)

    @staticmethod
    def wide(x: np.ndarray, batch: int) -> np.ndarray:
        """The array (..., 1) or (..., batch) as (..., batch)."""
        return x if x.shape[-1] == batch else np.repeat(x, batch, axis=-1)

    def island_sums(self, x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(..., buses, batch) sums over islands, in the row of the island's number."""
        if len(island) == 1:
            return x
        n, batch = island.shape
        cell = (island * batch + np.arange(batch)).ravel()  # of the island's row, in (n, batch)
        layers = x.size // (n * batch)
        cell = (cell + np.arange(layers)[:, None] * (n * batch)).ravel()
        return np.bincount(cell, x.ravel(), x.size).reshape(x.shape).astype(self.dtype, copy=False)

    @staticmethod
    def at_buses(x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(..., buses, batch) the island's value at each of its buses."""
        if len(island) == 1:
            return x
        n, batch = island.shape
        cell = (island * batch + np.arange(batch)).ravel()
        return np.take(x.reshape(-1, n * batch), cell, axis=1).reshape(x.shape)

    @staticmethod
    def rows(x: np.ndarray, index: Ints) -> np.ndarray:
        """Some rows of x."""
        return np.take(x, index, axis=0)  # ten times faster than an index

    @staticmethod
    def index(places: Ints) -> np.ndarray:
        """The places themselves."""
        return places

    @staticmethod
    def beside(arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Arrays one beside the other, along the batch."""
        return np.concatenate(list(arrays), axis=-1)

    @staticmethod
    def may_exceed(x: np.ndarray, threshold: float) -> bool:
        """Whether any abs(x) exceeds the threshold."""
        return bool(x.max(initial=0.0) > threshold or x.min(initial=0.0) < -threshold)

    @staticmethod
    def as_numpy(x: np.ndarray) -> np.ndarray:
        """The array itself."""
        return x


@dataclass(frozen=True)
class TorchOps:
    """The same on torch tensors; gradients pass through.

    Attributes:
        dtype: number type.
        device: where the tensors are.
    """

    dtype: torch.dtype
    device: torch.device

    def array(self, value: Floats) -> torch.Tensor:
        """A constant, of the type and on the device of the state."""
        import torch

        return torch.as_tensor(value, dtype=self.dtype, device=self.device)

    def matrix(self, value: sp.csr_array) -> torch.Tensor:
        """A constant matrix."""
        import torch

        if value.shape[0] * value.shape[1] < SPARSE_FROM_ENTRIES:
            return self.array(value.toarray())
        entries = value.tocoo()
        return torch.sparse_coo_tensor(
            torch.as_tensor(np.stack([entries.row, entries.col])),
            torch.as_tensor(entries.data),
            value.shape,
            dtype=self.dtype,
            device=self.device,
            check_invariants=True,
        ).coalesce()

    @staticmethod
    def minimum(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """The smaller value at every place."""
        return x.minimum(y)

    @staticmethod
    def maximum(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """The larger value at every place."""
        return x.maximum(y)

    @staticmethod
    def where(condition: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Takes x where the condition holds, y elsewhere."""
        return x.where(condition, y)

    @staticmethod
    def joined(arrays: Sequence[torch.Tensor]) -> torch.Tensor:
        """Tensors one below the other."""
        import torch

        return torch.cat(list(arrays))

    @staticmethod
    def positive(x: torch.Tensor) -> torch.Tensor:
        """max(x, 0)."""
        return x.clamp(min=0.0)

    @staticmethod
    def positive_up_to(x: torch.Tensor, limit: torch.Tensor) -> torch.Tensor:
        """min(max(x, 0), limit), as wide as x. The gradient is that of x up to the limit itself,
        and none where there is nothing to give: `minimum` would halve it between equals.
        """
        positive_part = x.clamp(min=0.0)
        if not (x.requires_grad or limit.requires_grad):
            return positive_part.minimum(limit)
        return (positive_part * (limit > 0.0)).where(positive_part <= limit, limit)

    @staticmethod
    def clipped(x: torch.Tensor, *limits: torch.Tensor) -> torch.Tensor:
        """max(min(x, *limits), 0)."""
        for limit in limits:
            x = x.minimum(limit)
        return x.clamp(min=0.0)

    @staticmethod
    def scaled_difference(x: torch.Tensor, y: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """(x - y) scale, as wide as x - y."""
        return (x - y) * scale

    @staticmethod
    def weighted_sum(
        a: torch.Tensor, x: torch.Tensor, b: torch.Tensor, y: torch.Tensor, offset: torch.Tensor
    ) -> torch.Tensor:
        """(a x + offset) + b y, as wide as x."""
        return a * x + offset + b * y

    @staticmethod
    def scaled_rows(
        x: torch.Tensor, index: Ints, scale: torch.Tensor, offset: torch.Tensor
    ) -> torch.Tensor:
        """x[index] scale + offset, as wide as x."""
        return x[index] * scale + offset

    @staticmethod
    def wide(x: torch.Tensor, batch: int) -> torch.Tensor:
        """The tensor (..., 1) or (..., batch) as (..., batch)."""
        return x.expand(*x.shape[:-1], batch)

    @staticmethod
    def island_sums(x: torch.Tensor, island: torch.Tensor) -> torch.Tensor:
        """(..., buses, batch) sums over islands, in the row of the island's number."""
        if len(island) == 1:
            return x
        return x.new_zeros(x.shape).scatter_add(-2, island.expand(x.shape), x)

    @staticmethod
    def at_buses(x: torch.Tensor, island: torch.Tensor) -> torch.Tensor:
        """(..., buses, batch) the island's value at each of its buses."""
        return x if len(island) == 1 else x.gather(-2, island.expand(x.shape))

    @staticmethod
    def rows(x: torch.Tensor, index: Ints) -> torch.Tensor:
        """Some rows of x."""
        return x[index]

    def index(self, places: Ints) -> torch.Tensor:
        """Places along an axis, on the device."""
        import torch

        return torch.as_tensor(places, device=self.device)

    @staticmethod
    def beside(arrays: Sequence[torch.Tensor]) -> torch.Tensor:
        """Tensors one beside the other, along the batch."""
        import torch

        return torch.cat(list(arrays), dim=-1)

    @staticmethod
    def may_exceed(x: torch.Tensor, threshold: float) -> bool:
        """Always true: to look would stop a device."""
        return True

    @staticmethod
    def as_numpy(x: torch.Tensor) -> np.ndarray:
        """The tensor as a NumPy array, without its gradient."""
        return x.detach().cpu().numpy()


@lru_cache(maxsize=64)
def _ops(dtype: Any, device: Any) -> ArrayOps:
    return NumPyOps(dtype) if device is None else TorchOps(dtype, device)


def array_ops(x: Array) -> ArrayOps:
    """The operations for arrays such as x."""
    return _ops(x.dtype, None if isinstance(x, np.ndarray) else x.device)
