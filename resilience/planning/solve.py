"""`solve`: a plan for a horizon, outages known in advance or given as scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypedDict, Unpack, cast, overload

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case, load_case
from resilience.case.schema.tables import DeviceTable
from resilience.errors import UsageError
from resilience.fragility.draw import outages_from
from resilience.models.case_program import Problem, as_switched, horizon
from resilience.models.methods import METHODS, Answer, Options
from resilience.models.methods.answer import gap
from resilience.models.microgrid import Physics
from resilience.models.network.situation import Situation
from resilience.models.program.referee import audit, settle
from resilience.planning.plan import Plan, Table, outage_texts, replacing_file
from resilience.planning.reasons import shed_reasons
from resilience.progress import phase, stopwatch
from resilience.simulation.replay import per_slot, variables

if TYPE_CHECKING:
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.models.risk import Risk
    from resilience.planning.scenario_plan import ScenarioPlan

Deterministic = Literal["lp", "milp", "socp", "nlp", "minlp", "exact"]


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

            limits = Options(time_limit, 1e-4 if relative_gap is None else relative_gap)
            found = plan_over_scenarios(case, method, physics, outages, seed, limits, options)
        else:
            limits = Options(time_limit, 1e-3 if relative_gap is None else relative_gap)
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
    options: Options,
) -> Plan:
    """The best plan where the outages are known in advance."""
    with phase("case"):
        if outages is not None or seed is not None:
            case = case.replace(outages=outages_from(outages, case, seed))
    find, usual = METHODS[method]
    with phase("model"):
        problem = horizon(case, physics or usual)
    answer = find(problem, options)
    with phase("audit"):
        return describe(problem, answer, method)


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
    problem = horizon(plan.case, cast(Physics, plan.physics))
    cones = any(s.kind == "cone" for s in problem.standard.structures)
    model = Pyomo(problem.standard, solver="scip" if cones else "highs")
    model.update(problem.vectors)
    with replacing_file(path) as fresh:
        model.write(fresh)


def describe(problem: Problem, answer: Answer, method: str) -> Plan:
    """A plan from the numbers of an answer: settled, audited, and put into tables."""
    case = problem.case
    z = settle(problem.standard, answer.z, problem.vectors)
    checked = audit(problem.standard, z, problem.vectors)
    terms = problem.standard.cost_terms(z, problem.data)
    costs = {name: float(spent.sum()) for name, spent in terms.items()}
    operating = sum(costs.values())
    credit = _credit(problem, z)
    bound = answer.bound if np.isfinite(answer.bound) else None
    tables = tabulate(problem, z)
    energy, reasons = balance(case, tables), shed_reasons(problem, z)
    return Plan(
        name=case.name,
        method=method,
        physics=problem.grid.physics,
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
        outages=outage_texts(case),
        start=case.start.isoformat(),
        step_min=case.step_min,
        seconds=0.0,
        seconds_by_phase={},
        tables=tables,
        case=case,
    )


def _credit(problem: Problem, z: Floats) -> float:
    value = problem.case.terminal_value_per_mwh
    if not value or not problem.case.ess:
        return 0.0
    return value * float(z[problem.standard.columns("ess.energy")[:, -1]].sum())


def tabulate(problem: Problem, z: Floats) -> dict[str, Table]:
    """Every quantity as a table (columns, slots); names and units in `results.UNITS`."""
    standard, case, data = problem.standard, problem.case, problem.data

    def values(name: str) -> Floats:
        return z[standard.columns(name)]

    power: dict[str, Floats] = {}
    for name, tables in (("generator.p", case.generator), ("pv.p", case.pv)):
        if tables:
            power |= dict(zip(standard.labels(name), values(name), strict=True))
    found: dict[str, Table] = {}
    if case.ess:
        flow = values("ess.discharge") - values("ess.charge")
        names = standard.labels("ess.charge")
        power |= dict(zip(names, flow, strict=True))
        size = np.array([t.e_mwh for t in case.ess])[:, None]
        found["energy"] = Table(names, values("ess.energy"))
        found["soc"] = Table(names, values("ess.energy") / size)
    if case.grid:
        flow = values("grid.import") - values("grid.export")
        power |= dict(zip(standard.labels("grid.import"), flow, strict=True))
    if case.load:
        names = standard.labels("load.shed")
        power |= dict(zip(names, values("load.shed") - data["load.demand"], strict=True))
        found["demand"] = Table(names, data["load.demand"])
        found["shed"] = Table(names, values("load.shed"))
    if case.pv:
        found["pv_available"] = Table(standard.labels("pv.p"), data["pv.available"])
    found["power"] = Table(tuple(power), np.array(list(power.values())))
    found |= _wires(problem, z)
    found |= _states(problem, z, as_switched(problem, z))
    return found | {"variables": Table(variables(standard), per_slot(standard, z))}


def _wires(problem: Problem, z: Floats) -> dict[str, Table]:
    standard, found = problem.standard, {}
    if standard.has("bus.v_sq"):
        squares = np.maximum(z[standard.columns("bus.v_sq")], 0.0)
        found["voltage"] = Table(standard.labels("bus.v_sq"), np.sqrt(squares))
    for table, name in (("line_power", "line.p"), ("line_reactive", "line.q")):
        if standard.has(name):
            found[table] = Table(standard.labels(name), z[standard.columns(name)])
    if standard.has("line.p"):
        closed = as_switched(problem, z).line_up
        found["line_closed"] = Table(standard.labels("line.p"), closed.astype(float))
    return found


def _states(problem: Problem, z: Floats, situation: Situation) -> dict[str, Table]:
    standard, case = problem.standard, problem.case
    island = np.where(situation.alive > 0.5, situation.island + 1, 0)
    bus_of = problem.grid.bus_of
    found = {"island": Table(case.network.bus_names, island[bus_of].astype(float))}
    reactive = [
        (name.split(".")[0], name)
        for name in ("generator.q", "pv.q", "ess.q", "grid.q")
        if standard.has(name)
    ]
    if reactive:
        labels = tuple(label for _, name in reactive for label in standard.labels(name))
        rows = np.concatenate([z[standard.columns(name)] for _, name in reactive])
        found["reactive"] = Table(labels, rows)
    if standard.has("generator.on"):
        found["on"] = Table(standard.labels("generator.on"), z[standard.columns("generator.on")])
    return found


def balance(case: Case, tables: dict[str, Table]) -> dict[str, float]:
    """The energy balance in MWh: what was fed in, what was taken, and what the wires lost."""
    power = tables["power"]

    def flow(devices: Sequence[DeviceTable], sign: float) -> float:
        rows = [power.labels.index(device.name) for device in devices]
        return float(np.maximum(sign * power.values[rows], 0.0).sum()) * case.step_h

    def total(name: str) -> float:
        return float(tables[name].values.sum()) * case.step_h if name in tables else 0.0

    found = {
        "demand": total("demand"),
        "shed": total("shed"),
        "pv": flow(case.pv, 1.0),
        "generators": flow(case.generator, 1.0),
        "import": flow(case.grid, 1.0),
        "discharge": flow(case.ess, 1.0),
        "charge": flow(case.ess, -1.0),
        "export": flow(case.grid, -1.0),
    }
    fed = sum(found[key] for key in ("pv", "generators", "import", "discharge"))
    taken = found["demand"] - found["shed"] + found["charge"] + found["export"]
    return found | {"losses": fed - taken, "pv_curtailed": total("pv_available") - found["pv"]}
