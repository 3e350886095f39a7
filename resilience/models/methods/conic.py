"""`socp` and `nlp`: the cone relaxation with its bound, and the AC equations from its point."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    Deadline,
    MethodOptions,
    MethodResult,
    broken_modes,
    idle_columns,
    is_off_ac,
    worst_violation,
)
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.large import (
    LONG_COLUMNS,
    exceeded_discs,
    first_bounds,
    first_discs,
    with_discs,
)
from resilience.models.methods.powers import with_powers_held
from resilience.models.methods.units import RescaledStandard
from resilience.models.program.gate import cost_scale, gap
from resilience.models.program.standard import Vectors
from resilience.progress import phase
from resilience.tolerances import NLP_TOLERANCE, RELAXATION_TOLERANCE

PENALTIES = (1e-3, 1e-2)  # $ per MW of loss and slot, tried until the cones are closed
CLOSED_AT_A_PRICE = "cones were closed by a price on losses, which costs more than the bound"
FINEST = 1e-11  # that Ipopt can miss rows by
MAX_CUT_ROUNDS = 30
CUT_SHARE = 0.3  # of the time limit, for rows on loops
CUT_GAIN = 0.1  # of the gap wanted, by which a round has to raise the bound
CUT_PATIENCE = 2  # rounds in a row that may raise it by less
LOCAL = "Ipopt finds a local optimum, and the bound is that of the relaxation; minlp searches on"


def root(program: CaseProgram, options: MethodOptions, deadline: Deadline) -> Solution:
    """The SOCP with modes and integers relaxed, and its proven bound.

    Raises:
        InfeasibleError: naming what is in conflict.
        SolverError: Clarabel gave up, or found no time.
    """
    with phase("conic relaxation"):
        solution = relaxation(program, program.vectors, seconds=deadline.final_s)
    if solution.status == "infeasible":
        raise infeasible(program)
    if solution.z is None:
        raise no_plan(program, "the conic relaxation", options, late=deadline.late)
    return solution


def tightened(
    program: CaseProgram,
    solution: Solution,
    options: MethodOptions,
    deadline: Deadline,
    enough: Callable[[float], bool] = lambda bound: False,
) -> Solution:
    """The relaxation with rows on cliques of loops, as long as they raise the bound.

    Where the solver fails on the last of them they are taken back. Without loops nothing changes.

    Args:
        program: what is relaxed.
        solution: without rows, or with those found so far.
        options: says by how much a round has to raise the bound.
        deadline: a share of it is spent.
        enough: whether a bound is high enough.
    """
    cliques, bound, idle = program.cliques, solution.bound, 0
    if cliques is None:
        return solution
    until_s = deadline.spent_s + CUT_SHARE * deadline.remaining_s
    for k in range(MAX_CUT_ROUNDS):
        before = cliques.rows, cliques.idle
        if enough(bound) or idle == CUT_PATIENCE:
            break
        if cliques.separate(solution.point, RELAXATION_TOLERANCE) < RELAXATION_TOLERANCE:
            break
        with phase("conic relaxation", f"{len(cliques.rows[1])} rows on loops, round {k + 1}"):
            seconds = until_s - deadline.spent_s
            tighter = relaxation(program, program.vectors, seconds=seconds)
        bound = max(bound, tighter.bound)
        if tighter.z is None:
            cliques.rows, cliques.idle = before
            break
        gain = gap(bound, solution.bound, cost_scale(program.vectors))
        idle = idle + 1 if gain < CUT_GAIN * options.gap else 0
        solution = replace(tighter, bound=bound)
    return solution


def relaxation(
    program: CaseProgram,
    vectors: Vectors,
    *,
    seconds: float = np.inf,
    penalty: float = 0.0,
    discs: Mapping[int, Bools] | None = None,
) -> Solution:
    """The SOCP for these vectors; a price on losses closes cones but voids the bound.

    Nothing where no seconds are left for it. `discs` are those held at first, see `large`.
    """
    standard, until_s = program.standard, time.perf_counter() + seconds
    discs = first_discs(standard) if discs is None else discs
    boxed, best = first_bounds(standard), NOTHING
    while (remaining_s := until_s - time.perf_counter()) > 0.0:
        solver = Conic(standard, penalty=penalty, time_limit=remaining_s, discs=discs, boxed=boxed)
        solver.update(vectors)
        if program.cliques is not None:
            solver.add_rows(*program.cliques.rows)
        solution = solver.solve()
        if not boxed.all() and (solver.is_beyond or solution == NOTHING):
            boxed = np.ones_like(boxed)
            continue
        if solution.z is None:
            return replace(solution, bound=max(solution.bound, best.bound))
        exceeded = exceeded_discs(standard, solution.z, discs)
        if not exceeded:
            return solution
        discs, best = with_discs(discs, exceeded), solution
    # Time is up: the last point stands outside of ratings, which its audit says.
    return best


def with_cones_closed(
    program: CaseProgram, relaxed: Solution, vectors: Vectors, seconds: Callable[[], float]
) -> Solution:
    """The relaxation's point if its cones are closed, else one with a slight price on losses.

    Where even that leaves cones open, the point whose cones are least open is returned.

    Args:
        program: what it is a point of.
        relaxed: the relaxation's solution for `vectors`.
        vectors: the numbers.
        seconds: says how many are left.
    """
    best, width = relaxed, worst_violation(program.standard, relaxed.point)
    for penalty in PENALTIES:
        if width <= RELAXATION_TOLERANCE:
            break
        with phase("conic program", f"losses priced at {penalty:g} $/MW"):
            trial = relaxation(program, vectors, seconds=seconds(), penalty=penalty)
        if trial.z is not None and worst_violation(program.standard, trial.z) < width:
            best, width = trial, worst_violation(program.standard, trial.z)
    return best


def ac_point(
    program: CaseProgram, start: Floats, vectors: Vectors, seconds: Callable[[], float]
) -> Solution:
    """The AC equations solved from `start`; a cold penalised start is tried where that fails."""
    if program.cliques is not None:
        # No equation knows the fill.
        vectors = vectors.fixed(program.cliques.fill, start[program.cliques.fill])
    for penalty in (0.0, PENALTIES[0]):
        time_limit = seconds()
        if time_limit <= 0.0:
            break
        solver = NLP(
            program.standard,
            time_limit=time_limit,
            penalty=penalty,
            tolerance=_row_tolerance(program),
        )
        solver.update(vectors)
        if not penalty:
            solver.start_from(start)
        with phase("AC equations", "Ipopt"):
            solution = solver.solve()
        if solution.z is not None:
            return solution
    return NOTHING


def _row_tolerance(program: CaseProgram) -> float:
    """What rows may be missed by: products of powers are larger in MW by the square of the base."""
    standard = program.standard
    base_mw = standard.base_mw if isinstance(standard, RescaledStandard) else 1.0
    return max(NLP_TOLERANCE / max(base_mw, 1.0) ** 2, FINEST)


def with_modes_held(program: CaseProgram, solution: Solution, vectors: Vectors) -> Vectors:
    """Vectors in which every mode that a solution breaks is held to the one nearest to it."""
    standard = program.standard
    broken = broken_modes(standard, solution.point)
    return vectors.fixed(*idle_columns(standard, solution.point, broken)) if broken else vectors


def _narrowed(
    program: CaseProgram, solution: Solution, vectors: Vectors, seconds: Callable[[], float]
) -> Solution:
    """A point of the relaxation within narrower bounds, cones closed as far as they can be."""
    if program.standard.n_columns >= LONG_COLUMNS:
        same = with_powers_held(program, solution, vectors, seconds())
        if same.z is not None:
            return same
    relaxed = relaxation(program, vectors, seconds=seconds())
    if relaxed.z is None:
        return relaxed
    return with_cones_closed(program, relaxed, vectors, seconds)


def with_all_held(
    program: CaseProgram, relaxed: Solution, vectors: Vectors, seconds: Callable[[], float]
) -> Solution:
    """From a point of the relaxation to one that holds every mode and cone, or nothing.

    Integers are as `vectors` hold them; `seconds` says how many are left. The AC equations may
    break modes that the relaxation keeps: where cones are open, losses use up what is too much, and
    where they are closed, a storage in two modes does. So each is held as soon as it is broken.
    """
    standard, narrowed = program.standard, vectors
    solution = with_cones_closed(program, relaxed, vectors, seconds)
    while solution.z is not None:
        one_mode = with_modes_held(program, solution, narrowed)
        if one_mode is not narrowed:
            narrowed = one_mode
            solution = _narrowed(program, solution, narrowed, seconds)
        elif is_off_ac(standard, solution.point):
            solution = ac_point(program, solution.point, narrowed, seconds)
        else:
            return solution
    return NOTHING


def socp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Cones as u v >= sum(x^2), modes and integers relaxed: a bound, and often a plan."""
    deadline = options.deadline()
    relaxed = tightened(program, root(program, options, deadline), options, deadline)
    best = with_cones_closed(program, relaxed, program.vectors, lambda: deadline.remaining_s)
    return MethodResult.from_solution(program, best, relaxed.bound, options.gap, CLOSED_AT_A_PRICE)


