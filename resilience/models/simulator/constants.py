"""Constants of the simulator, kept once per kind of array, so that a step converts nothing.

A kind is a library, number type and device: `ArrayOps` that compare equal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.simulator.arrays import Array, ArrayOps


@dataclass(eq=False)
class Constant:
    """A constant array in every kind that a step needed.

    Attributes:
        value: (n, 1), or of any shape.
    """

    value: Floats
    _by_kind: dict[ArrayOps, Array] = field(default_factory=dict, repr=False)

    def as_array(self, ops: ArrayOps) -> Array:
        """The constant as an array of the kind of `ops`."""
        array = self._by_kind.get(ops)
        if array is None:
            array = self._by_kind[ops] = ops.array(self.value)
        return array


@dataclass(eq=False)
class Matrix:
    """A constant sparse matrix, kept likewise.

    Attributes:
        value: (rows, columns).
    """

    value: sp.csr_array
    _by_kind: dict[ArrayOps, Array] = field(default_factory=dict, repr=False)

    def as_matrix(self, ops: ArrayOps) -> Array:
        """The matrix in the kind of `ops`, for `matrix @ array`."""
        matrix = self._by_kind.get(ops)
        if matrix is None:
            matrix = self._by_kind[ops] = ops.matrix(self.value)
        return matrix


@dataclass(eq=False)
class Map:
    """An affine function of the data: constant + coefficients @ data.

    Attributes:
        constant: (n,).
        coefficients: (n, n_data).
    """

    constant: Floats
    coefficients: sp.csr_array
    _by_kind: dict[ArrayOps, tuple[Array | None, Array | None]] = field(
        default_factory=dict, repr=False
    )

    def as_arrays(self, ops: ArrayOps) -> tuple[Array | None, Array | None]:
        """Constant (n, 1), None where it is zero, and matrix, None where no data enters."""
        arrays = self._by_kind.get(ops)
        if arrays is None:
            constant, matrix = self.constant[:, None], self.coefficients
            moves, is_linear = matrix.nnz > 0, not constant.any()
            arrays = self._by_kind[ops] = (
                None if is_linear and moves else ops.array(constant),
                ops.matrix(matrix) if moves else None,
            )
        return arrays

    @cached_property
    def _block(self) -> slice | None:
        """Where in the data the values stand as they are, one below the other, if they do."""
        columns = self.coefficients.indices
        one_per_row = np.diff(self.coefficients.indptr) == 1
        if not len(columns) or self.constant.any() or not one_per_row.all():
            return None
        if (np.diff(columns) != 1).any() or (self.coefficients.data != 1.0).any():
            return None
        return slice(int(columns[0]), int(columns[-1]) + 1)

    def __call__(self, ops: ArrayOps, data: Array) -> Array:
        """(n, batch) the values, or (n, 1) where data has no part in them; maybe a view."""
        if self._block is not None:
            return data[self._block]
        constant, matrix = self.as_arrays(ops)
        if matrix is None:
            return constant
        product = matrix @ data
        return product if constant is None else constant + product
