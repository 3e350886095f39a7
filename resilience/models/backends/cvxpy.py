"""cvxpy with Clarabel: the second-order cone relaxation and its proven bound."""

from __future__ import annotations

import importlib
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import (
    INFEASIBLE,
    NOTHING,
    Duals,
    LeafCuts,
    Solution,
    Status,
    crossed,
    of_solver,
    refuse_unknown,
)
from resilience.models.program.dual_bound import cone_share, safe_bound
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import (
    Adjacent,
    Angle,
    Cone,
    Disc,
    Largest,
    SecondOrder,
    Split,
    Structure,
)
from resilience.tolerances import CONFLICT_TOLERANCE

MAX_LISTED = 12  # rows that `conflict` names
# A tenth of Clarabel's own or less: an island is alive from a thousandth of its storage on, so that
# 1e-9 MWh may let it serve 1e-6 MWh, and a point open by 1e-8 costs visibly less than any can.
TOLERANCES = {"tol_feas": 1e-10, "tol_gap_rel": 1e-9, "tol_gap_abs": 1e-9}
WITHOUT_POINT = {
    "infeasible": INFEASIBLE,
    "infeasible_inaccurate": replace(INFEASIBLE, bound=-np.inf),  # believed, not proven
}


class Conic:
    """Holds affine rows and discs; cones as u v >= sum(x^2); integers and modes relaxed.

    Fixed columns are substituted, never given as two inequalities, which would leave the interior-
    point method without an interior.

    Args:
        standard: the program.
        time_limit: seconds per solve, building included; what is found by then may be a bound only.
        penalty: weight of the program's penalty (losses) on top of the cost; it closes cones and
            takes no part in the objective, but voids the bound, which is then -inf.
        elastic: lets every row be missed at this price in $ per unit; for explanations.
        discs: for the index of each structure of discs, the elements (n,) that are held, the others
            being relaxed; all of them if omitted.
    """

    exact: frozenset[type[Structure]] = frozenset({Disc, Largest})
    relaxed: frozenset[type[Structure]] = frozenset({Cone, Angle, Split, Adjacent})
    integers = False

    def __init__(
        self,
        standard: Standard,
        *,
        time_limit: float = np.inf,
        penalty: float = 0.0,
        elastic: float | None = None,
        discs: Mapping[int, Bools] | None = None,
    ) -> None:
        self.standard, self.time_limit = standard, time_limit
        self.penalty, self.elastic = penalty, elastic
        refuse_unknown(standard, "the conic relaxation", self.exact | self.relaxed)
        self._second_order = {
            k: (unrolled, elements)
            for k, unrolled in standard.structures_of(SecondOrder).items()
            if len(elements := _chosen(unrolled.n, discs, k))
        }
        self._cuts = LeafCuts(standard)
        self._rows = sp.csr_array((0, standard.n_columns)), np.empty(0)

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers."""
        self.vectors = vectors

    def add_rows(self, g: sp.csr_array, h: Floats) -> None:
        """Adds rows G z <= h."""
        rows, sides = self._rows
        self._rows = sp.vstack([rows, g], format="csr"), np.append(sides, h)

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """See `Backend.add_cuts`."""
        columns, values = self._cuts.add(node, alpha, beta)
        g = sp.lil_array((len(values), self.standard.n_columns))
        g[:, columns] = values
        self.add_rows(g.tocsr(), -np.asarray(alpha))

    def _with_added_rows(self) -> tuple[sp.csr_array, Vectors]:
        """Matrix and vectors with the added rows behind the program's own."""
        (g, h), v = self._rows, self._cuts.with_futures_open(self.vectors)
        low = np.append(v.row_lower, np.full(len(h), -np.inf))
        vectors = replace(v, row_lower=low, row_upper=np.append(v.row_upper, h))
        return sp.vstack([self.standard.a, g], format="csr"), vectors

    @of_solver("Clarabel")
    def solve(self) -> Solution:
        """Solves the relaxation."""
        cp: Any = importlib.import_module("cvxpy")
        began = time.perf_counter()
        a, v = self._with_added_rows()
        if crossed(v):
            return INFEASIBLE
        free = np.flatnonzero(v.lower < v.upper)
        fixed = np.where(v.lower < v.upper, 0.0, v.lower)
        x = cp.Variable(len(free))
        constraints, slack = self._constraints(x, free, fixed)
        objective = (v.cost + self.penalty * self.standard.penalty)[free] @ x
        if slack is not None:
            objective = self.elastic * cp.norm1(slack)
        program = cp.Problem(cp.Minimize(objective), constraints)
        answered = self._run(program, time.perf_counter() - began)
        if program.status in WITHOUT_POINT:
            return WITHOUT_POINT[program.status]
        if not answered or x.value is None:
            return NOTHING
        if program.status == "user_limit":
            return self._stopped(a, v, constraints)
        z = fixed.copy()
        z[free] = np.clip(x.value, v.lower[free], v.upper[free])
        self.slack = None if slack is None else np.asarray(slack.value)
        return self._solution(a, v, z, constraints, program.status == "optimal")

    def _run(self, program: Any, spent_s: float) -> bool:
        """Compiles and solves in the time that is left; False where there is no answer."""
        cp: Any = importlib.import_module("cvxpy")
        began, limit = time.perf_counter() - spent_s, {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cvxpy warns of inaccurate solutions; we certify them
            if np.isfinite(self.time_limit):
                program.get_problem_data(cp.CLARABEL)  # kept by the problem
                seconds = self.time_limit - (time.perf_counter() - began)
                if seconds <= 0.0:
                    return False
                limit["time_limit"] = seconds
            try:
                program.solve(solver=cp.CLARABEL, **TOLERANCES, **limit)
            except cp.error.SolverError:
                return False
        return True

    def _constraints(self, x: Any, free: Ints, fixed: Floats) -> tuple[list[Any], Any]:
        """Equations, inequalities, bounds and cones of the free columns; what rows may miss.

        Args:
            x: variable of the free columns.
            free: which columns these are.
            fixed: (columns,) values of the others, zeros for these.
        """
        cp: Any = importlib.import_module("cvxpy")
        a, v = self._with_added_rows()
        sides = v.row_upper - a @ fixed
        slack = None if self.elastic is None else cp.Variable(len(sides))
        equal = np.isfinite(v.row_lower)
        rows = np.flatnonzero(equal), np.flatnonzero(~equal)
        reduced = a.tocsc()[:, free].tocsr()
        equations, inequalities = (
            reduced[chosen] @ x + (0 if slack is None else slack[chosen]) for chosen in rows
        )
        constraints = [
            equations == sides[rows[0]],
            inequalities <= sides[rows[1]],
            x >= v.lower[free],
            x <= v.upper[free],
        ]
        for unrolled, elements in self._second_order.values():
            chosen = unrolled if len(elements) == unrolled.n else unrolled.elements(elements)
            matrices, consts = chosen.structure.second_order(chosen)
            t, *xs = [
                m.tocsc()[:, free] @ x + (m @ fixed + c)
                for m, c in zip(matrices, consts, strict=True)
            ]
            constraints.append(cp.SOC(t, cp.vstack(xs), axis=0))
        return constraints, slack

    def _solution(
        self, a: sp.csr_array, v: Vectors, z: Floats, constraints: list[Any], done: bool
    ) -> Solution:
        duals = self._duals(v, constraints)
        value = float(v.cost @ z + v.offset)
        status: Status = "optimal" if done else "feasible"
        if self.penalty or self.elastic is not None:
            return Solution(status, z, value, -np.inf, duals)
        slope, offset = cone_share(self.standard, duals.cones)
        bound = safe_bound(a, v, duals.rows, slope, offset)
        state_price = (v.cost + a.T @ duals.rows - slope)[: self.standard.n_states]
        return Solution(status, z, value, bound, duals, state_price)

    def _stopped(self, a: sp.csr_array, v: Vectors, constraints: list[Any]) -> Solution:
        """What a solve was worth that its limit ended: no point holds yet, but a bound does."""
        if self.penalty or self.elastic is not None:
            return NOTHING
        duals = self._duals(v, constraints)
        slope, offset = cone_share(self.standard, duals.cones)
        return replace(NOTHING, bound=safe_bound(a, v, duals.rows, slope, offset))

    def _duals(self, v: Vectors, constraints: list[Any]) -> Duals:
        equal = np.isfinite(v.row_lower)
        rows = np.zeros(len(equal))
        rows[equal], rows[~equal] = (c.dual_value for c in constraints[:2])
        cones: dict[int, Floats] = {}
        chosen = self._second_order.items()
        for (k, (unrolled, elements)), constraint in zip(chosen, constraints[4:], strict=True):
            t, xs = constraint.dual_value
            multipliers = np.vstack([np.asarray(t).reshape(1, -1), np.asarray(xs)])
            cones[k] = np.zeros((len(multipliers), unrolled.n))
            cones[k][:, elements] = multipliers
        return Duals(rows, cones)

    def conflict(self) -> list[str]:
        """Names of the rows that an elastic solve misses, the worst first.

        Where bounds contradict each other by themselves, those are named.
        """
        if crossed(self.vectors):
            room = self.vectors.upper - self.vectors.lower
            tightest = np.argsort(room)[:MAX_LISTED]
            return [
                f"bounds of {self.standard.column_name(int(j))}" for j in tightest if room[j] < 0
            ]
        trial = Conic(self.standard, time_limit=self.time_limit, elastic=1.0)
        trial.update(self.vectors)
        if trial.solve().z is None or trial.slack is None:
            return []
        missed = np.abs(trial.slack)
        worst_rows = np.argsort(-missed)[:MAX_LISTED]
        return [
            self.standard.row_name(int(i)) for i in worst_rows if missed[i] > CONFLICT_TOLERANCE
        ]


def _chosen(n: int, discs: Mapping[int, Bools] | None, k: int) -> Ints:
    """Which of the n elements of structure k are held."""
    return np.arange(n) if discs is None or k not in discs else np.flatnonzero(discs[k])
