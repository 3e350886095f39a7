"""Clarabel: the second-order cone relaxation of a whole program and its proven bound."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

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
from resilience.models.backends.clarabel import (
    INFEASIBLE_STATUS,
    ConePoint,
    ConeProgram,
    Multipliers,
    SecondOrderRows,
)
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
from resilience.tolerances import CONFLICT_TOLERANCE

MAX_LISTED = 12  # rows that `conflict` names
# A tenth of Clarabel's own or less: an island is alive from a thousandth of its storage on, so that
# 1e-9 MWh may let it serve 1e-6 MWh, and a point open by 1e-8 costs visibly less than any can.
TOLERANCES = {"tol_feas": 1e-10, "tol_gap_rel": 1e-9, "tol_gap_abs": 1e-9}
SOLVED: dict[str, Status] = {"Solved": "optimal", "AlmostSolved": "feasible"}
WITHOUT_POINT = {
    INFEASIBLE_STATUS: INFEASIBLE,
    "AlmostPrimalInfeasible": replace(INFEASIBLE, bound=-np.inf),  # believed, not proven
    "DualInfeasible": NOTHING,
}
USUAL_SHARE = 0.01
"""Of its largest value that the u of a cone u v >= sum(x^2) mostly has: currents of a tenth of what
lines can carry at most."""


class Conic:
    """Holds affine rows and discs; cones as u v >= sum(x^2); integers and modes relaxed.

    A cone is stated as |(2 s x, s^2 u - v)| <= s^2 u + v, with an s that makes both sides of the
    difference alike: with a squared current of 1e-6 beside a voltage of 1 it would be rounding.

    Args:
        standard: the program.
        time_limit: seconds per solve, building included; what is found by then may be a bound only.
        penalty: weight of the program's penalty (losses) on top of the cost; it closes cones and
            takes no part in the objective, but voids the bound, which is then -inf.
        elastic: lets every row be missed at this price in $ per unit; for explanations.
        discs: for the index of each structure of discs, the elements (n,) that are held, the others
            being relaxed; all of them if omitted.
        boxed: (columns,) whose bounds are held, the others being relaxed; all of them if omitted.
            `is_beyond` says whether the last point had to be put back to one of these.
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
        boxed: Bools | None = None,
    ) -> None:
        self.standard, self.time_limit = standard, time_limit
        self.penalty, self.elastic = penalty, elastic
        self.boxed = np.ones(standard.n_columns, bool) if boxed is None else boxed
        refuse_unknown(standard, "the conic relaxation", self.exact | self.relaxed)
        self._second_order = {
            k: (unrolled, elements)
            for k, unrolled in standard.structures_of(SecondOrder).items()
            if len(elements := _chosen(unrolled.n, discs, k))
        }
        self.slack: Floats | None = None
        self.is_beyond = False
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
        until_s = time.perf_counter() + self.time_limit
        a, v = self._with_added_rows()
        if crossed(v):
            return INFEASIBLE
        scales = {k: self._scale(*chosen, v) for k, chosen in self._second_order.items()}
        cones = [self._stated(*chosen, scales[k]) for k, chosen in self._second_order.items()]
        if self.elastic is not None:
            return self._missed(a, v, cones, until_s)
        priced = replace(v, cost=v.cost + self.penalty * self.standard.penalty)
        program = ConeProgram(a, priced, tuple(cones), self.boxed, TOLERANCES)
        point = program.solve(v.lower, v.upper, until_s - time.perf_counter())
        if point.status in WITHOUT_POINT:
            return WITHOUT_POINT[point.status]
        if point.z is None or point.status not in SOLVED:
            return NOTHING if self.penalty else replace(NOTHING, bound=point.bound)
        return self._solution(a, v, point, scales)

    def _scale(
        self, unrolled: UnrolledStructure[SecondOrder], elements: Ints, v: Vectors
    ) -> Floats:
        """(elements,) s of every cone, 1 where there is nothing to tell it from; of discs 1."""
        if not isinstance(unrolled.structure, Cone):
            return np.ones(len(elements))
        most_u, most_v = (
            m[elements].maximum(0.0) @ v.upper + m[elements].minimum(0.0) @ v.lower + c[elements]
            for m, c in zip(unrolled.matrices[:2], unrolled.consts[:2], strict=True)
        )
        usual = USUAL_SHARE * most_u
        tells = np.isfinite(usual) & np.isfinite(most_v) & (usual > 0.0) & (most_v > 0.0)
        return np.sqrt(np.where(tells, most_v, 1.0) / np.where(tells, usual, 1.0))

    def _stated(
        self, unrolled: UnrolledStructure[SecondOrder], elements: Ints, s: Floats
    ) -> SecondOrderRows:
        chosen = unrolled if len(elements) == unrolled.n else unrolled.elements(elements)
        if isinstance(chosen.structure, Cone):
            u, v, *xs = zip(chosen.matrices, chosen.consts, strict=True)
            pairs = [_times(u, s**2), v, *(_times(x, s) for x in xs)]
            chosen = replace(
                chosen,
                matrices=tuple(m for m, _ in pairs),
                consts=tuple(c for _, c in pairs),
            )
        return SecondOrderRows(*chosen.structure.second_order(chosen))

    def _solution(
        self, a: sp.csr_array, v: Vectors, point: ConePoint, scales: Mapping[int, Floats]
    ) -> Solution:
        assert point.z is not None
        self.is_beyond = point.beyond is not None and bool(point.beyond.any())
        status, value = SOLVED[point.status], float(v.cost @ point.z + v.offset)
        if point.multipliers is None:
            return Solution(status, point.z, value, -np.inf)
        duals = self._duals(point.multipliers, scales)
        if self.penalty:
            return Solution(status, point.z, value, -np.inf, duals)
        price = v.cost + a.T @ duals.rows - point.multipliers.slope
        return Solution(status, point.z, value, point.bound, duals, price[: self.standard.n_states])

    def _duals(self, multipliers: Multipliers, scales: Mapping[int, Floats]) -> Duals:
        """Multipliers of u + v, 2 x, u - v from those of s^2 u + v, 2 s x, s^2 u - v."""
        cones: dict[int, Floats] = {}
        chosen = self._second_order.items()
        for (k, (unrolled, elements)), y in zip(chosen, multipliers.cones, strict=True):
            unscaled = y
            if isinstance(unrolled.structure, Cone):
                s = scales[k]
                of_u, of_v = s**2 * (y[0] + y[-1]), y[0] - y[-1]
                unscaled = np.stack([(of_u + of_v) / 2, *(s * y[1:-1]), (of_u - of_v) / 2])
            cones[k] = np.zeros((len(y), unrolled.n))
            cones[k][:, elements] = unscaled
        return Duals(multipliers.rows, cones)

    def _missed(
        self, a: sp.csr_array, v: Vectors, cones: list[SecondOrderRows], until_s: float
    ) -> Solution:
        """The point that misses rows by the least sum, which is kept as `slack`; no bound."""
        n, m = a.shape[1], a.shape[0]
        zeros, ceiling = np.zeros(2 * m), np.full(2 * m, np.inf)
        eye = sp.eye_array(m)
        wide = Vectors(
            np.concatenate([np.zeros(n), np.full(2 * m, self.elastic)]),
            0.0,
            np.append(v.lower, zeros),
            np.append(v.upper, ceiling),
            v.row_lower,
            v.row_upper,
        )
        widened = [
            SecondOrderRows([_wide(block, n + 2 * m) for block in cone.matrices], cone.consts)
            for cone in cones
        ]
        boxed = np.append(self.boxed, np.ones(2 * m, bool))
        rows = sp.hstack([a, eye, -eye], format="csr")
        program = ConeProgram(rows, wide, tuple(widened), boxed, TOLERANCES)
        point = program.solve(wide.lower, wide.upper, until_s - time.perf_counter())
        if point.z is None or point.status not in SOLVED:
            return NOTHING
        z, more, less = np.split(point.z, [n, n + m])
        self.slack = more - less
        return Solution(SOLVED[point.status], z, float(v.cost @ z + v.offset), -np.inf)

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


def _times(affine: tuple[sp.csr_array, Floats], s: Floats) -> tuple[sp.csr_array, Floats]:
    matrix, const = affine
    return sp.csr_array(matrix.multiply(s[:, None])), const * s


def _wide(matrix: sp.csr_array, width: int) -> sp.csr_array:
    wide = matrix.copy()
    wide.resize(matrix.shape[0], width)
    return wide
