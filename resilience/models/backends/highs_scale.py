"""A program in other units than its caller's, each column and row in one of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.program.standard import Vectors


@dataclass(frozen=True)
class Scale:
    """What one unit of what HiGHS holds is in the units of the caller.

    Attributes:
        columns: (columns,) of a column.
        rows: (rows,) of a row: its largest coefficient, which HiGHS then holds as 1.
        cost: of the objective, $.
    """

    columns: Floats
    rows: Floats
    cost: float

    @classmethod
    def of_matrix(cls, a: sp.csr_array, columns: Floats, cost: float) -> Scale:
        """The one of a program with matrix a (rows, columns)."""
        return cls(columns, _largest(abs(a.multiply(columns[None, :])).max(axis=1).toarray()), cost)

    def matrix(self, a: sp.csr_array) -> sp.csr_array:
        """(rows, columns) as HiGHS holds it."""
        return sp.csr_array(a.multiply(self.columns[None, :]).multiply(1.0 / self.rows[:, None]))

    def vectors(self, v: Vectors) -> Vectors:
        """All numbers beside the matrix, as HiGHS holds them."""
        return Vectors(
            v.cost * self.columns / self.cost,
            v.offset / self.cost,
            v.lower / self.columns,
            v.upper / self.columns,
            v.row_lower / self.rows,
            v.row_upper / self.rows,
        )

    def with_money_columns(self, n: int) -> Scale:
        """The same with n more columns, in $."""
        return replace(self, columns=np.append(self.columns, np.full(n, self.cost)))

    def with_rows(self, block: sp.csr_array) -> Scale:
        """The same with more rows (rows, columns)."""
        more = self.of_matrix(block, self.columns, self.cost)
        return replace(self, rows=np.append(self.rows, more.rows))


def _largest(sizes: Floats) -> Floats:
    """(rows,) the largest coefficients; 1 for a row of zeros."""
    flat = sizes.ravel()
    return np.where(flat > 0.0, flat, 1.0)
