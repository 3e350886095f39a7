"""A comparison on one page: cost above the best possible, costs of days, shedding against cost."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND, Compared
from resilience.evaluation.paired import daily_cost, days_of
from resilience.evaluation.verdict import verdict
from resilience.plots import style
from resilience.plots.report_data import Record, has_bound, records

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


LOGARITHMIC_FROM = 15.0  # largest over smallest value, from which an axis is logarithmic
MAX_DOTTED_DAYS = 9  # days below which each is a dot
MIN_DRAWN_COST = 1e-6  # $/day; below, a cost is rounding and has no place on such an axis
MAX_LETTERS = 108  # of a line of the heading
LINEAR_BELOW_MWH = 0.01  # shedding below this is drawn on a linear scale, MWh/day
OFFSETS = [
    (shift * side, up, "left" if side > 0 else "right")
    for up in (0, 9, -9, 18, -18, 27)
    for shift, side in ((8, 1), (8, -1))
]
"""Where a name may stand beside its point: points to the right and up, and how it is aligned."""


def plot_report(compared: Compared, path: str | Path | None = None) -> Figure:
    """Draws a comparison on one page; with `path` (png, pdf or svg) it is also written there.

    Above: cost over the clairvoyant bound, a dot per episode, the mean with its 95 % interval.
    Below: costs of single days, and shedding against cost.

    Args:
        compared: a `Report`, or what `load_comparison` read.
        path: of the picture.

    Raises:
        UsageError: the suffix is no picture format.
    """
    return style.picture(lambda: _draw(compared), path)


def _draw(compared: Compared) -> Figure:
    from matplotlib.figure import Figure

    rows = records(compared)
    height = 0.27 * len(rows)
    figure = Figure(figsize=(9.0, 4.6 + 2 * height), layout="constrained")
    axes = figure.subplot_mosaic(
        [["over", "over"], ["daily", "trade"]], height_ratios=[0.9 + height, 2.0 + height]
    )
    looks = {row.name: _look(k) for k, row in enumerate(rows)}
    _over(axes["over"], rows, looks)
    _daily(axes["daily"], compared, rows, looks)
    _trade(axes["trade"], rows, looks)
    for axis in axes.values():
        style.open_frame(axis)
    style.headed(figure, _title(compared))
    figure.draw_without_rendering()
    _names(axes["trade"], rows)
    return figure


def _title(compared: Compared) -> str:
    days, n = days_of(compared), compared.scenarios.n
    head = (
        f"{compared.case.name}: {n} episode{'s' * (n != 1)} of {days:g} day{'s' * (days != 1)} "
        f"from {compared.case.start:%Y-%m-%d}"
    )
    return "\n".join([head, *textwrap.wrap(" ".join(verdict(compared)[:2]), MAX_LETTERS)])


def _look(k: int) -> dict[str, Any]:
    """Colour and marker of the k-th method; the pair repeats after many."""
    shape = (k + k // len(style.METHOD_COLOURS)) % len(style.MARKERS)
    return {
        "color": style.METHOD_COLOURS[k % len(style.METHOD_COLOURS)],
        "marker": style.MARKERS[shape],
    }


def _over(axis: Axes, rows: list[Record], looks: dict[str, dict[str, Any]]) -> None:
    values = np.concatenate([row.over for row in rows])
    floor = _scale(axis, values)
    for k, row in enumerate(rows):
        look = looks[row.name]
        spread = k + np.linspace(-0.22, 0.22, len(row.over)) if len(row.over) > 1 else [k]
        dots = np.maximum(row.over, floor)
        axis.scatter(dots, spread, s=12, color=look["color"], alpha=0.45, lw=0)
        if np.isfinite(row.mean.low):
            ends = np.maximum([row.mean.low, row.mean.high], floor)
            axis.plot(ends, [k, k], color=look["color"], lw=2.2, solid_capstyle="butt")
        axis.plot(max(row.mean.mean, floor), k, ms=7, mec="white", mew=0.8, **look)
    rule = next(row.mean.mean for row in rows if row.name == REFERENCE)
    axis.axvline(max(rule, floor), color="black", lw=0.8, ls="--", zorder=0)
    axis.set_yticks(range(len(rows)), [row.name for row in rows])
    axis.set_ylim(len(rows) - 0.5, -1.2)
    axis.set_xlabel(
        "cost above the clairvoyant bound, $/day\n"
        f"dots: episodes; markers: means, 95 % intervals; dashed: {REFERENCE}"
    )
    _numbers(axis, rows)


def _numbers(axis: Axes, rows: list[Record]) -> None:
    """The means as numbers, to the right of the panel."""
    right = axis.twinx()
    texts = [f"{row.mean.mean:+8.2f} {row.shed:9.3f}" for row in rows]
    head = f"{'$/day':>8} {'MWh/d shed':>11}"
    right.set_yticks([-0.9, *range(len(rows))], [head, *texts])
    right.set_ylim(axis.get_ylim())
    right.tick_params(length=0, labelfontfamily="monospace")
    right.set_frame_on(False)


def _scale(axis: Axes, values: Floats) -> float:
    """Sets the x-axis, logarithmic where values differ widely; returns the least that is drawn."""
    low, high = float(values.min()), float(values.max())
    positive = values[values > MIN_DRAWN_COST]
    if np.quantile(values, 0.1) <= MIN_DRAWN_COST or high < LOGARITHMIC_FROM * float(
        positive.min()
    ):
        low, high = min(low, 0.0), high if high > MIN_DRAWN_COST else 1.0
        axis.set_xlim(low - 0.04 * (high - low) * (low < 0), high + 0.06 * (high - low))
        return -np.inf
    low = float(positive.min())
    axis.set_xscale("log")
    axis.set_xlim(low / 1.3, high * 1.3)
    _plain_ticks(axis, low, high)
    return low


def _plain_ticks(axis: Axes, low: float, high: float) -> None:
    """Ticks 1, 2, 5, 10, ... in plain numbers on a logarithmic x-axis."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    some = (1.0, 2.0, 5.0) if high / low < 3e3 else (1.0,)
    axis.xaxis.set_major_locator(FixedLocator([d * k for d in decades for k in some]))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _daily(
    axis: Axes, compared: Compared, rows: list[Record], looks: dict[str, dict[str, Any]]
) -> None:
    names = [row.name for row in rows]
    values = [row.daily.ravel() for row in rows]
    colours = [looks[name]["color"] for name in names]
    if has_bound(compared):
        names.insert(0, BOUND)
        values.insert(0, daily_cost(compared, BOUND).ravel())
        colours.insert(0, "#6b7280")
    _scale(axis, np.concatenate(values))
    few = len(values[0]) < MAX_DOTTED_DAYS
    if few:
        for k, (dots, colour) in enumerate(zip(values, colours, strict=True)):
            spread = k + np.linspace(-0.22, 0.22, len(dots)) if len(dots) > 1 else [k]
            axis.scatter(dots, spread, s=16, color=colour, alpha=0.7, lw=0)
    else:
        _boxes(axis, values, colours)
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    worth = f"{compared.end_value_per_mwh:g}"
    words = f"cost of a day, $ (energy stored worth {worth} $/MWh)\n"
    words += "dots: days" if few else "box: middle half; whiskers: 5 to 95 %"
    axis.set_xlabel(words)


