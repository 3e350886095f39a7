"""A plan over few scenarios, followed in all of those that they stand for."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import standard_error
from resilience.models.components import in_roles
from resilience.models.program.gate import gap
from resilience.models.program.standard import Standard
from resilience.planning.scenarios.program import (
    DistinctScenarios,
    ScenarioProgram,
    microgrid_to_plan,
    scenario_program,
)
from resilience.planning.scenarios.records import Unreduced
from resilience.planning.two_stage.lshaped import TwoStageSolution
from resilience.planning.two_stage.master import Master
from resilience.planning.two_stage.recourse import Recourse
from resilience.progress import phase
from resilience.tolerances import SHED_TOLERANCE_MWH


@dataclass(frozen=True)
class Followed:
    """A common schedule in scenarios, (scenarios,) each.

    Attributes:
        cost: operating cost less terminal credit, $.
        shed_mwh: energy not served.
    """

    cost: Floats
    shed_mwh: Floats


def on_all_scenarios(
    program: ScenarioProgram, solution: TwoStageSolution, everything: Scenarios
) -> Unreduced | None:
    """What the common schedule of a plan costs over other scenarios than it was made for.

    A scenario that is still on it when it ends knows its own end from there on.

    Args:
        program: that the plan was made for.
        solution: the plan.
        everything: the scenarios.

    Returns:
        None where the schedule cannot be followed: they share outages that the plan's do not.

    Raises:
        InfeasibleError: a scenario has no recourse; it is named.
    """
    risk = program.two_stage.risk
    with phase("all scenarios"):
        wide = _program_of_all(program, everything)
        outcome = followed(program, solution, wide)
    if outcome is None:
        return None
    probability, index = everything.probability, wide.distinct.index
    cost, shed_mwh = outcome.cost[index], outcome.shed_mwh[index]
    return Unreduced(
        scenarios=everything.n,
        objective=risk.value(cost, probability),
        expected_cost=float(probability @ cost),
        cost_error=standard_error(cost, probability),
        expected_shed_mwh=float(probability @ shed_mwh),
        shed_error=standard_error(shed_mwh, probability),
        shed_probability=float(probability[shed_mwh > SHED_TOLERANCE_MWH].sum()),
    )


def _program_of_all(program: ScenarioProgram, everything: Scenarios) -> ScenarioProgram:
    """The program of all scenarios, whose common schedule is no longer than the plan's."""
    case = program.microgrid.case
    microgrid = microgrid_to_plan(case, everything, program.microgrid.physics)
    return scenario_program(
        microgrid,
        DistinctScenarios.among(everything, microgrid.case),
        most_common_slots=program.two_stage.trunk,
        risk=program.two_stage.risk,
    )


def followed(
    program: ScenarioProgram, solution: TwoStageSolution, wide: ScenarioProgram
) -> Followed | None:
    """What happens in the distinct scenarios of `wide` with the storage of a plan.

    Modes are relaxed. Every scenario is solved to its optimum, which its multipliers prove.

    Args:
        program: that the plan was made for.
        solution: the plan.
        wide: the program of other scenarios.

    Returns:
        None where no schedule of theirs has that storage.

    Raises:
        CertificateError: a scenario costs less than is proven.
    """
    first, two_stage = program.two_stage.first, wide.two_stage
    ends = np.array([first.state_columns(node) for node in range(two_stage.trunk)], np.intp)
    trial = Master(two_stage).trunk_through(solution.trunk[ends])
    if trial is None:
        return None
    second = Recourse(two_stage, workers=os.cpu_count() or 1).solve(trial.states)
    proven = second.alpha + (second.beta * trial.states).sum(axis=1)
    for cost, bound in zip(second.cost, proven, strict=True):
        gap(float(cost), float(bound), two_stage.cost_scale)
    costs = trial.spent.copy()
    costs[:-1] += second.cost
    shed_by_slot = _shed_by_node(wide, two_stage.first, trial.z)
    shed_mw = np.zeros(wide.distinct.n)
    for k, (chain, leaves) in enumerate(zip(wide.chain, wide.leaves, strict=True)):
        shed_mw[k] = shed_by_slot[:leaves].sum()
        if chain >= 0:
            branch, point = two_stage.branches[chain], second.points[chain]
            standard = two_stage.programs[branch.program]
            shed_mw[k] += _shed_by_node(wide, standard, point)[branch.offset :].sum()
    # Of those that stay on the trunk the chain is -1, and their cost the last.
    return Followed(costs[wide.chain], shed_mw * wide.microgrid.case.step_h)


def _shed_by_node(program: ScenarioProgram, standard: Standard, z: Floats) -> Floats:
    """(nodes,) MW not served in a point of a chain."""
    fleets = in_roles(program.microgrid.fleets.values(), "load")
    shed = [z[standard.columns(str(fleet.shed))].sum(axis=0) for fleet in fleets]
    return np.sum(shed, axis=0) if shed else np.zeros(standard.tree.n)
