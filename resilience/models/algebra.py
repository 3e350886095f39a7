"""Affine expressions over the columns and data of one stage.

An `Affine` is a vector of n expressions  sum_j a_ij x_j + sum_k b_ik d_k + c_i  in variables x and
exogenous data d. It is kept as triplets, so that adding two of them is one concatenation and a
stage is written in microseconds. Variables have ids 0, 1, 2, ...; the k-th datum has the id ~k
(a negative number), so that every operation treats both alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from resilience.arrays import Floats, Ints

Labels = tuple[str, ...]


class Affine:
    """A vector of n affine expressions, each with a label that survives into row names."""

    __slots__ = ("const", "ids", "labels", "rows", "values")
    __array_ufunc__ = None  # numpy hands `array * affine` over to us

    def __init__(
        self, rows: Ints, ids: Ints, values: Floats, const: Floats, labels: Labels | None = None
    ) -> None:
        self.rows, self.ids, self.values = rows, ids, values
        self.const, self.labels = const, labels

    @classmethod
    def constant(cls, value: ArrayLike, n: int) -> Affine:
        """The n-vector `value` (a scalar is repeated), without variables or data."""
        none = np.empty(0, np.intp)
        return cls(none, none, np.empty(0), np.broadcast_to(np.asarray(value, float), (n,)).copy())

    @classmethod
    def of_ids(cls, ids: Ints, labels: Labels | None = None) -> Affine:
        """One variable or datum per entry."""
        n = len(ids)
        return cls(np.arange(n), np.asarray(ids, np.intp), np.ones(n), np.zeros(n), labels)

    @property
    def n(self) -> int:
        """Number of expressions."""
        return len(self.const)

    def __len__(self) -> int:
        return self.n

    def _coerce(self, other: Any) -> Affine:
        if isinstance(other, Affine):
            return other
        value = np.asarray(other, float)
        return Affine.constant(value, self.n if value.size == 1 else len(value))

    def __add__(self, other: Any) -> Affine:
        other = self._coerce(other)
        left, right = self._stretched(other.n), other._stretched(self.n)
        return Affine(
            np.concatenate([left.rows, right.rows]),
            np.concatenate([left.ids, right.ids]),
            np.concatenate([left.values, right.values]),
            left.const + right.const,
            left.labels or right.labels,
        )

    __radd__ = __add__

    def __neg__(self) -> Affine:
        return self * -1.0

    def __sub__(self, other: Any) -> Affine:
        return self + -self._coerce(other)

    def __rsub__(self, other: Any) -> Affine:
        return -self + self._coerce(other)

    def __mul__(self, factor: ArrayLike) -> Affine:
        if isinstance(factor, Affine):
            raise TypeError("the product of two affine expressions is not affine")
        factor = np.asarray(factor, float)
        wide = self._stretched(self.n if factor.size == 1 else len(factor))
        scale = np.broadcast_to(factor, (wide.n,))
        return Affine(
            wide.rows, wide.ids, wide.values * scale[wide.rows], wide.const * scale, wide.labels
        )

    __rmul__ = __mul__

    def __getitem__(self, index: Any) -> Affine:
        chosen = np.atleast_1d(np.arange(self.n)[index])
        order = np.argsort(chosen, kind="stable")
        starts = np.searchsorted(chosen[order], np.arange(self.n + 1))
        pick = sp.csc_array((np.ones(len(chosen)), order, starts), shape=(len(chosen), self.n))
        labels = tuple(self.labels[i] for i in chosen) if self.labels else None
        return self.mapped(pick, labels)

    def _stretched(self, n: int) -> Affine:
        if self.n == n or n == 1:
            return self
        if self.n != 1:
            raise ValueError(f"cannot combine {self.n} expressions with {n}")
        return self.mapped(sp.csr_array(np.ones((n, 1))))

    def mapped(self, matrix: Any, labels: Labels | None = None) -> Affine:
        """`matrix @ self` for a constant (m, n) matrix, dense or sparse."""
        matrix = sp.csc_array(matrix)
        if matrix.shape[1] != self.n:
            raise ValueError(f"a matrix of shape {matrix.shape} cannot map {self.n} expressions")
        starts, counts = matrix.indptr[self.rows], np.diff(matrix.indptr)[self.rows]
        entry = np.repeat(np.arange(len(self.rows)), counts)
        shift = np.arange(len(entry)) - np.repeat(np.cumsum(counts) - counts, counts)
        at = starts[entry] + shift
        return Affine(
            matrix.indices[at].astype(np.intp),
            self.ids[entry],
            self.values[entry] * matrix.data[at],
            matrix @ self.const,
            labels,
        )

    def sum(self) -> Affine:
        """The single expression that adds up all n."""
        return self.mapped(np.ones((1, self.n)))

    @property
    def has_variables(self) -> bool:
        """Whether any entry names a variable."""
        return bool((self.ids >= 0).any())

    @property
    def has_data(self) -> bool:
        """Whether any entry names exogenous data."""
        return bool((self.ids < 0).any())


def stack(parts: Sequence[Affine]) -> Affine:
    """The expressions of all parts, one below the other."""
    offsets = np.cumsum([0] + [part.n for part in parts])
    named = all(part.labels is not None for part in parts)
    return Affine(
        np.concatenate([part.rows + o for part, o in zip(parts, offsets, strict=False)]),
        np.concatenate([part.ids for part in parts]),
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.const for part in parts]),
        tuple(label for part in parts for label in part.labels or ()) if named else None,
    )


def scatter(part: Affine, index: ArrayLike, n: int, labels: Labels | None = None) -> Affine:
    """An n-vector that is zero but for `part` at the places `index`."""
    index = np.asarray(index, np.intp)
    place = sp.csc_array((np.ones(part.n), index, np.arange(part.n + 1)), shape=(n, part.n))
    return part.mapped(place, labels)