def _boxes(axis: Axes, values: list[Floats], colours: list[str]) -> None:
    boxes = axis.boxplot(
        values, orientation="horizontal", positions=range(len(values)), widths=0.6, whis=(5, 95),
        patch_artist=True, medianprops={"color": "black"},
        flierprops={"marker": ".", "ms": 3, "mec": "#6b7280"},
    )  # fmt: skip
    for box, colour in zip(boxes["boxes"], colours, strict=True):
        box.set(facecolor=colour, alpha=0.55)


def _trade(axis: Axes, rows: list[Record], looks: dict[str, dict[str, Any]]) -> None:
    cost = np.array([row.mean.mean for row in rows])
    shed = np.array([row.shed for row in rows])
    floor = _scale(axis, cost)
    for row, x, y in zip(rows, cost, shed, strict=True):
        axis.plot(max(x, floor), y, ms=8, mec="white", mew=0.8, clip_on=False, **looks[row.name])
    if shed.max() > LOGARITHMIC_FROM * max(float(shed.min()), LINEAR_BELOW_MWH):
        axis.set_yscale("symlog", linthresh=LINEAR_BELOW_MWH, linscale=0.5)
        from matplotlib.ticker import FuncFormatter

        axis.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axis.set_ylim(0.0, max(1.5 * shed.max(), LINEAR_BELOW_MWH))
    axis.set_xlabel("mean cost above the bound, $/day")
    axis.set_ylabel("mean energy shed, MWh/day")
    axis.grid(color="#e5e7eb", lw=0.6)
    axis.set_axisbelow(True)


def _names(axis: Axes, rows: list[Record]) -> None:
    """Names beside the points of `_trade`, each where it covers no other name and no point.

    Where there is no such place it is left out: colour and marker are those of the panel above.
    """
    from matplotlib.transforms import Bbox

    points = [line.get_window_extent() for line in axis.lines]
    placed: list[Bbox] = []
    frame = axis.get_window_extent()
    for k, row in enumerate(rows):
        x, y = np.asarray(axis.lines[k].get_xydata())[0]
        others = [p for j, p in enumerate(points) if j != k]
        for dx, dy, side in OFFSETS:
            text = axis.annotate(
                row.name, (x, y), (dx, dy), textcoords="offset points", ha=side, va="center",
                fontsize=8,
            )  # fmt: skip
            box = text.get_window_extent()
            inside = box.x0 >= frame.x0 and box.x1 <= frame.x1 + 20 and box.y0 >= frame.y0
            if inside and not box.count_overlaps([*placed, *others]):
                placed.append(box)
                break
            text.remove()
