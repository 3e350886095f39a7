"""CasADi with Ipopt: the AC equations exactly, from a given starting point."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import lsqr

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import (
    INFEASIBLE,
    NOTHING,
    Duals,
    LeafCuts,
    Solution,
    crossed,
    of_solver,
    refuse_unknown,
)
from resilience.models.program.referee import row_violations
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
    UnrolledStructure,
)
from resilience.tolerances import COMPLEMENTARITY_TOLERANCE, CONFLICT_TOLERANCE, NLP_TOLERANCE

WARM_START_OPTIONS = {
    "warm_start_init_point": "yes",
    "mu_init": 1e-9,  # where the SOCP solver stopped; 1e-5 leaves its point, for 200 iterations
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
}
OPEN_ANGLES_PUSH = 1e-3, 1e-2
"""In place of the above where angles are open at the start, so that it is no solution yet; tried
until one of them ends at an optimum."""
SOLVED = "Solve_Succeeded"


class NLP:
    """Holds affine rows, discs and cones exactly; integers and modes relaxed; no bound.

    Rows and structures in which nothing can move (a line that is out) are checked and left out:
    they would be constraints without variables.

    Args:
        standard: the program.
        time_limit: seconds per solve, building included.
        penalty: see `Conic`.
        tolerance: by how much a row may be missed.
    """

    exact: frozenset[type[Structure]] = frozenset({Disc, Cone, Angle, Largest})
    relaxed: frozenset[type[Structure]] = frozenset({Split, Adjacent})
    integers = False
    plugin = "ipopt"

    def __init__(
        self,
        standard: Standard,
        *,
        time_limit: float = np.inf,
        penalty: float = 0.0,
        tolerance: float = NLP_TOLERANCE,
    ) -> None:
        self.standard, self.time_limit, self.penalty = standard, time_limit, penalty
        self.tolerance = tolerance
        refuse_unknown(standard, "a nonlinear program", self.exact | self.relaxed)
        self.start: Floats | None = None
        self._cuts = LeafCuts(standard)
        self._cut_rows: list[tuple[Ints, Floats, Floats]] = []

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers."""
        self.vectors = vectors

    def start_from(self, z: Floats) -> None:
        """The next solve begins at z (columns,)."""
        self.start = z

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """See `Backend.add_cuts`."""
        columns, values = self._cuts.add(node, alpha, beta)
        self._cut_rows.append((columns, values, -np.asarray(alpha)))

    @of_solver("Ipopt")
    def solve(self) -> Solution:
        """Solves to a local optimum; 'none' where Ipopt found no feasible point."""
        import casadi as ca

        began = time.perf_counter()
        v, standard = self._cuts.with_futures_open(self.vectors), self.standard
        live = v.lower < v.upper
        point = np.where(live, 0.0, v.lower)
        if crossed(v) or _broken(standard, v, point, live):
            return INFEASIBLE
        free = np.flatnonzero(live)
        x, now = ca.SX.sym("x", len(free)), ca.SX.sym("now", standard.n_states)
        z = ca.SX(point)
        z[: standard.n_states] = now
        z[free.tolist()] = x
        rows, low, high = self._constraints(ca, z, v, point, live)
        cost = ca.dot(ca.DM(v.cost + self.penalty * standard.penalty), z)
        nlp = {"x": x, "p": now, "f": cost, "g": ca.vertcat(*rows)}
        middle = np.clip(0.0, v.lower, v.upper)
        if self.start is not None:
            middle = np.clip(with_angles(standard, self.start, free), v.lower, v.upper)
        numbers = {
            "x0": middle[free],
            "p": point[: standard.n_states],
            "lbx": v.lower[free],
            "ubx": v.upper[free],
            "lbg": np.concatenate(low),
            "ubg": np.concatenate(high),
        }
        seconds = self.time_limit - (time.perf_counter() - began)
        answer = self._answer(ca, nlp, numbers, free, seconds)
        if answer is None:
            return NOTHING
        point[free] = np.clip(np.asarray(answer["x"]).ravel(), v.lower[free], v.upper[free])
        price = -np.asarray(answer["lam_p"]).ravel()
        value = float(v.cost @ point + v.offset)
        duals = self._duals(np.asarray(answer["lam_g"]).ravel(), live)
        return Solution("optimal", point, value, -np.inf, duals, price)

    def _duals(self, multipliers: Floats, live: Bools) -> Duals:
        """Multipliers of the program's rows, of those first that have something to move."""
        moving = np.flatnonzero(_moving(self.standard.a, live))
        rows = np.zeros(self.standard.n_rows)
        rows[moving] = multipliers[: len(moving)]
        return Duals(rows)

    def _answer(
        self, ca: Any, nlp: Any, numbers: dict[str, Floats], free: Ints, seconds: float
    ) -> Any:
        """What Ipopt finds in that time; None where that is no feasible point."""
        accepted, until = None, time.perf_counter() + seconds
        is_open = self.start is not None and bool(self.standard.structures_of(Angle))
        for push in OPEN_ANGLES_PUSH if is_open else (None,):
            seconds = until - time.perf_counter()
            if seconds <= 0.0:
                break
            solver = ca.nlpsol("polish", self.plugin, nlp, self._options(free, seconds, push))
            answer, stats = solver(**numbers), solver.stats()
            if stats["success"] and (accepted is None or answer["f"] < accepted["f"]):
                accepted = answer
            if stats["return_status"] == SOLVED:
                break
        return accepted

    def _options(self, free: Ints, seconds: float, push: float | None) -> dict[str, Any]:
        settings: dict[str, Any] = {
            "print_level": 0,
            "sb": "yes",
            "tol": NLP_TOLERANCE,
            "constr_viol_tol": self.tolerance,
            "compl_inf_tol": COMPLEMENTARITY_TOLERANCE,
            "bound_relax_factor": 0.0,
            "max_iter": 500,
        }
        if np.isfinite(seconds):
            settings["max_wall_time"] = seconds
        if self.start is not None:
            settings |= WARM_START_OPTIONS
        if push is not None:
            settings |= {"mu_init": push, "bound_push": push, "bound_frac": push}
            settings["mu_strategy"] = "adaptive"  # a quarter of the iterations, on 33 buses
        return {"ipopt": settings, "print_time": False, "verbose_init": False}

    def _constraints(
        self, ca: Any, z: Any, v: Vectors, point: Floats, live: Bools
    ) -> tuple[list[Any], list[Floats], list[Floats]]:
        standard = self.standard
        moving = np.flatnonzero(_moving(standard.a, live))
        rows = [_times(ca, standard.a[moving], z)]
        low, high = [v.row_lower[moving]], [v.row_upper[moving]]
        for columns, values, rhs in self._cut_rows:
            rows.append(ca.mtimes(ca.DM(values), z[columns.tolist()]))
            low.append(np.full(len(rhs), -np.inf))
            high.append(rhs)
        for unrolled in _nonlinear(standard):
            alive = unrolled.elements(np.flatnonzero(_alive(unrolled, point, live)))
            args = [_times(ca, m, z) + c for m, c in zip(alive.matrices, alive.consts, strict=True)]
            for row, lower, upper in _STATEMENTS[type(unrolled.structure)](ca, args, alive.limits):
                rows.append(row)
                low.append(np.broadcast_to(lower, len(alive.consts[0])))
                high.append(np.broadcast_to(upper, len(alive.consts[0])))
        return rows, low, high


