"""`solve`: a plan for a horizon, outages known in advance or given as scenarios."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack, cast, overload

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.case.outages import outage_texts
from resilience.errors import UsageError
from resilience.files import replacing_file
from resilience.fragility.draw import outages_from
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import METHODS, MethodOptions, MethodResult
from resilience.models.methods.answer import gap
from resilience.models.microgrid import Physics
from resilience.models.program.referee import audit, settle
from resilience.planning.plan import Plan
from resilience.planning.reasons import shed_reasons
from resilience.planning.solve_scenarios import ScenarioOptions
from resilience.planning.tables import balance, tabulate
from resilience.progress import phase, stopwatch
from resilience.tolerances import PLAN_GAP, SCENARIO_GAP

if TYPE_CHECKING:
    from resilience.planning.scenario_plan import ScenarioPlan

Deterministic = Literal["lp", "milp", "socp", "nlp", "minlp", "exact"]


@overload
def solve(
    case: Case | str | Path,
    method: Deterministic = "minlp",
    *,
    physics: Physics | None = None,
    outages: str | Path | None = None,
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
    outages: str | Path | None = None,
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
    outages: str | Path | None = None,
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
        outages: `"6-26@14:00-17:30, ..."`, a CSV file, `"bell"` or `"storm"` for one draw of
            what the case's `[outage]` or `[storm]` describes, or `"none"`; the case's own if
            omitted.
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
    scenario_based = _over_scenarios(method, options)
    found: Plan | ScenarioPlan
    with stopwatch() as seconds:
        with phase("case"):
            case = case if isinstance(case, Case) else load_case(case)
        if scenario_based:
            from resilience.planning.solve_scenarios import plan_over_scenarios

            limits = MethodOptions(
                time_limit, SCENARIO_GAP if relative_gap is None else relative_gap
            )
            found = plan_over_scenarios(case, method, physics, outages, seed, limits, options)
        else:
            limits = MethodOptions(time_limit, PLAN_GAP if relative_gap is None else relative_gap)
            found = _deterministic(case, method, physics, outages, seed, limits)
    return replace(found, seconds=sum(seconds.values()), seconds_by_phase=seconds)


def _over_scenarios(method: str, options: ScenarioOptions) -> bool:
    """Whether a method plans over scenarios.

    Raises:
        UsageError: unknown method, or options that it does not take.
    """
    from resilience.dispatch.registry import DISPATCHERS

    names = dict.fromkeys([*METHODS, "stochastic", *DISPATCHERS])
    if method not in names:
        raise UsageError(
            f"method {method!r} is unknown; allowed: {', '.join(names)}",
            hint="minlp is the default; lp is the fastest; stochastic does not know the outages",
        )
    taken = ScenarioOptions.__annotations__ if method == "stochastic" else {"scenarios"}
    given = [key for key, value in options.items() if value is not None]
    wrong = [key for key in given if method in METHODS or key not in taken]
    if wrong:
        what = "knows its outages" if method in METHODS else "is simulated"
        raise UsageError(
            f"method {method} {what} and takes no {', '.join(wrong)}",
            hint="--method stochastic plans over scenarios",
        )
    return method not in METHODS


def _deterministic(
    case: Case,
    method: str,
    physics: Physics | None,
    outages: str | Path | None,
    seed: int | None,
    options: MethodOptions,
) -> Plan:
    """The best plan where the outages are known in advance."""
    with phase("case"):
        if outages is not None or seed is not None:
            case = case.replace(outages=outages_from(outages, case, seed))
    find, usual = METHODS[method]
    with phase("model"):
        program = horizon(case, physics or usual)
    answer = find(program, options)
    with phase("audit"):
        return describe(program, answer, method)


def export_model(plan: Plan | ScenarioPlan, path: Path) -> None:
    """Writes the model behind a plan as LP, MPS or NL, by the suffix of `path`.

    Raises:
        UsageError: another suffix, a plan without its case, or one over scenarios.
    """
    from resilience.models.backends.pyomo import Pyomo, check_format

    check_format(path)
    if not isinstance(plan, Plan):
        raise UsageError(
            "a plan over scenarios is not one model that could be exported",
            hint="export that of a single storm: --method lp with its outages",
        )
    if plan.case is None:
        raise UsageError("a plan without its case has no model", hint="solve the case again")
    program = horizon(plan.case, cast(Physics, plan.physics))
    cones = any(s.kind == "cone" for s in program.standard.structures)
    model = Pyomo(program.standard, solver="scip" if cones else "highs")
    model.update(program.vectors)
    with replacing_file(path) as fresh:
        model.write(fresh)


def describe(program: CaseProgram, answer: MethodResult, method: str) -> Plan:
    """A plan from the numbers of an answer: settled, audited, and put into tables."""
    case = program.case
    z = settle(program.standard, answer.z, program.vectors)
    checked = audit(program.standard, z, program.vectors)
    terms = program.standard.cost_terms(z, program.data)
    costs = {name: float(spent.sum()) for name, spent in terms.items()}
    operating = sum(costs.values())
    credit = _credit(program, z)
    bound = answer.bound if np.isfinite(answer.bound) else None
    tables = tabulate(program, z)
    energy, reasons = balance(case, tables), shed_reasons(program, z)
    return Plan(
        name=case.name,
        method=method,
        physics=program.microgrid.physics,
        status=answer.status,
        objective=operating - credit,
        operating_cost=operating,
        terminal_credit=credit,
        bound=bound,
        gap=None if bound is None else gap(operating - credit, bound),
        bound_of=answer.bound_of,
        relaxed=answer.relaxed,
        notes=answer.notes,
        audit=checked.worst,
        audit_worst=checked.name,
        costs=costs,
        energy_mwh=energy,
        shed_mwh=energy["shed"],
        shed_by_load=reasons,
        outages=outage_texts(case.outages, case.window),
        start=case.start.isoformat(),
        step_min=case.step_min,
        seconds=0.0,
        seconds_by_phase={},
        tables=tables,
        case=case,
    )


def _credit(program: CaseProgram, z: Floats) -> float:
    value = program.case.terminal_value_per_mwh
    if not value or not program.case.ess:
        return 0.0
    return value * float(z[program.standard.columns("ess.energy")[:, -1]].sum())
