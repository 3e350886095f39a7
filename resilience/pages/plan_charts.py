"""Charts of a plan: power by source, stored energy, fuel, what is shed, voltages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.schema import LoadTable
from resilience.models.components import device_fleets, in_roles
from resilience.pages.charts import Chart, ChartSeries, Mark, lines, stacked
from resilience.planning.tables import SlotTable
from resilience.plots.style import fleet_order
from resilience.tolerances import DRAWN_TOLERANCE_MW

SHADES = tuple(f"var(--shed{k})" for k in range(8))
"""From the darkest on: what is shed of groups of loads."""
MAX_GROUPS = 7

Tables = Mapping[str, SlotTable]


def plan_charts(case: Case, tables: Tables) -> dict[str, Chart]:
    """Every chart that the tables of a plan allow, by its key.

    Args:
        case: the case as solved.
        tables: of the plan, see `tables.table_units`.
    """
    charts = {"power": power_chart(case, tables)}
    if "soc" in tables:
        charts["soc"] = _soc(case, tables["soc"])
    if "fuel" in tables:
        charts["fuel"] = _fuel(case, tables["fuel"])
    if "shed" in tables and float(tables["shed"].values.max(initial=0.0)) > DRAWN_TOLERANCE_MW:
        charts["shed"] = _shed_by_load(case, tables["shed"])
        if len({load.priority for load in case.tables_of(LoadTable)}) > 1:
            charts["priority"] = _shed_by_priority(case, tables["shed"])
    if "voltage" in tables:
        charts["voltage"] = _voltage(case, tables["voltage"])
    return charts


def power_chart(case: Case, tables: Tables) -> Chart:
    """Power by source above zero, what storage and grid take below it, and the demand."""
    power = tables["power"]
    flows = [
        (fleet, np.array([power[name] for name in fleet.names]))
        for fleet in fleet_order(device_fleets(case).values())
    ]
    signs: tuple[tuple[Mark, float], ...] = (("up", 1.0), ("down", -1.0))
    series = [
        ChartSeries(fleet.title, fleet.colour, mark, np.maximum(sign * flow, 0.0).sum(0))
        for mark, sign in signs
        for fleet, flow in flows
        if len(flow) and (sign * flow).max(initial=0.0) > DRAWN_TOLERANCE_MW
    ]
    if "demand" in tables:
        demand, shed = (tables[name].values.sum(axis=0) for name in ("demand", "shed"))
        if "surplus" in tables:
            demand = demand + tables["surplus"].values.sum(axis=0)
        series += demand_series(demand, shed)
    note = "Below zero: what storage and grid take."
    return Chart("Power by source", "MW", series, note=note, is_tall=True)


def demand_series(demand: Floats, shed: Floats) -> Iterator[ChartSeries]:
    """The demand as a line and, where anything is, what of it is shed."""
    if shed.max(initial=0.0) > DRAWN_TOLERANCE_MW:
        yield ChartSeries("shed", "var(--shed)", "hatch", shed)
    yield ChartSeries("demand", "var(--ink)", "line", demand)


def _soc(case: Case, table: SlotTable) -> Chart:
    storage = in_roles(device_fleets(case).values(), "storage")
    size = np.concatenate([fleet.size_mwh() for fleet in storage])
    start = np.concatenate([fleet.start()[fleet.stored] for fleet in storage if fleet.stored])
    soc = np.column_stack([start / size, table.values])
    return Chart(
        "State of charge", "%", lines(table.labels, 100.0 * soc, size), bottom=0.0, top=100.0
    )


def _fuel(case: Case, table: SlotTable) -> Chart:
    tanks = {tank.name: tank for tank in case.tank}
    start = [tanks[name].initial_m3 if name in tanks else table[name][0] for name in table.labels]
    level = np.column_stack([np.array(start, float), table.values])
    return Chart("Fuel in the tanks", "m³", lines(table.labels, level), bottom=0.0)


def _shed_by_load(case: Case, table: SlotTable) -> Chart:
    order = np.argsort(-table.values.sum(axis=1), kind="stable")
    hit = table.values.max(axis=1) > DRAWN_TOLERANCE_MW
    rows = [(table.labels[k], table.values[k]) for k in order if hit[k]]
    if len(rows) > MAX_GROUPS + 1:
        others = np.sum([values for _, values in rows[MAX_GROUPS:]], axis=0)
        rows = [*rows[:MAX_GROUPS], (f"{len(rows) - MAX_GROUPS} more", others)]
    return Chart("Shed, by load", "MW", stacked(rows, SHADES), bottom=0.0)


def _shed_by_priority(case: Case, table: SlotTable) -> Chart:
    rows = [
        (f"priority {priority:g}", np.sum([table[name] for name in names], axis=0))
        for priority, names in loads_by_priority(case).items()
    ]
    return Chart("Shed, by priority", "MW", stacked(rows, SHADES), bottom=0.0)


def loads_by_priority(case: Case) -> dict[float, list[str]]:
    """Names of loads by their priority, the highest first."""
    groups: dict[float, list[str]] = {}
    for load in sorted(case.tables_of(LoadTable), key=lambda load: -load.priority):
        groups.setdefault(load.priority, []).append(load.name)
    return groups


def _voltage(case: Case, table: SlotTable) -> Chart:
    low, middle, high = np.nanquantile(table.values, [0.0, 0.5, 1.0], axis=0)
    between = "lowest to highest bus"
    series = [
        ChartSeries(between, "var(--band)", "low", low),
        ChartSeries(between, "var(--band)", "high", high),
        ChartSeries("median bus", "var(--m0)", "line", middle),
    ]
    limits = float(case.network.v_min_pu.min()), float(case.network.v_max_pu.max())
    return Chart("Voltage", "pu", series, limits)
