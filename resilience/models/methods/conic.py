"""`socp` and `nlp`: the cone relaxation with its bound, and the AC equations from its point."""

from __future__ import annotations

from resilience.arrays import Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.cvxpy import Conic
from resilience.models.case_program import Problem
from resilience.models.methods.answer import (
    CLOSED,
    Answer,
    Clock,
    Options,
    sides,
    violated,
    widest,
)
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.start import LEAST
from resilience.models.program.standard import Vectors
from resilience.progress import phase

PENALTIES = (1e-3, 1e-2)  # $ per MW of loss and slot, tried until the cones are closed


def root(problem: Problem, options: Options) -> Solution:
    """The SOCP with modes and integers relaxed, and its proven bound.

    Raises:
        InfeasibleError: naming what is in conflict.
        SolverError: Clarabel gave up.
    """
    with phase("conic relaxation"):
        found = relaxation(problem, problem.vectors)
    if found.status == "infeasible":
        raise infeasible(problem)
    if found.z is None:
        raise no_plan(problem, "the conic relaxation", options)
    return found


def relaxation(problem: Problem, vectors: Vectors, penalty: float = 0.0) -> Solution:
    """The SOCP for these vectors; a price on losses closes cones but voids the bound."""
    solver = Conic(problem.standard, penalty=penalty)
    solver.update(vectors)
    return solver.solve()


def closed(problem: Problem, found: Solution, vectors: Vectors) -> Solution:
    """The relaxation's point if its cones are closed, else one with a slight price on losses.

    Where even that leaves cones open, the point with the narrowest is returned.
    """
    best, width = found, widest(problem.standard, found.point)
    for penalty in PENALTIES:
        if width <= CLOSED:
            break
        with phase("conic program", f"losses priced at {penalty:g} $/MW"):
            trial = relaxation(problem, vectors, penalty)
        if trial.z is not None and widest(problem.standard, trial.z) < width:
            best, width = trial, widest(problem.standard, trial.z)
    return best


def ac_point(problem: Problem, start: Floats, vectors: Vectors, seconds: float) -> Solution:
    """The AC equations solved from `start`; a cold penalised start is tried where that fails."""
    clock = Clock(seconds)
    for penalty in (0.0, PENALTIES[0]):
        solver = NLP(problem.standard, time_limit=max(clock.left, LEAST), penalty=penalty)
        solver.update(vectors)
        if not penalty:
            solver.start_from(start)
        with phase("AC equations", "Ipopt"):
            found = solver.solve()
        if found.z is not None:
            return found
    return NOTHING


def in_one_mode(problem: Problem, found: Solution, vectors: Vectors) -> Vectors:
    """Vectors in which every mode that `found` breaks is held to the one nearest to it."""
    broken = violated(problem.standard, found.point)
    return vectors.fixed(*sides(problem.standard, found.point, broken)) if broken else vectors


def completed(problem: Problem, found: Solution, vectors: Vectors, seconds: float) -> Solution:
    """From a point of the relaxation to one that holds every mode and cone, or nothing.

    Integers are as `vectors` hold them. `seconds` limit the AC equations, if they are needed.
    """
    standard = problem.standard
    point = closed(problem, found, vectors)
    one_mode = in_one_mode(problem, point, vectors)
    if one_mode is not vectors:
        point = relaxation(problem, one_mode)
        if point.z is None:
            return NOTHING
        point = closed(problem, point, one_mode)
    if widest(standard, point.point) > CLOSED:
        point = ac_point(problem, point.point, one_mode, seconds)
    return NOTHING if point.z is None or violated(standard, point.z) else point


def socp(problem: Problem, options: Options) -> Answer:
    """Cones as u v >= sum(x^2), modes and integers relaxed: a bound, and often a plan."""
    found = root(problem, options)
    best = closed(problem, found, problem.vectors)
    return Answer.of(problem, best, found.bound, [])


def nlp(problem: Problem, options: Options) -> Answer:
    """The AC equations exactly, integers relaxed; broken modes are held to their larger side."""
    clock = Clock(options.time_limit)
    found = root(problem, options)
    start = closed(problem, found, problem.vectors)
    vectors = in_one_mode(problem, start, problem.vectors)
    polished = ac_point(problem, start.point, vectors, clock.left)
    if polished.z is None:
        raise no_plan(problem, "Ipopt", options, late=clock.left <= 0)
    return Answer.of(problem, polished, found.bound, [])
