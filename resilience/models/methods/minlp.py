"""`minlp`: a plan that satisfies the AC equations, the proven bound, and the gap between them.

Outer approximation (Duran & Grossmann 1986) of the branch-flow model:

1. SOCP with all binaries relaxed: the first bound, and tangents of all cones at its point.
2. MILP over the tangents so far, integers exact, cones relaxed: a commitment, and its dual bound is
   a bound for the whole problem.
3. Commitment fixed: SOCP, and Ipopt from its point where a cone stayed open: a plan.
4. Tangents at the plan are added; a commitment without a plan is cut off; back to 2 until the gap
   is small enough or time is up.

The price on losses that closes cones is used for plans only, never for bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.models.algebra import Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower, tangents
from resilience.models.methods.answer import (
    CLOSED,
    Answer,
    Bools,
    Clock,
    Options,
    fractional,
    gap,
    infeasible,
    nothing_found,
    remains,
    sides,
    violated,
)
from resilience.models.methods.conic import _width, ac_point, closed, relaxation
from resilience.models.problem import Problem
from resilience.models.standard import Vectors
from resilience.progress import phase

ROUNDS = 8
SHARE = 0.5  # of the time left that one MILP may take


@dataclass
class Search:
    """What is known so far."""

    problem: Problem
    options: Options
    clock: Clock
    bound: float = -np.inf
    best: Solution = NOTHING
    modes: dict[int, Bools] = field(default_factory=dict)
    rows: list[tuple[sp.csr_array, Floats]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def gap(self) -> float:
        """Relative gap of the best plan."""
        return np.inf if self.best.z is None else gap(self.best.objective, self.bound)

    @property
    def done(self) -> bool:
        """Whether the gap asked for is reached or time is up."""
        return self.gap <= self.options.gap or self.clock.left <= 0

    def offer(self, found: Solution) -> None:
        """Keeps a plan that is better than the best."""
        if found.z is not None and found.objective < self.best.objective:
            self.best = found


def minlp(problem: Problem, options: Options) -> Answer:
    """See the module's docstring."""
    search = Search(problem, options, Clock(options.time_limit))
    with phase("conic relaxation"):
        root = relaxation(problem)
    if root.z is None:
        raise nothing_found("the conic relaxation", options.time_limit)
    search.bound = root.bound
    search.rows.append(tangents(problem.standard, root.point))
    if not fractional(problem.standard, root.point).any():
        _plan(search, root, _rounded(problem, root.point))
    for k in range(ROUNDS):
        if search.done:
            break
        if not _round(search, k + 1):
            break
    if search.best.z is None:
        raise nothing_found("minlp", options.time_limit)
    return _answer(search)


def _rounded(problem: Problem, z: Floats) -> Vectors:
    at = np.flatnonzero(problem.standard.integer)
    return problem.vectors.fixed(at, np.round(z[at]))


def _round(search: Search, k: int) -> bool:
    """One MILP and one plan; False when nothing new can come."""
    problem, standard = search.problem, search.problem.standard
    if not standard.integer.any() and not search.modes:
        return False
    with phase("commitment", f"round {k}, gap {100 * search.gap:.2f} %"):
        master = _master(search)
    search.bound = max(search.bound, master.bound)
    if master.status == "infeasible":
        if search.best.z is None:
            raise infeasible([], f"the {problem.grid.physics} model with its integers")
        return False
    if master.z is None or search.done:
        return False
    search.rows.append(tangents(standard, master.point))
    vectors = _rounded(problem, master.point)
    with phase("conic program", f"round {k}"):
        found = relaxation(problem, vectors)
    if found.z is None:
        search.rows.append(_no_good(problem, master.point))
        return True
    search.rows.append(tangents(standard, found.point))
    before = search.best.objective
    _plan(search, found, vectors)
    if search.best.objective >= before - 1e-9 * abs(before):
        search.rows.append(_no_good(problem, master.point))
    return True


def _master(search: Search) -> Solution:
    standard = search.problem.standard
    lowered = lower(standard, exact=search.modes, discs="outer")
    g = sp.vstack([rows for rows, _ in search.rows], format="csr")
    h = np.concatenate([sides_ for _, sides_ in search.rows])
    solver = Highs(
        lowered,
        rows=(g, h),
        gap=search.options.gap / 2,
        time_limit=max(SHARE * search.clock.left, 1.0),
    )
    solver.update(search.problem.vectors)
    return solver.solve()


def _plan(search: Search, found: Solution, vectors: Vectors) -> None:
    """Turns a point of the relaxation for fixed integers into a plan that satisfies everything."""
    problem, standard = search.problem, search.problem.standard
    point = closed(problem, found, vectors)
    broken = violated(standard, point.point)
    if broken:
        for k, elements in broken.items():
            search.modes[k] = search.modes.get(k, np.zeros(len(elements), bool)) | elements
        vectors = vectors.fixed(*sides(standard, point.point, broken))
        point = relaxation(problem, vectors)
        if point.z is None:
            return
        point = closed(problem, point, vectors)
    if _width(problem, point) > CLOSED:
        with phase("AC equations", "Ipopt"):
            point = ac_point(problem, point.point, vectors, max(search.clock.left, 5.0))
    if point.z is not None and not violated(standard, point.point):
        search.offer(point)


def _no_good(problem: Problem, z: Floats) -> tuple[sp.csr_array, Floats]:
    """At least one integer must differ: sum over ones (1 - b) + sum over zeros b >= 1."""
    at = np.flatnonzero(problem.standard.integer)
    ones = np.round(z[at]) > 0.5
    row = sp.csr_array(
        (np.where(ones, 1.0, -1.0), (np.zeros(len(at), np.intp), at)),
        shape=(1, problem.standard.n_columns),
    )
    return row, np.array([ones.sum() - 1.0])


def _answer(search: Search) -> Answer:
    reached = search.gap <= search.options.gap
    if not reached:
        search.notes.append(
            f"the gap of {100 * search.gap:.2f} % is above the {100 * search.options.gap:.2g} % "
            f"asked for after {search.options.time_limit - search.clock.left:.0f} s; "
            "this is the best plan found"
        )
    return Answer(
        status="optimal" if reached else "feasible",
        z=search.best.point,
        objective=search.best.objective,
        bound=search.bound,
        bound_of=search.problem.grid.physics,
        relaxed=remains(search.problem.standard, search.best.point),
        notes=search.notes,
    )
