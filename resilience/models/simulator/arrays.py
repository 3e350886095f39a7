"""The few array operations of the simulator, for NumPy and for torch (differentiable).

Arrays are (n, batch). Constants of the simulator are kept once per kind of array, that is per
library, number type and device, so that a step converts nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints

Array = Any
SPARSE = 100_000  # entries of a matrix from which torch gets it sparse


@dataclass(eq=False)
class Constant:
    """A constant array, (n, 1) or of any shape, kept in every kind that was asked for."""

    value: Floats
    _made: dict[Any, Any] = field(default_factory=dict, repr=False)

    def of(self, ops: Any) -> Array:
        """The constant as an array of the kind of `ops`."""
        found = self._made.get(ops)
        if found is None:
            found = self._made[ops] = ops.array(self.value)
        return found


@dataclass(eq=False)
class Matrix:
    """A constant sparse matrix, kept likewise."""

    value: sp.csr_array
    _made: dict[Any, Any] = field(default_factory=dict, repr=False)

    def of(self, ops: Any) -> Any:
        """The matrix in the kind of `ops`."""
        found = self._made.get(ops)
        if found is None:
            found = self._made[ops] = ops.matrix(self.value)
        return found


@dataclass(eq=False)
class Map:
    """constant + coefficients @ data, for a constant (n,) and a sparse matrix (n, n_data)."""

    constant: Floats
    coefficients: sp.csr_array
    _made: dict[Any, Any] = field(default_factory=dict, repr=False)

    def of(self, ops: Any) -> tuple[Array, Array]:
        """Constant (n, 1), None where it is zero, and matrix, None where data has no part in it."""
        found = self._made.get(ops)
        if found is None:
            constant, matrix = self.constant[:, None], self.coefficients
            moves, rests = matrix.nnz > 0, not constant.any()
            found = (
                None if rests and moves else ops.array(constant),
                ops.matrix(matrix) if moves else None,
            )
            self._made[ops] = found
        return found

    @cached_property
    def _block(self) -> slice | None:
        """Where in the data the values stand as they are, one below the other, if they do."""
        at = self.coefficients.indices
        plain = np.diff(self.coefficients.indptr) == 1
        if not len(at) or self.constant.any() or not plain.all() or (np.diff(at) != 1).any():
            return None
        return slice(int(at[0]), int(at[-1]) + 1) if (self.coefficients.data == 1.0).all() else None

    def __call__(self, ops: Any, data: Array) -> Array:
        """(n, batch) the values, or (n, 1) where data has no part in them. Not to be changed."""
        if self._block is not None:
            return data[self._block]
        constant, matrix = self.of(ops)
        if matrix is None:
            return constant
        moved = matrix @ data
        return moved if constant is None else constant + moved


@dataclass(frozen=True)
class Grouped:
    """A matrix with many columns alike: these are added up before anything is multiplied."""

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
    used = [k for k, s in enumerate(spans) if s.stop > s.start]
    group = {key: n for n, key in enumerate(dict.fromkeys(keys[k] for k in used))}
    rows = [group[keys[k]] for k in used]
    first = [keys.index(key) for key in group]
    one = np.ones(len(used), matrix.dtype)
    inner = sp.csr_array((one, (rows, used)), shape=(len(group), matrix.shape[1]))
    return Grouped(sp.csr_array(columns[:, first]), inner)


@dataclass(frozen=True)
class NumPy:
    """Operations on numpy arrays of one number type."""

    dtype: Any

    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    where = staticmethod(np.where)
    joined = staticmethod(np.concatenate)

    def array(self, value: Floats) -> np.ndarray:
        """A constant."""
        return np.asarray(value, self.dtype)

    def matrix(self, value: sp.csr_array) -> Grouped | sp.csr_array:
        """A constant matrix: in two steps where these are fewer entries."""
        found = grouped(value.astype(self.dtype))
        return found if found.nnz < value.nnz else value.astype(self.dtype)

    @staticmethod
    def positive(x: np.ndarray) -> np.ndarray:
        """max(x, 0)."""
        return np.maximum(x, 0.0)

    @staticmethod
    def between(x: np.ndarray, *most: np.ndarray) -> np.ndarray:
        """x, a fresh array, cut to 0 and all of `most`, in place."""
        for limit in most:
            np.minimum(x, limit, out=x)
        return np.maximum(x, 0.0, out=x)

    @staticmethod
    def times(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """x y, in place of x, a fresh array as wide as y."""
        return np.multiply(x, y, out=x)

    @staticmethod
    def plus(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """x + y, in place of x, a fresh array as wide as y."""
        return np.add(x, y, out=x)

    @staticmethod
    def less(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """x - y, in place of x, a fresh array as wide as y."""
        return np.subtract(x, y, out=x)

    @staticmethod
    def wide(x: np.ndarray, batch: int) -> np.ndarray:
        """x (..., 1) or (..., batch) as (..., batch)."""
        return x if x.shape[-1] == batch else np.repeat(x, batch, axis=-1)

    def segment(self, x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(..., buses, batch) sums over islands, in the row of the island's number."""
        if len(island) == 1:
            return x
        n, batch = island.shape
        at = (island * batch + np.arange(batch)).ravel()
        parts = x.reshape(-1, n * batch)
        at = (at + np.arange(len(parts))[:, None] * (n * batch)).ravel()
        return np.bincount(at, x.ravel(), x.size).reshape(x.shape).astype(self.dtype, copy=False)

    @staticmethod
    def spread(x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(..., buses, batch) the island's value at each of its buses."""
        if len(island) == 1:
            return x
        n, batch = island.shape
        at = (island * batch + np.arange(batch)).ravel()
        found: np.ndarray = np.take(x.reshape(-1, n * batch), at, axis=1)
        return found.reshape(x.shape)

    @staticmethod
    def rows(x: np.ndarray, at: Ints) -> np.ndarray:
        """Some rows of x, a fresh array."""
        return np.take(x, at, axis=0)  # ten times faster than an index

    @staticmethod
    def some(x: np.ndarray, least: float) -> bool:
        """Whether any |x| exceeds `least`: what only then matters may be left out."""
        return bool(x.max(initial=0.0) > least or x.min(initial=0.0) < -least)

    @staticmethod
    def plain(x: np.ndarray) -> np.ndarray:
        """x as a NumPy array."""
        return x


@dataclass(frozen=True)
class Torch:
    """The same on torch tensors; gradients pass through."""

    dtype: Any
    device: Any

    @property
    def _torch(self) -> Any:
        import torch

        return torch

    def array(self, value: Floats) -> Any:
        """A constant, of the type and on the device of the state."""
        return self._torch.as_tensor(value, dtype=self.dtype, device=self.device)

    def matrix(self, value: sp.csr_array) -> Any:
        """A constant matrix."""
        if value.shape[0] * value.shape[1] < SPARSE:
            return self.array(value.toarray())
        entries = value.tocoo()
        at = np.stack([entries.row, entries.col])
        return self._torch.sparse_coo_tensor(
            at, entries.data, value.shape, dtype=self.dtype, device=self.device
        ).coalesce()

    def minimum(self, x: Any, y: Any) -> Any:
        """The smaller of each."""
        return self._torch.minimum(x, y)

    def maximum(self, x: Any, y: Any) -> Any:
        """The larger of each."""
        return self._torch.maximum(x, y)

    def where(self, condition: Any, x: Any, y: Any) -> Any:
        """x where the condition holds, y elsewhere."""
        return self._torch.where(condition, x, y)

    def joined(self, parts: list[Any]) -> Any:
        """One below the other."""
        return self._torch.cat(parts)

    @staticmethod
    def positive(x: Any) -> Any:
        """max(x, 0)."""
        return x.clamp(min=0.0)

    def between(self, x: Any, *most: Any) -> Any:
        """x cut to 0 and all of `most`."""
        for limit in most:
            x = self._torch.minimum(x, limit)
        return x.clamp(min=0.0)

    @staticmethod
    def times(x: Any, y: Any) -> Any:
        """x y."""
        return x * y

    @staticmethod
    def plus(x: Any, y: Any) -> Any:
        """x + y."""
        return x + y

    @staticmethod
    def less(x: Any, y: Any) -> Any:
        """x - y."""
        return x - y

    @staticmethod
    def wide(x: Any, batch: int) -> Any:
        """x (..., 1) or (..., batch) as (..., batch)."""
        return x.expand(*x.shape[:-1], batch)

    def segment(self, x: Any, island: Any) -> Any:
        """(..., buses, batch) sums over islands, in the row of the island's number."""
        if len(island) == 1:
            return x
        return self._torch.zeros_like(x).scatter_add(-2, island.expand(x.shape), x)

    @staticmethod
    def spread(x: Any, island: Any) -> Any:
        """(..., buses, batch) the island's value at each of its buses."""
        return x if len(island) == 1 else x.gather(-2, island.expand(x.shape))

    @staticmethod
    def rows(x: Any, at: Ints) -> Any:
        """Some rows of x."""
        return x[at]

    @staticmethod
    def some(x: Any, least: float) -> bool:
        """Always: to look would stop a device."""
        return True

    @staticmethod
    def plain(x: Any) -> np.ndarray:
        """x as a NumPy array."""
        return x.detach().cpu().numpy()


@lru_cache(maxsize=64)
def _kind(dtype: Any, device: Any) -> Any:
    return NumPy(dtype) if device is None else Torch(dtype, device)


def namespace(x: Array) -> Any:
    """The operations for the kind of array that x is."""
    return _kind(x.dtype, None if isinstance(x, np.ndarray) else x.device)
