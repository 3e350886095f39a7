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
    """A vector of n affine expressions, each with a label that survives into row names.

    Attributes:
        rows: (entries,) which expression each triplet belongs to.
        ids: (entries,) which variable (>= 0) or datum (< 0, the k-th being ~k) it multiplies.
        values: (entries,) its coefficient; triplets of one row and id add up.
        const: (n,) constants.
        labels: (n,) names; None where none has been given.
    """

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

    def _coerce(self, term: Any) -> Affine:
        if isinstance(term, Affine):
            return term
        value = np.asarray(term, float)
        return Affine.constant(value, self.n if value.size == 1 else len(value))

    def __add__(self, other: Any) -> Affine:
        term = self._coerce(other)
        a, b = self._stretched(term.n), term._stretched(self.n)
        return Affine(
            np.concatenate([a.rows, b.rows]),
            np.concatenate([a.ids, b.ids]),
            np.concatenate([a.values, b.values]),
            a.const + b.const,
            a.labels or b.labels,
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
        # A selection is a 0/1 matrix with a one in (k, chosen[k]). Its columns, which `mapped`
        # wants, are the places in `chosen` in the order of what stands there; an expression may be
        # chosen twice, or not at all.
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
        """`matrix @ self` for a constant (m, n) matrix, dense or sparse.

        Raises:
            ValueError: the matrix does not have n columns.
        """
        # The triplet (row i, id, value) becomes one triplet (k, id, matrix[k, i] * value) for every
        # entry in column i of the matrix. So each triplet is repeated as often as its column has
        # entries, and `place` counts through the entries of that column.
        matrix = sp.csc_array(matrix)
        if matrix.shape[1] != self.n:
            raise ValueError(f"a matrix of shape {matrix.shape} cannot map {self.n} expressions")
        starts, counts = matrix.indptr[self.rows], np.diff(matrix.indptr)[self.rows]
        triplet = np.repeat(np.arange(len(self.rows)), counts)
        within_column = np.arange(len(triplet)) - np.repeat(np.cumsum(counts) - counts, counts)
        place = starts[triplet] + within_column
        return Affine(
            matrix.indices[place].astype(np.intp),
            self.ids[triplet],
            self.values[triplet] * matrix.data[place],
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


def stack(terms: Sequence[Affine]) -> Affine:
    """All expressions, one below the other."""
    offsets = np.cumsum([0] + [term.n for term in terms])
    labelled = all(term.labels is not None for term in terms)
    return Affine(
        np.concatenate([term.rows + o for term, o in zip(terms, offsets, strict=False)]),
        np.concatenate([term.ids for term in terms]),
        np.concatenate([term.values for term in terms]),
        np.concatenate([term.const for term in terms]),
        tuple(label for term in terms for label in term.labels or ()) if labelled else None,
    )


def scatter(term: Affine, index: ArrayLike, n: int, labels: Labels | None = None) -> Affine:
    """An n-vector that is zero but for `term` at the places `index`."""
    index = np.asarray(index, np.intp)
    place = sp.csc_array((np.ones(term.n), index, np.arange(term.n + 1)), shape=(n, term.n))
    return term.mapped(place, labels)


def replaced(term: Affine, index: Ints, values: Affine) -> Affine:
    """The same expressions but for `values` at the places `index`."""
    keep = np.ones(term.n)
    keep[index] = 0.0
    return term * keep + scatter(values, index, term.n)


def labelled(term: Affine, labels: Labels) -> Affine:
    """The same expressions under other names."""
    return Affine(term.rows, term.ids, term.values, term.const, labels)
