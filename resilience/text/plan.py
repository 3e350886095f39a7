"""A plan as text for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from resilience.case.deliveries import delivery_slot
from resilience.case.outages import outage_texts
from resilience.case.schema import LoadTable
from resilience.models.components import DeviceFleet, device_fleets, fleet_classes, in_roles
from resilience.planning.plan import Plan
from resilience.planning.records import CertifiedPlan
from resilience.text.actions import action_list, schedule
from resilience.text.grid import grid
from resilience.text.prices import price_table
from resilience.tolerances import AUDIT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case

WIDEST = 1000  # letters, more than any table takes
MAX_LISTED = 12  # names in a list, before the others are only counted


def print_plan(
    plan: Plan, console: Console, *, with_schedule: bool = False, with_prices: bool = False
) -> None:
    """Prints the plan: verdict, what was assumed, what to do, costs, energy, shedding, certificate.

    Args:
        plan: the plan.
        console: where to.
        with_schedule: also the powers of every unit, hour by hour.
        with_prices: also what a MWh costs, hour by hour, with one more solve.

    Raises:
        UsageError: prices of a plan that was kept without its case.
        SolverError: no optimum was found in time, and so no prices.
    """
    console.print(_verdict(plan))
    console.print(_assumed(plan))
    if plan.not_modelled:
        console.print(not_modelled(plan))
    for section in (
        *_actions(plan, console.width, with_schedule),
        _money_and_energy(plan, console),
        *_prices(plan, console.width, with_prices),
        _shed(plan),
        Padding(certificate(plan), (0, 0)),
    ):
        console.print()
        console.print(section)
    if plan.outages:
        console.print("This plan knew its outages; the operator's plan is --method stochastic.")


def _verdict(plan: Plan) -> Text:
    style = "bold green" if plan.status == "optimal" and not plan.relaxed else "bold yellow"
    status = f"{plan.status} for a relaxation" if plan.relaxed else plan.status
    text = Text.assemble((plan.name, "bold"), "  ", plan.method, " on ", plan.physics, "  ")
    text.append(status, style)
    text.append(f"\nobjective {plan.objective:.4f} $")
    text.append(f" = operating cost {plan.operating_cost:.4f}")
    text.append(f" - terminal credit {plan.terminal_credit:.4f}")
    if plan.bound is not None and plan.gap is not None:
        text.append(f"\nproven bound {plan.bound:.4f} $ ({plan.bound_of})")
        text.append(f", gap {percent(plan.gap)}")
    else:
        text.append("\nno bound was proven")
    return text


def percent(share: float) -> str:
    """`0.053 %`; what is below a millionth is called so."""
    return "below 0.0001 %" if share < 1e-6 else f"{100 * share:.4f} %"


def _assumed(plan: Plan) -> Text:
    text = Text()
    if not plan.outages:
        return text.append("assumes no outage", "yellow")
    text.append("assumes " + ", ".join(plan.outages) + "\n", "yellow")
    return text.append("and knows it in advance: a real operator would not", "yellow")


def not_modelled(plan: CertifiedPlan) -> Text:
    """What of the network's source is in no number of a plan."""
    return Text(f"not modelled: {'; '.join(plan.not_modelled)}", "yellow")


def _actions(plan: Plan, width: int, with_schedule: bool) -> list[RenderableType]:
    """The list of instructions, and if asked for the schedule; nothing without the case."""
    if plan.case is None:
        return []
    hourly = schedule(plan.case, plan.tables, width) if with_schedule else []
    return [action_list(plan.case, plan.instructions(), "To do"), *hourly]


def _prices(plan: Plan, width: int, with_prices: bool) -> list[RenderableType]:
    """What a MWh costs, if asked for."""
    if not with_prices:
        return []
    rows = plan.price_rows()  # without its case, a plan has none
    return [] if plan.case is None else [*price_table(plan.case, rows, width)]


def _money_and_energy(plan: Plan, console: Console) -> RenderableType:
    costs = [(name, f"{spent:.4f}") for name, spent in plan.costs.items() if abs(spent) > 5e-5]
    costs.append(("operating cost", f"{plan.operating_cost:.4f}"))
    energy = [(words, f"{abs(plan.energy_mwh[key]):.3f}") for key, words in _energy_words(plan)]
    tables = grid("Cost", costs, "term", "$"), grid("Energy", energy, "", "MWh")
    abreast = Table.grid(padding=(0, 4))
    abreast.add_row(*tables)
    needed = abreast.__rich_measure__(console, console.options.update(max_width=WIDEST)).maximum
    return abreast if needed <= console.width else Group(*tables)


def _energy_words(plan: Plan) -> list[tuple[str, str]]:
    """Keys of the energy balance and what they are called: where energy went, then its sources."""
    fleets = in_roles(fleet_classes(), "weather", "dispatchable", "storage", "exchange")
    intake = [fleet.intake for fleet in fleets]
    sources = [
        term
        for fleet in in_roles(fleets, "weather", "dispatchable", "exchange", "storage")
        for term in (fleet.fed, fleet.curtailed)
    ]
    words = [("demand", "demand"), ("shed", "shed"), ("surplus", "taken by loads that return")]
    words += [(term.key, term.words) for term in intake if term]
    words += [("losses", "lost in wires")]
    words += [(term.key, term.words) for term in sources if term]
    return [(key, name) for key, name in words if key in plan.energy_mwh]


