"""HiGHS on plain arrays, for linear programs that grow rows of their own: masters of decomposition.

Rows are only ever added, bounds and costs changed; the basis is kept throughout.
"""

from __future__ import annotations

from typing import Any

import highspy
import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError
from resilience.models.backends.highs import LINEAR, MINIMIZE, ROWWISE
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Vectors


class Plain:
    """min c'z + c0  s.t.  row_lower <= A z <= row_upper, lower <= z <= upper.

    Args:
        a: (rows, columns).
        vectors: all else. Owned by this object from now on.
    """

    def __init__(self, a: sp.csr_array, vectors: Vectors) -> None:
        self._blocks, self.vectors = [a], vectors
        self.model: Any = highspy.Highs()  # type: ignore[no-untyped-call]
        self.model.silent()
        for name, value in LINEAR.items():
            self.model.setOptionValue(name, value)
        v = vectors
        self.model.passModel(
            a.shape[1],
            a.shape[0],
            a.nnz,
            ROWWISE,
            MINIMIZE,
            v.offset,
            v.cost,
            v.lower,
            v.upper,
            v.row_lower,
            v.row_upper,
            a.indptr.astype(np.int32),
            a.indices.astype(np.int32),
            a.data,
            np.zeros(a.shape[1], np.int32),
        )

    def add_rows(self, block: sp.csr_array, lower: Floats, upper: Floats) -> None:
        """Adds rows  lower <= block z <= upper."""
        n, v = block.shape[0], self.vectors
        starts, at = block.indptr[:-1].astype(np.int32), block.indices.astype(np.int32)
        self.model.addRows(n, lower, upper, block.nnz, starts, at, block.data)
        self._blocks.append(block)
        v.row_lower, v.row_upper = np.append(v.row_lower, lower), np.append(v.row_upper, upper)

    def set_bounds(self, columns: Ints, lower: Floats, upper: Floats) -> None:
        """Changes the bounds of some columns."""
        self.vectors.lower[columns], self.vectors.upper[columns] = lower, upper
        self.model.changeColsBounds(len(columns), columns.astype(np.int32), lower, upper)

    def set_costs(self, columns: Ints, cost: Floats) -> None:
        """Changes the costs of some columns."""
        self.vectors.cost[columns] = cost
        self.model.changeColsCost(len(columns), columns.astype(np.int32), cost)

    def solve(self) -> tuple[Floats, Floats] | None:
        """The optimal values (columns,) and multipliers (rows,), None where there is no point.

        Raises:
            SolverError: the solver stopped for any other reason.
        """
        self.model.run()
        status = self.model.getModelStatus()
        if status == highspy.HighsModelStatus.kInfeasible:
            return None
        if status != highspy.HighsModelStatus.kOptimal:
            raise SolverError(f"a linear program ended as {self.model.modelStatusToString(status)}")
        found = self.model.getSolution()
        return np.array(found.col_value), -np.array(found.row_dual)

    def bound(self, multipliers: Floats, lower: Floats, upper: Floats) -> float:
        """A bound in $ that holds whatever the solver's tolerances, over a box of the columns."""
        v = self.vectors
        within = Vectors(v.cost, v.offset, lower, upper, v.row_lower, v.row_upper)
        a = sp.vstack(self._blocks, format="csr")
        return safe_bound(a, within, v.row_lower, v.row_upper, multipliers)
