"""`exact`: SCIP on everything at once, convex first, nonconvex only where that is not enough."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Bools
from resilience.errors import UsageError
from resilience.models.backends.base import NOTHING, Solution, Status
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    LATE,
    Deadline,
    MethodOptions,
    MethodResult,
    gap,
    rounded,
    sides,
    violated,
    widest,
)
from resilience.models.methods.conic import completed, relaxation
from resilience.models.methods.explain import infeasible, no_plan
from resilience.progress import phase
from resilience.tolerances import EXACT_GAP, RELAXATION_TOLERANCE


@dataclass
class ScipSearch:
    """What is known so far; `modes` are the elements of splits and curves that have binaries."""

    program: CaseProgram
    clock: Deadline
    modes: dict[int, Bools] = field(default_factory=dict)
    bound: float = -np.inf
    best: Solution = NOTHING

    @property
    def done(self) -> bool:
        """Whether the best plan is proven, or time is up."""
        return gap(self.best.objective, self.bound) <= EXACT_GAP or self.clock.left <= 0

    def offer(self, plan: Solution) -> None:
        """Keeps a plan that is better than the best."""
        if plan.objective < self.best.objective:
            self.best = plan


def exact(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Global optimum of the AC model to a gap of 1e-5, whatever gap is asked for.

    Cones are held as u v >= sum(x^2), integers exactly, and modes where the answer breaks them.
    With integers and modes as found, the conic program and if need be Ipopt close the cones. If
    that costs nothing, the plan is optimal. Otherwise SCIP searches again with everything exact
    and cones as equalities, which is slow.

    Raises:
        UsageError: the extra `exact` (PySCIPOpt) is not installed.
        InfeasibleError: naming what is in conflict.
        SolverError: no plan was found in time.
    """
    if importlib.util.find_spec("pyscipopt") is None:
        raise UsageError(
            "method 'exact' needs SCIP, which is not installed",
            hint='pip install "resilience[exact]"',
        )
    search = ScipSearch(program, Deadline(options.time_limit))
    while _round(search):
        pass
    if not search.done:
        with phase("SCIP", "AC equations"):
            strict = _scip(search, Pyomo(program.standard, solver="scip", gap=EXACT_GAP / 2))
        search.bound = max(search.bound, strict.bound)
        search.offer(strict)
    if search.best.z is None:
        raise no_plan(program, "SCIP", options)
    proven = gap(search.best.objective, search.bound) <= EXACT_GAP
    status: Status = "optimal" if proven else "feasible"
    best = replace(search.best, status=status)
    return MethodResult.of(program, best, search.bound, [] if proven else [LATE])


def _round(search: ScipSearch) -> bool:
    """The convex problem with the modes held so far; False when it leaves nothing to hold."""
    standard = search.program.standard
    if standard.integer.any() or search.modes:
        lowered = lower(standard, exact=search.modes)
        with phase("SCIP", "convex relaxation"):
            found = _scip(search, Pyomo(lowered, solver="scip", cones="relaxed", gap=EXACT_GAP / 2))
    else:
        with phase("conic relaxation"):
            found = relaxation(search.program, search.program.vectors)
    if found.status == "infeasible":
        raise infeasible(search.program)
    search.bound = max(search.bound, found.bound)
    if found.z is None:
        return False
    search.offer(_plan(search, found))
    new = False
    for k, elements in violated(standard, found.z).items():
        held = search.modes.get(k, np.zeros(len(elements), bool))
        new |= bool((elements & ~held).any())
        search.modes[k] = held | elements
    return new and not search.done


def _scip(search: ScipSearch, solver: Pyomo) -> Solution:
    solver.time_limit = max(search.clock.left, 1.0)
    solver.update(search.program.vectors)
    found = solver.solve()
    if found.status == "infeasible":
        raise infeasible(search.program)
    return found


def _plan(search: ScipSearch, found: Solution) -> Solution:
    """The point found with its cones closed and the solver's tolerances taken out."""
    program, standard = search.program, search.program.standard
    vectors = rounded(program, found.point)
    vectors = vectors.fixed(*sides(standard, found.point, search.modes))
    with phase("conic program"):
        point = relaxation(program, vectors)
    best = NOTHING if point.z is None else completed(program, point, vectors, search.clock.left)
    closed = widest(standard, found.point) <= RELAXATION_TOLERANCE
    holds = closed and not violated(standard, found.point)
    return found if best.z is None and holds else best
