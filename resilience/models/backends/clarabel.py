"""Clarabel without a modelling layer: a cone program in arrays, its bounds changed again and again.

For searches that solve hundreds of small relaxations. What is fixed is substituted, with the rows
and cones that say nothing else, so that the interior-point method keeps an interior.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import failures_of
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Vectors
from resilience.tolerances import CONFLICT_TOLERANCE

NOT_SOLVED = ("PrimalInfeasible", "DualInfeasible", "AlmostPrimalInfeasible")


@dataclass(frozen=True)
class SecondOrderRows:
    """Elements |(x1, x2, ...)| <= t, with t, x1, x2, ... affine.

    Attributes:
        matrices: of t, x1, x2, ..., (n, columns) each.
        consts: likewise, (n,) each.
    """

    matrices: Sequence[sp.csr_array]
    consts: Sequence[Floats]


@dataclass(frozen=True)
class ConePoint:
    """What one solve gave.

    Attributes:
        z: (columns,) a point of the relaxation to the solver's tolerance; None without one.
        bound: proven, whatever the tolerances; inf where there is no point at all.
    """

    z: Floats | None
    bound: float


@dataclass(frozen=True)
class ConeProgram:
    """min cost @ z, rows between sides, second-order rows; the box comes with each solve.

    Attributes:
        a: (rows, columns).
        numbers: cost, sides, and the widest box.
        cones: the second-order rows.
        boxed: (columns,) whose bounds the solver has to be told; rows imply those of the others.
    """

    a: sp.csr_array
    numbers: Vectors
    cones: tuple[SecondOrderRows, ...]
    boxed: Bools

    @failures_of("Clarabel")
    def solve(self, lower: Floats, upper: Floats, seconds: float) -> ConePoint:
        """The relaxation within a box, (columns,) each; infeasible is a bound of inf."""
        clarabel: Any = importlib.import_module("clarabel")
        v, free = self.numbers, np.flatnonzero(lower < upper)
        settled = np.where(lower < upper, 0.0, lower)
        a = self.a.tocsc()[:, free].tocsr()
        offset = self.a @ settled
        says = np.diff(a.indptr) > 0
        low, high = v.row_lower - offset, v.row_upper - offset
        if (np.maximum(low, -high)[~says] > CONFLICT_TOLERANCE).any():
            return ConePoint(None, np.inf)
        equal = says & (v.row_lower == v.row_upper)
        above, below = (says & ~equal & np.isfinite(side) for side in (v.row_upper, v.row_lower))
        boxed = self.boxed[free]
        eye = sp.eye_array(len(free), format="csr")[boxed]
        blocks = [a[equal], a[above], -a[below], eye, -eye]
        sides = [high[equal], high[above], -low[below], upper[free][boxed], -lower[free][boxed]]
        n_equal, n_rows = int(equal.sum()), sum(map(len, sides))
        cones, sizes = self._cones(free, settled)
        blocks += [block for block, _ in cones]
        sides += [side for _, side in cones]
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        settings.time_limit = max(seconds, 1e-3)
        solver = clarabel.DefaultSolver(
            sp.csc_array((len(free), len(free))),
            v.cost[free],
            sp.vstack(blocks, format="csc"),
            np.concatenate(sides),
            [
                clarabel.ZeroConeT(n_equal),
                clarabel.NonnegativeConeT(n_rows - n_equal),
                *[clarabel.SecondOrderConeT(size) for size, n in sizes for _ in range(n)],
            ],
            settings,
        )
        answer = solver.solve()
        if str(answer.status) in NOT_SOLVED:
            return ConePoint(None, np.inf if str(answer.status) == NOT_SOLVED[0] else -np.inf)
        duals = np.asarray(answer.z)
        kinds = np.flatnonzero(equal), np.flatnonzero(above), np.flatnonzero(below)
        bound = self._bound(lower, upper, duals, kinds, n_rows)
        z = settled.copy()
        z[free] = np.clip(np.asarray(answer.x), lower[free], upper[free])
        return ConePoint(z if np.isfinite(z).all() else None, bound)

    def _moving(self, cone: SecondOrderRows, lower: Floats, upper: Floats) -> Ints:
        """Elements in which a column can move."""
        moves = (lower < upper).astype(float)
        return np.flatnonzero(sum(abs(m) @ moves for m in cone.matrices) > 0.0)

    def _cones(
        self, free: Ints, settled: Floats
    ) -> tuple[list[tuple[sp.csr_array, Floats]], list[tuple[int, int]]]:
        """Blocks and sides, element after element, and (size, number) of each group."""
        blocks, sizes = [], []
        is_free = np.zeros(len(settled))
        is_free[free] = 1.0
        for cone in self.cones:
            rows, size = self._moving(cone, np.zeros(len(settled)), is_free), len(cone.matrices)
            if not len(rows):
                continue
            parts = [m[rows].tocsc()[:, free] for m in cone.matrices]
            sides = [
                m[rows] @ settled + c[rows] for m, c in zip(cone.matrices, cone.consts, strict=True)
            ]
            order = np.arange(size * len(rows)).reshape(size, len(rows)).T.ravel()
            stacked = sp.vstack(parts, format="csr")[order]
            blocks.append((-stacked, np.concatenate(sides)[order]))
            sizes.append((size, len(rows)))
        return blocks, sizes

    def _bound(
        self,
        lower: Floats,
        upper: Floats,
        duals: Floats,
        kinds: tuple[Ints, Ints, Ints],
        n_rows: int,
    ) -> float:
        """The Lagrangian over the box, for multipliers moved into their cones."""
        if not np.isfinite(duals).all():
            return -np.inf
        rows, first = np.zeros(self.a.shape[0]), 0
        for chosen, sign in zip(kinds, (1.0, 1.0, -1.0), strict=True):
            rows[chosen] += sign * duals[first : first + len(chosen)]
            first += len(chosen)
        slope, offset, first = np.zeros(self.a.shape[1]), 0.0, n_rows
        for cone in self.cones:
            chosen, size = self._moving(cone, lower, upper), len(cone.matrices)
            moved = duals[first : first + size * len(chosen)].reshape(len(chosen), size).T.copy()
            first += moved.size
            moved[0] = np.maximum(moved[0], np.linalg.norm(moved[1:], axis=0))
            for m, c, y in zip(cone.matrices, cone.consts, moved, strict=True):
                slope += m[chosen].T @ y
                offset += float(c[chosen] @ y)
        v = self.numbers
        box = Vectors(v.cost, v.offset, lower, upper, v.row_lower, v.row_upper)
        return safe_bound(self.a, box, rows, slope, offset)
