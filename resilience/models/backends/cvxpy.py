"""cvxpy with Clarabel: the second-order cone relaxation and its proven bound."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.models.algebra import Floats, Ints
from resilience.models.backends.base import NOTHING, Duals, Solution, leaf_rows
from resilience.models.certificate import cone_rows, conic_bound
from resilience.models.standard import Standard, Vectors


class Conic:
    """Holds affine rows and discs; cones as u v >= sum(x^2); integers and modes relaxed.

    Fixed columns are substituted, never given as two inequalities, which would leave the interior-
    point method without an interior.

    Args:
        problem: the problem.
        penalty: weight of the problem's penalty (losses) on top of the cost; it closes cones and
            takes no part in the objective, but voids the bound, which is then -inf.
        elastic: lets every equality be missed at this price in $ per unit; for explanations.
    """

    exact = frozenset({"affine", "disc", "largest"})

    def __init__(
        self, problem: Standard, *, penalty: float = 0.0, elastic: float | None = None
    ) -> None:
        self.problem, self.penalty, self.elastic = problem, penalty, elastic
        self._rows = (sp.csr_array((0, problem.n_columns)), np.empty(0))

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers."""
        self.vectors = vectors

    def add_rows(self, g: sp.csr_array, h: Floats) -> None:
        """Adds rows G z <= h."""
        rows, sides = self._rows
        self._rows = sp.vstack([rows, g], format="csr"), np.append(sides, h)

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """See `Backend.add_cuts`; the leaf's future cost must have finite bounds."""
        future = int(self.problem.future[np.searchsorted(self.problem.tree.leaves, node)])
        names = [b.name for _, b in self.problem.forms[0].stage.states]
        states = np.concatenate([self.problem.columns(name)[:, node] for name in names])
        columns, values = leaf_rows(states, future, beta)
        g = sp.lil_array((len(alpha), self.problem.n_columns))
        g[:, columns] = values
        self.add_rows(g.tocsr(), -alpha)

    def solve(self) -> Solution:
        """Solves the relaxation."""
        cp: Any = importlib.import_module("cvxpy")
        v = self.vectors
        cost = v.cost + self.penalty * self.problem.penalty
        free = np.flatnonzero(v.lower < v.upper)
        held = np.where(v.lower < v.upper, 0.0, v.lower)
        x = cp.Variable(len(free))
        constraints, slack = self._constraints(x, free, held)
        objective = cost[free] @ x
        if slack is not None:
            objective = self.elastic * cp.norm1(slack)
        program = cp.Problem(cp.Minimize(objective), constraints)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cvxpy warns of inaccurate solutions; we certify them
            try:
                program.solve(solver=cp.CLARABEL)
            except cp.error.SolverError:
                return NOTHING
        if program.status in ("infeasible", "infeasible_inaccurate"):
            return Solution("infeasible", None, np.inf, np.inf)
        if x.value is None:
            return NOTHING
        z = held.copy()
        z[free] = np.clip(x.value, v.lower[free], v.upper[free])
        self.slack = None if slack is None else np.asarray(slack.value)
        return self._solution(z, constraints, program.status == "optimal")

    def _constraints(self, x: Any, free: Ints, held: Floats) -> tuple[list[Any], Any]:
        cp: Any = importlib.import_module("cvxpy")
        problem, v = self.problem, self.vectors
        a = problem.a.tocsc()
        known = problem.a @ held
        equal = np.flatnonzero(problem.equality)
        below = np.flatnonzero(~problem.equality)
        reduced = a[:, free].tocsr()
        slack = None if self.elastic is None else cp.Variable(len(equal))
        missed = 0 if slack is None else slack
        g, h = self._rows
        found = [
            reduced[equal] @ x + missed == (v.row_upper - known)[equal],
            reduced[below] @ x <= (v.row_upper - known)[below],
            g.tocsc()[:, free] @ x <= h - g @ held,
            x >= v.lower[free],
            x <= v.upper[free],
        ]
        for structure in problem.structures:
            if structure.kind not in ("cone", "disc"):
                continue
            matrices, consts = cone_rows(structure)
            t, *xs = [
                m.tocsc()[:, free] @ x + (m @ held + c)
                for m, c in zip(matrices, consts, strict=True)
            ]
            found.append(cp.SOC(t, cp.vstack(xs), axis=0))
        return found, slack

    def _solution(self, z: Floats, constraints: list[Any], done: bool) -> Solution:
        problem, v = self.problem, self.vectors
        rows = np.zeros(problem.n_rows)
        rows[problem.equality] = constraints[0].dual_value
        rows[~problem.equality] = constraints[1].dual_value
        cones: dict[int, Floats] = {}
        kinds = [k for k, s in enumerate(problem.structures) if s.kind in ("cone", "disc")]
        for k, constraint in zip(kinds, constraints[5:], strict=True):
            t, xs = constraint.dual_value
            cones[k] = np.vstack([np.asarray(t).reshape(1, -1), np.asarray(xs)])
        bound = -np.inf
        if not self.penalty and self.elastic is None and not len(self._rows[1]):
            bound = conic_bound(problem, v, rows, cones)
        value = float(v.cost @ z + v.offset)
        status = "optimal" if done else "feasible"
        return Solution(status, z, value, bound, Duals(rows, cones))  # type: ignore[arg-type]

    def conflict(self, most: int = 12) -> list[str]:
        """Names of the equalities that an elastic solve misses, the worst first."""
        trial = Conic(self.problem, elastic=1.0)
        trial.update(self.vectors)
        if trial.solve().z is None or trial.slack is None:
            return []
        missed = np.abs(trial.slack)
        equal = np.flatnonzero(self.problem.equality)
        worst = np.argsort(-missed)[:most]
        return [self.problem.row_name(equal[i]) for i in worst if missed[i] > 1e-6]
