"""`solve`: one deterministic horizon, outages known in advance, by any of the methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from resilience.case import Case, load_case
from resilience.case.schema import DeviceTable
from resilience.dispatch.reasons import shed_reasons
from resilience.errors import UsageError
from resilience.fragility.outages import outages_from
from resilience.models.algebra import Floats
from resilience.models.methods import METHODS, Answer, Options
from resilience.models.methods.answer import gap
from resilience.models.microgrid import Physics
from resilience.models.problem import Problem, as_switched, horizon
from resilience.models.referee import audit, settle
from resilience.models.situation import Situation
from resilience.progress import phase, stopwatch
from resilience.results import Plan, Table, outage_texts, replacing_file


def solve(
    case: Case | str | Path,
    method: str = "minlp",
    *,
    physics: Physics | None = None,
    outages: str | Path | None = None,
    seed: int | None = None,
    time_limit: float = 60.0,
    relative_gap: float = 1e-3,
) -> Plan:
    """The best plan for the case's horizon.

    Args:
        case: a case, its file, or the name of an installed one.
        method: lp, milp, socp, nlp, minlp or exact.
        physics: copperplate, lindistflow or distflow; the method's own if omitted.
        outages: `"6-26@14:00-17:30, ..."`, a CSV file, `"bell"` for one draw of the
            process that the case's `[outage]` describes, or `"none"`; the case's own if omitted.
        seed: of the draw; 0 if omitted.
        time_limit: seconds for the search; the best plan found is returned.
        relative_gap: gap at which the search may stop.

    Raises:
        CaseError: the case or the outages have mistakes; all of them are listed.
        UsageError: unknown method or physics, or a pair that does not go together.
        InfeasibleError: no plan satisfies the model; the message names what conflicts.
        SolverError: no plan was found in time.
    """
    if method not in METHODS:
        raise UsageError(
            f"method {method!r} is unknown; allowed: {', '.join(METHODS)}",
            hint="minlp is the default; lp is the fastest",
        )
    with stopwatch() as seconds:
        with phase("case"):
            case = case if isinstance(case, Case) else load_case(case)
            if outages is not None or seed is not None:
                case = case.replace(outages=outages_from(outages, case, seed))
        find, usual = METHODS[method]
        with phase("model"):
            problem = horizon(case, physics or usual)
        answer = find(problem, Options(time_limit, relative_gap))
        with phase("audit"):
            plan = describe(problem, answer, method)
    total = sum(seconds.values())
    return replace(plan, seconds=total, seconds_by_phase=seconds)


def export_model(plan: Plan, path: Path) -> None:
    """Writes the model behind a plan as LP, MPS or NL, by the suffix of `path`.

    Raises:
        UsageError: another suffix, or a plan without its case.
    """
    from resilience.models.backends.pyomo import Pyomo, check_format

    check_format(path)
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
    return found | _states(problem, z, as_switched(problem, z))


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
