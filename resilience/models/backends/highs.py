"""HiGHS through highspy: sparse arrays in, warm basis kept; the hot loop."""

from __future__ import annotations

from typing import Any

import highspy
import numpy as np
import scipy.sparse as sp

from resilience.models.algebra import Floats
from resilience.models.backends.base import NOTHING, Duals, Solution, leaf_rows
from resilience.models.backends.lower import Lowered, lower
from resilience.models.certificate import safe_bound
from resilience.models.standard import Standard, Vectors

KINDS = highspy.HighsVarType
STATUS = highspy.HighsModelStatus


class Highs:
    """Holds affine rows, integers, splits and piecewise curves; discs as polygons; cones relaxed.

    Args:
        problem: the problem, or one already lowered with a choice of what is relaxed.
        time_limit: seconds per solve.
        gap: relative MIP gap at which a solve stops.
        rows: further rows G z <= h of constant coefficients (cone cuts, no-good cuts).
    """

    exact = frozenset({"affine", "integer", "split", "adjacent", "largest"})

    def __init__(
        self,
        problem: Standard | Lowered,
        *,
        time_limit: float = np.inf,
        gap: float = 1e-4,
        rows: tuple[sp.csr_array, Floats] | None = None,
        threads: int = 0,
    ) -> None:
        self.lowered = problem if isinstance(problem, Lowered) else lower(problem)
        self.problem = self.lowered.problem
        self.time_limit = time_limit
        self._extra = rows
        self._started = False
        self._cut_rows = 0
        self.is_mip = bool(self.lowered.integer.any())
        self.model: Any = highspy.Highs()  # type: ignore[no-untyped-call]
        self.model.silent()
        for name, value in {"mip_rel_gap": gap, "threads": threads}.items():
            self.model.setOptionValue(name, value)

    def _matrix(self) -> sp.csr_array:
        if self._extra is None:
            return self.lowered.a
        g = self._extra[0].copy()
        g.resize(g.shape[0], self.lowered.a.shape[1])
        return sp.vstack([self.lowered.a, g], format="csr")

    def _sides(self, v: Vectors) -> tuple[Floats, Floats]:
        if self._extra is None:
            return v.row_lower, v.row_upper
        h = self._extra[1]
        return np.append(v.row_lower, np.full(len(h), -np.inf)), np.append(v.row_upper, h)

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers; the basis of the last solve is kept."""
        v = self.lowered.vectors(vectors)
        low, high = self._sides(v)
        self._vectors = vectors
        if not self._started:
            self._pass(v, low, high)
            return
        self._change(v, low, high)

    def _pass(self, v: Vectors, low: Floats, high: Floats) -> None:
        a = self._matrix()
        lp = highspy.HighsLp()
        lp.num_row_, lp.num_col_ = a.shape
        lp.col_cost_, lp.offset_ = v.cost, v.offset
        lp.col_lower_, lp.col_upper_ = v.lower, v.upper
        lp.row_lower_, lp.row_upper_ = low, high
        lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = a.indptr, a.indices, a.data
        if self.is_mip:
            kinds = np.where(self.lowered.integer, 1, 0)
            lp.integrality_ = [KINDS.kInteger if k else KINDS.kContinuous for k in kinds]
        self.model.passModel(lp)
        self._columns = np.arange(a.shape[1], dtype=np.int32)
        self._rows = np.arange(a.shape[0], dtype=np.int32)
        self._sent = v.cost
        self._started = True

    def _change(self, v: Vectors, low: Floats, high: Floats) -> None:
        model = self.model
        model.changeColsBounds(len(self._columns), self._columns, v.lower, v.upper)
        model.changeRowsBounds(len(self._rows), self._rows, low, high)
        if not np.array_equal(v.cost, self._sent):
            model.changeColsCost(len(self._columns), self._columns, v.cost)
            self._sent = v.cost
        model.changeObjectiveOffset(v.offset)

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """Adds rows; the basis is kept. The leaf's future cost is set free when it has a cut."""
        leaf = int(np.searchsorted(self.problem.tree.leaves, node))
        future = int(self.problem.future[leaf])
        names = [b.name for _, b in self.problem.forms[0].stage.states]
        states = np.concatenate([self.problem.columns(name)[:, node] for name in names])
        columns, values = leaf_rows(states, future, beta)
        for rhs, row in zip(-alpha, values, strict=True):
            self.model.addRow(-np.inf, rhs, len(columns), columns.astype(np.int32), row)
            self._cut_rows += 1
        self.model.changeColBounds(future, -highspy.kHighsInf, highspy.kHighsInf)

    def start_from(self, z: Floats) -> None:
        """Hands a MIP a first point, in the problem's own columns."""
        at = np.flatnonzero(self.problem.integer).astype(np.int32)
        self.model.setSolution(len(at), at, np.round(z[at]))

    def solve(self) -> Solution:
        """Solves; a MIP stopped by its limits returns its incumbent and its dual bound."""
        if np.isfinite(self.time_limit):
            self.model.setOptionValue("time_limit", self.model.getRunTime() + self.time_limit)
        self.model.run()
        info, status = self.model.getInfo(), self.model.getModelStatus()
        if status in (STATUS.kInfeasible, STATUS.kUnboundedOrInfeasible):
            return Solution("infeasible", None, np.inf, np.inf)
        if info.primal_solution_status != 2:
            return NOTHING
        found = self.model.getSolution()
        z = np.asarray(found.col_value)[: self.problem.n_columns]
        done = status == STATUS.kOptimal
        if self.is_mip:
            value = info.objective_function_value
            return Solution("optimal" if done else "feasible", z, value, info.mip_dual_bound)
        return self._linear(z, found, done)

    def _linear(self, z: Floats, found: Any, done: bool) -> Solution:
        value = self.model.getInfo().objective_function_value
        prices = np.asarray(found.col_dual)
        start = prices[: self.problem.n_states]
        rows = -np.asarray(found.row_dual)
        if not done:
            return Solution("feasible", z, value, -np.inf, Duals(rows), start)
        return Solution("optimal", z, value, value, Duals(rows), start)

    def certified_bound(self, solution: Solution) -> float:
        """A bound that holds whatever the solver's tolerances, from its multipliers."""
        if solution.duals is None or self._cut_rows:
            return solution.bound
        v = self.lowered.vectors(self._vectors)
        low, high = self._sides(v)
        return safe_bound(self._matrix(), v, low, high, solution.duals.rows)

    def conflict(self) -> list[str]:
        """Names of rows and columns that together admit no point; empty if there is one."""
        self.model.setOptionValue("iis_strategy", 2)
        _, iis = self.model.getIis()
        n = self.problem.n_rows
        rows = [self.problem.row_name(i) for i in iis.row_index_ if i < n]
        others = [i for i in iis.row_index_ if i >= n]
        columns = [j for j in iis.col_index_ if j < self.problem.n_columns]
        bounds = [f"bounds of {self.problem.column_name(j)}" for j in columns]
        return rows + ([f"{len(others)} rating or mode rows"] if others else []) + bounds
