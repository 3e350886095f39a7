"""`exact`: SCIP on everything at once, convex first, nonconvex only where that is not enough."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Bools
from resilience.errors import UsageError
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    NOTHING_NEW,
    OUT_OF_TIME,
    Deadline,
    MethodOptions,
    MethodResult,
    broken_facts,
    broken_modes,
    idle_columns,
    with_integers_held,
)
from resilience.models.methods.conic import relaxation, with_all_held
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.minlp import ConicSearch, begin, branch
from resilience.models.methods.trees import can_branch
from resilience.models.program.gate import cost_scale, gap
from resilience.progress import phase
from resilience.tolerances import EXACT_GAP


@dataclass
class ScipSearch:
    """What is known so far.

    Attributes:
        program: what to solve.
        deadline: when to stop.
        modes: for the index of each structure with modes, the elements (n,) that have binaries.
        bound: lower bound, $.
        best: the best plan so far.
    """

    program: CaseProgram
    deadline: Deadline
    modes: dict[int, Bools] = field(default_factory=dict)
    bound: float = -np.inf
    best: Solution = NOTHING

    @property
    def done(self) -> bool:
        """Whether the best plan is proven, or time is up."""
        scale = cost_scale(self.program.vectors)
        return gap(self.best.objective, self.bound, scale) <= EXACT_GAP or self.deadline.late

    def seconds(self) -> float:
        """Seconds for one more solve: to the hard stop as long as there is nothing to show."""
        deadline = self.deadline
        return deadline.final_s if self.best.z is None else deadline.remaining_s

    def offer(self, plan: Solution) -> None:
        """Keeps a plan that is better than the best."""
        if plan.objective < self.best.objective:
            self.best = plan


def exact(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Global optimum of the AC model to a gap of 1e-5, whatever gap is asked for.

    Where all decisions are switches, branch and bound over trees comes first. Then SCIP searches:
    cones are held as u v >= sum(x^2), integers exactly, and modes where the answer breaks them.
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
    search = ScipSearch(program, options.deadline())
    if can_branch(program.in_mw):
        _branch_first(search, options)
    if search.best.z is None or not search.done:
        while _held_more_modes(search):
            pass
    if not search.done:
        with phase("SCIP", "AC equations"):
            strict = _scip(search, Pyomo(program.standard, solver="scip", gap=EXACT_GAP / 2))
        search.bound = max(search.bound, strict.bound)
        if strict.z is not None and not broken_facts(program.standard, strict.z):
            search.offer(strict)
    if search.best.z is None:
        raise no_plan(program, "SCIP", options, late=search.deadline.late)
    reason = OUT_OF_TIME if search.deadline.late else NOTHING_NEW
    return MethodResult.from_solution(program, search.best, search.bound, EXACT_GAP, reason)


def _branch_first(search: ScipSearch, options: MethodOptions) -> None:
    """Branch and bound over trees in the first half of the time; often that is all it takes."""
    half = replace(search.deadline, limit_s=0.5 * search.deadline.limit_s)
    trees = ConicSearch(search.program, replace(options, gap=EXACT_GAP), half)
    begin(trees)
    branch(trees)
    search.bound = max(search.bound, trees.bound)
    search.offer(trees.best)


def _held_more_modes(search: ScipSearch) -> bool:
    """Solves the convex program; False when its point leaves no mode to hold, or time is up."""
    standard = search.program.standard
    if standard.integer.any() or search.modes:
        lowered = lower(standard, modes=search.modes)
        solver = Pyomo(lowered, solver="scip", cones="relaxed", gap=EXACT_GAP / 2)
        with phase("SCIP", "convex relaxation"):
            relaxed = _scip(search, solver)
    else:
        with phase("conic relaxation"):
            relaxed = relaxation(search.program, search.program.vectors, seconds=search.seconds())
    if relaxed.status == "infeasible":
        raise infeasible(search.program)
    search.bound = max(search.bound, relaxed.bound)
    if relaxed.z is None:
        return False
    search.offer(_plan(search, relaxed))
    new = False
    for k, elements in broken_modes(standard, relaxed.z).items():
        before = search.modes.get(k, np.zeros(len(elements), bool))
        new |= bool((elements & ~before).any())
        search.modes[k] = before | elements
    return new and not search.done


def _scip(search: ScipSearch, solver: Pyomo) -> Solution:
    solver.update(search.program.vectors)
    solver.time_limit = search.seconds()
    if solver.time_limit <= 0.0:
        return NOTHING
    solution = solver.solve()
    if solution.status == "infeasible":
        raise infeasible(search.program)
    return solution


def _plan(search: ScipSearch, relaxed: Solution) -> Solution:
    """A relaxed point with its cones closed and the solver's tolerances taken out."""
    program, standard, z = search.program, search.program.standard, relaxed.point
    vectors = with_integers_held(program, z).fixed(*idle_columns(standard, z, search.modes))
    with phase("conic program"):
        point = relaxation(program, vectors, seconds=search.seconds())
    best = NOTHING
    if point.z is not None:
        best = with_all_held(program, point, vectors, search.seconds)
    return relaxed if best.z is None and not broken_facts(standard, z) else best
