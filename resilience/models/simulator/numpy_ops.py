"""The operations of the simulator on NumPy arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints


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
    def at_least(x: np.ndarray, number: float) -> np.ndarray:
        """max(x, number)."""
        return np.maximum(x, number)

    @staticmethod
    def above(x: np.ndarray) -> np.ndarray:
        """max(x, 0)."""
        return np.maximum(x, 0.0)

    @staticmethod
    def positive_up_to(x: np.ndarray, limit: np.ndarray) -> np.ndarray:
        """min(max(x, 0), limit), as wide as x."""
        result = np.maximum(x, 0.0)
        return np.minimum(result, limit, out=result)

    @staticmethod
    def within(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """max(min(x, high), low)."""
        result = np.minimum(x, high)
        return np.maximum(result, low, out=result)

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

    @staticmethod
    def stacked(arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Arrays of one shape along a new first axis."""
        return np.array(arrays)

    @staticmethod
    def cumulated(x: np.ndarray) -> np.ndarray:
        """(n + 1, ...) sums of the first 0, 1, ..., n along the first axis."""
        sums = np.zeros((len(x) + 1, *x.shape[1:]), x.dtype)
        for k, layer in enumerate(x):  # ten times faster than `cumsum`
            np.add(sums[k], layer, out=sums[k + 1])
        return sums

    @staticmethod
    def priced(prices: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(batch,) sums of x, tier by tier: the bits do not depend on the size of the batch."""
        total = np.zeros(x.shape[1:], x.dtype)
        for price, amount in zip(prices, x, strict=True):
            total += price * amount
        return total.sum(0)

    @staticmethod
    def priced_above(prices: np.ndarray, x: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """(batch,) sums of what x is above levels, tier by tier likewise."""
        total = np.zeros(x.shape, x.dtype)
        for price, level in zip(prices, levels, strict=True):
            amount = x - level
            np.maximum(amount, 0.0, out=amount)
            np.multiply(amount, price, out=amount)
            np.add(total, amount, out=total)
        return total.sum(0)

    def sums(self, x: np.ndarray, island: np.ndarray, n: int) -> np.ndarray:
        """(..., n, batch) sums of the rows of x over islands."""
        if n == 1:
            return x.sum(-2, keepdims=True)
        *leading, rows, batch = x.shape
        cell = (island * batch + np.arange(batch)).ravel()  # of the island's row, in (n, batch)
        layers = x.reshape(math.prod(leading), rows * batch)
        result = np.array([np.bincount(cell, layer, n * batch) for layer in layers], self.dtype)
        return result.reshape(*leading, n, batch)

    @staticmethod
    def at_islands(x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(..., rows, batch) what x is in the row of each row's island."""
        *leading, n, batch = x.shape
        if n == 1:
            return x
        cell = (island * batch + np.arange(batch)).ravel()
        flat = x.reshape(*leading, n * batch).take(cell, axis=-1)
        return flat.reshape(*leading, *island.shape)

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
