"""`exact`: SCIP on everything at once, convex first, nonconvex only where that is not enough."""

from __future__ import annotations

import importlib.util

from resilience.errors import UsageError
from resilience.models.backends.base import Solution
from resilience.models.backends.pyomo import Cones, Pyomo
from resilience.models.methods.answer import (
    CLOSED,
    Answer,
    Clock,
    Options,
    infeasible,
    nothing_found,
    remains,
)
from resilience.models.methods.conic import _width
from resilience.models.problem import Problem
from resilience.progress import phase


def exact(problem: Problem, options: Options) -> Answer:
    """SCIP with cones as u v >= sum(x^2); if its optimum closes them it is the optimum of the AC
    model too. Otherwise SCIP again with equality, which is global but slow.

    Raises:
        UsageError: the extra `exact` (PySCIPOpt) is not installed.
    """
    if importlib.util.find_spec("pyscipopt") is None:
        raise UsageError(
            "method 'exact' needs SCIP, which is not installed",
            hint='pip install "resilience[exact]"',
        )
    clock = Clock(options.time_limit)
    with phase("SCIP", "convex relaxation"):
        found = _scip(problem, options, clock, "relaxed")
    bound = found.bound
    if found.z is not None and _width(problem, found) > CLOSED and clock.left > 0:
        with phase("SCIP", "AC equations"):
            strict = _scip(problem, options, clock, "equal")
        if strict.z is not None:
            found, bound = strict, max(bound, strict.bound)
    if found.z is None:
        raise nothing_found("SCIP", options.time_limit)
    return Answer(
        status=found.status,
        z=found.point,
        objective=found.objective,
        bound=bound,
        bound_of=problem.grid.physics,
        relaxed=remains(problem.standard, found.point),
        notes=["the time limit ended the search"] if found.status == "feasible" else [],
    )


def _scip(problem: Problem, options: Options, clock: Clock, cones: Cones) -> Solution:
    solver = Pyomo(
        problem.standard,
        solver="scip",
        cones=cones,
        time_limit=max(clock.left, 1.0),
        gap=min(options.gap, 1e-5),
    )
    solver.update(problem.vectors)
    found = solver.solve()
    if found.status == "infeasible":
        raise infeasible([], f"the {problem.grid.physics} model")
    return found
