"""Panels that several pictures have: stacked power, state of charge, islands, lines out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.plots.style import (
    DEMAND_COLOUR,
    OUTAGE_COLOUR,
    SHED_COLOUR,
    STORAGE_COLOUR,
    aside,
    colours,
    stairs,
    steps,
)
from resilience.tolerances import DRAWN_TOLERANCE_MW

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MAX_COLOURED = 8  # storage units, up to which each has a colour of its own
MAX_LABELLED = 14  # rows of a band, up to which each has a label
DEAD, GRID = 0, 1
BAND = (
    "#1f2937",
    "#e2e5e9",
    "#77aadd",
    "#ee8866",
    "#eedd88",
    "#44bb99",
    "#ffaabb",
    "#bbcc33",
    "#99ddff",
    "#aaaa00",
)
"""Dead, connected to the grid, and islands: the light scheme of Paul Tol (2021)."""


def draw_power(
    axis: Axes, hours: Floats, fed: Mapping[str, Floats], intake: Mapping[str, Floats]
) -> None:
    """Power by source stacked above zero, and what storage and grid take below it.

    Args:
        axis: the panel.
        hours: (slots + 1,) begin of every slot, and the end.
        fed: a key of `colours` to (slots,) MW fed in.
        intake: the same to (slots,) MW taken, zero or more.
    """
    up = down = np.zeros(len(hours) - 1)
    colour_of = colours()
    for name, flow in fed.items():
        stairs(axis, hours, up, up + flow, color=colour_of[name], label=name)
        up = up + flow
    for name, flow in intake.items():
        stairs(axis, hours, down - flow, down, color=colour_of[name])
        down = down - flow
    axis.axhline(0.0, color="black", lw=0.5)


def draw_demand(axis: Axes, hours: Floats, demand: Floats, shed: Floats) -> None:
    """The demand as a line, and hatched below it what of it is not served."""
    if shed.max(initial=0.0) > DRAWN_TOLERANCE_MW:
        style = {"facecolor": "none", "edgecolor": SHED_COLOUR, "hatch": "/////"}
        stairs(axis, hours, demand - shed, demand, label="shed", **style)
    steps(axis, hours, demand, color=DEMAND_COLOUR, lw=1.0, label="demand")


def draw_soc(axis: Axes, hours: Floats, names: Sequence[str], soc: Floats, size: Floats) -> None:
    """State of charge: a line per unit, or where they are many all of them and their mean.

    Args:
        axis: the panel.
        hours: (slots + 1,) begin of every slot, and the end.
        names: of the units.
        soc: (units, slots + 1).
        size: (units,) MWh, the weights of the mean.
    """
    import matplotlib as mpl

    shades = mpl.colormaps["viridis"](np.linspace(0.1, 0.9, max(len(names), 2)))
    if len(names) <= MAX_COLOURED:
        for name, line, colour in zip(names, soc, shades, strict=False):
            axis.plot(hours, line, color=colour, lw=1.4, label=name)
    elif len(names):
        for k, line in enumerate(soc):
            label = f"{len(names)} units" if k == 0 else None
            axis.plot(hours, line, color="#93b7d6", lw=0.6, label=label)
        mean = size @ soc / size.sum()
        axis.plot(hours, mean, color=STORAGE_COLOUR, lw=1.8, label="all together")
    axis.set_ylim(0.0, 1.02)


def band_colours(number: Ints, on_grid: Bools) -> Ints:
    """(rows, slots) index in `BAND`. Islands of one slot differ as far as there are colours.

    An island keeps its colour while it gains or loses rows, and gets it back when it returns.

    Args:
        number: (rows, slots) number of the island of every row; 0 is dead.
        on_grid: (rows,) whether a grid connection stands there.
    """
    earlier: dict[bytes, int] = {}  # colour that a set of rows had, by its mask
    shown = np.full_like(number, DEAD)
    for t in range(number.shape[1]):
        if t and (number[:, t] == number[:, t - 1]).all():
            shown[:, t] = shown[:, t - 1]
            continue
        before = shown[:, t - 1] if t else np.full(len(number), GRID)
        shown[:, t] = _colours(number[:, t], on_grid, before, earlier)
    return shown


def _colours(number: Ints, on_grid: Bools, before: Ints, earlier: dict[bytes, int]) -> Ints:
    """(rows,) colours of one slot, the largest island first, given those of the slot before."""
    shown = np.full_like(number, DEAD)
    apart: list[Bools] = []
    for island in np.unique(number[number > 0]):
        members = number == island
        if on_grid[members].any():
            shown[members] = GRID
        else:
            apart.append(members)
    occupied: set[int] = set()
    for members in sorted(apart, key=lambda m: -int(m.sum())):
        colour = _colour(members, before[members], earlier, occupied)
        earlier[members.tobytes()] = colour
        occupied.add(colour)
        shown[members] = colour
    return shown


def _colour(members: Bools, before: Ints, earlier: dict[bytes, int], occupied: set[int]) -> int:
    """What most of its rows had, else what it had at another time, else the least used."""
    had, count = np.unique(before[before > GRID], return_counts=True)
    preferred = [int(c) for c in had[np.argsort(-count, kind="stable")]]
    if members.tobytes() in earlier:
        preferred.append(earlier[members.tobytes()])
    free = [c for c in preferred if c not in occupied]
    if free:
        return free[0]
    uses = list(earlier.values())
    every = range(GRID + 1, len(BAND))
    return min([c for c in every if c not in occupied] or every, key=lambda c: (uses.count(c), c))


def draw_band(axis: Axes, hours: Floats, labels: Sequence[str], shown: Ints) -> None:
    """Which rows form which island: one colour each, see `band_colours`."""
    from matplotlib.colors import ListedColormap

    rows = len(labels)
    axis.pcolormesh(
        hours,
        np.arange(rows + 1),
        shown,
        cmap=ListedColormap(BAND),
        vmin=-0.5,
        vmax=len(BAND) - 0.5,
    )
    few = rows <= MAX_LABELLED
    if few:
        axis.hlines(np.arange(1, rows), hours[0], hours[-1], color="white", lw=0.8)
    every = 1 if few else int(np.ceil(rows / 8))
    ticks = range(0, rows, every)
    axis.set_yticks([k + 0.5 for k in ticks], [labels[k] for k in ticks], fontsize=7)
    axis.set_ylim(rows, 0)


def band_legend(axis: Axes, shown: Ints) -> None:
    """Says what the colours of a band mean, as far as they occur."""
    from matplotlib.patches import Patch

    words = {GRID: "on the grid", GRID + 1: "islands, one\ncolour each", DEAD: "dead"}
    there = [code for code in words if (shown == code).any()]
    handles = [Patch(color=BAND[code], label=words[code]) for code in there]
    aside(axis, handles=handles)


def draw_lines_out(axis: Axes, hours: Floats, names: Sequence[str], down: Bools) -> None:
    """A bar for every time that a line is out; `down` is (lines, slots)."""
    padded = np.pad(down.astype(int), ((0, 0), (1, 1)))
    change = np.diff(padded, axis=1)
    for row in range(len(names)):
        first, stop = np.flatnonzero(change[row] == 1), np.flatnonzero(change[row] == -1)
        spans = [(hours[a], hours[b] - hours[a]) for a, b in zip(first, stop, strict=True)]
        axis.broken_barh(spans, (row + 0.15, 0.7), color=OUTAGE_COLOUR, lw=0)
    every = 1 if len(names) <= MAX_LABELLED else int(np.ceil(len(names) / 8))
    ticks = range(0, len(names), every)
    axis.set_yticks([k + 0.5 for k in ticks], [names[k] for k in ticks], fontsize=7)
    axis.set_ylim(max(len(names), 1), 0)
    if not len(names):
        axis.set_yticks([])
        axis.text(0.5, 0.5, "no line is out", transform=axis.transAxes, ha="center", va="center")
