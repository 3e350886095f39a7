"""A plan over scenarios as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.text import Text

from resilience.arrays import Floats
from resilience.fragility.outages.weights import worth
from resilience.models.components import device_fleets, fleet_classes, in_roles
from resilience.planning.scenarios.first_failures import first_failures
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.scenarios.records import Unreduced
from resilience.text.actions import action_list, failure_tables, schedule, when
from resilience.text.grid import grid, pages
from resilience.text.plan import certificate, not_modelled, percent

MAX_SCHEDULE_ROWS = 12  # more would not be read


def print_scenario_plan(
    plan: ScenarioPlan, console: Console, *, with_schedule: bool = False
) -> None:
    """Prints the plan: costs and bound, what to do, the common schedule, scenarios, certificate.

    Args:
        plan: the plan.
        console: where to.
        with_schedule: also the powers of every unit, hour by hour.
    """
    console.print(_verdict(plan))
    if plan.not_modelled:
        console.print(not_modelled(plan))
    proof = certificate(plan, " in every scenario", f"{plan.algorithm}; ")
    for section in (
        *_actions(plan, console.width, with_schedule),
        _schedule(plan, console.width),
        grid("Over scenarios", over_scenarios(plan), "", ""),
        proof,
    ):
        console.print()
        console.print(section)


def _actions(plan: ScenarioPlan, width: int, with_schedule: bool) -> list[RenderableType]:
    """What to do until an outage shows, and when one does; nothing without the case."""
    if plan.case is None:
        return []
    sections: list[RenderableType] = [
        action_list(plan.case, plan.instructions(), "To do until an outage shows")
    ]
    if failures := first_failures(plan):
        sections.append(Group(*failure_tables(plan.case, failures, width)))
    hourly = schedule(plan.case, plan.tables, width) if with_schedule else []
    return [*sections, *hourly]


def _verdict(plan: ScenarioPlan) -> Text:
    style = "bold green" if plan.status == "optimal" and not plan.relaxed else "bold yellow"
    text = Text.assemble((plan.name, "bold"), "  ", plan.method, " on ", plan.physics, "  ")
    status = f"{plan.status} for a relaxation" if plan.relaxed else plan.status
    text.append("simulated" if plan.algorithm == "simulation" else status, style)
    text.append(f"\nobjective {plan.objective:.4f} $: {plan.risk} over {plan.scenarios} scenarios")
    if plan.represented is not None:
        text.append(f" that stand for {plan.represented}")
    if plan.different < plan.scenarios:
        text.append(f", {plan.different} of them different")
    text.append(f"\nproven bound {plan.bound:.4f} $ ({plan.bound_of}), gap {percent(plan.gap)}")
    if plan.unreduced is not None:
        text.append("\n" + over_all(plan.unreduced), "bold")
    return text


def over_all(over_all: Unreduced) -> str:
    """What the plan costs over the scenarios that were reduced, in words."""
    return (
        f"over all {over_all.scenarios} this plan costs {over_all.expected_cost:.2f} ± "
        f"{over_all.cost_error:.2g} $ and sheds {over_all.expected_shed_mwh:.3f} ± "
        f"{over_all.shed_error:.2g} MWh (standard errors; modes relaxed), in "
        f"{100 * over_all.shed_probability:.1f} % of them"
    )


def _schedule(plan: ScenarioPlan, terminal: int) -> RenderableType:
    """The common schedule, in as many steps of equal length as can be read."""
    case, n = plan.case, plan.common_slots
    if case is None:
        return Text("without its case, the common schedule cannot be summed up")
    width = max(-(-n // MAX_SCHEDULE_ROWS), 1)
    starts = np.arange(0, n, width)
    power = plan.tables["power"]

    def mean(names: Iterable[str]) -> Floats:
        rows = [power.labels.index(name) for name in names]
        total = power.values[rows].sum(0)
        return np.add.reduceat(total, starts) / np.diff(np.append(starts, n))

    fleets = device_fleets(case)
    shown = in_roles(fleet_classes(), "storage", "dispatchable", "exchange")
    columns = [mean(fleets[f.kind].names if f.kind in fleets else ()) for f in shown]
    ends = np.append(starts[1:], n) - 1
    energy = plan.tables.get("energy")
    stored = np.zeros(len(ends)) if energy is None else energy.values.sum(0)[ends]
    staying = plan.tables["staying"].values[0][starts]
    steps = [(int(t), int(end) + 1) for t, end in zip(starts, ends, strict=True)]
    cells = [
        *((f"{f.title}\nMW", [f"{mw:+.3f}" for mw in column])
          for f, column in zip(shown, columns, strict=True)),
        ("stored\nMWh", [f"{mwh:.3f}" for mwh in stored]),
        ("here\n%", [f"{100 * share:.1f}" for share in staying]),
    ]  # fmt: skip
    hours = n * plan.step_min / 60.0
    title = f"Common schedule, {hours:g} h: means fed in; MWh at the end"
    times = [when(case, *step) for step in steps]
    return Group(*pages(title, ("from-to", times), cells, terminal))


def over_scenarios(plan: ScenarioPlan) -> list[tuple[str, str]]:
    """What the plan costs, sheds and leaves over its scenarios, in words and figures."""
    energy = plan.episodes["end_energy_mwh"]
    p = plan.episodes["probability"]
    rows = [
        ("expected cost", f"{plan.expected_cost:.4f} $"),
        ("CVaR 95 %", f"{plan.cvar_95_cost:.4f} $"),
        ("worst", f"{plan.worst_cost:.4f} $"),
        ("expected shedding", f"{plan.expected_shed_mwh:.4f} MWh"),
        ("probability of shedding", _chance(plan)),
        ("energy left, expected", f"{float(p @ energy):.3f} MWh"),
        ("value of perfect information", _worth(plan, plan.value_of_perfect_information)),
    ]
    if plan.value_of_stochastic_solution is not None:
        more = _worth(plan, plan.value_of_stochastic_solution)
        rows.append(("value of the stochastic solution", more))
    return rows


def _chance(plan: ScenarioPlan) -> str:
    """The probability of shedding, with what weighted scenarios are worth."""
    weights = worth(plan.episodes["probability"])
    return f"{100 * plan.shed_probability:.2f} %{f', {weights}' if weights else ''}"


def _worth(plan: ScenarioPlan, value: float) -> str:
    """A difference to the plan's cost, which, where it was searched for, is known to its gap."""
    doubt = 0.0 if plan.algorithm == "simulation" else round(plan.objective - plan.bound, 4)
    text = f"{round(value, 4) + 0.0:.4f} $"  # adding 0.0 makes a rounded -0.0 a plain zero
    return f"{text}, within the gap of {doubt:.4f} $" if doubt and abs(value) <= doubt else text
