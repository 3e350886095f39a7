"""HiGHS through highspy: sparse arrays in, warm basis kept; the hot loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.backends.base import (
    INFEASIBLE,
    NOTHING,
    Duals,
    LeafCuts,
    Solution,
    Status,
    failures_of,
    of_solver,
)
from resilience.models.backends.highs_model import (
    AT_LOWER,
    BASIC,
    LINEAR_OPTIONS,
    TREE_OPTIONS,
    WARM_OPTIONS,
    Basis,
    HighsModel,
    Option,
    RunStatus,
    Statuses,
    basis_of,
)
from resilience.models.backends.highs_scale import Scale
from resilience.models.backends.lower import Lowered, lower
from resilience.models.backends.node_by_node import node_statuses
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.referee import row_violations
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.units import Units, column_scale
from resilience.models.structures import Adjacent, Largest, Split, Structure
from resilience.tolerances import CONFLICT_TOLERANCE

KEY_SEED = 0  # of the random sums by which rows are told apart
EXPLAIN_S = 5.0  # for each way of explaining what is infeasible
LONG_HORIZON_OPTIONS = {"simplex_dual_edge_weight_strategy": -1}
"""Steepest edge, which HiGHS chooses itself: half the time of Devex on a long horizon."""
MAX_LISTED = 12  # rows that `missed` names


class Highs:
    """Holds affine rows, integers, splits and piecewise curves; discs as polygons; cones relaxed.

    Args:
        standard: the program, or one already lowered with a choice of what is relaxed.
        time_limit: seconds per solve.
        gap: relative MIP gap at which a solve stops.
        rows: further rows G z <= h of constant coefficients (cone cuts, no-good cuts).
        threads: of the solver, 0 for its own choice.
        duals: whether an LP's solution carries its multipliers; loops save by doing without.
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
        self._extra_rows = rows
        self._sent: Vectors | None = None
        self._later_cuts = LeafCuts(self.standard)
        self._warm = False
        self.is_mip = bool(self.lowered.integer.any())
        self.model = HighsModel({"mip_rel_gap": gap, "threads": threads, **TREE_OPTIONS})
        if not self.is_mip:
            self.model.set_options(LINEAR_OPTIONS)

    def _matrix(self) -> sp.csr_array:
        if self._extra_rows is None:
            return self.lowered.a
        g = self._extra_rows[0].copy()
        g.resize(g.shape[0], self.lowered.a.shape[1])
        return sp.vstack([self.lowered.a, g], format="csr")

    def _with_extra_rows(self, v: Vectors) -> Vectors:
        """The vectors of the lowered program with the sides of the further rows behind them."""
        if self._extra_rows is None:
            return v
        h = self._extra_rows[1]
        low = np.append(v.row_lower, np.full(len(h), -np.inf))
        return replace(v, row_lower=low, row_upper=np.append(v.row_upper, h))

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers; the basis of the last solve is kept."""
        self._latest, vectors = vectors, self._later_cuts.with_futures_open(vectors)
        if self._sent is None:
            self._pass(self.lowered.vectors(vectors))
        else:
            self._change(vectors, self._sent)
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
        a, v = self._matrix(), self._with_extra_rows(v)
        self.model.load(a, v, self.lowered.integer, None if self.is_mip else self._scale(a))

    def _scale(self, a: sp.csr_array) -> Scale | None:
        """The program's own units, where they are not those that it is in."""
        units = Units.of_program(self.standard, self._latest)
        if units == Units():
            return None
        columns = np.ones(a.shape[1])
        columns[: self.standard.n_columns] = column_scale(self.standard, units)
        return Scale.of_matrix(a, columns, units.cost)

    def _change(self, new: Vectors, old: Vectors) -> None:
        """Sends what differs; what `lower` added never does."""
        model = self.model
        if not (self.is_mip or self._warm):
            model.set_options(WARM_OPTIONS)
            self._warm = True
        columns = _differing(new.lower, old.lower, new.upper, old.upper)
        if len(columns):
            model.change_bounds(columns, new.lower[columns], new.upper[columns])
        rows = _differing(new.row_lower, old.row_lower, new.row_upper, old.row_upper)
        if len(rows):
            model.change_sides(rows, new.row_lower[rows], new.row_upper[rows])
        columns = _differing(new.cost, old.cost)
        if len(columns):
            model.change_costs(columns, new.cost[columns])
        model.change_offset(new.offset)

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """Adds rows to what `update` sent; the basis is kept. See `Backend.add_cuts`."""
        columns, values = self._later_cuts.add(node, alpha, beta)
        right = -np.asarray(alpha, float)
        self.model.add_rows(np.tile(columns, (len(right), 1)), values, -np.inf, right)
        self.update(self._latest)

    def tune(self, options: Mapping[str, Option]) -> None:
        """Sets options of HiGHS by their names."""
        self.model.set_options(options)

    def basis(self) -> Basis:
        """The basis of the last solve, for `start_at`."""
        return self.model.basis

    def start_at(self, basis: Basis) -> None:
        """Lets the next solve start from a basis, and from nothing else of what is solved already.

        For solves whose result may not depend, not even by rounding, on those in between.
        """
        self.model.forget()
        self.model.set_basis(basis)

    def resume_at(self, basis: Basis) -> None:
        """As `start_at`, but with the factors and norms that the last solve has left: faster."""
        self.model.set_basis(basis)

    def start_node_by_node(self) -> None:
        """Lets the next solve start from the nodes of the tree, each solved by itself."""
        self._start(*node_statuses(self.standard, self._latest))

    def start_as(self, solved: Highs) -> bool:
        """Lets the next solve start where another one ended; False where it had other rows.

        This one may have more, behind those or between them.
        """
        old, new = solved._matrix(), self._matrix()
        if old.shape[1] != new.shape[1]:
            return False
        places = rows_among(old, new)
        if places is None:
            return False
        columns, rows = (np.array(statuses, object) for statuses in solved.model.statuses)
        self._start(columns, rows, places)
        return True

    def _start(self, columns: Statuses, rows: Statuses, places: Ints | None = None) -> None:
        """At the statuses of the first columns and rows, or of the rows in these places: what is
        added to them is slack.
        """
        n_rows, n_columns = self._matrix().shape
        columns = np.append(columns, np.full(n_columns - len(columns), AT_LOWER, object))
        statuses = np.full(n_rows, BASIC, object)
        statuses[np.arange(len(rows)) if places is None else places] = rows
        self.model.set_basis(basis_of(columns, statuses))

    def forget(self) -> None:
        """Lets the next solve start from nothing."""
        self.model.forget()

    def start_from(self, z: Floats) -> None:
        """Hands a MIP a first point, in the program's own columns."""
        columns = np.flatnonzero(self.standard.integer)
        self.model.set_start(columns, np.round(z[columns]))

    @of_solver("HiGHS")
    def solve(self) -> Solution:
        """Solves; a MIP stopped by its limits returns its incumbent and its dual bound."""
        if np.isfinite(self.time_limit):
            self.model.limit_time(self.time_limit)
        status = self.model.run()
        if status is RunStatus.AMBIGUOUS:
            status = self._without_presolve()
        if status is RunStatus.INFEASIBLE:
            return INFEASIBLE
        if status is RunStatus.UNBOUNDED:
            return NOTHING
        info = self.model.info
        if not info.has_point:
            return replace(NOTHING, bound=info.mip_bound if self.is_mip else -np.inf)
        done = status is RunStatus.OPTIMAL
        if self.is_mip:
            z = self.model.solution.values[: self.standard.n_columns]
            return Solution("optimal" if done else "feasible", z, info.objective, info.mip_bound)
        return self._linear(done, info.objective)

    def _without_presolve(self) -> RunStatus:
        """Presolve cannot tell unbounded from infeasible; the simplex method can."""
        presolve = self.model.option("presolve")
        self.model.set_options({"presolve": "off"})
        status = self.model.run()
        self.model.set_options({"presolve": presolve})
        return status

    def _linear(self, done: bool, value: float) -> Solution:
        kind: Status = "optimal" if done else "feasible"
        bound, solution = value if done else -np.inf, self.model.solution
        z = solution.values[: self.standard.n_columns]
        if not self.duals:
            return Solution(kind, z, value, bound)
        state_price = solution.reduced_costs[: self.standard.n_states]
        return Solution(kind, z, value, bound, Duals(solution.multipliers), state_price)

    def certified_bound(self, solution: Solution) -> float:
        """A bound that holds whatever the solver's tolerances, from its multipliers."""
        if solution.duals is None or self._later_cuts.cuts or self._sent is None:
            return solution.bound
        v = self._with_extra_rows(self.lowered.vectors(self._sent))
        return safe_bound(self._matrix(), v, solution.duals.rows)

    @failures_of("HiGHS")
    def conflict(self, seconds: float = EXPLAIN_S) -> list[str]:
        """Names of rows and columns that together admit no point; empty if none were found soon."""
        rows, columns = self.model.conflict(seconds)
        n, standard = self.standard.n_rows, self.standard
        names = [standard.row_name(i) for i in rows if i < n]
        unnamed = sum(i >= n for i in rows)
        bounds = [f"bounds of {standard.column_name(j)}" for j in columns if j < standard.n_columns]
        return names + ([f"{unnamed} rating or mode rows"] if unnamed else []) + bounds

    @failures_of("HiGHS")
    def missed(self, rows: Ints, seconds: float = EXPLAIN_S) -> list[str]:
        """Names of those of `rows` that have to be missed for all others to hold, the worst few."""
        penalty = np.full(self._matrix().shape[0], -1.0)
        penalty[rows] = 1.0
        self.model.limit_time(seconds)
        self.model.set_options({"mip_rel_gap": 0.5})
        z = self.model.relaxed_point(penalty)[: self.standard.n_columns]
        if self._sent is None or len(z) < self.standard.n_columns:
            return []
        off = row_violations(self.standard, z, self._sent)[rows]
        worst_rows = [i for i in np.argsort(-off)[:MAX_LISTED] if off[i] > CONFLICT_TOLERANCE]
        return [self.standard.row_name(int(rows[i])) for i in sorted(worst_rows)]


def _differing(new: Floats, old: Floats, *more: Floats) -> Ints:
    """Where new and old, or another such pair, are not the same."""
    apart = new != old
    if more:
        apart |= more[0] != more[1]
    return np.flatnonzero(apart)


def rows_among(old: sp.csr_array, new: sp.csr_array) -> Ints | None:
    """(rows of old,) where each is among those of new, equal ones in their order, or None.

    Rows are told apart by sums of their coefficients with random weights, and then compared.
    """
    weights = np.random.default_rng(KEY_SEED).normal(size=old.shape[1])
    keys = [matrix @ weights for matrix in (old, new)]
    old_order, new_order = (np.argsort(key, kind="stable") for key in keys)
    old_keys, new_keys = keys[0][old_order], keys[1][new_order]
    repeated = np.arange(len(old_keys)) - np.searchsorted(old_keys, old_keys)
    rank = np.searchsorted(new_keys, old_keys) + repeated
    if rank.max(initial=-1) >= len(new_keys):
        return None
    places = np.empty(len(old_keys), np.intp)
    places[old_order] = new_order[rank]
    same = new[places]
    return places if same.nnz == old.nnz and not (same != old).nnz else None
