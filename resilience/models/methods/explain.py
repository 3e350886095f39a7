"""Why there is no plan: the names of the rows and slots that conflict."""

from __future__ import annotations

from collections.abc import Sequence

from resilience.errors import InfeasibleError, ResilienceError, SolverError
from resilience.models.backends.cvxpy import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.methods.answer import Options
from resilience.models.problem import Problem

SECONDS = 10.0  # for each of the two searches
SHOWN = 8


def infeasible(problem: Problem, names: Sequence[str] = ()) -> InfeasibleError:
    """The error for a problem that is known to have no plan, `names` being in conflict."""
    return _named(problem, names or _linear_conflict(problem) or _conic_conflict(problem))


def no_plan(problem: Problem, what: str, options: Options) -> ResilienceError:
    """The error where `what` found nothing: infeasible if that can be proven, else out of time."""
    names = _linear_conflict(problem)
    if names:
        return _named(problem, names)
    return SolverError(
        f"{what} found no plan within {options.time_limit:g} s",
        hint="raise --time-limit or use --method lp",
    )


def _named(problem: Problem, names: Sequence[str]) -> InfeasibleError:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    shown = ", ".join(names[:SHOWN]) + more or "no small set of rows could be named"
    return InfeasibleError(
        f"no plan satisfies the {problem.grid.physics} model; in conflict: {shown}",
        hint="make PV curtailable, widen the voltage band, or free a limit of the devices named",
    )


def _linear_conflict(problem: Problem) -> list[str]:
    """What conflicts without the cones: all relaxed, else with integers and modes held."""
    standard = problem.standard
    relaxed = lower(standard, integer=standard.integer & False, exact={}, discs="outer")
    for lowered in (relaxed, lower(standard, discs="outer")):
        solver = Highs(lowered, time_limit=SECONDS)
        solver.update(problem.vectors)
        if solver.solve().status == "infeasible":
            return solver.conflict()
    return []


def _conic_conflict(problem: Problem) -> list[str]:
    solver = Conic(problem.standard)
    solver.update(problem.vectors)
    return solver.conflict()