def nlp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """The AC equations exactly, integers relaxed; broken modes are held to their larger side."""
    deadline = options.deadline()
    relaxed = root(program, options, deadline)
    point = _ac_plan(program, relaxed, deadline)
    scale = cost_scale(program.vectors)

    def enough(bound: float) -> bool:
        return gap(point.objective, bound, scale) <= options.gap

    tighter = tightened(program, relaxed, options, deadline, enough)
    if tighter is not relaxed and not enough(tighter.bound):
        point = min(point, _ac_plan(program, tighter, deadline), key=lambda plan: plan.objective)
    if point.z is None:
        raise no_plan(program, "Ipopt", options, late=deadline.late)
    return MethodResult.from_solution(program, point, tighter.bound, options.gap, LOCAL)


def _ac_plan(program: CaseProgram, relaxed: Solution, deadline: Deadline) -> Solution:
    """From a point of the relaxation to one of the AC equations that keeps modes, or nothing.

    Of a large program that is as near to them as the relaxation itself can come, if it can.
    """
    if program.standard.n_columns >= LONG_COLUMNS:
        return with_all_held(program, relaxed, program.vectors, lambda: deadline.final_s)
    start = with_cones_closed(program, relaxed, program.vectors, lambda: deadline.remaining_s)
    point, vectors = start, with_modes_held(program, start, program.vectors)
    while point.z is not None:
        point = ac_point(program, point.point, vectors, lambda: deadline.final_s)
        if point.z is None:
            break
        before, vectors = vectors, with_modes_held(program, point, vectors)
        if vectors is before:
            break
    return point
