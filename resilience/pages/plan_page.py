"""The page of a plan over known outages."""

from __future__ import annotations

import numpy as np

from resilience.case import Case
from resilience.case.critical import critical_loads
from resilience.case.schema import LoadTable
from resilience.errors import UsageError
from resilience.models.components import fleet_classes, in_roles
from resilience.pages.charts import times
from resilience.pages.document import number, render
from resilience.pages.feeder import map_data
from resilience.pages.plan_charts import loads_by_priority, plan_charts
from resilience.planning.plan import Plan
from resilience.planning.reading.reasons import REASONS
from resilience.planning.records import CertifiedPlan
from resilience.plots.feeder.view import feeder_map, lines_down
from resilience.text.actions import action_rows
from resilience.text.plan import percent

Rows = list[tuple[str, ...]]


def plan_page(plan: Plan) -> str:
    """The page as text.

    Raises:
        UsageError: the plan was kept without its case.
    """
    case = case_of(plan)
    slots = plan.tables["power"].values.shape[1]
    charts = plan_charts(case, plan.tables)
    drawn = {
        "times": times(case.window, slots, lines_down(case, slots)),
        "charts": {key: chart.data() for key, chart in charts.items()},
        "map": map_data(feeder_map(plan, case)),
    }
    return render(
        "plan.html.j2",
        plan.summary(),
        drawn,
        title=f"{plan.name}: a plan",
        case=case,
        plan=plan,
        verdict=_verdict(plan),
        tiles=_tiles(plan, case),
        actions=action_rows(case, plan.instructions()),
        priorities=_priorities(plan, case),
        shed=_shed(plan),
        costs=plan.costs,
        energy=_energy(plan),
        certificate=certificate_rows(plan),
        assumptions=assumption_rows(plan, case),
    )


def case_of(plan: CertifiedPlan) -> Case:
    """The case of a plan.

    Raises:
        UsageError: the plan was kept without it.
    """
    if plan.case is None:
        raise UsageError("a plan without its case has no page", hint="keep case.toml beside it")
    return plan.case


def _verdict(plan: Plan) -> list[str]:
    proof = (
        f"It costs {number(plan.objective)} $. No plan for these outages costs less than "
        f"{number(plan.bound)} $ ({plan.bound_of}); the gap is {percent(plan.gap)}."
        if plan.bound is not None and plan.gap is not None
        else f"It costs {number(plan.objective)} $. No bound was proven: a better plan may exist."
    )
    first = "Nothing is shed." if plan.shed_mwh < 5e-4 else _shed_words(plan)
    if plan.outages:
        knows = (
            f"It assumes that {', '.join(plan.outages)} and nothing else is out, and knows it in "
            "advance: a real operator would not."
        )
    else:
        knows = "It assumes that nothing fails."
    relaxed = (
        [f"It leaves out a part of the model: {'; '.join(plan.relaxed)}."] if plan.relaxed else []
    )
    return [first, proof, *relaxed, knows]


def _shed_words(plan: Plan) -> str:
    demand = plan.energy_mwh["demand"]
    loads = len(plan.shed_by_load)
    return (
        f"{number(plan.shed_mwh, 3)} of {number(demand, 3)} MWh "
        f"({100.0 * plan.shed_mwh / demand:.1f} %) are not served, of {loads} "
        f"load{'s' * (loads != 1)}."
    )


def _tiles(plan: Plan, case: Case) -> list[tuple[str, str, str]]:
    """Heads, figures and units."""
    tiles = [
        ("objective", number(plan.objective), "$"),
        ("proven bound", number(plan.bound), "$" if plan.bound is not None else ""),
        ("gap", "–" if plan.gap is None else short_gap(plan.gap), "%"),
        ("shed", number(plan.shed_mwh, 3), "MWh"),
    ]
    critical = [load.name for load in np.array(case.tables_of(LoadTable))[critical_loads(case)]]
    if critical and "shed" in plan.tables:
        shed, demand = (
            sum(float(plan.tables[name][load].sum()) for load in critical)
            for name in ("shed", "demand")
        )
        served = 100.0 * (1.0 - shed / demand) if demand else 100.0
        tiles.append(("critical loads served", number(served, 1), "%"))
    if "voltage" in plan.tables:
        lowest = float(np.nanmin(plan.tables["voltage"].values))
        tiles.append(("lowest voltage", number(lowest, 3), "pu"))
    return tiles


