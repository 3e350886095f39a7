"""One page that shows a plan: power by source, stored energy, shedding, voltages, islands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.case.schema import GridTable
from resilience.errors import UsageError
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.planning.plan import Plan
from resilience.plots import panels, style
from resilience.tolerances import DRAWN_TOLERANCE_MW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_plan(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draws the plan; with `path` (png, pdf or svg) it is also written there.

    Raises:
        UsageError: the suffix is no picture format, or the plan is without its case.
    """
    return style.picture(lambda: _draw(plan), path)


def _draw(plan: Plan) -> Figure:
    from matplotlib.figure import Figure

    drawn = [p for need, p in _PANELS.items() if need in plan.tables]
    if plan.case is not None and plan.case.outages:
        drawn.append(_lines_out)
    heights = [{_power: 2.4, _islands: 1.5, _lines_out: 0.6}.get(p, 1.2) for p in drawn]
    figure = Figure(figsize=(9.0, 1.2 + 1.35 * sum(heights)), layout="constrained")
    axes = figure.subplots(
        len(drawn), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    hours, (_, down) = _hours(plan), _outages(plan)
    for axis, panel in zip(axes, drawn, strict=True):
        panel(axis, plan, hours)
        if panel not in (_islands, _lines_out):
            style.shade(axis, hours, down)
        style.open_frame(axis)
    style.time_axis(axes[-1], plan.times[0], hours)
    if down.any():
        axes[-1].set_xlabel(axes[-1].get_xlabel() + "; grey: a line is out")
    style.headed(figure, _title(plan))
    return figure


def _title(plan: Plan) -> str:
    proven = "" if plan.bound is None else f", proven bound {plan.bound:.3f} $"
    return (
        f"{plan.name}: {plan.method} on {plan.physics}, {plan.status}, "
        f"objective {plan.objective:.3f} ${proven}, shed {plan.shed_mwh:.2f} MWh"
    )


def _hours(plan: Plan) -> Floats:
    slots = plan.tables["power"].values.shape[1]
    return np.arange(slots + 1) * plan.step_min / 60.0


def _fleets(plan: Plan) -> list[DeviceFleet]:
    """The fleets whose power is stacked."""
    if plan.case is None:
        raise UsageError("a plan without its case cannot be drawn", hint="keep case.toml beside it")
    return style.fleet_order(device_fleets(plan.case).values())


def _outages(plan: Plan) -> tuple[list[str], np.ndarray]:
    """Lines that are out at some time, and (lines, slots) when."""
    outages = plan.case.outages if plan.case else ()
    lines = list(dict.fromkeys(outage.line for outage in outages))
    down = np.zeros((len(lines), len(_hours(plan)) - 1), bool)
    for outage in outages:
        down[lines.index(outage.line), outage.first : outage.stop] = True
    return lines, down


def _power(axis: Axes, plan: Plan, hours: Floats) -> None:
    power = plan.tables["power"]
    flows = {f.title: np.array([power[name] for name in f.names]) for f in _fleets(plan)}
    fed = {group: np.maximum(flow, 0.0).sum(0) for group, flow in flows.items()}
    intake = {group: np.maximum(-flow, 0.0).sum(0) for group, flow in flows.items()}
    panels.draw_power(axis, hours, fed, intake)
    if "demand" in plan.tables:
        demand, shed = (plan.tables[name].values.sum(0) for name in ("demand", "shed"))
        if "surplus" in plan.tables:
            demand = demand + plan.tables["surplus"].values.sum(0)
        panels.draw_demand(axis, hours, demand, shed)
    axis.set_ylabel("power, MW")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, frameon=False, fontsize=8)


def _storage(axis: Axes, plan: Plan, hours: Floats) -> None:
    table = plan.tables["soc"]
    storage = in_roles(_fleets(plan), "storage")
    size = np.concatenate([fleet.size_mwh() for fleet in storage])
    start_mwh = np.concatenate([fleet.start()[fleet.stored] for fleet in storage if fleet.stored])
    soc = np.column_stack([start_mwh / size, table.values])
    panels.draw_soc(axis, hours, table.labels, soc, size)
    axis.set_ylabel("state of\ncharge")
    style.aside(axis)


def _fuel(axis: Axes, plan: Plan, hours: Floats) -> None:
    table = plan.tables["fuel"]
    tanks = {tank.name: tank for tank in plan.case.tank} if plan.case is not None else {}
    for k, name in enumerate(table.labels):
        start = tanks[name].initial_m3 if name in tanks else table.values[k, 0]
        level = np.append(start if start is not None else np.nan, table.values[k])
        axis.plot(hours, level, color=style.FUEL_COLOURS[k % len(style.FUEL_COLOURS)], label=name)
    axis.set_ylim(bottom=0.0)
    axis.set_ylabel("fuel, m³")
    style.aside(axis)


def _shed(axis: Axes, plan: Plan, hours: Floats) -> None:
    total = plan.tables["shed"].values.sum(0)
    style.stairs(axis, hours, np.zeros_like(total), total, color=style.SHED_COLOUR)
    axis.set_ylabel("shed, MW")
    axis.set_ylim(0.0, max(1.05 * total.max(), 0.1))
    if total.max() < DRAWN_TOLERANCE_MW:
        axis.set_yticks([0.0])
        axis.text(0.5, 0.5, "nothing is shed", transform=axis.transAxes, ha="center", va="center")


def _voltage(axis: Axes, plan: Plan, hours: Floats) -> None:
    voltage = plan.tables["voltage"].values
    low, middle, high = np.quantile(voltage, [0.0, 0.5, 1.0], axis=0)
    style.stairs(axis, hours, low, high, color="#9ecae9", label="lowest to\nhighest bus")
    style.steps(axis, hours, middle, color="#08519c", lw=1.2, label="median")
    if plan.case is not None:
        limits = plan.case.network.v_min_pu.min(), plan.case.network.v_max_pu.max()
        for k, limit in enumerate(limits):
            label = None if k else "limits"
            axis.axhline(limit, color=style.SHED_COLOUR, lw=0.9, ls="--", label=label)
    axis.set_ylabel("voltage, pu")
    style.aside(axis)


def _islands(axis: Axes, plan: Plan, hours: Floats) -> None:
    table, case = plan.tables["island"], plan.case
    on_grid = (
        np.isin(table.labels, _grid_buses(plan)) if case else np.zeros(len(table.labels), bool)
    )
    shown = panels.band_colours(table.values.astype(int), on_grid)
    panels.draw_band(axis, hours, table.labels, shown)
    panels.band_legend(axis, shown)
    axis.set_ylabel("bus")


def _grid_buses(plan: Plan) -> list[str]:
    if plan.case is None:
        return []
    network = plan.case.network
    return [network.bus_names[network.bus(t.bus)] for t in plan.case.tables_of(GridTable)]


def _lines_out(axis: Axes, plan: Plan, hours: Floats) -> None:
    lines, down = _outages(plan)
    panels.draw_lines_out(axis, hours, lines, down)
    axis.set_ylabel("lines\nout")


_PANELS = {
    "power": _power,
    "soc": _storage,
    "fuel": _fuel,
    "shed": _shed,
    "voltage": _voltage,
    "island": _islands,
}
"""A panel for every table that a plan may have, from top to bottom."""