def _moving(matrix: Any, live: Bools) -> Bools:
    """(rows,) whether a row of the matrix has a column that can move."""
    return np.abs(matrix) @ live.astype(float) > 0.0


Statement = tuple[Any, float, float | Floats]
"""An expression, and what it lies between."""


def _cone(ca: Any, args: Sequence[Any], limits: Sequence[Floats]) -> list[Statement]:
    u, v, *xs = args
    return [(u * v - sum(x**2 for x in xs), 0.0, 0.0)]


def _disc(ca: Any, args: Sequence[Any], limits: Sequence[Floats]) -> list[Statement]:
    radius = np.where(limits[0] > 0.0, limits[0], 1.0)  # Ipopt's tolerance is absolute
    return [(sum((x / radius) ** 2 for x in args), -np.inf, (limits[0] / radius) ** 2)]


def _angle(ca: Any, args: Sequence[Any], limits: Sequence[Floats]) -> list[Statement]:
    theta, re, im, *_ = args
    across, along = im * ca.cos(theta) - re * ca.sin(theta), re * ca.cos(theta) + im * ca.sin(theta)
    return [(across, 0.0, 0.0), (along, 0.0, np.inf), (theta, -0.5 * np.pi, 0.5 * np.pi)]


_STATEMENTS: dict[type[Structure], Callable[..., list[Statement]]] = {
    Cone: _cone,
    Disc: _disc,
    Angle: _angle,
}


def _nonlinear(standard: Standard) -> list[UnrolledStructure[Any]]:
    """Everything that is stated to Ipopt beside rows."""
    kinds: tuple[type[Structure], ...] = (SecondOrder, Angle)
    return [u for kind in kinds for u in standard.structures_of(kind).values()]


def with_angles(standard: Standard, z: Floats, free: Ints) -> Floats:
    """The same point, the columns of which angles alone are made as near to them as can be.

    The sum of squares of what they lack is least; a start of zeros would turn the conic point away
    from its flows.
    """
    angles = list(standard.structures_of(Angle).values())
    if not angles:
        return z
    matrix = sp.vstack([u.matrices[0] for u in angles], format="csc")
    columns = free[np.diff(matrix.indptr)[free] > 0]
    z = z.copy()
    z[columns] = 0.0
    values = [u.values(z) for u in angles]
    lacks = np.concatenate([np.arctan2(im, np.maximum(re, 0.0)) - t for t, re, im, *_ in values])
    z[columns] = lsqr(matrix[:, columns], lacks, atol=1e-12, btol=1e-12)[0]
    return z


def _alive(unrolled: UnrolledStructure[Structure], point: Floats, live: Bools) -> Bools:
    """(elements,) whether something moves that the structure says anything about."""
    moving = [_moving(m, live) for m in unrolled.matrices]
    return unrolled.structure.bound_arguments(moving, unrolled.values(point))


def _broken(standard: Standard, v: Vectors, point: Floats, live: Bools) -> bool:
    """Whether what is fixed breaks a row or a structure all by itself."""
    violations = [row_violations(standard, point, v)[~_moving(standard.a, live)]]
    for unrolled in _nonlinear(standard):
        violations.append(unrolled.violation(point)[~_alive(unrolled, point, live)])
    return bool(np.concatenate(violations).max(initial=0.0) > CONFLICT_TOLERANCE)


def _times(ca: Any, matrix: Any, z: Any) -> Any:
    m = matrix.tocsc()
    pattern = ca.Sparsity(*m.shape, m.indptr.tolist(), m.indices.tolist())
    return ca.mtimes(ca.DM(pattern, m.data), z)
