"""From what a method decided and what then happens in every scenario, to a `ScenarioPlan`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.models.program.risk_measures import conditional_value_at_risk, worst
from resilience.planning.records import (
    Certificate,
    Costs,
    Horizon,
)
from resilience.planning.scenarios.outcomes import ScenarioOutcomes
from resilience.planning.scenarios.plan import BAND_QUANTILES, ScenarioPlan
from resilience.planning.scenarios.program import ScenarioProgram
from resilience.planning.scenarios.records import InformationValue, ScenarioStatistics, Unreduced
from resilience.planning.tables import SlotTable
from resilience.tolerances import SHED_TOLERANCE_MWH


@dataclass(frozen=True)
class PlannedScenarios:
    """What a method decided, and what happens in every scenario.

    Attributes:
        method: as `--method`.
        physics: of the plan.
        algorithm: how it was found, in words.
        program: the case and its scenarios; says how long the common schedule lasts.
        scenarios: the scenarios as they were drawn, alike ones more than once.
        outcomes: costs, powers and stored energy in each of them.
        clairvoyant_cost: (scenarios,) $ of each if it were known beforehand.
        risk: the objective over scenarios.
        certificate: bound, gap, and what the referee says.
        notes: what else a reader should know, in words.
        tables: the common schedule.
        mean_value_cost: risk of the costs with the plan for mean data, $; None where undefined.
        value_of_stochastic_solution: what the plan for the mean costs more, $; None likewise.
        unreduced: what the plan costs over all scenarios that these stand for; None where they
            stand for themselves.
    """

    method: str
    physics: Physics
    algorithm: str
    program: ScenarioProgram
    scenarios: Scenarios
    outcomes: ScenarioOutcomes
    clairvoyant_cost: Floats
    risk: Risk
    certificate: Certificate
    notes: list[str]
    tables: dict[str, SlotTable]
    mean_value_cost: float | None
    value_of_stochastic_solution: float | None
    unreduced: Unreduced | None = None


def full_plan(planned: PlannedScenarios, seconds_by_phase: dict[str, float]) -> ScenarioPlan:
    """The plan with all that follows from what happens.

    Args:
        planned: what was decided.
        seconds_by_phase: how long that took.
    """
    case, program, scenarios = planned.program.microgrid.case, planned.program, planned.scenarios
    outcomes, probability, horizon = planned.outcomes, scenarios.probability, Horizon.of_case(case)
    shed_mwh = outcomes.shed.sum((0, 1)) * case.step_h
    staying = _staying(program)
    return ScenarioPlan(
        name=case.name,
        method=planned.method,
        physics=planned.physics,
        certificate=planned.certificate,
        totals=Costs(
            objective=planned.risk.value(outcomes.cost, probability),
            operating_cost=float(probability @ outcomes.operating_cost),
            terminal_credit=float(probability @ outcomes.terminal_credit),
        ),
        horizon=horizon,
        notes=planned.notes,
        not_modelled=[str(omission) for omission in case.omissions],
        seconds_by_phase=seconds_by_phase,
        tables={**planned.tables, "staying": SlotTable(("probability",), staying[None])},
        case=case,
        algorithm=planned.algorithm,
        risk=str(planned.risk),
        statistics=_statistics(outcomes.cost, shed_mwh, probability),
        worth=_worth(planned),
        scenarios=scenarios.n,
        different=program.distinct.n,
        seed=scenarios.seed,
        process=scenarios.process,
        common_slots=program.two_stage.trunk,
        half_left_at=_half_left_at(staying, horizon),
        bands={
            "energy": _band(outcomes.energy.sum(0), probability),
            "shed": _band(outcomes.shed.sum(0), probability),
        },
        episodes=_episodes(planned, shed_mwh),
        recourse=(outcomes.devices, outcomes.power),
        outages=scenarios,
        unreduced=planned.unreduced,
    )


def _statistics(cost: Floats, shed_mwh: Floats, probability: Floats) -> ScenarioStatistics:
    return ScenarioStatistics(
        expected_cost=float(probability @ cost),
        cvar_95_cost=conditional_value_at_risk(cost, 0.95, probability),
        worst_cost=worst(cost, probability),
        expected_shed_mwh=float(probability @ shed_mwh),
        shed_probability=float(probability[shed_mwh > SHED_TOLERANCE_MWH].sum()),
    )


def _worth(planned: PlannedScenarios) -> InformationValue:
    probability = planned.scenarios.probability
    objective = planned.risk.value(planned.outcomes.cost, probability)
    clairvoyant = planned.risk.value(planned.clairvoyant_cost, probability)
    return InformationValue(
        clairvoyant_cost=clairvoyant,
        mean_value_cost=planned.mean_value_cost,
        value_of_stochastic_solution=planned.value_of_stochastic_solution,
        value_of_perfect_information=objective - clairvoyant,
    )


def _staying(program: ScenarioProgram) -> Floats:
    """(slots of the trunk,) probability of following the common schedule still."""
    chance, leaves = program.distinct.probability, program.leaves
    return np.array([chance[leaves > t].sum() for t in range(program.two_stage.trunk)])


def _half_left_at(staying: Floats, horizon: Horizon) -> str | None:
    """The first slot in which more than half of the probability has left, ISO 8601."""
    gone: Ints = np.flatnonzero(staying < 0.5)
    return horizon.times(int(gone[0]) + 1)[-1].isoformat() if len(gone) else None


def _episodes(planned: PlannedScenarios, shed_mwh: Floats) -> dict[str, Floats]:
    """(scenarios,) what is saved of each."""
    program, outcomes = planned.program, planned.outcomes
    return {
        "leaves_slot": program.leaves[program.distinct.index],
        "probability": planned.scenarios.probability,
        "cost": outcomes.cost,
        "operating_cost": outcomes.operating_cost,
        "terminal_credit": outcomes.terminal_credit,
        "shed_mwh": shed_mwh,
        "end_energy_mwh": outcomes.energy[:, -1].sum(0),
        "clairvoyant_cost": planned.clairvoyant_cost,
    }


def _band(values: Floats, probability: Floats) -> SlotTable:
    """Mean and quantiles over scenarios of values (slots, scenarios)."""
    ends = np.quantile(values, BAND_QUANTILES, axis=1, weights=probability, method="inverted_cdf")
    return SlotTable(("mean", "low", "high"), np.array([values @ probability, *ends]))
