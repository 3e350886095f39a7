"""Modes that a relaxed two-stage plan breaks, each held to its larger side.

Of a decomposed program they are first held behind the trunk as it is: only branches that break some
are solved again, until none does. The trunk is searched anew, with all that is held by then, only
where it breaks modes itself, or where what comes of it is further from the bound than is wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError
from resilience.models.backends.base import OutOfTimeError
from resilience.models.methods.answer import (
    Deadline,
    broken_modes,
    idle_columns,
    worst_violation,
)
from resilience.models.program.gate import gap, status_of
from resilience.models.program.standard import Standard
from resilience.models.structures import Disc
from resilience.planning.two_stage.lshaped import (
    DecompositionOptions,
    Machinery,
    TwoStageSolution,
)
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

SEARCHES = 3  # for a trunk, as long as modes are broken
ROUNDS_BEHIND = 12  # behind one trunk; holding a mode may break that of the next step
TRUNK = -1
"""Number of the trunk among the pieces of a plan, where branches have theirs."""


@dataclass
class ModeSearch:
    """What is held so far.

    Attributes:
        two_stage: the program.
        solve: solves it, by the algorithm chosen.
        options: of the relaxed search.
        deadline: when time is up.
        machinery: of the relaxed search, where it was decomposed.
        idle: by the number of a branch, or `TRUNK`, columns of its program at zero.
    """

    two_stage: TwoStage
    solve: Callable[[TwoStage, DecompositionOptions], TwoStageSolution]
    options: DecompositionOptions
    deadline: Deadline
    machinery: Machinery | None = None
    idle: dict[int, Ints] = field(default_factory=dict)

    def hold(self, columns: dict[int, Ints]) -> None:
        """Holds more columns, by the number of the piece."""
        for k, more in columns.items():
            self.idle[k] = np.concatenate([self.idle.get(k, np.empty(0, np.intp)), more])

    @property
    def idle_branches(self) -> dict[int, Ints]:
        """What is held in branches alone."""
        return {k: columns for k, columns in self.idle.items() if k != TRUNK}

    def narrower(self, solution: TwoStageSolution) -> DecompositionOptions:
        """How to search for a trunk that keeps to what is held, beginning from this one."""
        two_stage = self.two_stage
        ends = [two_stage.first.state_columns(node) for node in range(two_stage.trunk)]
        return replace(
            self.options,
            time_limit=self.deadline.final_s,
            start=solution.trunk[np.array(ends, np.intp)],
            discs="inner",
            idle_trunk=self.idle.get(TRUNK, np.empty(0, np.intp)),
            idle_branches=self.idle_branches,
        )

    def gap_to(self, bound: float, solution: TwoStageSolution) -> float:
        """Relative gap of a plan."""
        return gap(solution.objective, bound, self.two_stage.cost_scale)


def with_modes_held(search: ModeSearch, relaxed: TwoStageSolution) -> TwoStageSolution:
    """The plan with every mode that it broke held to its larger side, and polygons within discs
    where one was exceeded; as it was where that cannot be.
    """
    solution, best = relaxed, None
    for k in range(SEARCHES):
        broken, is_wide = _broken(search.two_stage, solution)
        if not (broken or is_wide):
            return min(solution, best or solution, key=lambda plan: plan.objective)
        if search.machinery is not None and not is_wide and TRUNK not in broken:
            with phase("modes", f"round {k + 1}, the same first stage"):
                lawful = _held_behind(search, search.machinery, solution, broken)
            if best is not None and (lawful is None or lawful.objective >= best.objective):
                return best
            best = lawful or best
            if best is not None and search.gap_to(relaxed.bound, best) <= search.options.gap:
                return best
        search.hold(broken)
        try:
            with phase("modes", f"round {k + 1}"):
                solution = search.solve(search.two_stage, search.narrower(solution))
        except (InfeasibleError, OutOfTimeError):
            return best or relaxed
    return best or solution


def _held_behind(
    search: ModeSearch,
    machinery: Machinery,
    solution: TwoStageSolution,
    broken: dict[int, Ints],
) -> TwoStageSolution | None:
    """The same trunk with branches that break no mode; None where they cannot, or do in the end."""
    two_stage, recourse = search.two_stage, machinery.recourse
    trial = machinery.master.trial_of(solution.trunk)
    points, cost = list(solution.points), solution.cost.copy()
    recourse.seconds = lambda: search.deadline.final_s
    for _ in range(ROUNDS_BEHIND):
        search.hold(broken)
        recourse.hold(search.idle_branches)
        try:
            second = recourse.solve(trial.states, sorted(broken))
        except (InfeasibleError, OutOfTimeError):
            return None
        for k, value, point in zip(sorted(broken), second.cost, second.points, strict=True):
            cost[k], points[k] = trial.spent[k] + value, point
        broken = _idle_of(_branches(two_stage, points, broken))
        if not broken:
            objective = two_stage.risk.value(cost, solution.probability)
            lawful = replace(solution, points=points, cost=cost, objective=objective)
            reached = search.gap_to(solution.bound, lawful)
            return replace(lawful, status=status_of(reached, search.options.gap))
    return None


def _broken(two_stage: TwoStage, solution: TwoStageSolution) -> tuple[dict[int, Ints], bool]:
    """By the number of a piece, columns that hold what it breaks; whether any exceeds a disc."""
    n = len(two_stage.branches)
    pieces = {TRUNK: (two_stage.first, solution.trunk)}
    pieces |= _branches(two_stage, solution.points, range(n))
    is_wide = any(worst_violation(p, z, Disc) > RELAXATION_TOLERANCE for p, z in pieces.values())
    return _idle_of(pieces), is_wide


def _branches(
    two_stage: TwoStage, points: list[Floats], numbers: Iterable[int]
) -> dict[int, tuple[Standard, Floats]]:
    """Some branches by their number, with what each is a point of."""
    return {k: (two_stage.programs[two_stage.branches[k].program], points[k]) for k in numbers}


def _idle_of(pieces: dict[int, tuple[Standard, Floats]]) -> dict[int, Ints]:
    """Columns to hold at zero in those that break a mode."""
    return {
        k: idle_columns(problem, z, elements)[0]
        for k, (problem, z) in pieces.items()
        if (elements := broken_modes(problem, z))
    }
