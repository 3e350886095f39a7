"""Clarabel without a modelling layer: a cone program in arrays, its bounds changed again and again.

What is fixed is substituted, with the rows and cones that say nothing else, so that the
interior-point method keeps an interior.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import failures_of
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Vectors
from resilience.tolerances import CONFLICT_TOLERANCE, RELAXATION_TOLERANCE

INFEASIBLE_STATUS = "PrimalInfeasible"
NOT_SOLVED = (INFEASIBLE_STATUS, "DualInfeasible", "AlmostPrimalInfeasible")
LEAST_SHARE = 0.5
"""Of a multiplier, to which it is made smaller at most, see `SecondOrderRows.turned`."""
BROKEN = (INFEASIBLE_STATUS, None, np.inf)


@dataclass(frozen=True)
class SecondOrderRows:
    """Elements |(x1, x2, ...)| <= t, with t, x1, x2, ... affine.

    Attributes:
        matrices: of t, x1, x2, ..., (n, columns) each.
        consts: likewise, (n,) each.
    """

    matrices: Sequence[sp.csr_array]
    consts: Sequence[Floats]

    def moving(self, free: Bools) -> Bools:
        """(n,) elements in which a column that is free, (columns,), stands."""
        moves = free.astype(float)
        count: Floats = sum(abs(m) @ moves for m in self.matrices)
        return np.asarray(count > 0.0)

    def turned(self, y: Floats, reduced: Floats) -> Floats:
        """Multipliers (k + 1, n) that make negative costs of t + x_k less, at the price of t - x_k.

        With u = t + x_k and v = t - x_k an element says that u v is at least the sum of the other
        squares, and of multipliers the same: alpha = y_t + y_k of u is made less by what the cost
        of its column lacks, and beta = y_t - y_k of v larger in proportion. A solver that leaves
        1e-8 $ on a current which no bound holds within 1e4 has a bound that is off by 1e-4 $
        otherwise; of v, a voltage, the bounds are near.

        Args:
            y: multipliers within their cones.
            reduced: (columns,) cost of every column, multipliers of rows and cones included.
        """
        alpha, beta = y[0] + y[-1], y[0] - y[-1]
        rows, columns, weights = self._columns_of_u()
        lacks = np.zeros(len(alpha))
        lacks[rows] = reduced[columns] / weights
        smaller = np.maximum(alpha + lacks, LEAST_SHARE * alpha)
        lacking = (lacks < 0.0) & (smaller > 0.0)
        others = (y[1:-1] ** 2).sum(axis=0)
        alpha = np.where(lacking, smaller, alpha)
        beta = np.where(lacking, others / np.where(lacking, smaller, 1.0), beta)
        return _in_cone(np.stack([0.5 * (alpha + beta), *y[1:-1], 0.5 * (alpha - beta)]))

    def _columns_of_u(self) -> tuple[Ints, Ints, Floats]:
        """Elements in which t + x_k has one column, that column, and its weight in t and in x_k.

        Those with that column in t - x_k, too, are left out, as those of a disc.
        """
        u, v = (sp.csr_array(self.matrices[0] + sign * self.matrices[-1]) for sign in (1.0, -1.0))
        u.eliminate_zeros()
        in_both = abs(u.multiply(v)).sum(axis=1) > 0.0
        rows = np.flatnonzero((np.diff(u.indptr) == 1) & ~np.asarray(in_both).ravel())
        return rows, u.indices[u.indptr[rows]], 0.5 * u.data[u.indptr[rows]]

    def short(self, z: Floats) -> Floats:
        """(n,) by how much t is less than |(x1, x2, ...)| at z, negative where it is more."""
        t, *xs = [m @ z + c for m, c in zip(self.matrices, self.consts, strict=True)]
        return np.asarray(np.sqrt(sum(x**2 for x in xs)) - t)


@dataclass(frozen=True)
class Multipliers:
    """What the rows and cones of a program are worth, moved into their cones.

    Attributes:
        rows: (rows,), of either sign where a row is an equation.
        cones: per second-order rows (k + 1, n), zero where nothing moves.
        slope: (columns,) share of the cones in the Lagrangian.
    """

    rows: Floats
    cones: list[Floats]
    slope: Floats


@dataclass(frozen=True)
class ConePoint:
    """What one solve gave.

    Attributes:
        status: Clarabel's word for it.
        z: (columns,) a point of the relaxation to the solver's tolerance; None without one.
        bound: proven, whatever the tolerances; inf where there is no point at all.
        multipliers: of rows and cones; None without any.
        beyond: (columns,) where z had to be put back to a bound that the solver was not told; None
            without a point.
    """

    status: str
    z: Floats | None
    bound: float
    multipliers: Multipliers | None = None
    beyond: Bools | None = None


@dataclass(frozen=True)
class _Split:
    """Which rows are told to Clarabel, and as what.

    Attributes:
        kinds: rows that are equations, those with an upper side, those with a lower side.
        n_linear: rows and bounds before the cones.
        moving: per second-order rows, the elements in which something moves.
    """

    kinds: tuple[Ints, Ints, Ints]
    n_linear: int
    moving: list[Ints]


@dataclass(frozen=True)
class ConeProgram:
    """min cost @ z, rows between sides, second-order rows; the box comes with each solve.

    Attributes:
        a: (rows, columns).
        numbers: cost, sides, and the widest box.
        cones: the second-order rows.
        boxed: (columns,) whose bounds the solver has to be told; rows imply those of the others, or
            no point comes near them.
        settings: of Clarabel, by name, where they are not its own.
    """

    a: sp.csr_array
    numbers: Vectors
    cones: tuple[SecondOrderRows, ...]
    boxed: Bools
    settings: Mapping[str, float] = field(default_factory=dict)

    @failures_of("Clarabel")
    def solve(self, lower: Floats, upper: Floats, seconds: float) -> ConePoint:
        """The relaxation within a box, (columns,) each; infeasible is a bound of inf.

        The seconds count from the call on, whatever it takes to state the program.
        """
        clarabel: Any = importlib.import_module("clarabel")
        until_s = time.perf_counter() + seconds
        is_free = lower < upper
        free, settled = np.flatnonzero(is_free), np.where(is_free, 0.0, lower)
        a = self.a.tocsc()[:, free].tocsr()
        says, offset = np.diff(a.indptr) > 0, self.a @ settled
        low, high = self.numbers.row_lower - offset, self.numbers.row_upper - offset
        moves = [cone.moving(is_free) for cone in self.cones]
        if (np.maximum(low, -high)[~says] > CONFLICT_TOLERANCE).any() or any(
            (cone.short(settled)[~moving] > CONFLICT_TOLERANCE).any()
            for cone, moving in zip(self.cones, moves, strict=True)
        ):
            return ConePoint(*BROKEN)
        equal = says & (low == high)
        above, below = (says & ~equal & np.isfinite(side) for side in (high, low))
        eye = sp.eye_array(len(free), format="csr")
        ceil, floor = (self.boxed[free] & np.isfinite(end[free]) for end in (upper, lower))
        blocks = [a[equal], a[above], -a[below], eye[ceil], -eye[floor]]
        sides = [high[equal], high[above], -low[below], upper[free][ceil], -lower[free][floor]]
        n_equal, n_linear = int(equal.sum()), sum(map(len, sides))
        kinds = np.flatnonzero(equal), np.flatnonzero(above), np.flatnonzero(below)
        split = _Split(kinds, n_linear, [np.flatnonzero(moving) for moving in moves])
        stated = [clarabel.ZeroConeT(n_equal), clarabel.NonnegativeConeT(n_linear - n_equal)]
        for cone, chosen in zip(self.cones, split.moving, strict=True):
            block, side = _element_by_element(cone, chosen, free, settled)
            blocks.append(block)
            sides.append(side)
            stated += [clarabel.SecondOrderConeT(len(cone.matrices))] * len(chosen)
        none = sp.csc_array((len(free), len(free)))
        cost, stacked = self.numbers.cost[free], sp.vstack(blocks, format="csc")
        solver = clarabel.DefaultSolver(
            none, cost, stacked, np.concatenate(sides), stated, self._settings(clarabel)
        )
        if np.isfinite(until_s):
            solver.set_termination_callback(lambda info: time.perf_counter() > until_s)
        answer = solver.solve()
        status = str(answer.status)
        if status in NOT_SOLVED:
            return ConePoint(status, None, np.inf if status == INFEASIBLE_STATUS else -np.inf)
        multipliers, bound = self._multipliers(np.asarray(answer.z), split, lower, upper)
        z = settled.copy()
        z[free] = answer.x
        if not np.isfinite(z).all():
            return ConePoint(status, None, bound, multipliers)
        inside = np.clip(z, lower, upper)
        beyond = np.abs(z - inside) > RELAXATION_TOLERANCE * (1.0 + np.abs(inside))
        return ConePoint(status, inside, bound, multipliers, beyond & ~self.boxed)

    def _settings(self, clarabel: Any) -> Any:
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        for name, value in self.settings.items():
            setattr(settings, name, value)
        return settings

    def _multipliers(
        self, duals: Floats, split: _Split, lower: Floats, upper: Floats
    ) -> tuple[Multipliers | None, float]:
        """The solver's multipliers, moved into their cones, and the Lagrangian over the box."""
        if not np.isfinite(duals).all():
            return None, -np.inf
        rows, first = np.zeros(self.a.shape[0]), 0
        for chosen, sign in zip(split.kinds, (1.0, 1.0, -1.0), strict=True):
            rows[chosen] += sign * duals[first : first + len(chosen)]
            first += len(chosen)
        first, multipliers = split.n_linear, []
        for cone, chosen in zip(self.cones, split.moving, strict=True):
            size = len(cone.matrices)
            moved = np.zeros((size, len(cone.consts[0])))
            stop = first + size * len(chosen)
            moved[:, chosen] = duals[first:stop].reshape(len(chosen), size).T
            first = stop
            multipliers.append(_in_cone(moved))
        v = self.numbers
        box = Vectors(v.cost, v.offset, lower, upper, v.row_lower, v.row_upper)
        as_they_are = self._bounded(rows, multipliers, box)
        reduced = v.cost + self.a.T @ rows - as_they_are[0].slope
        turned = [cone.turned(y, reduced) for cone, y in zip(self.cones, multipliers, strict=True)]
        return max(as_they_are, self._bounded(rows, turned, box), key=lambda proof: proof[1])

    def _bounded(
        self, rows: Floats, cones: list[Floats], box: Vectors
    ) -> tuple[Multipliers, float]:
        slope, offset = np.zeros(self.a.shape[1]), 0.0
        for cone, multipliers in zip(self.cones, cones, strict=True):
            for m, c, y in zip(cone.matrices, cone.consts, multipliers, strict=True):
                slope += m.T @ y
                offset += float(c @ y)
        return Multipliers(rows, cones, slope), safe_bound(self.a, box, rows, slope, offset)


def _in_cone(y: Floats) -> Floats:
    """Multipliers (k + 1, n) with a first one that is large enough."""
    return np.stack([np.maximum(y[0], np.linalg.norm(y[1:], axis=0)), *y[1:]])


def _element_by_element(
    cone: SecondOrderRows, chosen: Ints, free: Ints, settled: Floats
) -> tuple[sp.csr_array, Floats]:
    """Block and sides of some elements, all rows of one before those of the next."""
    size = len(cone.matrices)
    parts = [m[chosen].tocsc()[:, free] for m in cone.matrices]
    sides = [
        m[chosen] @ settled + c[chosen] for m, c in zip(cone.matrices, cone.consts, strict=True)
    ]
    order = np.arange(size * len(chosen)).reshape(size, len(chosen)).T.ravel()
    return -sp.vstack(parts, format="csr")[order], np.concatenate(sides)[order]
