"""`solve` over scenarios: the two-stage program, or any dispatcher on the same storms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.dispatch.registry import DISPATCHERS
from resilience.errors import UsageError
from resilience.fragility.draw import DRAWN, fixed, outages_from, sample_bell, sample_case
from resilience.fragility.outages.bell import case_bell
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.methods.answer import LATE, MethodOptions, gap
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.models.program.risk_measures import conditional_value_at_risk, worst
from resilience.planning import outcomes
from resilience.planning.outcomes import ScenarioOutcomes
from resilience.planning.scenario_methods import (
    TITLES,
    ScenarioResult,
    solve_scenario_program,
    wait_and_see,
)
from resilience.planning.scenario_plan import HIGH, LOW, ScenarioPlan
from resilience.planning.scenario_program import (
    DistinctScenarios,
    ScenarioProgram,
    scenario_program,
)
from resilience.planning.tables import SlotTable
from resilience.progress import phase
from resilience.simulation.world import World, grid_with_fallible_lines, simulate
from resilience.tolerances import SCENARIO_GAP, SHED_TOLERANCE_MWH


class ScenarioOptions(TypedDict, total=False):
    """Options of `solve` for plans over scenarios.

    Attributes:
        scenarios: how many are drawn (200), or the scenarios themselves.
        risk: what is minimised: `"mean"`, or `"cvar:0.95:0.5"`, half the mean and half the mean of
            the worst 5 %.
        common_slots: slots after which every scenario goes its own way; if omitted, each leaves the
            common schedule when its own outage shows.
        algorithm: `"extensive"` or `"lshaped"`; by the number of scenarios if omitted.
    """

    scenarios: int | Scenarios | None
    risk: str | Risk | None
    common_slots: int | None
    algorithm: str | None


USUAL_SCENARIOS = 200


def scenarios_for(
    case: Case, outages: str | Path | None, number: int | Scenarios | None, seed: int | None
) -> Scenarios:
    """The scenarios that a user asks for.

    Args:
        case: the case.
        outages: a file of scenarios (.npz, .csv), a list of outages (one certain scenario), or
            drawn: `bell` from the case's `[outage]`, `storm` from its `[storm]`, None from the
            latter if there is one.
        number: how many are drawn, or the scenarios themselves.
        seed: of the draw; 0 if omitted.

    Raises:
        CaseError: a file or a list with mistakes.
        UsageError: a number or a seed where nothing is drawn, or as `sample_bell`.
    """
    asked = str(outages).strip().lower()
    drawn = outages is None or asked in DRAWN
    given = isinstance(number, Scenarios)
    if (given and (seed is not None or outages is not None)) or (
        not drawn and (seed is not None or number is not None)
    ):
        raise UsageError(
            "scenarios that are given, and a number or a seed of others; allowed: one of the two",
            hint="leave out `--scenarios` and `--seed`, or the outages",
        )
    if isinstance(number, Scenarios):
        return number
    if drawn:
        return _drawn(case, asked, number or USUAL_SCENARIOS, seed or 0)
    if Path(str(outages)).suffix in (".npz", ".csv"):
        return load_scenarios(str(outages), case)
    return fixed(case, outages_from(outages, case))


def _drawn(case: Case, asked: str, n: int, seed: int) -> Scenarios:
    if asked == "bell":
        return sample_bell(case, case_bell(case), n, seed)
    if asked == "storm":
        from resilience.fragility.chain import storm_scenarios

        return storm_scenarios(case, n, seed)
    return sample_case(case, n, seed)


def plan_over_scenarios(
    case: Case,
    method: str,
    physics: Physics | None,
    outages: str | Path | None,
    seed: int | None,
    limits: MethodOptions,
    options: ScenarioOptions,
) -> ScenarioPlan:
    """The plan of a method that does not know its outages; arguments as for `resilience.solve`.

    Raises:
        UsageError: physics that the method does not hold, and as `scenarios_for`.
    """
    scenarios = scenarios_for(case, outages, options.get("scenarios"), seed)
    if method != "stochastic":
        if physics not in (None, "copperplate"):
            raise UsageError(
                f"method {method} is simulated at copperplate, not {physics}",
                hint="AC power flow certifies afterwards",
            )
        return simulated_plan(case, scenarios, method)
    risk = options.get("risk")
    return two_stage_plan(
        case,
        scenarios,
        physics=physics or "copperplate",
        risk=Risk.parse(risk) if isinstance(risk, str) else risk,
        common_slots=options.get("common_slots"),
        algorithm=options.get("algorithm"),
        limits=limits,
    )


def two_stage_plan(
    case: Case,
    scenarios: Scenarios,
    *,
    physics: Physics = "copperplate",
    risk: Risk | None = None,
    common_slots: int | None = None,
    algorithm: str | None = None,
    limits: MethodOptions | None = None,
) -> ScenarioPlan:
    """The best common schedule and its recourse; see `resilience.solve`."""
    risk, limits = risk or Risk(), limits or MethodOptions(gap=SCENARIO_GAP)
    with phase("model"):
        storms = DistinctScenarios.among(scenarios, case)
        microgrid = grid_with_fallible_lines(case, scenarios, physics)
        program = scenario_program(microgrid, storms, common_slots=common_slots, risk=risk)
    answer = solve_scenario_program(
        program, algorithm=algorithm, relative_gap=limits.gap, time_limit=limits.time_limit
    )
    known = wait_and_see(program)
    with phase("audit"):
        found, tables = outcomes.of_plan(program, answer.solved)
    plan = _described(case, scenarios, found.at(storms.of), known[storms.of], risk)
    plan = replace(plan, physics=physics, tables=tables)
    return replace(plan, **_certified(program, answer, plan), **_common(program, plan))


def simulated_plan(case: Case, scenarios: Scenarios, method: str) -> ScenarioPlan:
    """What a dispatcher does in the same scenarios, in the form of a plan."""
    with phase("model"):
        storms = DistinctScenarios.among(scenarios, case)
        microgrid = grid_with_fallible_lines(case, scenarios, "copperplate")
        world = World.of(microgrid, scenarios)
        program = scenario_program(microgrid, storms)
    with phase("dispatch", method):
        run = simulate(world, DISPATCHERS[method](world))
    known = wait_and_see(program)[storms.of]
    found = outcomes.of_run(world, run)
    plan = _described(case, scenarios, found, known, Risk())
    last = int(np.argmax(program.leaves[storms.of]))
    plan = replace(plan, method=method, tables=_schedule(program, found, last))
    bound = min(plan.clairvoyant_cost, plan.objective)
    return replace(
        plan,
        algorithm="simulation",
        bound=bound,
        gap=gap(plan.objective, bound),
        bound_of="every scenario known beforehand, on copperplate",
        **_common(program, plan),
    )


def _described(
    case: Case, scenarios: Scenarios, found: ScenarioOutcomes, known: Floats, risk: Risk
) -> ScenarioPlan:
    """All that follows from what happens in every scenario."""
    p, cost = scenarios.probability, found.cost
    shed = found.shed.sum((0, 1)) * case.step_h
    episodes = {
        "probability": p,
        "cost": cost,
        "operating_cost": found.operating_cost,
        "terminal_credit": found.terminal_credit,
        "shed_mwh": shed,
        "end_energy_mwh": found.energy[:, -1].sum(0),
        "clairvoyant_cost": known,
    }
    objective, clairvoyant = risk.of(cost, p), risk.of(known, p)
    return ScenarioPlan(
        name=case.name,
        method="stochastic",
        physics="copperplate",
        algorithm="",
        status="feasible",
        risk=str(risk),
        objective=objective,
        expected_cost=float(p @ cost),
        cvar_95_cost=conditional_value_at_risk(cost, 0.95, p),
        worst_cost=worst(cost, p),
        bound=-np.inf,
        gap=np.inf,
        bound_of="",
        clairvoyant_cost=clairvoyant,
        mean_value_cost=None,
        value_of_stochastic_solution=None,
        value_of_perfect_information=max(objective - clairvoyant, 0.0),
        expected_operating_cost=float(p @ found.operating_cost),
        expected_terminal_credit=float(p @ found.terminal_credit),
        expected_shed_mwh=float(p @ shed),
        shed_probability=float(p[shed > SHED_TOLERANCE_MWH].sum()),
        scenarios=scenarios.n,
        different=0,
        seed=scenarios.seed,
        process=scenarios.process,
        common_slots=0,
        half_left_at=None,
        relaxed=[],
        notes=[],
        audit=found.audit,
        audit_worst=found.audit_worst,
        start=case.start.isoformat(),
        step_min=case.step_min,
        bands={
            "energy": _band(found.energy.sum(0), p),
            "shed": _band(found.shed.sum(0), p),
        },
        episodes=episodes,
        recourse=(found.devices, found.power),
        outages=scenarios,
        case=case,
    )


def _certified(
    program: ScenarioProgram, answer: ScenarioResult, plan: ScenarioPlan
) -> dict[str, Any]:
    """The certificate of a two-stage plan: bound, gap, and what it is worth to have planned so."""
    solved, value = answer.solved, plan.objective
    bound = min(solved.bound, value)
    gain = None if answer.mean_value is None else max(answer.mean_value - answer.stochastic, 0.0)
    return {
        "algorithm": TITLES[answer.algorithm],
        "status": solved.status,
        "bound": bound,
        "gap": gap(value, bound),
        "bound_of": f"two-stage program on {program.microgrid.physics}",
        "mean_value_cost": answer.mean_value,
        "value_of_stochastic_solution": gain,
        "relaxed": answer.relaxed,
        "notes": [] if solved.status == "optimal" else [LATE],
    }


def _common(program: ScenarioProgram, plan: ScenarioPlan) -> dict[str, Any]:
    """How long the common schedule lasts, and which share of the scenarios follows it when."""
    storms, trunk = program.storms, program.two.trunk
    leaves = program.leaves[storms.of]
    staying = np.array([program.storms.probability[program.leaves > t].sum() for t in range(trunk)])
    gone = np.flatnonzero(staying < 0.5)
    half = plan.times(int(gone[0]) + 1)[-1].isoformat() if len(gone) else None
    return {
        "different": storms.n,
        "common_slots": trunk,
        "half_left_at": half,
        "tables": {**plan.tables, "staying": SlotTable(("probability",), staying[None])},
        "episodes": {"leaves_slot": leaves, **plan.episodes},
    }


def _schedule(
    program: ScenarioProgram, found: ScenarioOutcomes, scenario: int
) -> dict[str, SlotTable]:
    """The common schedule of a dispatcher: what it does in the scenario that stays longest."""
    case, common = program.microgrid.case, slice(0, program.two.trunk)
    units, loads = tuple(u.name for u in case.ess), tuple(load.name for load in case.load)
    power, energy = found.power[:, common, scenario], found.energy[:, common, scenario]
    tables = {"power": SlotTable(found.devices, power)}
    if units:
        size = np.array([unit.e_mwh for unit in case.ess])[:, None]
        tables |= {"energy": SlotTable(units, energy), "soc": SlotTable(units, energy / size)}
    if loads:
        shed = found.shed[:, common, scenario]
        served = -power[len(power) - len(loads) :]
        tables |= {"demand": SlotTable(loads, served + shed), "shed": SlotTable(loads, shed)}
    return tables


def _band(values: Floats, p: Floats) -> SlotTable:
    """Mean and quantiles over scenarios of values (slots, scenarios)."""
    ends = np.quantile(values, [LOW, HIGH], axis=1, weights=p, method="inverted_cdf")
    return SlotTable(("mean", "low", "high"), np.array([values @ p, *ends]))