def short_gap(gap: float) -> str:
    """A gap in percent, as short as a tile has room for."""
    return "< 0.0001" if gap < 1e-6 else f"{100.0 * gap:.4f}"


def _priorities(plan: Plan, case: Case) -> Rows:
    """What is served of the loads of every priority."""
    if "shed" not in plan.tables:
        return []
    shed, demand = plan.tables["shed"], plan.tables["demand"]
    rows: Rows = []
    for priority, names in loads_by_priority(case).items():
        missing = np.array([shed[name] for name in names])
        mwh = float(missing.sum()) * case.step_h
        all_mwh = sum(float(demand[name].sum()) for name in names) * case.step_h
        hours = float((missing > 1e-6).any(axis=0).sum()) * case.step_h
        served = 100.0 * (1.0 - mwh / all_mwh) if all_mwh else 100.0
        rows.append(
            (f"{priority:g}", str(len(names)), number(all_mwh, 3), number(mwh, 3),
             number(served, 2), number(hours, 2))
        )  # fmt: skip
    return rows


def _shed(plan: Plan) -> Rows:
    return [
        (load, number(mwh, 3), REASONS[reason])
        for load, reasons in sorted(
            plan.shed_by_load.items(), key=lambda item: -sum(item[1].values())
        )
        for reason, mwh in sorted(reasons.items(), key=lambda item: -item[1])
    ]


def _energy(plan: Plan) -> Rows:
    """The energy balance in words, where energy went first."""
    fleets = in_roles(fleet_classes(), "weather", "dispatchable", "storage", "exchange")
    terms = [fleet.intake for fleet in fleets]
    terms += [term for fleet in fleets for term in (fleet.fed, fleet.curtailed)]
    words = {"demand": "demand", "shed": "shed", "surplus": "taken by loads that return"}
    words |= {"losses": "lost in wires"} | {term.key: term.words for term in terms if term}
    return [(words.get(key, key), number(abs(mwh), 3)) for key, mwh in plan.energy_mwh.items()]


def certificate_rows(plan: CertifiedPlan) -> Rows:
    """What of the model a plan satisfies, how well, and how long it took."""
    holds = "; ".join(plan.relaxed) if plan.relaxed else ""
    rows: Rows = [("status", plan.status)]
    if holds:
        rows.append(("relaxed, and not satisfied by this plan", holds))
    elif plan.audit:
        rows.append(("satisfies", f"the whole {plan.physics} model"))
    if plan.certificate.bound is not None and plan.certificate.gap is not None:
        rows.append(("proven bound", f"{number(plan.certificate.bound, 6)} $ ({plan.bound_of})"))
        rows.append(("gap", percent(plan.certificate.gap)))
    if plan.audit:
        worst = f"{max(plan.audit.values()):.1e}"
        where = f" at {plan.audit_worst}" if plan.audit_worst else ""
        rows.append(("audit: worst scaled violation", worst + where))
    rows += [("note", note) for note in plan.notes]
    phases = ", ".join(f"{name} {s:.2f}" for name, s in plan.seconds_by_phase.items())
    return [*rows, ("time", f"{plan.seconds:.2f} s ({phases})")]


def assumption_rows(plan: CertifiedPlan, case: Case) -> Rows:
    """What a reader has to take for given."""
    network = case.network
    rows: Rows = [
        ("case", f"{case.name}. {case.description}".strip()),
        ("horizon", f"{case.window}, slots of {case.step_min:g} min; powers are means over a slot"),
        (
            "network",
            f"{len(network.bus_names)} buses, {int(network.in_service.sum())} closed lines",
        ),
        ("physics", plan.physics),
        ("method", plan.method),
        ("energy left at the end", f"credited at {case.terminal_value_per_mwh:g} $/MWh"),
    ]
    return [*rows, *(("not modelled", omission) for omission in plan.not_modelled)]
