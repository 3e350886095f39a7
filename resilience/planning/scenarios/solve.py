"""`solve` over scenarios: the two-stage program, or any dispatcher on the same scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from resilience.case import Case, load_case
from resilience.case.outages import OutageWords
from resilience.dispatch.registry import factory_of
from resilience.errors import UsageError
from resilience.fragility.draw import DRAWN, fixed, outages_from, sample_case, sample_of
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.components import in_roles
from resilience.models.methods.answer import OUT_OF_TIME, MethodOptions
from resilience.models.microgrid import Physics
from resilience.models.program.gate import gap, status_of
from resilience.models.program.risk import Risk
from resilience.planning.records import Certificate
from resilience.planning.scenarios.description import PlannedScenarios, full_plan
from resilience.planning.scenarios.methods import (
    TITLES,
    solve_scenario_program,
    wait_and_see,
)
from resilience.planning.scenarios.options import ScenarioOptions
from resilience.planning.scenarios.outcomes import (
    ScenarioOutcomes,
    planned_outcomes,
    simulated_outcomes,
)
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.scenarios.program import (
    DistinctScenarios,
    ScenarioProgram,
    microgrid_to_plan,
    scenario_program,
)
from resilience.planning.scenarios.unreduced import on_all_scenarios
from resilience.planning.tables import SlotTable, copperplate_notes, limit_notes
from resilience.progress import phase, stopwatch
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World, microgrid_with_fallible_lines

DEFAULT_SCENARIOS = 200
NOT_FOLLOWED = (
    "the common schedule cannot be followed in the scenarios that the reduced set stands for: all "
    "figures are over the reduced set alone"
)
NOT_SIMULATED = (
    "all figures are over the reduced set alone; simulate the unreduced scenarios to see what it "
    "leaves out"
)


def scenarios_for(
    case: Case,
    outages: str | Path | Sequence[OutageWords] | None,
    number: int | Scenarios | None,
    seed: int | None,
) -> Scenarios:
    """The scenarios that a user asks for.

    Args:
        case: the case.
        outages: a file of scenarios (.npz, .csv), a list of outages (one certain scenario), or
            drawn: `bell` from the case's `[outage]`, `storm` from its `[storm]`, `blackout` from
            its `[blackout]`, None from the last of these that there is.
        number: how many are drawn, or the scenarios themselves.
        seed: of the draw; 0 if omitted.

    Raises:
        CaseError: a file or a list with mistakes.
        UsageError: a number or a seed where nothing is drawn, or as `sample_bell`.
    """
    source = str(outages).strip().lower()
    is_drawn = outages is None or source in DRAWN
    is_ready = isinstance(number, Scenarios)
    if (is_ready and (seed is not None or outages is not None)) or (
        not is_drawn and (seed is not None or number is not None)
    ):
        raise UsageError(
            "scenarios that are given, and a number or a seed of others; allowed: one of the two",
            hint="leave out `--scenarios` and `--seed`, or the outages",
        )
    if isinstance(number, Scenarios):
        if number.slots != case.slots:
            raise UsageError(
                f"scenarios of {number.slots} slots; allowed: {case.slots}, as the case",
                hint="draw them again for this horizon",
            )
        return number
    if is_drawn:
        return _draw(case, source, number or DEFAULT_SCENARIOS, seed or 0)
    if Path(str(outages)).suffix in (".npz", ".csv"):
        return load_scenarios(str(outages), case)
    return fixed(case, outages_from(outages, case))


def _draw(case: Case, source: str, n: int, seed: int) -> Scenarios:
    return sample_of(case, source, n, seed) if source in DRAWN else sample_case(case, n, seed)


def plan_over_scenarios(
    case: Case | str | Path,
    method: str,
    physics: Physics | None,
    outages: str | Path | Sequence[OutageWords] | None,
    seed: int | None,
    limits: MethodOptions,
    options: ScenarioOptions,
) -> ScenarioPlan:
    """The plan of a method that does not know its outages; arguments as for `resilience.solve`.

    Raises:
        UsageError: physics that the method does not hold, and as `scenarios_for`.
    """
    with stopwatch() as seconds:
        with phase("case"):
            case = case if isinstance(case, Case) else load_case(case)
        scenarios = scenarios_for(case, outages, options.get("scenarios"), seed)
        if method == "stochastic":
            planned = plan_in_two_stages(case, scenarios, physics or "copperplate", limits, options)
        elif physics in (None, "copperplate"):
            planned = simulate_dispatcher(case, scenarios, method)
        else:
            raise UsageError(
                f"method {method} is simulated at copperplate, not {physics}",
                hint="AC power flow certifies afterwards",
            )
    return full_plan(planned, seconds)


def plan_in_two_stages(
    case: Case,
    scenarios: Scenarios,
    physics: Physics,
    limits: MethodOptions,
    options: ScenarioOptions,
) -> PlannedScenarios:
    """The best common schedule and its recourse."""
    risk = options.get("risk")
    risk = Risk.parse(risk) if isinstance(risk, str) else risk or Risk()
    with phase("model"):
        microgrid = microgrid_to_plan(case, scenarios, physics)
        distinct = DistinctScenarios.among(scenarios, microgrid.case)
        program = scenario_program(
            microgrid, distinct, common_slots=options.get("common_slots"), risk=risk
        )
    result = solve_scenario_program(
        program,
        algorithm=options.get("algorithm"),
        relative_gap=limits.gap,
        time_limit=limits.time_limit,
    )
    clairvoyant_cost = wait_and_see(program)[distinct.index]
    with phase("audit"):
        distinct_outcomes, tables = planned_outcomes(program, result.solution)
    scenario_outcomes = distinct_outcomes.selected(distinct.index)
    unreduced, everything = None, scenarios.represents
    if everything is not None:
        unreduced = on_all_scenarios(program, result.solution, everything)
    objective = risk.value(scenario_outcomes.cost, scenarios.probability)
    bound, scale = result.solution.bound, program.two_stage.cost_scale
    reached = gap(objective, bound, scale)
    status = status_of(reached, limits.gap)
    return PlannedScenarios(
        method="stochastic",
        physics=physics,
        algorithm=TITLES[result.algorithm],
        program=program,
        scenarios=scenarios,
        outcomes=scenario_outcomes,
        clairvoyant_cost=clairvoyant_cost,
        risk=risk,
        certificate=Certificate(
            status=status,
            bound=bound,
            gap=reached,
            bound_of=f"two-stage program on {physics}{_reduced_set(scenarios)}",
            relaxed=scenario_outcomes.relaxed,
            audit=scenario_outcomes.audit,
            audit_worst=scenario_outcomes.audit_worst,
            cost_scale=scale,
        ),
        notes=[
            *([] if status == "optimal" else [_reason(reached, limits.gap, result.late)]),
            *([NOT_FOLLOWED] if everything is not None and unreduced is None else []),
            *copperplate_notes(case, physics),
            *limit_notes(microgrid),
        ],
        tables=tables,
        unreduced=unreduced,
        mean_value_cost=result.mean_value_cost,
        value_of_stochastic_solution=result.value_of_stochastic_solution,
    )


def _reduced_set(scenarios: Scenarios) -> str:
    """What a bound over few scenarios is no bound of, in words."""
    return "" if scenarios.represents is None else ", the reduced set"


def _reason(reached: float, wanted_gap: float, late: bool) -> str:
    """Why a plan is not called optimal."""
    if late:
        return OUT_OF_TIME
    return (
        f"the gap of {100 * reached:.2g} % is above the {100 * wanted_gap:.2g} % asked for: the "
        "bound lets storage and grids be in two modes at once, and polygons stand around ratings"
    )


def simulate_dispatcher(case: Case, scenarios: Scenarios, method: str) -> PlannedScenarios:
    """What a dispatcher does in the same scenarios."""
    risk = Risk()
    with phase("model"):
        microgrid = microgrid_with_fallible_lines(case, scenarios, "copperplate")
        distinct = DistinctScenarios.among(scenarios, microgrid.case)
        world = World.build(microgrid, scenarios)
        program = scenario_program(microgrid, distinct)
    with phase("dispatch", method):
        trajectory = simulate(world, factory_of(method)(world.setting))
    clairvoyant_cost = wait_and_see(program)[distinct.index]
    scenario_outcomes = simulated_outcomes(world, trajectory)
    objective = risk.value(scenario_outcomes.cost, scenarios.probability)
    bound, scale = risk.value(clairvoyant_cost, scenarios.probability), program.two_stage.cost_scale
    longest = int(np.argmax(program.leaves[distinct.index]))
    return PlannedScenarios(
        method=method,
        physics="copperplate",
        algorithm="simulation",
        program=program,
        scenarios=scenarios,
        outcomes=scenario_outcomes,
        clairvoyant_cost=clairvoyant_cost,
        risk=risk,
        certificate=Certificate(
            status="feasible",
            bound=bound,
            gap=gap(objective, bound, scale),
            bound_of=f"every scenario known beforehand, on copperplate{_reduced_set(scenarios)}",
            relaxed=[],
            audit=scenario_outcomes.audit,
            audit_worst=scenario_outcomes.audit_worst,
            cost_scale=scale,
        ),
        notes=[
            *([] if scenarios.represents is None else [NOT_SIMULATED]),
            *copperplate_notes(case, "copperplate"),
        ],
        tables=_common_schedule(program, scenario_outcomes, longest),
        mean_value_cost=None,
        value_of_stochastic_solution=None,
    )


def _common_schedule(
    program: ScenarioProgram, scenario_outcomes: ScenarioOutcomes, scenario: int
) -> dict[str, SlotTable]:
    """The common schedule of a dispatcher: what it does in the scenario that stays longest."""
    common, fleets = slice(0, program.two_stage.trunk), program.microgrid.fleets.values()
    storage = in_roles(fleets, "storage")
    units = tuple(name for fleet in storage for name in fleet.names)
    loads = tuple(name for fleet in in_roles(fleets, "load") for name in fleet.names)
    power, energy = (
        scenario_outcomes.power[:, common, scenario],
        scenario_outcomes.energy[:, common, scenario],
    )
    tables = {"power": SlotTable(scenario_outcomes.devices, power)}
    if units:
        size = np.concatenate([fleet.size_mwh() for fleet in storage])[:, None]
        tables |= {"energy": SlotTable(units, energy), "soc": SlotTable(units, energy / size)}
    if loads:
        shed = scenario_outcomes.shed[:, common, scenario]
        served = -power[len(power) - len(loads) :]
        tables |= {"demand": SlotTable(loads, served + shed), "shed": SlotTable(loads, shed)}
    return tables
