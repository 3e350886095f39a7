"""`lp` and `milp`: HiGHS on copperplate or LinDistFlow, binaries only where they are needed."""

from __future__ import annotations

import numpy as np

from resilience.errors import UsageError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Discs, lower
from resilience.models.methods.answer import (
    Answer,
    Bools,
    Clock,
    Options,
    fractional,
    infeasible,
    nothing_found,
    remains,
    violated,
)
from resilience.models.problem import Problem
from resilience.progress import phase


def lp(problem: Problem, options: Options) -> Answer:
    """Relaxes every mode and integer, tests the answer, and adds binaries only where it fails."""
    return _solve(problem, options, np.zeros(problem.standard.n_columns, bool))


def milp(problem: Problem, options: Options) -> Answer:
    """Holds all integers from the start; modes get their binaries where the answer needs them."""
    return _solve(problem, options, problem.standard.integer.copy())


def _solve(problem: Problem, options: Options, integer: Bools) -> Answer:
    standard, clock = problem.standard, Clock(options.time_limit)
    if any(s.kind == "cone" for s in standard.structures):
        raise UsageError(
            "linear methods cannot hold the cones of distflow; allowed: copperplate, lindistflow",
            hint="use --method socp, nlp, minlp or exact with --physics distflow",
        )
    modes: dict[int, Bools] = {}
    bound, rounds = -np.inf, 0
    while True:
        with phase("linear program", f"round {rounds + 1}"):
            solver = _solver(problem, options, clock, integer, modes, "inner")
            found = _answered(solver, options, problem)
        bound = max(bound, _bound(problem, options, clock, integer, modes, solver, found))
        broken = violated(standard, found.point)
        loose = fractional(standard, found.point)
        if (not broken and not loose.any()) or clock.left <= 0:
            break
        integer |= loose
        for k, elements in broken.items():
            modes[k] = modes.get(k, np.zeros(len(elements), bool)) | elements
        rounds += 1
    return _answer(problem, found, bound, rounds, modes)


def _solver(
    problem: Problem,
    options: Options,
    clock: Clock,
    integer: Bools,
    modes: dict[int, Bools],
    discs: Discs,
) -> Highs:
    lowered = lower(problem.standard, integer=integer, exact=modes, discs=discs)
    solver = Highs(lowered, time_limit=max(clock.left, 1.0), gap=options.gap / 2)
    solver.update(problem.vectors)
    if integer[problem.standard.columns("line.closed")].any() if _switches(problem) else False:
        base = base_topology(problem, options)
        if base is not None:
            solver.start_from(base.point)
    return solver


def _switches(problem: Problem) -> bool:
    return problem.standard.has("line.closed")


def base_topology(problem: Problem, options: Options) -> Solution | None:
    """The best plan that never switches a line, or None where that is infeasible."""
    standard = problem.standard
    closed = standard.columns("line.closed")
    status = problem.x0["line.closed"][:, None] * problem.vectors.upper[closed]
    kept = problem.vectors.fixed(closed.ravel(), status.ravel())
    solver = Highs(lower(standard, exact={}), time_limit=options.time_limit / 4, gap=options.gap)
    solver.update(kept)
    found = solver.solve()
    return None if found.z is None else found


def _answered(solver: Highs, options: Options, problem: Problem) -> Solution:
    found = solver.solve()
    if found.status == "infeasible":
        raise infeasible(solver.conflict(), f"the {problem.grid.physics} model")
    if found.z is not None:
        return found
    base = base_topology(problem, options) if _switches(problem) else None
    if base is None:
        raise nothing_found("the linear method", options.time_limit)
    return Solution("feasible", base.z, base.objective, found.bound)


def _bound(
    problem: Problem,
    options: Options,
    clock: Clock,
    integer: Bools,
    modes: dict[int, Bools],
    solver: Highs,
    found: Solution,
) -> float:
    """A bound for the model itself: where polygons stand for discs, around them, not within."""
    if not len(solver.lowered.disc_rows):
        return solver.certified_bound(found) if not solver.is_mip else found.bound
    if solver.is_mip:
        outer = _solver(problem, options, clock, integer, modes, "outer")
        return outer.solve().bound
    solver.lowered.discs = "outer"
    solver.update(problem.vectors)
    return solver.certified_bound(solver.solve())


def _answer(
    problem: Problem, found: Solution, bound: float, rounds: int, modes: dict[int, Bools]
) -> Answer:
    notes = []
    if modes:
        count = sum(int(elements.sum()) for elements in modes.values())
        notes.append(f"{count} mode binaries were needed, added in {rounds} rounds")
    if found.status == "feasible":
        notes.append("the time limit ended the search; this is the best plan found")
    return Answer(
        status=found.status,
        z=found.point,
        objective=found.objective,
        bound=bound,
        bound_of=problem.grid.physics,
        relaxed=remains(problem.standard, found.point),
        notes=notes,
    )
