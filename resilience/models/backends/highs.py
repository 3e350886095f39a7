"""HiGHS through highspy: sparse arrays in, warm basis kept; the hot loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import highspy
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from resilience.arrays import Floats, Ints
from resilience.models.backends.base import INFEASIBLE, NOTHING, Duals, LeafCuts, Solution, Status
from resilience.models.backends.lower import Lowered, lower
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.referee import row_violations
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Adjacent, Largest, Split, Structure
from resilience.tolerances import CONFLICT_TOLERANCE

ROWWISE = int(highspy.MatrixFormat.kRowwise)
MINIMIZE = int(highspy.ObjSense.kMinimize)
STATUS = highspy.HighsModelStatus
EXPLAIN_S = 5.0  # s for each way of explaining what is infeasible

# Measured by `python -m bench`: coefficients in pu and MW need no scaling, few pivots no steepest
# edges. From a basis, perturbed costs and a stale factorisation cost more pivots than they save;
# from scratch the perturbation is what keeps a large LP from stalling.
LINEAR = {"simplex_scale_strategy": 0, "simplex_dual_edge_weight_strategy": 1}
WARM = {
    "dual_simplex_cost_perturbation_multiplier": 0.0,
    "no_unnecessary_rebuild_refactor": False,
}


class Highs:
    """Holds affine rows, integers, splits and piecewise curves; discs as polygons; cones relaxed.

    Args:
        problem: the problem, or one already lowered with a choice of what is relaxed.
        time_limit: seconds per solve.
        gap: relative MIP gap at which a solve stops.
        rows: further rows G z <= h of constant coefficients (cone cuts, no-good cuts).
        threads: of the solver, 0 for its own choice.
        duals: whether an LP's solution carries its multipliers; loops save by not asking.
    """

    exact: frozenset[type[Structure]] = frozenset({Split, Adjacent, Largest})
    integers = True

    def __init__(
        self,
        standard: Standard | Lowered,
        *,
        time_limit: float = np.inf,
        gap: float = 1e-4,
        rows: tuple[sp.csr_array, Floats] | None = None,
        threads: int = 0,
        duals: bool = True,
    ) -> None:
        self.lowered = standard if isinstance(standard, Lowered) else lower(standard)
        self.standard = self.lowered.standard
        self.time_limit, self.duals = time_limit, duals
        self._extra = rows
        self._sent: Vectors | None = None
        self._late = LeafCuts(self.standard)
        self._warm = False
        self.is_mip = bool(self.lowered.integer.any())
        self.model: Any = highspy.Highs()  # type: ignore[no-untyped-call]
        self.model.silent()
        self._set({"mip_rel_gap": gap, "threads": threads})
        if not self.is_mip:
            self._set(LINEAR)

    def _set(self, options: dict[str, Any]) -> None:
        for name, value in options.items():
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
        self._given, vectors = vectors, self._late.opened(vectors)
        if self._sent is None:
            self._pass(self.lowered.vectors(vectors))
        else:
            self._change(vectors, self._sent)
        if self._discs != self.lowered.discs:
            self._turn(self.lowered.vectors(vectors))
        # Copies, so that a caller may change its vectors in place.
        self._sent = replace(
            vectors,
            cost=vectors.cost.copy(),
            lower=vectors.lower.copy(),
            upper=vectors.upper.copy(),
            row_lower=vectors.row_lower.copy(),
            row_upper=vectors.row_upper.copy(),
        )

    def _pass(self, v: Vectors) -> None:
        a = self._matrix()
        low, high = self._sides(v)
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
            low,
            high,
            a.indptr.astype(np.int32),
            a.indices.astype(np.int32),
            a.data,
            self.lowered.integer.astype(np.int32),
        )
        self._discs = self.lowered.discs

    def _change(self, new: Vectors, old: Vectors) -> None:
        """Sends what differs; what `lower` added never does."""
        model = self.model
        if not (self.is_mip or self._warm):
            self._set(WARM)
            self._warm = True
        at = _differ(new.lower, old.lower, new.upper, old.upper)
        if len(at):
            model.changeColsBounds(len(at), at, new.lower[at], new.upper[at])
        at = _differ(new.row_lower, old.row_lower, new.row_upper, old.row_upper)
        if len(at):
            model.changeRowsBounds(len(at), at, new.row_lower[at], new.row_upper[at])
        at = _differ(new.cost, old.cost)
        if len(at):
            model.changeColsCost(len(at), at, new.cost[at])
        model.changeObjectiveOffset(new.offset)

    def _turn(self, v: Vectors) -> None:
        """Polygons from within the discs to around them, or back."""
        at = np.arange(self.standard.n_rows, len(v.row_upper), dtype=np.int32)
        self.model.changeRowsBounds(len(at), at, v.row_lower[at], v.row_upper[at])
        self._discs = self.lowered.discs

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """Adds rows to what `update` sent; the basis is kept. See `Backend.add_cuts`."""
        columns, values = self._late.add(node, alpha, beta)
        for rhs, row in zip(-np.asarray(alpha, float), values, strict=True):
            self.model.addRow(-np.inf, rhs, len(columns), columns.astype(np.int32), row)
        self.update(self._given)

    def tune(self, options: dict[str, Any]) -> None:
        """Sets options of HiGHS by their names."""
        self._set(options)

    def basis(self) -> Any:
        """The basis of the last solve, for `start_at`."""
        return self.model.getBasis()

    def start_at(self, basis: Any) -> None:
        """Lets the next solve start from a basis, whatever has been solved in between."""
        self.forget()
        self.model.setBasis(basis)

    def forget(self) -> None:
        """Lets the next solve start from nothing."""
        self.model.clearSolver()

    def start_from(self, z: Floats) -> None:
        """Hands a MIP a first point, in the problem's own columns."""
        at = np.flatnonzero(self.standard.integer).astype(np.int32)
        self.model.setSolution(len(at), at, np.round(z[at]))

    def solve(self) -> Solution:
        """Solves; a MIP stopped by its limits returns its incumbent and its dual bound."""
        if np.isfinite(self.time_limit):
            self.model.setOptionValue("time_limit", self.model.getRunTime() + self.time_limit)
        self.model.run()
        status = self.model.getModelStatus()
        if status == STATUS.kUnboundedOrInfeasible:
            status = self._without_presolve()
        if status == STATUS.kInfeasible:
            return INFEASIBLE
        if status == STATUS.kUnbounded:
            return NOTHING
        info = self.model.getInfo()
        if info.primal_solution_status != 2:
            return replace(NOTHING, bound=info.mip_dual_bound if self.is_mip else -np.inf)
        found = self.model.getSolution()
        z = _array(found.col_value)[: self.standard.n_columns]
        done = status == STATUS.kOptimal
        if self.is_mip:
            value = info.objective_function_value
            return Solution("optimal" if done else "feasible", z, value, info.mip_dual_bound)
        return self._linear(z, found, done, info.objective_function_value)

    def _without_presolve(self) -> Any:
        """Presolve cannot tell unbounded from infeasible; the simplex method can."""
        _, presolve = self.model.getOptionValue("presolve")
        self._set({"presolve": "off"})
        self.model.run()
        self._set({"presolve": presolve})
        return self.model.getModelStatus()

    def _linear(self, z: Floats, found: Any, done: bool, value: float) -> Solution:
        kind: Status = "optimal" if done else "feasible"
        bound = value if done else -np.inf
        if not self.duals:
            return Solution(kind, z, value, bound)
        prices = _array(found.col_dual)
        start = prices[: self.standard.n_states]
        return Solution(kind, z, value, bound, Duals(-_array(found.row_dual)), start)

    def certified_bound(self, solution: Solution) -> float:
        """A bound that holds whatever the solver's tolerances, from its multipliers."""
        if solution.duals is None or self._late.cuts or self._sent is None:
            return solution.bound
        v = self.lowered.vectors(self._sent)
        low, high = self._sides(v)
        return safe_bound(self._matrix(), v, low, high, solution.duals.rows)

    def conflict(self) -> list[str]:
        """Names of rows and columns that together admit no point; empty if none were found soon."""
        self.model.setOptionValue("iis_strategy", 2)
        self.model.setOptionValue("iis_time_limit", EXPLAIN_S)
        _, iis = self.model.getIis()
        n = self.standard.n_rows
        rows = [self.standard.row_name(i) for i in iis.row_index_ if i < n]
        others = [i for i in iis.row_index_ if i >= n]
        columns = [j for j in iis.col_index_ if j < self.standard.n_columns]
        bounds = [f"bounds of {self.standard.column_name(j)}" for j in columns]
        return rows + ([f"{len(others)} rating or mode rows"] if others else []) + bounds

    def missed(self, rows: Ints, most: int = 12) -> list[str]:
        """Names of those of `rows` that have to be missed for all others to hold, the worst few."""
        penalty = np.full(self._matrix().shape[0], -1.0)
        penalty[rows] = 1.0
        self.model.setOptionValue("time_limit", self.model.getRunTime() + EXPLAIN_S)
        self.model.setOptionValue("mip_rel_gap", 0.5)
        self.model.feasibilityRelaxation(-1.0, -1.0, 1.0, None, None, penalty)
        z = _array(self.model.getSolution().col_value)[: self.standard.n_columns]
        if self._sent is None or len(z) < self.standard.n_columns:
            return []
        off = row_violations(self.standard, z, self._sent)[rows]
        worst = [i for i in np.argsort(-off)[:most] if off[i] > CONFLICT_TOLERANCE]
        return [self.standard.row_name(int(rows[i])) for i in sorted(worst)]


def _differ(new: Floats, old: Floats, *more: Floats) -> NDArray[np.int32]:
    """Where new and old, or another such pair, are not the same."""
    apart = new != old
    if more:
        apart |= more[0] != more[1]
    return np.flatnonzero(apart).astype(np.int32)


def _array(values: list[float]) -> Floats:
    return np.fromiter(values, np.float64, len(values))
