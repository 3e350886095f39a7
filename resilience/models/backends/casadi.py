"""CasADi with Ipopt: the AC equations exactly, from a given starting point."""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.models.algebra import Floats, Ints
from resilience.models.backends.base import NOTHING, Solution, leaf_rows
from resilience.models.standard import Standard, Unrolled, Vectors

TOLERANCE = 1e-8
WARM = {
    "warm_start_init_point": "yes",
    "mu_init": 1e-5,
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
}


class NLP:
    """Holds affine rows, discs and cones exactly; integers and modes relaxed; no bound.

    Elements of cones whose columns are all fixed (a line that is out) are left out: they would be
    rows without variables.

    Args:
        problem: the problem.
        time_limit: seconds per solve.
        penalty: see `Conic`.
    """

    exact = frozenset({"affine", "disc", "cone", "largest"})

    def __init__(
        self, problem: Standard, *, time_limit: float = np.inf, penalty: float = 0.0
    ) -> None:
        self.problem, self.time_limit, self.penalty = problem, time_limit, penalty
        self.start: Floats | None = None
        self._cuts: list[tuple[Ints, Floats, Floats]] = []

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers."""
        self.vectors = vectors

    def start_from(self, z: Floats) -> None:
        """The next solve begins at z (columns,)."""
        self.start = z

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """See `Backend.add_cuts`."""
        future = int(self.problem.future[np.searchsorted(self.problem.tree.leaves, node)])
        names = [b.name for _, b in self.problem.forms[0].stage.states]
        states = np.concatenate([self.problem.columns(name)[:, node] for name in names])
        columns, values = leaf_rows(states, future, beta)
        self._cuts.append((columns, values, -alpha))

    def solve(self) -> Solution:
        """Solves to a local optimum; 'none' where Ipopt found no feasible point."""
        import casadi as ca

        v, problem = self.vectors, self.problem
        free = np.flatnonzero(v.lower < v.upper)
        x = ca.SX.sym("x", len(free))
        z = ca.SX(np.where(v.lower < v.upper, 0.0, v.lower))
        z[free.tolist()] = x
        rows, low, high = self._rows(ca, z, free)
        cost = v.cost + self.penalty * problem.penalty
        nlp = {"x": x, "f": ca.dot(ca.DM(cost), z), "g": ca.vertcat(*rows)}
        solver = ca.nlpsol("polish", "ipopt", nlp, self._options())
        middle = np.clip(0.0, v.lower, v.upper) if self.start is None else self.start
        answer = solver(
            x0=middle[free],
            lbx=v.lower[free],
            ubx=v.upper[free],
            lbg=np.concatenate(low),
            ubg=np.concatenate(high),
        )
        if not solver.stats()["success"]:
            return NOTHING
        point = np.where(v.lower < v.upper, 0.0, v.lower)
        point[free] = np.clip(np.asarray(answer["x"]).ravel(), v.lower[free], v.upper[free])
        return Solution("optimal", point, float(v.cost @ point + v.offset), -np.inf)

    def _options(self) -> dict[str, Any]:
        settings: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "tol": TOLERANCE,
            "constr_viol_tol": TOLERANCE,
            "bound_relax_factor": 0.0,
            "max_iter": 500,
        }
        if np.isfinite(self.time_limit):
            settings["max_wall_time"] = max(self.time_limit, 1.0)
        if self.start is not None:
            settings |= WARM
        return {"ipopt": settings, "print_time": False, "verbose_init": False}

    def _rows(self, ca: Any, z: Any, free: Ints) -> tuple[list[Any], list[Floats], list[Floats]]:
        problem, v = self.problem, self.vectors
        live = np.zeros(problem.n_columns, bool)
        live[free] = True
        keep = np.flatnonzero(np.abs(problem.a) @ live.astype(float) > 0)
        rows = [_times(ca, problem.a[keep], z)]
        low, high = [v.row_lower[keep]], [v.row_upper[keep]]
        for columns, values, rhs in self._cuts:
            rows.append(ca.mtimes(ca.DM(values), z[columns.tolist()]))
            low.append(np.full(len(rhs), -np.inf))
            high.append(rhs)
        for structure in problem.structures:
            if structure.kind not in ("cone", "disc"):
                continue
            at = _touching(structure, live)
            args = [
                _times(ca, m[at], z) + c[at]
                for m, c in zip(structure.matrices, structure.consts, strict=True)
            ]
            if structure.kind == "cone":
                rows.append(args[0] * args[1] - sum(x**2 for x in args[2:]))
                low.append(np.zeros(len(at)))
                high.append(np.zeros(len(at)))
            else:
                rows.append(sum(x**2 for x in args))
                low.append(np.full(len(at), -np.inf))
                high.append(structure.limits[0][at] ** 2)
        return rows, low, high


def _touching(structure: Unrolled, live: Any) -> Ints:
    """Elements of which more than the v of a cone can still move."""
    args = structure.matrices[:1] + structure.matrices[2:]
    args = args if structure.kind == "cone" else structure.matrices
    moving = sum(np.abs(m) @ live.astype(float) for m in args)
    return np.flatnonzero(moving > 0)


def _times(ca: Any, matrix: Any, z: Any) -> Any:
    m = matrix.tocsc()
    pattern = ca.Sparsity(*m.shape, m.indptr.tolist(), m.indices.tolist())
    return ca.mtimes(ca.DM(pattern, m.data), z)
