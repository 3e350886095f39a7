"""What all pictures share: colours that the colour blind can tell apart, time axes, files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.files import check_picture, replacing_file
from resilience.models.components import ESS, fleet_classes, in_roles
from resilience.models.components.fleet import AnyFleet
from resilience.plots.letters import IGNORED, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FUEL_COLOURS = "#8c510a", "#35978f", "#bf812d", "#80cdc1"
SHED_COLOUR = "#a3157e"
DEMAND_COLOUR = "#000000"
STORAGE_COLOUR = ESS.colour
"""Of what all storage holds together."""
SHED_MAP = "RdPu"
"""Colour map of groups of loads that are shed."""
OUTAGE_COLOUR = "#4b5563"
"""Lines that are out."""
METHOD_COLOURS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#000000",
    "#8a6d3b",
)
MARKERS = "osD^vPX*"
DPI = 150
TICKS_H = (0.25, 0.5, 1, 2, 3, 4, 6, 12)
MAX_TICKS = 13  # of a time axis of full width


def fleet_order(fleets: Iterable[AnyFleet]) -> list[AnyFleet]:
    """Fleets whose power is stacked, from the axis upwards; loads are not."""
    return in_roles(fleets, "exchange", "dispatchable", "weather", "storage")


def colours() -> dict[str, str]:
    """Colour of the power of every fleet by its title, and of `shed` and `demand`.

    Okabe and Ito (2008), the yellow a little darker; shed is the dark end of `SHED_MAP`.
    """
    fleets = {fleet.title: fleet.colour for fleet in fleet_order(fleet_classes())}
    return fleets | {"shed": SHED_COLOUR, "demand": DEMAND_COLOUR}


@contextmanager
def look() -> Iterator[None]:
    """Letters a little smaller than usual, for everything drawn within, and no mathematics: a
    dollar is a dollar, also in a name. Letters that a font has not are told when all is drawn.
    """
    import matplotlib as mpl

    with (
        mpl.rc_context({"font.size": 9, "hatch.linewidth": 0.8, "text.parse_math": False}),
        warnings.catch_warnings(),
    ):
        warnings.filterwarnings("ignore", IGNORED)
        yield


def write_figure(figure: Figure, path: str | Path | None) -> Figure:
    """Writes the figure where there is a path, whole or not at all."""
    if path is not None:
        with replacing_file(Path(path)) as fresh:
            save_figure(figure, fresh, str(path), DPI)
    return figure


def picture(draw: Callable[[], Figure], path: str | Path | None) -> Figure:
    """What is drawn in our look, written where there is a path, which is checked first.

    Raises:
        UsageError: a suffix that is no picture format.
    """
    if path is not None:
        check_picture(Path(path))
    with look():
        return write_figure(draw(), path)


def headed(figure: Figure, text: str) -> None:
    """A heading above all panels, on the left."""
    figure.suptitle(text, fontsize=10, x=0.01, ha="left")


def open_frame(axis: Axes) -> None:
    """Leaves the left and the lower side of the frame."""
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def aside(axis: Axes, **style: Any) -> None:
    """A legend to the right of a panel, its entries stacked as what they stand for is."""
    axis.legend(
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
        fontsize=8,
        handlelength=1.2,
        **style,
    )


def stairs(axis: Axes, hours: Floats, bottom: Floats, top: Floats, **style: Any) -> None:
    """Fills what is between two lines that are constant within a slot."""
    axis.fill_between(
        hours, with_last_repeated(bottom), with_last_repeated(top), step="post", lw=0, **style
    )


def with_last_repeated(values: Floats) -> Floats:
    """(slots + 1,) the values, the last one to the end of its slot."""
    return np.append(values, values[-1:])


def steps(axis: Axes, hours: Floats, values: Floats, **style: Any) -> None:
    """A line that is constant within a slot."""
    axis.step(hours, with_last_repeated(values), where="post", **style)


def shade(axis: Axes, hours: Floats, down: np.ndarray) -> None:
    """Grey where any line is out; `down` is (lines, slots)."""
    out = np.pad(down.any(axis=0).astype(int), 1)
    for first, stop in zip(
        np.flatnonzero(np.diff(out) == 1), np.flatnonzero(np.diff(out) == -1), strict=True
    ):
        axis.axvspan(hours[first], hours[stop], color="#e5e7eb", lw=0, zorder=-1)


def time_axis(axis: Axes, start: datetime, hours: Floats, width: float = 1.0) -> None:
    """Clock times where the span is two days or less, else dates.

    Args:
        axis: the lowest panel.
        start: time of hour 0.
        hours: (slots + 1,) begin of every slot, and the end.
        width: share of a full page that the panel has.
    """
    last, room = float(hours[-1]), MAX_TICKS * width
    axis.set_xlim(float(hours[0]), last)
    if last <= 48.0:
        step = next((s for s in TICKS_H if last / s <= room), 24)
        ticks = np.arange(0.0, last + 1e-9, step)
        words = [f"{start + timedelta(hours=float(h)):%H:%M}" for h in ticks]
        axis.set_xlabel(f"time of day, from {start:%Y-%m-%d}")
    else:
        every = max(int(np.ceil(last / 24.0 / room)), 1)
        midnight = (24.0 - start.hour - start.minute / 60.0) % 24.0
        ticks = np.arange(midnight, last + 1e-9, 24.0 * every)
        words = [f"{start + timedelta(hours=float(h)):%d %b}" for h in ticks]
        axis.set_xlabel(f"midnights, from {start:%Y-%m-%d}")
    axis.set_xticks(ticks, words)
