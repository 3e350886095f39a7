"""Solves the two-stage program of a case: the algorithm, modes to keep to, what it is worth."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError, UsageError
from resilience.models.backends.base import Status
from resilience.models.methods.answer import (
    Deadline,
    broken_facts,
    broken_modes,
    gap,
    idle_columns,
    worst_violation,
)
from resilience.models.program.standard import Standard
from resilience.models.structures import Cone, Disc
from resilience.planning.scenario_program import ScenarioProgram, scenario_program
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import DecompositionOptions, TwoStageSolution, lshaped
from resilience.planning.two_stage.master import Master
from resilience.planning.two_stage.recourse import Recourse
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE, SCENARIO_GAP

FEW_STORMS = 50
FEW_COLUMNS = 20_000  # of the extensive form; beyond, cutting is faster even with few scenarios
MODE_ROUNDS = 3
ALGORITHMS = {"extensive": extensive, "lshaped": lshaped}
TITLES = {"extensive": "extensive form", "lshaped": "L-shaped method"}


@dataclass(frozen=True)
class ScenarioResult:
    """A two-stage program of a case, solved.

    Attributes:
        solved: the plan; its bound holds for the program with modes and integers relaxed, so for
            the whole of it too.
        algorithm: extensive or lshaped.
        relaxed: facts of the model that the plan does not satisfy, in words.
        mean_value: $ of the risk, where the trunk is that of the plan for mean data; None where
            there is no such trunk.
        stochastic: $ of the same for the best trunk, modes relaxed as in `mean_value`.
    """

    solved: TwoStageSolution
    algorithm: str
    relaxed: list[str] = field(default_factory=list)
    mean_value: float | None = None
    stochastic: float = np.nan


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
        algorithm: extensive or lshaped; by the number of storms and the size if omitted.
        relative_gap: gap at which to stop.
        time_limit: seconds for the search.

    Raises:
        InfeasibleError: there is no plan; what conflicts is named, with its scenario.
        SolverError: a solver failed.
        UsageError: unknown algorithm, or physics with cones.
    """
    two, clock = program.two, Deadline(time_limit)
    algorithm = _algorithm(program, algorithm)
    with phase("mean-value plan"):
        start = program.mean_states()
    options = DecompositionOptions(relative_gap, time_limit, os.cpu_count() or 1, start)
    first = ALGORITHMS[algorithm](two, options)
    integers = bool(two.first.integer.any())
    mean_cost = None if integers else first.start_cost
    if mean_cost is None and start is not None and not integers:
        with phase("mean-value plan", "its recourse"):
            mean_cost = costs_of(two, start)
    kept = _kept(two, first, algorithm, options, clock)
    found = replace(kept, bound=min(first.bound, kept.objective))
    closed = gap(found.objective, found.bound) <= relative_gap
    status: Status = "optimal" if closed else "feasible"
    return ScenarioResult(
        replace(found, status=status),
        algorithm,
        _left(two, found),
        None if mean_cost is None else two.risk.of(mean_cost, first.probability),
        first.objective,
    )


def wait_and_see(program: ScenarioProgram) -> Floats:
    """(storms,) proven bounds in $ on what each costs if it is known from the start."""
    apart = scenario_program(program.microgrid, program.storms, common_slots=0)
    two = apart.two
    x0 = np.concatenate([np.empty(0), *(two.x0[name] for name in two.first.initial)])
    with phase("clairvoyant bound"):
        second = Recourse(two, workers=os.cpu_count() or 1).at(np.tile(x0, (len(two.chains), 1)))
    return np.minimum(second.alpha + second.beta @ x0, second.cost)


def costs_of(two: TwoStage, states: Floats) -> Floats | None:
    """(scenarios,) $ with a trunk that passes through states (trunk nodes, states), if it can."""
    trial = Master(two).held_at(states)
    if trial is None:
        return None
    cost = trial.spent.copy()
    cost[:-1] += Recourse(two, workers=os.cpu_count() or 1).at(trial.states).cost
    return cost


def _algorithm(program: ScenarioProgram, wanted: str | None) -> str:
    two = program.two
    if two.first.structures_of(Cone):
        raise UsageError(
            "two-stage programs are linear and cannot hold the cones of distflow; "
            "allowed: copperplate, lindistflow",
            hint="certify the plan by AC power flow afterwards",
        )
    if wanted is not None and wanted not in ALGORITHMS:
        raise UsageError(
            f"algorithm {wanted!r} is unknown; allowed: {', '.join(ALGORITHMS)}",
            hint="leave it out: the number of scenarios decides",
        )
    columns = two.tree.n * two.first.forms[0].n_own
    few = program.storms.n < FEW_STORMS
    small = few and (columns <= FEW_COLUMNS or bool(two.first.integer.any()))
    return wanted or ("extensive" if small else "lshaped")


def _kept(
    two: TwoStage,
    found: TwoStageSolution,
    algorithm: str,
    options: DecompositionOptions,
    clock: Deadline,
) -> TwoStageSolution:
    """The plan with every mode that it broke held to its larger side, and polygons within discs
    where one was exceeded; as it was where that cannot be.
    """
    begun = found
    held: list[Ints] = []
    holds: dict[int, list[Ints]] = {}
    for k in range(MODE_ROUNDS):
        broken, wide = False, False
        for chain, (problem, z) in _pieces(two, found).items():
            elements = broken_modes(problem, z)
            wide = wide or worst_violation(problem, z, Disc) > RELAXATION_TOLERANCE
            if elements:
                broken = True
                (held if chain < 0 else holds.setdefault(chain, [])).append(
                    idle_columns(problem, z, elements)[0]
                )
        if not (broken or wide):
            return found
        ends = [two.first.state_columns(node) for node in range(two.trunk)]
        again = replace(
            options,
            time_limit=max(clock.remaining_s, 1.0),
            start=found.trunk[np.array(ends, np.intp)],
            discs="inner",
            held=np.concatenate([np.empty(0, np.intp), *held]),
            holds={chain: np.concatenate(at) for chain, at in holds.items()},
        )
        try:
            with phase("modes", f"round {k + 1}"):
                found = ALGORITHMS[algorithm](two, again)
        except InfeasibleError:
            return begun
    return found


def _pieces(two: TwoStage, found: TwoStageSolution) -> dict[int, tuple[Standard, Floats]]:
    """The trunk as -1 and every chain by its number, with what it is a point of."""
    pieces = {-1: (two.first, found.trunk)}
    for k, (chain, z) in enumerate(zip(two.chains, found.points, strict=True)):
        pieces[k] = two.programs[chain.program], z
    return pieces


def _left(two: TwoStage, found: TwoStageSolution) -> list[str]:
    """What the plan leaves relaxed: of the trunk, and of how many scenarios."""
    lines, scenarios = [], 0
    for k, (problem, z) in _pieces(two, found).items():
        left = broken_facts(problem, z)
        if k < 0:
            lines += [f"common slots: {line}" for line in left]
        scenarios += k >= 0 and bool(left)
    if scenarios:
        lines.append(f"recourse: modes, ratings or integers do not hold in {scenarios} scenarios")
    return lines
