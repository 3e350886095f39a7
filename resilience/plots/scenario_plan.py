"""One page that shows a plan over scenarios: the common schedule, and what comes after it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.files import check_picture
from resilience.models.components import device_fleets
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.tables import SlotTable
from resilience.plots import style
from resilience.plots.style import DEMAND_COLOUR, SHED_COLOUR, STORAGE_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resilience.case import Case


def plot_scenario_plan(plan: ScenarioPlan, path: str | Path | None = None) -> Figure:
    """Draws the plan; with `path` (png, pdf or svg) it is also written there.

    Raises:
        UsageError: the suffix is no picture format, or the plan lacks its case.
    """
    if path is not None:
        check_picture(Path(path))
    if plan.case is None:
        raise UsageError("a plan without its case cannot be drawn", hint="keep case.toml beside it")
    with style.look():
        return style.write_figure(_draw(plan, plan.case), path)


def _draw(plan: ScenarioPlan, case: Case) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.subplots(4, 1, gridspec_kw={"height_ratios": [2.0, 1.6, 1.0, 1.4]})
    slots = plan.bands["energy"].values.shape[1]
    hours = np.arange(slots + 1) * plan.step_min / 60.0
    _power(axes[0], plan, case, hours[: plan.common_slots + 1])
    _stored(axes[1], plan.bands["energy"], hours[1:])
    axes[1].plot(
        hours[1 : plan.common_slots + 1],
        plan.tables["energy"].values.sum(0)
        if "energy" in plan.tables
        else np.zeros(plan.common_slots),
        color="black",
        lw=1.2,
        label="common schedule",
    )
    axes[1].set_ylabel("stored, MWh")
    axes[1].legend(frameon=False, fontsize=8)
    _band(axes[2], plan.bands["shed"], hours, SHED_COLOUR)
    axes[2].set_ylabel("shed, MW")
    axes[2].set_ylim(0.0, max(1.05 * float(plan.bands["shed"].values.max()), 0.1))
    _costs(axes[3], plan)
    for axis in axes[:3]:
        style.time_axis(axis, plan.times(1)[0], hours)
    for axis in axes[:2]:
        axis.set_xlabel("")
    for axis in axes:
        style.open_frame(axis)
    style.headed(figure, _title(plan))
    return figure


def _title(plan: ScenarioPlan) -> str:
    return (
        f"{plan.name}: {plan.method} on {plan.physics}, {plan.scenarios} scenarios, "
        f"objective {plan.objective:.3f} $, proven bound {plan.bound:.3f} $"
    )


def _power(axis: Axes, plan: ScenarioPlan, case: Case, hours: Floats) -> None:
    """Power by source in the common schedule, and how likely it is to be followed still."""
    power = plan.tables["power"]
    for fleet in style.fleet_order(device_fleets(case).values()):
        total = np.sum([power[name] for name in fleet.names], axis=0)
        style.steps(axis, hours, total, color=fleet.colour, lw=1.4, label=fleet.title)
    axis.axhline(0.0, color="black", lw=0.5)
    axis.set_ylabel("common schedule,\nMW fed in")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, frameon=False, fontsize=8)
    share = axis.twinx()
    axis.set_zorder(share.get_zorder() + 1)
    axis.patch.set_visible(False)
    staying = plan.tables["staying"].values[0]
    share.fill_between(
        hours, 0.0, np.append(staying, staying[-1]), step="post", color="black", alpha=0.08, lw=0
    )
    share.set_ylim(0.0, 1.0)
    share.set_ylabel("no outage yet\n(probability, grey)", fontsize=8)


def _band(axis: Axes, band: SlotTable, hours: Floats, colour: str) -> None:
    mean, low, high = (np.append(row, row[-1]) for row in band.values)
    axis.fill_between(
        hours, low, high, step="post", color=colour, alpha=0.25, lw=0, label="5 to 95 %"
    )
    axis.step(hours, mean, where="post", color=colour, lw=1.3, label="mean of scenarios")


def _stored(axis: Axes, band: SlotTable, ends: Floats) -> None:
    mean, low, high = band.values
    axis.fill_between(ends, low, high, color=STORAGE_COLOUR, alpha=0.25, lw=0, label="5 to 95 %")
    axis.plot(ends, mean, color=STORAGE_COLOUR, lw=1.3, label="mean of scenarios")


def _costs(axis: Axes, plan: ScenarioPlan) -> None:
    cost, p = plan.episodes["cost"], plan.episodes["probability"]
    clairvoyant = plan.episodes["clairvoyant_cost"]
    for values, dash, label in ((cost, "-", plan.method), (clairvoyant, "--", "known beforehand")):
        order = np.argsort(values)
        shade = DEMAND_COLOUR if dash == "-" else SHED_COLOUR
        share = np.cumsum(p[order])
        axis.step(values[order], share, dash, where="post", color=shade, lw=1.3, label=label)
    axis.axvline(plan.expected_cost, color=DEMAND_COLOUR, lw=0.8, ls=":")
    axis.set_xlabel("cost of a scenario, $ (dotted: expected)")
    axis.set_ylabel("share of scenarios\nthat cost no more")
    axis.set_ylim(0.0, 1.02)
    axis.legend(frameon=False, fontsize=8)
