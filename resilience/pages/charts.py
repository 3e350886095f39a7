"""Charts over the slots of a result, as plain data that the page's script draws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case.window import Window
from resilience.pages.document import plain
from resilience.tolerances import DRAWN_TOLERANCE_MW

Mark = Literal["up", "down", "line", "low", "high", "hatch"]
"""How a series is drawn: stacked above or below zero, as a line, as one of the two ends of a band,
or hatched below the line called demand. A line with one value more than slots joins their edges,
others are constant within a slot."""
MAX_LINES = 8
"""ChartSeries beside each other that can be told apart by colour."""


@dataclass(frozen=True, eq=False)
class ChartSeries:
    """One quantity of a chart.

    Attributes:
        name: in the legend.
        colour: `#rrggbb`, or a variable of the style sheet.
        mark: how it is drawn.
        values: (slots,), or one more of a line between their edges.
    """

    name: str
    colour: str
    mark: Mark
    values: Floats

    def data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "name": self.name,
            "colour": self.colour,
            "mark": self.mark,
            "values": plain(np.asarray(self.values, float)),
        }


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart over time.

    Attributes:
        title: above it.
        unit: of its values.
        series: from the axis upwards where they are stacked.
        limits: values that are drawn as dashed lines.
        bottom, top: of the axis; None: as the values say.
        note: below it.
        slots: where they are others than those of the page, as many from its start.
        is_tall: it is given more room than others.
    """

    title: str
    unit: str
    series: Sequence[ChartSeries]
    limits: tuple[float, ...] = ()
    bottom: float | None = None
    top: float | None = None
    note: str = ""
    slots: int | None = None
    is_tall: bool = False

    def data(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "title": self.title,
            "unit": self.unit,
            "series": [series.data() for series in self.series],
            "limits": list(self.limits),
            "bottom": self.bottom,
            "top": self.top,
            "note": self.note,
            "slots": self.slots,
            "tall": self.is_tall,
        }


def times(window: Window, slots: int, down: Bools | None = None) -> dict[str, Any]:
    """The slots that all charts of a page share.

    Args:
        window: the horizon.
        slots: how many of it there are.
        down: (lines, slots) where a line is out, which is shaded.
    """
    return {
        "start": window.start.isoformat(),
        "step_min": window.step_min,
        "slots": slots,
        "labels": [*(window.label(t) for t in range(window.slots)), window.end_label(window.slots)],
        "shade": [] if down is None else spans(np.asarray(down.any(axis=0))),
    }


def spans(mask: Bools) -> list[tuple[int, int]]:
    """(first, stop) of slots in a row."""
    edges = np.flatnonzero(np.diff(np.pad(mask.astype(int), 1)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def lines(names: Sequence[str], values: Floats, weights: Floats | None = None) -> list[ChartSeries]:
    """A line each where they are few; else all of them faintly, and their mean.

    Args:
        names: (rows,) of the lines.
        values: (rows, slots), or one more.
        weights: (rows,) of the mean; alike if omitted.
    """
    if len(names) <= MAX_LINES:
        return [
            ChartSeries(name, f"var(--m{k})", "line", row)
            for k, (name, row) in enumerate(zip(names, values, strict=True))
        ]
    share = np.ones(len(names)) if weights is None else np.asarray(weights, float)
    low, high = values.min(axis=0), values.max(axis=0)
    between = f"lowest to highest of {len(names)}"
    mean = ChartSeries("all together", "var(--m0)", "line", share @ values / share.sum())
    band = [
        ChartSeries(between, "var(--band)", "low", low),
        ChartSeries(between, "var(--band)", "high", high),
    ]
    return [*band, mean]


def stacked(rows: Iterable[tuple[str, Floats]], colours: Sequence[str]) -> list[ChartSeries]:
    """Quantities on top of each other; those that are nowhere above zero are left out."""
    there = [
        (name, values) for name, values in rows if values.max(initial=0.0) > DRAWN_TOLERANCE_MW
    ]
    return [
        ChartSeries(name, colours[k % len(colours)], "up", values)
        for k, (name, values) in enumerate(there)
    ]
