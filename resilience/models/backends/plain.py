"""HiGHS on plain arrays, for linear programs that grow rows of their own: masters of decomposition.

Rows are only ever added, bounds and sides changed; the basis is kept throughout. With integers the
program as it stands is handed to a tree search.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError
from resilience.models.backends.base import OutOfTimeError, failures_of, no_numbers
from resilience.models.backends.highs_model import (
    LINEAR_OPTIONS,
    TREE_OPTIONS,
    HighsModel,
    RunStatus,
)
from resilience.models.backends.highs_scale import Scale
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Vectors


class Plain:
    """min c'z + c0  s.t.  row_lower <= A z <= row_upper, lower <= z <= upper.

    Args:
        a: (rows, columns).
        vectors: everything else. Owned by this object from now on.
        scale: the units in which HiGHS holds it; those of the arrays if omitted.
    """

    def __init__(self, a: sp.csr_array, vectors: Vectors, scale: Scale | None = None) -> None:
        self._blocks, self.vectors = [a], vectors
        self._model = HighsModel(LINEAR_OPTIONS)
        self._model.load(a, vectors, scale=scale)

    def add_rows(self, block: sp.csr_array, lower: Floats, upper: Floats) -> None:
        """Adds rows  lower <= block z <= upper."""
        self._model.add_matrix(block, lower, upper)
        self._blocks.append(block)
        v = self.vectors
        v.row_lower, v.row_upper = np.append(v.row_lower, lower), np.append(v.row_upper, upper)

    def set_bounds(self, columns: Ints, lower: Floats, upper: Floats) -> None:
        """Changes the bounds of some columns."""
        self.vectors.lower[columns], self.vectors.upper[columns] = lower, upper
        self._model.change_bounds(columns, lower, upper)

    def set_sides(self, rows: Ints, lower: Floats, upper: Floats) -> None:
        """Changes the sides of some rows."""
        self.vectors.row_lower[rows], self.vectors.row_upper[rows] = lower, upper
        self._model.change_sides(rows, lower, upper)

    def search_tree(
        self, integer: Ints, start: Floats | None, gap: float, seconds: float = np.inf
    ) -> tuple[Floats, float] | None:
        """The best values (columns,) with some columns whole, and the bound that the search proves.

        Args:
            integer: the columns.
            start: values of these to begin from.
            gap: relative, at which to stop.
            seconds: that it may take; without any it is not begun.

        Raises:
            OutOfTimeError: that was not enough for a point.
            SolverError: the solver stopped for any other reason.
        """
        if seconds <= 0.0:
            raise OutOfTimeError("no time was left for a tree search")
        a, is_integer = (
            sp.vstack(self._blocks, format="csr"),
            np.zeros(len(self.vectors.cost), bool),
        )
        is_integer[integer] = True
        model = HighsModel({"mip_rel_gap": gap, "mip_abs_gap": 0.0, **TREE_OPTIONS})
        model.load(sp.csr_array(a), self.vectors, is_integer)
        if start is not None:
            model.set_start(integer, start)
        if np.isfinite(seconds):
            model.limit_time(seconds)
        with failures_of("HiGHS"):
            status = model.run()
        info = model.info
        if status in (RunStatus.INFEASIBLE, RunStatus.AMBIGUOUS):
            return None
        if not info.has_point:
            if model.is_out_of_time:
                raise OutOfTimeError("a tree search took longer than the time that was left")
            raise SolverError(f"a tree search ended as {model.status_text}")
        z = model.solution.values
        z[integer] = np.round(z[integer])
        return z, info.mip_bound

    def solve(self, seconds: float = np.inf) -> tuple[Floats, Floats] | None:
        """The optimal values (columns,) and multipliers (rows,), None where there is no point.

        Args:
            seconds: that it may take; without any it is not begun.

        Raises:
            OutOfTimeError: that was not enough.
            SolverError: the solver stopped for any other reason.
        """
        if seconds <= 0.0:
            raise OutOfTimeError("no time was left for a linear program")
        if np.isfinite(seconds):
            self._model.limit_time(seconds)
        with failures_of("HiGHS"):
            answer = self._solved()
        if answer is not None and not all(np.isfinite(array).all() for array in answer):
            raise no_numbers("HiGHS")
        return answer

    def _solved(self) -> tuple[Floats, Floats] | None:
        status = self._model.run()
        if status is RunStatus.INFEASIBLE:
            return None
        if self._model.is_out_of_time:
            raise OutOfTimeError("a linear program took longer than the time that was left")
        if status is not RunStatus.OPTIMAL:
            raise SolverError(f"a linear program ended as {self._model.status_text}")
        solution = self._model.solution
        return solution.values, solution.multipliers

    def bound(self, multipliers: Floats, lower: Floats, upper: Floats) -> float:
        """A bound in $ that holds whatever the solver's tolerances, over a box of the columns."""
        a = sp.vstack(self._blocks, format="csr")
        return safe_bound(a, replace(self.vectors, lower=lower, upper=upper), multipliers)
