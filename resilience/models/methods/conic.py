"""`socp` and `nlp`: the cone relaxation with its bound, and the AC equations from its point."""

from __future__ import annotations

import numpy as np

from resilience.models.algebra import Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.cvxpy import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.methods.answer import (
    CLOSED,
    Answer,
    Clock,
    Options,
    infeasible,
    nothing_found,
    open_cones,
    remains,
    sides,
    violated,
)
from resilience.models.problem import Problem
from resilience.models.standard import Vectors
from resilience.progress import phase

PENALTIES = (1e-3, 1e-2)  # $ per MW of loss and slot, tried until the cones are closed


def relaxation(problem: Problem, vectors: Vectors | None = None) -> Solution:
    """The SOCP with its proven bound.

    Raises:
        InfeasibleError: naming what is in conflict.
    """
    solver = Conic(problem.standard)
    solver.update(vectors or problem.vectors)
    found = solver.solve()
    if found.status == "infeasible" and vectors is None:
        raise infeasible(_conflict(problem, solver), f"the {problem.grid.physics} model")
    return found


def _conflict(problem: Problem, solver: Conic) -> list[str]:
    linear = Highs(lower(problem.standard, integer=np.zeros(len(solver.vectors.cost), bool)))
    linear.update(solver.vectors)
    if linear.solve().status == "infeasible":
        return linear.conflict()
    return solver.conflict()


def closed(problem: Problem, found: Solution, vectors: Vectors | None = None) -> Solution:
    """The relaxation's point if its cones are closed, else one with a slight price on losses.

    Where even that leaves cones open, the point with the narrowest is returned.
    """
    best, width = found, _width(problem, found)
    for penalty in PENALTIES:
        if width <= CLOSED:
            break
        with phase("conic program", f"losses priced at {penalty:g} $/MW"):
            solver = Conic(problem.standard, penalty=penalty)
            solver.update(vectors or problem.vectors)
            trial = solver.solve()
        if trial.z is not None and _width(problem, trial) < width:
            best, width = trial, _width(problem, trial)
    return best


def _width(problem: Problem, found: Solution) -> float:
    gaps = open_cones(problem.standard, found.point).values()
    return max((float(g.max(initial=0.0)) for g in gaps), default=0.0)


def ac_point(problem: Problem, start: Floats, vectors: Vectors, time_limit: float) -> Solution:
    """The AC equations solved from `start`; a cold penalised start is tried where that fails."""
    for penalty in (0.0, PENALTIES[0]):
        solver = NLP(problem.standard, time_limit=time_limit, penalty=penalty)
        solver.update(vectors)
        if not penalty:
            solver.start_from(start)
        found = solver.solve()
        if found.z is not None:
            return found
    return NOTHING


def in_one_mode(problem: Problem, found: Solution, vectors: Vectors) -> Vectors:
    """Vectors in which every split that `found` breaks is held to its larger side."""
    broken = violated(problem.standard, found.point)
    return vectors.fixed(*sides(problem.standard, found.point, broken)) if broken else vectors


def socp(problem: Problem, options: Options) -> Answer:
    """Cones as u v >= sum(x^2), modes and integers relaxed: a bound, and often a plan."""
    with phase("conic relaxation"):
        found = relaxation(problem)
    if found.z is None:
        raise nothing_found("the conic relaxation", options.time_limit)
    best = closed(problem, found)
    return _answer(problem, best, found.bound)


def nlp(problem: Problem, options: Options) -> Answer:
    """The AC equations exactly, integers relaxed; broken modes are held to their larger side."""
    clock = Clock(options.time_limit)
    with phase("conic relaxation"):
        found = relaxation(problem)
    if found.z is None:
        raise nothing_found("the conic relaxation", options.time_limit)
    start = closed(problem, found)
    vectors = in_one_mode(problem, start, problem.vectors)
    with phase("AC equations", "Ipopt"):
        polished = ac_point(problem, start.point, vectors, clock.left)
    if polished.z is None:
        raise nothing_found("Ipopt", options.time_limit)
    return _answer(problem, polished, found.bound)


def _answer(problem: Problem, found: Solution, bound: float) -> Answer:
    relaxed = remains(problem.standard, found.point)
    return Answer(
        status="optimal" if found.status == "optimal" else "feasible",
        z=found.point,
        objective=found.objective,
        bound=bound,
        bound_of=problem.grid.physics,
        relaxed=relaxed,
    )
