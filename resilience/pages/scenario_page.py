"""The page of a plan over scenarios: what to do until an outage shows, and what may follow."""

from __future__ import annotations

from resilience.arrays import Floats
from resilience.case import Case
from resilience.pages.charts import Chart, ChartSeries, times
from resilience.pages.document import number, render
from resilience.pages.feeder import map_data
from resilience.pages.plan_charts import plan_charts
from resilience.pages.plan_page import assumption_rows, case_of, certificate_rows, short_gap
from resilience.planning.scenarios.first_failures import first_failures
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.tables import SlotTable
from resilience.plots.feeder.view import feeder_map
from resilience.text.actions import action_rows, failure_cells
from resilience.text.plan import percent
from resilience.text.scenario_plan import over_all, over_scenarios
from resilience.tolerances import DRAWN_TOLERANCE_MW


def scenario_page(plan: ScenarioPlan) -> str:
    """The page as text.

    Raises:
        UsageError: the plan was kept without its case.
    """
    case = case_of(plan)
    slots = plan.tables["power"].values.shape[1]
    charts = plan_charts(case, plan.tables) | _over_time(plan, case)
    failures = failure_cells(case, first_failures(plan))
    drawn = {
        "times": times(case.window, slots),
        "charts": {key: chart.data() for key, chart in charts.items()},
        "map": map_data(feeder_map(plan, case)),
    }
    return render(
        "scenarios.html.j2",
        plan.summary(),
        drawn,
        title=f"{plan.name}: a plan over scenarios",
        case=case,
        plan=plan,
        verdict=_verdict(plan),
        tiles=_tiles(plan),
        actions=action_rows(case, plan.instructions()),
        failure_heads=[_two_lines(head) for head in failures.heads],
        failures=failures.rows,
        resting=failures.idle,
        outcomes=over_scenarios(plan),
        certificate=certificate_rows(plan),
        assumptions=[
            ("scenarios", f"{plan.scenarios} of {plan.process}"),
            ("risk", plan.risk),
            *assumption_rows(plan, case),
        ],
    )


def _two_lines(head: str) -> tuple[str, str]:
    """Which lines, and what is said of them."""
    first, *more = head.split("\n")
    return first, " · ".join(more)


def _verdict(plan: ScenarioPlan) -> list[str]:
    chance = 100.0 * plan.shed_probability
    sheds = (
        "No scenario sheds anything."
        if plan.shed_probability < 1e-9
        else f"Something is shed in {chance:.1f} % of the scenarios, "
        f"{number(plan.expected_shed_mwh, 3)} MWh on average over all of them."
    )
    many = f"{plan.scenarios} scenarios"
    if plan.represented is not None:
        many += f" that stand for {plan.represented}"
    costs = (
        f"It costs {number(plan.objective)} $: {plan.risk} over {many}. No plan for them costs "
        f"less than {number(plan.bound)} $ ({plan.bound_of}); the gap is {percent(plan.gap)}."
    )
    wider = [over_all(plan.unreduced) + "."] if plan.unreduced is not None else []
    follows = (
        f"The schedule below holds until an outage shows; from then on every scenario goes its own "
        f"way. Knowing the scenario beforehand would save "
        f"{number(plan.value_of_perfect_information)} $."
    )
    return [sheds, costs, *wider, follows]


def _tiles(plan: ScenarioPlan) -> list[tuple[str, str, str]]:
    return [
        ("objective", number(plan.objective), "$"),
        ("proven bound", number(plan.bound), "$"),
        ("gap", short_gap(plan.gap), "%"),
        ("expected shedding", number(plan.expected_shed_mwh, 3), "MWh"),
        ("worst scenario", number(plan.worst_cost), "$"),
        ("mean of the worst 5 %", number(plan.cvar_95_cost), "$"),
    ]


def _over_time(plan: ScenarioPlan, case: Case) -> dict[str, Chart]:
    """Bands over all scenarios, and how likely the common schedule still holds."""
    charts = {}
    titles = {
        "energy": ("Stored energy, over all scenarios", "MWh"),
        "shed": ("Shed, over all scenarios", "MW"),
    }
    for key, table in plan.bands.items():
        if key == "shed" and float(table.values.max(initial=0.0)) <= DRAWN_TOLERANCE_MW:
            continue
        title, unit = titles[key]
        charts[f"band_{key}"] = Chart(
            title, unit, _band(table), bottom=0.0, note="Band: 90 % of the scenarios.",
            slots=table.values.shape[1],
        )  # fmt: skip
    if "staying" in plan.tables:
        staying: Floats = 100.0 * plan.tables["staying"].values[0]
        series = [ChartSeries("no outage yet", "var(--m2)", "line", staying)]
        charts["staying"] = Chart(
            "Probability that the common schedule still holds", "%", series, bottom=0.0, top=100.0
        )
    return charts


def _band(table: SlotTable) -> list[ChartSeries]:
    return [
        ChartSeries("5 to 95 % of the scenarios", "var(--band)", "low", table["low"]),
        ChartSeries("5 to 95 % of the scenarios", "var(--band)", "high", table["high"]),
        ChartSeries("mean", "var(--m0)", "line", table["mean"]),
    ]
