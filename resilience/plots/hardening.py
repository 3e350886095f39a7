"""What to build before the storm as a picture: the feeder with what is built, and the frontier."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.planning.hardening.draws import StrengthOption
from resilience.planning.hardening.report import Hardening
from resilience.planning.hardening.sites import UnitOption
from resilience.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_hardening(hardening: Hardening, path: str | Path | None = None) -> Figure:
    """Draws the feeder with what is built, what it saves in new storms, and other budgets.

    Lines are as wide as they are likely to fail. Without places of buses there is no map.

    Args:
        hardening: from `resilience.harden`.
        path: a .png, .pdf or .svg file.

    Raises:
        UsageError: a suffix that is no picture format.
    """
    return style.picture(lambda: _draw(hardening), path)


def _draw(hardening: Hardening) -> Figure:
    from matplotlib.figure import Figure

    panels = [_costs]
    if len(hardening.frontier) > 1:
        panels.append(_frontier)
    if _places(hardening) is not None:
        panels.insert(0, _map)
    figure = Figure(figsize=(4.0 * len(panels), 3.6), layout="constrained")
    for axis, draw in zip(np.ravel(figure.subplots(1, len(panels))), panels, strict=True):
        draw(axis, hardening)
    style.headed(
        figure,
        f"{hardening.case.name}: {len(hardening.chosen)} of {len(hardening.options)} options, "
        f"{hardening.cost:,.10g} $",
    )
    return figure


def _places(hardening: Hardening) -> Floats | None:
    """(buses, 2) where the buses stand; None where any has no place."""
    network, places = hardening.case.network, hardening.case.places
    if any(name not in places for name in network.bus_names):
        return None
    return np.array([places[name] for name in network.bus_names], float)


def _map(axis: Axes, hardening: Hardening) -> None:
    place, network = _places(hardening), hardening.case.network
    assert place is not None
    chances = zip(hardening.options, hardening.fails, strict=True)
    fails = {option.line: p for option, p in chances if isinstance(option, StrengthOption)}
    built = {o.line for o in hardening.chosen if not isinstance(o, UnitOption)}
    for k, name in enumerate(network.line_names):
        if not network.in_service[k] and name not in built:
            continue
        x, y = place[[network.from_bus[k], network.to_bus[k]]].T
        colour = style.METHOD_COLOURS[1] if name in built else style.OUTAGE_COLOUR
        axis.plot(x, y, color=colour, lw=0.8 + 6.0 * fails.get(name, 0.0), solid_capstyle="round")
        if name in built:
            axis.annotate(
                name, (x.mean(), y.mean()), (3, 3), textcoords="offset points", fontsize=7
            )
    axis.plot(*place.T, "o", color="#000000", ms=2.2)
    _units(axis, hardening, place)
    axis.set_title("built (orange), width: chance to fail", fontsize=9, loc="left")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_axis_off()


def _units(axis: Axes, hardening: Hardening, place: Floats) -> None:
    """A mark at every bus at which units are built, with their sites and how many."""
    chosen = [option for option in hardening.chosen if isinstance(option, UnitOption)]
    sites = Counter((option.unit.bus, option.site) for option in chosen)
    for (bus, site), number in sites.items():
        x, y = place[hardening.case.network.bus(bus)]
        axis.plot(x, y, "s", color=style.METHOD_COLOURS[1], ms=6)
        words = site if number == 1 else f"{number} × {site}"
        axis.annotate(words, (x, y), (5, 5), textcoords="offset points", fontsize=7)


def _costs(axis: Axes, hardening: Hardening) -> None:
    table = hardening.comparison()
    place = np.arange(len(table))
    axis.bar(
        place, table["cost"], yerr=table["cost_error"], color=style.METHOD_COLOURS[0], capsize=3
    )
    axis.set_xticks(place, [str(name) for name in table.index])
    axis.set_ylabel("cost of a new storm, $")
    style.open_frame(axis)


def _frontier(axis: Axes, hardening: Hardening) -> None:
    table, unit = hardening.frontier_frame(), "$" if hardening.years is None else "$ a year"
    # A budget without end has no place but what is spent of it.
    budget = np.where(np.isfinite(table.index), table.index, table["spent"])
    axis.plot(budget, table["value"], "o-", color=style.METHOD_COLOURS[1], label="best choice")
    axis.plot(budget, table["bound"], "_", color=style.METHOD_COLOURS[0], ms=9, label="proven")
    axis.set_xlabel("budget, $")
    axis.set_ylabel(f"objective, {unit}")
    axis.set_ylim(bottom=0.0)
    axis.legend(frameon=False)
    style.open_frame(axis)
