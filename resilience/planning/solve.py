"""`solve`: a plan for a horizon, outages known in advance or given as scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack, cast, overload

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.case.outages import OutageWords, outage_texts
from resilience.errors import UsageError, did_you_mean
from resilience.files import check_file, replacing_file
from resilience.fragility.draw import outages_from
from resilience.models.case_program import CaseProgram, horizon, terminal_credit
from resilience.models.methods import METHODS, MethodOptions, MethodResult
from resilience.models.methods.answer import broken_facts
from resilience.models.microgrid import Physics
from resilience.models.program.gate import (
    check_audit,
    check_costs,
    cost_scale,
    gap,
    names_of,
    status_of,
)
from resilience.models.program.referee import audit, settle
from resilience.models.structures import Cone
from resilience.planning.plan import Plan
from resilience.planning.reading.causes import shed_causes
from resilience.planning.reading.fuel import fuel_notes
from resilience.planning.reading.reasons import shed_by_reason, shed_loads
from resilience.planning.records import Certificate, Costs, Horizon
from resilience.planning.scenarios.options import ScenarioOptions
from resilience.planning.tables import (
    SlotTable,
    balance,
    copperplate_notes,
    limit_notes,
    tabulate,
    trip_notes,
)
from resilience.progress import phase, stopwatch
from resilience.results import PLAN, SCENARIO_PLAN, ResultKind
from resilience.tolerances import PLAN_GAP, SCENARIO_GAP

if TYPE_CHECKING:
    from resilience.planning.scenarios.plan import ScenarioPlan

Deterministic = Literal["lp", "milp", "socp", "nlp", "minlp", "exact"]


@overload
def solve(
    case: Case | str | Path,
    method: Deterministic = "minlp",
    *,
    physics: Physics | None = None,
    outages: str | Path | Sequence[OutageWords] | None = None,
    seed: int | None = None,
    time_limit: float = 60.0,
    relative_gap: float | None = None,
) -> Plan: ...


@overload
def solve(
    case: Case | str | Path,
    method: str,
    *,
    physics: Physics | None = None,
    outages: str | Path | Sequence[OutageWords] | None = None,
    seed: int | None = None,
    time_limit: float = 60.0,
    relative_gap: float | None = None,
    **options: Unpack[ScenarioOptions],
) -> Plan | ScenarioPlan: ...


def solve(
    case: Case | str | Path,
    method: str = "minlp",
    *,
    physics: Physics | None = None,
    outages: str | Path | Sequence[OutageWords] | None = None,
    seed: int | None = None,
    time_limit: float = 60.0,
    relative_gap: float | None = None,
    **options: Unpack[ScenarioOptions],
) -> Plan | ScenarioPlan:
    """The best plan for the case's horizon.

    Args:
        case: a case, its file, or the name of an installed one.
        method: lp, milp, socp, nlp, minlp or exact, which know the outages in advance; or
            `stochastic`, a two-stage program over scenarios; or the name of any dispatcher, which
            is simulated in the same scenarios.
        physics: copperplate, lindistflow or distflow; the method's own if omitted.
        outages: `"6-26@14:00-17:30, ..."`, a list of such or of `("6-26", "14:00", "17:30")`, a
            CSV file, `"bell"` or `"storm"` for one draw of what the case's `[outage]` or `[storm]`
            describes, or `"none"`; the case's own if omitted.
            Over scenarios: a file of scenarios (.npz, .csv), or a draw from the process.
        seed: of the draw; 0 if omitted.
        time_limit: seconds for the search; the best plan found is returned.
        relative_gap: gap at which the search may stop; 1e-3, over scenarios 1e-4, if omitted.
        options: of plans over scenarios, see `ScenarioOptions`.

    Raises:
        CaseError: the case or the outages have mistakes; all of them are listed.
        UsageError: unknown method or physics, or a pair that does not go together.
        InfeasibleError: no plan satisfies the model; the message names what conflicts.
        SolverError: no plan was found in time.
    """
    if _is_over_scenarios(method, options):
        from resilience.planning.scenarios.solve import plan_over_scenarios

        limits = MethodOptions(time_limit, SCENARIO_GAP if relative_gap is None else relative_gap)
        return plan_over_scenarios(case, method, physics, outages, seed, limits, options)
    limits = MethodOptions(time_limit, PLAN_GAP if relative_gap is None else relative_gap)
    return plan_known_outages(case, method, physics, outages, seed, limits)


def _is_over_scenarios(method: str, options: ScenarioOptions) -> bool:
    """Whether a method plans over scenarios.

    Raises:
        UsageError: unknown method, or options that it does not take.
    """
    from resilience.dispatch.registry import DISPATCHERS, rule_of

    names = dict.fromkeys([*METHODS, "stochastic", *DISPATCHERS])
    if method not in names and rule_of(method) is None:
        raise UsageError(
            f"method {method!r} is unknown; allowed: {', '.join(names)}, rule-LEVEL",
            hint="minlp is the default; lp is the fastest; stochastic does not know the outages",
        )
    arguments = {"physics", "outages", "seed", "time_limit", "relative_gap"}
    keys = [*ScenarioOptions.__annotations__, *sorted(arguments)]
    if unknown := [key for key in options if key not in keys]:
        raise UsageError(f"solve has no {unknown[0]!r}", hint=did_you_mean(unknown[0], keys))
    allowed = ScenarioOptions.__annotations__ if method == "stochastic" else {"scenarios"}
    wrong = [
        key
        for key, value in options.items()
        if value is not None and (method in METHODS or key not in allowed)
    ]
    if wrong:
        reason = "knows its outages" if method in METHODS else "is simulated"
        raise UsageError(
            f"method {method} {reason} and takes no {', '.join(wrong)}",
            hint="--method stochastic plans over scenarios",
        )
    return method not in METHODS


def plan_known_outages(
    case: Case | str | Path,
    method: str,
    physics: Physics | None,
    outages: str | Path | Sequence[OutageWords] | None,
    seed: int | None,
    limits: MethodOptions,
) -> Plan:
    """The best plan where the outages are known in advance; arguments as for `solve`."""
    with stopwatch() as seconds:
        with phase("case"):
            case = case if isinstance(case, Case) else load_case(case)
            if outages is not None or seed is not None:
                case = case.replace(outages=outages_from(outages, case, seed))
        find_point, default_physics = METHODS[method]
        with phase("model"):
            program = horizon(case, physics or default_physics)
        result = find_point(program, limits)
        with phase("audit"):
            point = audited_point(program, result, limits.gap)
    return Plan(
        name=case.name,
        method=method,
        physics=program.microgrid.physics,
        certificate=point.certificate,
        totals=point.totals,
        horizon=Horizon.of_case(case),
        notes=[
            *result.notes,
            *trip_notes(program.case, point.tables),
            *point.fuel_notes,
            *copperplate_notes(program.case, program.microgrid.physics),
            *limit_notes(program.microgrid),
        ],
        not_modelled=[str(omission) for omission in case.omissions],
        seconds_by_phase=seconds,
        tables=point.tables,
        case=case,
        energy_mwh=point.energy_mwh,
        shed_mwh=point.energy_mwh["shed"],
        shed_by_load=point.shed_by_load,
        shed_causes=point.shed_causes,
        outages=outage_texts(case.outages, case.window),
    )


def result_kind(method: str) -> ResultKind:
    """What kind of result a method gives."""
    return PLAN if method in METHODS else SCENARIO_PLAN


def check_export(path: Path, method: str) -> None:
    """Refuses to export the model of a method to a file before anything is solved.

    Raises:
        UsageError: another suffix than of LP, MPS or NL, a folder, an unknown method, or one over
            scenarios.
        FileError: it could not be written.
    """
    from resilience.models.backends.pyomo import check_format

    check_format(path)
    if _is_over_scenarios(method, {}):
        raise UsageError(
            f"the model of a plan over scenarios, as by method {method}, is not one that could be "
            "exported",
            hint="export that of a single storm: --method lp with its outages",
        )
    check_file(path)


def check_prices(method: str) -> None:
    """Refuses to look for prices of a plan over scenarios before anything is solved.

    Raises:
        UsageError: such a method, or an unknown one.
    """
    if _is_over_scenarios(method, {}):
        raise UsageError(
            f"a plan over scenarios, as by method {method}, has no prices: they differ in each",
            hint="ask for those of a single storm: --method lp with its outages",
        )


def export_model(plan: Plan | ScenarioPlan, path: Path) -> None:
    """Writes the model behind a plan as LP, MPS or NL, by the suffix of `path`.

    Raises:
        UsageError: as `check_export`, a plan without its case, or the angles of closed loops in
            another file than NL.
    """
    from resilience.models.backends.pyomo import Pyomo

    check_export(path, plan.method)
    if not isinstance(plan, Plan) or plan.case is None:
        raise UsageError("a plan without its case has no model", hint="solve the case again")
    program = horizon(plan.case, cast(Physics, plan.physics))
    cones = program.standard.structures_of(Cone)
    model = Pyomo(program.standard, solver="scip" if cones else "highs")
    model.update(program.vectors)
    with replacing_file(path) as fresh:
        model.write(fresh)


@dataclass(frozen=True)
class AuditedPoint:
    """A method's point, settled and audited: what the numbers of a plan are.

    Attributes:
        certificate: its bound and what the referee says.
        totals: what it costs.
        tables: every quantity by slot.
        energy_mwh: the energy balance, MWh.
        shed_by_load: {load: {reason: MWh}}.
        shed_causes: {load: {reason: sentence}}.
        fuel_notes: a sentence per tank.
    """

    certificate: Certificate
    totals: Costs
    tables: dict[str, SlotTable]
    energy_mwh: dict[str, float]
    shed_by_load: dict[str, dict[str, float]]
    shed_causes: dict[str, dict[str, str]]
    fuel_notes: list[str]


def audited_point(program: CaseProgram, result: MethodResult, wanted_gap: float) -> AuditedPoint:
    """The point of a method's result, settled, audited, and put into tables.

    What it leaves relaxed is judged last, of the settled point, so that nothing moves afterwards.

    Args:
        program: what was solved.
        result: its answer.
        wanted_gap: relative gap within which the answer may be called optimal.

    Raises:
        CertificateError: the point breaks what is not said to be relaxed, costs something else than
            the method says, or less than the bound.
    """
    standard, vectors = program.standard, program.vectors
    z = settle(standard, result.z, vectors)
    checked, relaxed = audit(standard, z, vectors), broken_facts(standard, z)
    check_audit(checked, names_of(relaxed))
    terms = standard.cost_terms(z, program.data)
    costs = {name: float(spent.sum()) for name, spent in terms.items()}
    operating, credit = sum(costs.values()), _credit(program, z)
    objective, scale = operating - credit, cost_scale(vectors)
    check_costs(result.objective, {**costs, "terminal credit": -credit}, scale)
    reached = gap(objective, result.bound, scale)
    has_bound = bool(np.isfinite(result.bound))
    certificate = Certificate(
        status=status_of(reached, wanted_gap) if result.status == "optimal" else "feasible",
        bound=result.bound if has_bound else None,
        gap=reached if has_bound else None,
        bound_of=result.bound_of,
        relaxed=relaxed,
        audit=checked.worst,
        audit_worst=checked.name,
        cost_scale=scale,
    )
    tables, shed = tabulate(program, z), shed_loads(program, z)
    return AuditedPoint(
        certificate,
        Costs(objective, operating, credit, costs),
        tables,
        balance(program.case, tables),
        shed_by_reason(program, shed),
        shed_causes(program, z, shed),
        fuel_notes(program, z),
    )


def _credit(program: CaseProgram, z: Floats) -> float:
    stored = [f.stored for f in program.microgrid.fleets.values() if f.stored is not None]
    if not stored:
        return 0.0
    energy = np.concatenate([z[program.standard.columns(name)] for name in stored])
    return float(terminal_credit(program.case, energy))
