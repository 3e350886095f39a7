"""One storm as dispatchers met it: power, storage, shedding, islands, lines, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.evaluation.comparison import Compared
from resilience.files import check_picture
from resilience.models.components import device_fleets, in_roles
from resilience.plots import panels, style
from resilience.plots.storm_choice import Day, EpisodeView, storm
from resilience.plots.storm_data import MethodView
from resilience.tolerances import DRAWN_TOLERANCE_MW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


HEIGHTS = {"power": 2.4, "soc": 1.1, "shed": 1.1, "islands": 1.1, "lines": 0.6}
"""Of the rows, in inches times 1.35."""


def plot_storm(
    compared: Compared,
    methods: str | Sequence[str],
    episode: int | None = None,
    day: Day = None,
    path: str | Path | None = None,
) -> Figure:
    """Draws one storm as one or several methods met it; with `path` it is also written there.

    Args:
        compared: a `Report`, or what `load_comparison` read.
        methods: a method that was compared, or up to six; `clairvoyant` is one of them.
        episode: number from 1. What is omitted of episode and day is chosen: where most is shed
            in all, or, where nothing is, where lines are out for longest.
        day: number from 1, or "all".
        path: a .png, .pdf or .svg file.

    Raises:
        UsageError: a method, an episode or a day that the comparison does not have, or a suffix
            that is no picture format.
    """
    if path is not None:
        check_picture(Path(path))
    view = storm(compared, methods, episode, day)
    with style.look():
        return style.write_figure(_draw(view), path)


def _draw(view: EpisodeView) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    n = len(view.methods)
    width = 9.0 if n == 1 else 1.6 + 3.7 * n
    heights = _heights(view)
    figure = Figure(
        figsize=(width, 1.2 + 1.35 * sum(heights.values())),
        layout=ConstrainedLayoutEngine(wspace=0.05),
    )
    axes = figure.subplots(
        len(heights), n, sharex=True, sharey="row", squeeze=False,
        gridspec_kw={"height_ratios": list(heights.values())},
    )  # fmt: skip
    for k, (name, method) in enumerate(view.methods.items()):
        rows = dict(zip(heights, axes[:, k], strict=True))
        _column(rows, view, method, last=k == n - 1)
        head = f"{name}: {method.cost:.2f} $, {method.shed.sum() * view.case.step_h:.2f} MWh shed"
        rows["power"].set_title(head, loc="left", fontsize=9, fontweight="bold")
        style.time_axis(rows["lines"], view.start, view.hours, 1.0 if n == 1 else 0.55)
        if k == 0:
            _row_labels(rows)
    shed_max = max(float(m.shed.sum(0).max(initial=0.0)) for m in view.methods.values())
    axes[2, 0].set_ylim(0.0, max(1.05 * shed_max, 0.1))
    _top(figure, axes[0], _title(view))
    return figure


def _heights(view: EpisodeView) -> dict[str, float]:
    """More room for more zones and lines, up to a limit."""
    return HEIGHTS | {
        "islands": min(max(0.5, 0.22 * len(view.feeder.zones)), 2.2),
        "lines": min(max(0.4, 0.17 * len(view.feeder.lines)), 1.6),
    }


def _title(view: EpisodeView) -> str:
    same = "" if len(view.methods) == 1 else ", the same storm for all"
    return (
        f"{view.case.name} from {view.start:%Y-%m-%d %H:%M} ({view.which}{same}): "
        "$ spent and MWh shed"
    )


def _column(rows: dict[str, Axes], view: EpisodeView, method: MethodView, *, last: bool) -> None:
    hours, shared = view.hours, view.feeder
    _power(rows["power"], hours, method, _curtailed_words(view))
    units = view.case.ess
    size_mwh = np.array([unit.e_mwh for unit in units])
    panels.draw_soc(rows["soc"], hours, [unit.name for unit in units], method.soc, size_mwh)
    _shed(rows["shed"], hours, view.groups, method)
    shown = panels.band_colours(shared.island, shared.on_grid)
    labels = [
        f"{zone} (grid)" if here else zone
        for zone, here in zip(shared.zones, shared.on_grid, strict=True)
    ]
    panels.draw_band(rows["islands"], hours, labels, shown)
    panels.draw_lines_out(rows["lines"], hours, shared.lines, shared.down)
    for name, axis in rows.items():
        if name not in ("islands", "lines"):
            style.shade(axis, hours, shared.down)
        for centre in shared.centre_h:
            axis.axvline(centre, color="black", lw=1.0, ls=(0, (1, 1.5)))
        style.open_frame(axis)
    if last:
        if view.case.ess:
            style.aside(rows["soc"])
        if view.groups:
            style.aside(rows["shed"], reverse=True)
        panels.band_legend(rows["islands"], shown)


def _curtailed_words(view: EpisodeView) -> str:
    """What curtailed power is called: `PV curtailed`."""
    weather = in_roles(device_fleets(view.case).values(), "weather")
    return ", ".join(fleet.curtailed.words for fleet in weather if fleet.curtailed)


def _power(axis: Axes, hours: Floats, method: MethodView, curtailed: str) -> None:
    panels.draw_power(axis, hours, method.fed, method.intake)
    top = sum(method.fed.values(), np.zeros(len(hours) - 1))
    if method.curtailed.max(initial=0.0) > DRAWN_TOLERANCE_MW:
        look = {"facecolor": "none", "edgecolor": "#b59410", "hatch": "....."}
        style.stairs(axis, hours, top, top + method.curtailed, label=curtailed, **look)
    panels.draw_demand(axis, hours, method.demand, method.shed.sum(0))


def _shed(axis: Axes, hours: Floats, groups: list[tuple[str, Ints]], method: MethodView) -> None:
    import matplotlib as mpl

    shades = mpl.colormaps[style.SHED_MAP](np.linspace(0.95, 0.3, max(len(groups), 2)))
    top = np.zeros(len(hours) - 1)
    for (name, rows), colour in zip(groups, shades, strict=False):
        shed = method.shed[rows].sum(0)
        style.stairs(axis, hours, top, top + shed, color=colour, label=name)
        top = top + shed
    if top.max(initial=0.0) < DRAWN_TOLERANCE_MW:
        words = "nothing is shed"
        axis.text(0.5, 0.5, words, transform=axis.transAxes, ha="center", va="center")


def _row_labels(rows: dict[str, Axes]) -> None:
    words = {
        "power": "power, MW",
        "soc": "state of\ncharge",
        "shed": "shed, MW",
        "islands": "buses",
        "lines": "lines\nout",
    }
    for name, axis in rows.items():
        axis.set_ylabel(words[name])


def _top(figure: Figure, axes: np.ndarray, title: str) -> None:
    """The heading, and below it one legend for the power of all methods."""
    from matplotlib.lines import Line2D

    entries: dict[str, Any] = {}
    for axis in axes:
        handles, labels = axis.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    entries["storm centre"] = Line2D([], [], color="black", lw=1.0, ls=(0, (1, 1.5)))
    figure.legend(
        entries.values(), entries.keys(), title=title, title_fontsize=10,
        alignment="left", loc="outside upper left", ncols=8, frameon=False, fontsize=8,
        columnspacing=1.4, handlelength=1.6,
    )  # fmt: skip