def _shed(plan: Plan) -> RenderableType:
    if not plan.shed_by_load:
        return Text("Nothing is shed.", "green")
    from resilience.planning.reading.reasons import REASONS

    rows = []
    for load, reasons in sorted(plan.shed_by_load.items(), key=lambda x: -sum(x[1].values())):
        for reason, mwh in sorted(reasons.items(), key=lambda x: -x[1]):
            because = plan.shed_causes.get(load, {}).get(reason, REASONS[reason])
            rows.append((load, f"{mwh:.3f}", because))
    table = grid(f"Shed: {plan.shed_mwh:.3f} MWh", rows, "load", "MWh", "because")
    table.columns[2].justify = "left"
    return table


def certificate(plan: CertifiedPlan, scope: str = "", algorithm: str = "") -> Text:
    """What of the model a plan satisfies, how well, and how long it took.

    Args:
        plan: of either kind.
        scope: where it satisfies the model, if not simply everywhere.
        algorithm: how it was found.
    """
    text = Text()
    if plan.relaxed:
        text.append("relaxed, and not satisfied by this plan:\n", "bold red")
        for line in plan.relaxed:
            text.append(f"  {line}\n", "red")
    elif plan.audit:
        text.append(f"satisfies the whole {plan.physics} model{scope}\n", "green")
    if plan.audit:
        worst = max(plan.audit.values())
        text.append("audit: worst scaled violation ")
        text.append(f"{worst:.1e}", "green" if worst <= AUDIT_TOLERANCE else "red")
        text.append(f" at {plan.audit_worst}\n" if plan.audit_worst else "\n")
    for note in plan.notes:
        text.append(f"note: {note}\n", "yellow")
    phases = ", ".join(f"{name} {s:.2f}" for name, s in plan.seconds_by_phase.items())
    text.append(f"time: {plan.seconds:.2f} s ({algorithm}{phases})", "dim")
    return text


def print_case(case: Case, console: Console) -> None:
    """Prints what a case holds."""
    network = case.network
    title = Text.assemble((case.name, "bold"), f"  {case.description}")
    closed = int(network.in_service.sum())
    title.append(
        f"\n{len(network.bus_names)} buses, {closed} closed lines, "
        f"{len(network.line_names) - closed} open; {case.slots} slots of {case.step_min:g} min "
        f"from {case.start:%Y-%m-%d %H:%M}"
    )
    console.print(title)
    breakpoints = [n for n, b in zip(network.line_names, network.breakpoint, strict=True) if b]
    switches = [n for n, s in zip(network.line_names, network.switchable, strict=True) if s]
    fails = [unit.name for unit in case.fallible if unit.can_fail]
    cold = [load.name for load in case.tables_of(LoadTable) if load.cold_load_share]
    named = {
        "breakpoints": breakpoints,
        "switchable": switches,
        "units that fail": fails,
        "loads that return with a surplus": cold,
    }
    for words, names in named.items():
        if names:
            console.print(f"{words}: {', '.join(names)}")
    console.print(f"outages: {', '.join(outage_texts(case.outages, case.window)) or 'none'}")
    for line in (*_tanks(case), *_islands(case)):
        console.print(line)
    fleets = device_fleets(case)
    order = in_roles(fleet_classes(), "exchange", "dispatchable", "weather", "storage", "load")
    rows = [_fleet(kind, case, fleets.get(kind)) for kind in (fleet.kind for fleet in order)]
    table = grid("", rows, "devices", "number", "MW", "at buses")
    table.columns[3].justify = "left"
    console.print(table)


def _fleet(kind: str, case: Case, fleet: DeviceFleet | None) -> tuple[str, ...]:
    tables = case.devices.get(kind, ())
    total = 0.0 if fleet is None else float(fleet.size_mw().sum())
    places = ", ".join(f"{t.name}@{t.bus}" for t in tables[:MAX_LISTED])
    more = f" and {len(tables) - MAX_LISTED} more" if len(tables) > MAX_LISTED else ""
    return kind, str(len(tables)), f"{total:.3f}", places + more


def _tanks(case: Case) -> list[str]:
    """What every tank holds, who burns from it, and what is delivered."""
    lines = []
    for tank in case.tank:
        units = [unit.name for unit in case.generator if unit.tank == tank.name]
        contents = (
            f"{tank.initial_m3:g} of {tank.capacity_m3:g} m³ for {', '.join(units) or 'nobody'}"
        )
        comes = [
            f"{d.amount_m3:g} at {case.slot_label(slot)}"
            for d in tank.delivery
            if 0 <= (slot := delivery_slot(d, case.window)) < case.slots
        ]
        more = f"; delivered: {', '.join(comes)}" if comes else ""
        lines.append(f"tank {tank.name}: {contents}{more}")
    return lines


def _islands(case: Case) -> list[str]:
    """What the outages of the case cut the feeder into at worst."""
    from resilience.models.case_program import status
    from resilience.models.microgrid import Microgrid

    if not case.outages:
        return []
    microgrid = Microgrid.build(case, "copperplate")
    situation = microgrid.situation(status(case))
    counts = situation.island.max(axis=0) + 1
    worst = int(counts.argmax())
    lines = [f"most islands: {counts[worst]}, from {case.slot_label(worst)}"]
    for number in range(int(counts[worst])):
        inside = situation.island[microgrid.bus_of, worst] == number
        buses = [name for name, yes in zip(case.network.bus_names, inside, strict=True) if yes]
        is_alive = situation.alive[microgrid.bus_of, worst][inside].any()
        more = f", ... ({len(buses)})" if len(buses) > MAX_LISTED else ""
        verdict = "" if is_alive else " (no source: dead)"
        lines.append(f"  {', '.join(buses[:MAX_LISTED])}{more}{verdict}")
    return lines
