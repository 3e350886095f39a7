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
    sides,
    violated,
    widest,
)
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.start import LEAST
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
        found = relaxation(program, program.vectors)
    if found.status == "infeasible":
        raise infeasible(program)
    if found.z is None:
        raise no_plan(program, "the conic relaxation", options)
    return found


def relaxation(program: CaseProgram, vectors: Vectors, penalty: float = 0.0) -> Solution:
    """The SOCP for these vectors; a price on losses closes cones but voids the bound."""
    solver = Conic(program.standard, penalty=penalty)
    solver.update(vectors)
    return solver.solve()


def closed(program: CaseProgram, found: Solution, vectors: Vectors) -> Solution:
    """The relaxation's point if its cones are closed, else one with a slight price on losses.

    Where even that leaves cones open, the point with the narrowest is returned.
    """
    best, width = found, widest(program.standard, found.point)
    for penalty in PENALTIES:
        if width <= RELAXATION_TOLERANCE:
            break
        with phase("conic program", f"losses priced at {penalty:g} $/MW"):
            trial = relaxation(program, vectors, penalty)
        if trial.z is not None and widest(program.standard, trial.z) < width:
            best, width = trial, widest(program.standard, trial.z)
    return best


def ac_point(program: CaseProgram, start: Floats, vectors: Vectors, seconds: float) -> Solution:
    """The AC equations solved from `start`; a cold penalised start is tried where that fails."""
    clock = Deadline(seconds)
    for penalty in (0.0, PENALTIES[0]):
        solver = NLP(program.standard, time_limit=max(clock.left, LEAST), penalty=penalty)
        solver.update(vectors)
        if not penalty:
            solver.start_from(start)
        with phase("AC equations", "Ipopt"):
            found = solver.solve()
        if found.z is not None:
            return found
    return NOTHING


def in_one_mode(program: CaseProgram, found: Solution, vectors: Vectors) -> Vectors:
    """Vectors in which every mode that `found` breaks is held to the one nearest to it."""
    broken = violated(program.standard, found.point)
    return vectors.fixed(*sides(program.standard, found.point, broken)) if broken else vectors


def completed(program: CaseProgram, found: Solution, vectors: Vectors, seconds: float) -> Solution:
    """From a point of the relaxation to one that holds every mode and cone, or nothing.

    Integers are as `vectors` hold them. `seconds` limit the AC equations, if they are needed.
    """
    standard = program.standard
    point = closed(program, found, vectors)
    one_mode = in_one_mode(program, point, vectors)
    if one_mode is not vectors:
        point = relaxation(program, one_mode)
        if point.z is None:
            return NOTHING
        point = closed(program, point, one_mode)
    if widest(standard, point.point) > RELAXATION_TOLERANCE:
        point = ac_point(program, point.point, one_mode, seconds)
    return NOTHING if point.z is None or violated(standard, point.z) else point


def socp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Cones as u v >= sum(x^2), modes and integers relaxed: a bound, and often a plan."""
    found = root(program, options)
    best = closed(program, found, program.vectors)
    return MethodResult.of(program, best, found.bound, [])


def nlp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """The AC equations exactly, integers relaxed; broken modes are held to their larger side."""
    clock = Deadline(options.time_limit)
    found = root(program, options)
    start = closed(program, found, program.vectors)
    vectors = in_one_mode(program, start, program.vectors)
    polished = ac_point(program, start.point, vectors, clock.left)
    if polished.z is None:
        raise no_plan(program, "Ipopt", options, late=clock.left <= 0)
    return MethodResult.of(program, polished, found.bound, [])
