"""Solves the two-stage program of a case: the algorithm, modes to keep to, what it is worth."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.methods.answer import Deadline
from resilience.models.program.gate import gap, status_of
from resilience.models.structures import Cone
from resilience.planning.scenarios.program import ScenarioProgram, scenario_program
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import (
    DecompositionOptions,
    Machinery,
    TwoStageSolution,
    lshaped,
)
from resilience.planning.two_stage.master import Master
from resilience.planning.two_stage.modes import ModeSearch, with_modes_held
from resilience.planning.two_stage.recourse import Recourse
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase
from resilience.tolerances import SCENARIO_GAP

MAX_SCENARIOS_EXTENSIVE = 50  # different ones; below, the extensive form is faster
MAX_COLUMNS_EXTENSIVE = 20_000  # beyond, cutting is faster even with few scenarios
ALGORITHMS = {"extensive": extensive, "lshaped": lshaped}
TITLES = {"extensive": "extensive form", "lshaped": "L-shaped method"}


@dataclass(frozen=True)
class ScenarioResult:
    """A two-stage program of a case, solved.

    Attributes:
        solution: the plan; its bound holds for the program with modes and integers relaxed, so
            for the whole of it too.
        algorithm: extensive or lshaped.
        late: whether the time limit ended the search.
        mean_value_cost: $ of the risk, where the trunk is that of the plan for mean data; None
            where there is no such trunk.
        stochastic_cost: $ of the same for the best trunk, modes relaxed as in `mean_value_cost`.
    """

    solution: TwoStageSolution
    algorithm: str
    late: bool
    mean_value_cost: float | None
    stochastic_cost: float

    @property
    def value_of_stochastic_solution(self) -> float | None:
        """What the plan for the mean costs more, $; None where it is undefined.

        Both costs are within a gap only: where it makes no difference, their own may be negative.
        """
        return None if self.mean_value_cost is None else self.mean_value_cost - self.stochastic_cost


def solve_scenario_program(
    program: ScenarioProgram,
    *,
    algorithm: str | None = None,
    relative_gap: float = SCENARIO_GAP,
    time_limit: float = np.inf,
) -> ScenarioResult:
    """The best trunk and its recourse.

    Args:
        program: what to solve.
        algorithm: extensive or lshaped; by the number of scenarios and the size if omitted.
        relative_gap: gap at which to stop.
        time_limit: seconds for the search.

    Raises:
        InfeasibleError: there is no plan; what conflicts is named, with its scenario.
        SolverError: a solver failed.
        CertificateError: a plan costs less than what is proven.
        UsageError: unknown algorithm, or physics with cones.
    """
    two_stage, deadline = program.two_stage, Deadline(time_limit)
    algorithm = _algorithm(program, algorithm)
    with phase("mean-value plan"):
        start = program.mean_states()
    options = DecompositionOptions(
        relative_gap,
        deadline.remaining_s,
        os.cpu_count() or 1,
        start,
        total_time_limit=time_limit,
    )
    search = ModeSearch(two_stage, ALGORITHMS[algorithm], options, deadline)
    if algorithm == "lshaped":
        search.machinery = Machinery.without_cuts(two_stage, options)
        relaxed = lshaped(two_stage, options, search.machinery)
    else:
        relaxed = extensive(two_stage, options)
    has_integers = bool(two_stage.first.integer.any())
    mean_cost = None if has_integers else relaxed.start_cost
    if mean_cost is None and start is not None and not has_integers:
        with phase("mean-value plan", "its recourse"):
            mean_cost = costs_of(two_stage, start)
    solution = with_modes_held(search, relaxed)
    # The bound is the relaxed program's, since holding modes narrows it.
    bound, scale = relaxed.bound, two_stage.cost_scale
    status = status_of(gap(solution.objective, bound, scale), relative_gap)
    mean_value_cost = None
    if mean_cost is not None:
        mean_value_cost = two_stage.risk.value(mean_cost, relaxed.probability)
        gap(mean_value_cost, bound, scale)  # nor may this plan be cheaper than what is proven
    return ScenarioResult(
        solution=replace(solution, bound=bound, status=status),
        algorithm=algorithm,
        late=deadline.remaining_s <= 0,
        mean_value_cost=mean_value_cost,
        stochastic_cost=relaxed.objective,
    )


def wait_and_see(program: ScenarioProgram) -> Floats:
    """(distinct scenarios,) proven bounds in $ on what each costs, known from the start.

    Raises:
        CertificateError: a plan costs less.
    """
    two_stage = scenario_program(program.microgrid, program.distinct, common_slots=0).two_stage
    x0 = np.concatenate([np.empty(0), *(two_stage.x0[name] for name in two_stage.first.initial)])
    starts = np.tile(x0, (len(two_stage.branches), 1))
    with phase("clairvoyant bound"):
        second = Recourse(two_stage, workers=os.cpu_count() or 1).solve(starts)
    bounds = second.alpha + second.beta @ x0
    for cost, bound in zip(second.cost, bounds, strict=True):
        gap(float(cost), float(bound), two_stage.cost_scale)
    return bounds


def costs_of(two_stage: TwoStage, states: Floats) -> Floats | None:
    """(scenarios,) $ with a trunk that passes through states (trunk nodes, states), if it can."""
    trial = Master(two_stage).trunk_through(states)
    if trial is None:
        return None
    cost = trial.spent.copy()
    cost[:-1] += Recourse(two_stage, workers=os.cpu_count() or 1).solve(trial.states).cost
    return cost


def _algorithm(program: ScenarioProgram, request: str | None) -> str:
    """The algorithm that a user asks for, or that suits the size."""
    two_stage = program.two_stage
    if two_stage.first.structures_of(Cone):
        raise UsageError(
            "two-stage programs are linear and cannot hold the cones of distflow; "
            "allowed: copperplate, lindistflow",
            hint="certify the plan by AC power flow afterwards",
        )
    if request is not None and request not in ALGORITHMS:
        raise UsageError(
            f"algorithm {request!r} is unknown; allowed: {', '.join(ALGORITHMS)}",
            hint="leave it out: the number of scenarios decides",
        )
    columns = two_stage.tree.n * two_stage.first.form.n_own
    few = program.distinct.n < MAX_SCENARIOS_EXTENSIVE
    is_small = few and (columns <= MAX_COLUMNS_EXTENSIVE or bool(two_stage.first.integer.any()))
    return request or ("extensive" if is_small else "lshaped")
