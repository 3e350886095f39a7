"""`socp` and `nlp`: the cone relaxation with its bound, and the AC equations from its point."""

from __future__ import annotations

from resilience.arrays import Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.cvxpy import Conic
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    Deadline,
    MethodOptions,
    MethodResult,
    broken_modes,
    idle_columns,
    worst_violation,
)
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.start import FALLBACK_S
from resilience.models.program.standard import Vectors
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

PENALTIES = (1e-3, 1e-2)  # $ per MW of loss and slot, tried until the cones are closed


def root(program: CaseProgram, options: MethodOptions) -> Solution:
    """The SOCP with modes and integers relaxed, and its proven bound.

    Raises:
        InfeasibleError: naming what is in conflict.
        SolverError: Clarabel gave up.
    """
    with phase("conic relaxation"):
        solution = relaxation(program, program.vectors)
    if solution.status == "infeasible":
        raise infeasible(program)
    if solution.z is None:
        raise no_plan(program, "the conic relaxation", options)
    return solution


def relaxation(program: CaseProgram, vectors: Vectors, penalty: float = 0.0) -> Solution:
    """The SOCP for these vectors; a price on losses closes cones but voids the bound."""
    solver = Conic(program.standard, penalty=penalty)
    solver.update(vectors)
    return solver.solve()


def with_cones_closed(program: CaseProgram, relaxed: Solution, vectors: Vectors) -> Solution:
    """The relaxation's point if its cones are closed, else one with a slight price on losses.

    Where even that leaves cones open, the point whose cones are least open is returned.
    """
    best, width = relaxed, worst_violation(program.standard, relaxed.point)
    for penalty in PENALTIES:
        if width <= RELAXATION_TOLERANCE:
            break
        with phase("conic program", f"losses priced at {penalty:g} $/MW"):
            trial = relaxation(program, vectors, penalty)
        if trial.z is not None and worst_violation(program.standard, trial.z) < width:
            best, width = trial, worst_violation(program.standard, trial.z)
    return best


def ac_point(program: CaseProgram, start: Floats, vectors: Vectors, seconds: float) -> Solution:
    """The AC equations solved from `start`; a cold penalised start is tried where that fails."""
    deadline = Deadline(seconds)
    for penalty in (0.0, PENALTIES[0]):
        time_limit = max(deadline.remaining_s, FALLBACK_S)
        solver = NLP(program.standard, time_limit=time_limit, penalty=penalty)
        solver.update(vectors)
        if not penalty:
            solver.start_from(start)
        with phase("AC equations", "Ipopt"):
            solution = solver.solve()
        if solution.z is not None:
            return solution
    return NOTHING


def with_modes_held(program: CaseProgram, solution: Solution, vectors: Vectors) -> Vectors:
    """Vectors in which every mode that a solution breaks is held to the one nearest to it."""
    standard = program.standard
    broken = broken_modes(standard, solution.point)
    return vectors.fixed(*idle_columns(standard, solution.point, broken)) if broken else vectors


def with_all_held(
    program: CaseProgram, relaxed: Solution, vectors: Vectors, seconds: float
) -> Solution:
    """From a point of the relaxation to one that holds every mode and cone, or nothing.

    Integers are as `vectors` hold them. `seconds` limit the AC equations, if they are needed.
    """
    standard = program.standard
    solution = with_cones_closed(program, relaxed, vectors)
    one_mode = with_modes_held(program, solution, vectors)
    if one_mode is not vectors:
        solution = relaxation(program, one_mode)
        if solution.z is None:
            return NOTHING
        solution = with_cones_closed(program, solution, one_mode)
    if worst_violation(standard, solution.point) > RELAXATION_TOLERANCE:
        solution = ac_point(program, solution.point, one_mode, seconds)
    if solution.z is None or broken_modes(standard, solution.z):
        return NOTHING
    return solution


def socp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Cones as u v >= sum(x^2), modes and integers relaxed: a bound, and often a plan."""
    relaxed = root(program, options)
    best = with_cones_closed(program, relaxed, program.vectors)
    return MethodResult.from_solution(program, best, relaxed.bound, [])


def nlp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """The AC equations exactly, integers relaxed; broken modes are held to their larger side."""
    deadline = Deadline(options.time_limit)
    relaxed = root(program, options)
    start = with_cones_closed(program, relaxed, program.vectors)
    vectors = with_modes_held(program, start, program.vectors)
    polished = ac_point(program, start.point, vectors, deadline.remaining_s)
    if polished.z is None:
        raise no_plan(program, "Ipopt", options, late=deadline.remaining_s <= 0)
    return MethodResult.from_solution(program, polished, relaxed.bound, [])
