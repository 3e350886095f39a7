"""A storm and a feeder on one page: track and wind, lines by probability, hours, curves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.case.schema import GridTable, StormTable
from resilience.fragility.chain import slot_times
from resilience.fragility.lines.spans import Series, SpannedLines, SpanWind, failure_probability
from resilience.fragility.tracks import interpolated
from resilience.fragility.wind import wind
from resilience.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resilience.fragility.feeder_hazard import Hazard

SWATH_MPS = (17.5, 25, 33, 42, 50, 60, 80)
WIND_MAP = "YlGnBu"
RISK_MAP = "YlOrRd"
REACH_DEG = 2.5
CELLS = 90
MIN_DISTANCE_DEG = 0.35  # of times along the track
CURVE_MPS = np.linspace(15.0, 110.0, 191)


def plot_hazard(hazard: Hazard, path: str | Path | None = None) -> Figure:
    """Draws a storm's hazard; with `path` it is also written there.

    Args:
        hazard: from `resilience.hazard`.
        path: a .png, .pdf or .svg file.

    Raises:
        UsageError: a suffix that is no picture format.
    """
    return style.picture(lambda: _draw(hazard), path)


def _draw(hazard: Hazard) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    axes = figure.subplots(2, 2, gridspec_kw={"height_ratios": [1.25, 1.0]})
    _map(figure, axes[0, 0], hazard)
    _feeder(figure, axes[0, 1], hazard)
    _hours(axes[1, 0], hazard)
    _curves(axes[1, 1], hazard)
    feeder = hazard.storm
    expected = feeder.failed_by[:, -1].sum()
    style.headed(
        figure,
        f"{feeder.track.name or 'storm'} over {feeder.case.name} ({feeder.geography.about}): "
        f"{expected:.1f} of {len(feeder.lines.names)} lines expected to fail",
    )
    return figure


def _map(figure: Figure, axis: Axes, hazard: Hazard) -> None:
    """Track, swath of the strongest wind over the horizon, and where the feeder is."""
    feeder = hazard.storm
    place = feeder.geography
    lat, lon = place.middle
    wide = REACH_DEG / np.cos(np.radians(lat))
    x, y = np.linspace(lon - wide, lon + wide, CELLS), lat + np.linspace(-1, 1, CELLS) * REACH_DEG
    across, up = np.meshgrid(x, y)
    table = feeder.case.storm or StormTable()
    eye = interpolated(feeder.track, slot_times(feeder.case))
    around = (across.ravel() + 180.0) % 360.0 - 180.0
    blown = wind(
        eye, up.ravel(), around, model=table.wind, asymmetry=table.asymmetry, inflow=table.inflow
    ).speed_mps.max(axis=1)
    shades = axis.contourf(
        x, y, blown.reshape(across.shape), SWATH_MPS, cmap=WIND_MAP, extend="both", alpha=0.85
    )
    figure.colorbar(shades, ax=axis, label="strongest wind, m/s, 1-min mean at sea", shrink=0.85)
    for member in feeder.members[:60] if len(feeder.members) > 1 else ():
        path = interpolated(member, slot_times(feeder.case))
        axis.plot(_near(path.lon, lon), path.lat, color="#6b7280", lw=0.4, alpha=0.6)
    shown = eye.present
    axis.plot(_near(eye.lon, lon)[shown], eye.lat[shown], color="black", lw=1.4)
    _clock(axis, hazard, eye.lat, _near(eye.lon, lon), shown)
    axis.plot(lon, lat, marker="*", ms=13, color="#d62728", mec="white", ls="none")
    axis.annotate("feeder", (lon, lat), (7, -16), textcoords="offset points", color="#d62728")
    axis.set_xlim(x[0], x[-1])
    axis.set_ylim(y[0], y[-1])
    axis.set_aspect(1.0 / np.cos(np.radians(lat)))
    axis.set_xlabel("degrees east")
    axis.set_ylabel("degrees north")
    axis.set_title("Track and wind", loc="left", fontsize=9, fontweight="bold")


def _clock(axis: Axes, hazard: Hazard, lat: Floats, lon: Floats, shown: np.ndarray) -> None:
    """A dot on the track every three hours of the horizon, with its time."""
    case = hazard.storm.case
    moments = len(lat)
    minutes = (np.arange(moments) + 0.5) * case.slots * case.step_min / moments
    first = case.start.hour * 60 + case.start.minute
    step = case.slots * case.step_min / moments
    last = np.full(2, np.inf)
    for k in range(moments):
        if shown[k] and (first + minutes[k]) % 180.0 < step:
            here = np.array([lon[k], lat[k]])
            axis.plot(lon[k], lat[k], "o", ms=3.5, color="black")
            if np.hypot(*(here - last)) < MIN_DISTANCE_DEG:
                continue
            last = here
            when = f"{int((first + minutes[k]) // 60) % 24:02d} h"
            axis.annotate(
                when, (lon[k], lat[k]), (0, 6), textcoords="offset points", fontsize=7,
                ha="center", clip_on=True, annotation_clip=True,
            )  # fmt: skip


def _near(lon: Floats, middle: float) -> Floats:
    """Longitudes within half a turn of the middle of the map."""
    return (lon - middle + 180.0) % 360.0 - 180.0 + middle


def _feeder(figure: Figure, axis: Axes, hazard: Hazard) -> None:
    """Lines coloured by the probability that they fail; those that cannot are grey."""
    import matplotlib as mpl
    from matplotlib.colors import Normalize

    feeder = hazard.storm
    network, place = feeder.case.network, feeder.geography
    east, north = place.bus_km
    chance = dict(zip(feeder.lines.names, feeder.failed_by[:, -1], strict=True))
    top = np.ceil(4.0 * max(chance.values(), default=1.0)) / 4.0
    scale, colours = Normalize(0.0, max(top, 0.25)), mpl.colormaps[RISK_MAP]
    for k, name in enumerate(network.line_names):
        i, j = network.from_bus[k], network.to_bus[k]
        may_fail = name in chance
        axis.plot(
            east[[i, j]],
            north[[i, j]],
            color=colours(0.15 + 0.85 * scale(chance[name])) if may_fail else "#c8ccd2",
            lw=3.0 if may_fail else 0.8,
            ls="-" if may_fail else ":",
            solid_capstyle="round",
        )
    axis.plot(east, north, "o", ms=3.0, color="black", ls="none")
    sources = [network.bus(grid.bus) for grid in feeder.case.tables_of(GridTable)]
    axis.plot(east[sources], north[sources], "s", ms=8, color="black", ls="none")
    degree = np.bincount(
        np.concatenate([network.from_bus[network.in_service], network.to_bus[network.in_service]]),
        minlength=len(east),
    )
    for bus in np.flatnonzero(degree != 2) if len(east) <= 80 else ():
        spot = (float(east[bus]), float(north[bus]))
        axis.annotate(network.bus_names[bus], spot, (4, 4), textcoords="offset points", fontsize=7)
    colours = mpl.colors.LinearSegmentedColormap.from_list(
        "risk", colours(np.linspace(0.15, 1.0, 64))
    )
    figure.colorbar(
        mpl.cm.ScalarMappable(scale, colours), ax=axis, shrink=0.85, label="probability of failure"
    )
    axis.set_aspect("equal")
    axis.set_xlabel(f"km east of bus {network.bus_names[0]}")
    axis.set_ylabel("km north")
    title = "Lines" + (", places made up" if place.synthetic else "")
    axis.set_title(title, loc="left", fontsize=9, fontweight="bold")
    style.open_frame(axis)


def _hours(axis: Axes, hazard: Hazard) -> None:
    """Wind along the lines, and how many lines have failed and are down."""
    feeder = hazard.storm
    case = feeder.case
    hours = np.asarray(np.arange(case.slots + 1) * case.step_h, np.float64)
    blown = feeder.strongest_mps
    style.stairs(axis, hours, blown.min(axis=0), blown.max(axis=0), color="#0072b2", alpha=0.35)
    style.steps(axis, hours, blown.mean(axis=0), color="#0072b2", lw=1.0)
    axis.axhline(feeder.repair.wind_limit_mps, color="#0072b2", lw=0.7, ls="--")
    axis.text(
        hours[-1], feeder.repair.wind_limit_mps, "no repair above ", color="#0072b2", fontsize=7,
        ha="right", va="bottom",
    )  # fmt: skip
    averaging_s = feeder.winds[0].averaging_s
    axis.set_ylabel(f"wind, m/s, {averaging_s:g} s mean", color="#0072b2")
    axis.set_ylim(0.0)
    right = axis.twinx()
    style.steps(right, hours, feeder.failed_by.sum(axis=0), color="#d55e00", lw=1.6)
    down = hazard.scenarios.down.sum(axis=0) @ hazard.scenarios.probability
    style.steps(right, hours, down, color="#d55e00", lw=1.2, ls=":")
    right.set_ylabel("lines: failed so far (solid), down (dotted)", color="#d55e00")
    right.set_ylim(0.0)
    right.spines["top"].set_visible(False)
    style.time_axis(axis, case.start, hours, 0.55)
    axis.set_title("Hour by hour, expected", loc="left", fontsize=9, fontweight="bold")
    axis.spines["top"].set_visible(False)


def _curves(axis: Axes, hazard: Hazard) -> None:
    """Curves of the elements, and of the shortest and the longest line in an even wind."""
    feeder = hazard.storm
    curves = [series.curve for series in feeder.lines.series]
    for curve, colour in zip(curves, style.METHOD_COLOURS, strict=False):
        probability = curve.probability(CURVE_MPS)
        axis.plot(CURVE_MPS, probability, color=colour, lw=1.6, label=curve.name)
    spans = np.bincount(feeder.lines.span_line, minlength=len(feeder.lines.names))
    for k, dash in ((int(spans.argmin()), "--"), (int(spans.argmax()), ":")):
        label = f"line {feeder.lines.names[k]}, {spans[k]} span" + "s" * int(spans[k] != 1)
        axis.plot(CURVE_MPS, _line_curve(hazard, k), color="black", lw=1.2, ls=dash, label=label)
    top = float(feeder.strongest_mps.max(initial=0.0))
    axis.axvline(top, color="#d62728", lw=1.0)
    axis.text(top, 1.02, "this storm ", color="#d62728", fontsize=7, ha="right", va="bottom")
    axis.set_ylim(0.0, 1.0)
    axis.set_xlim(CURVE_MPS[0], CURVE_MPS[-1])
    axis.set_xlabel(f"wind, m/s: {curves[0].measure}")
    axis.set_ylabel("probability of failure")
    axis.legend(frameon=False, fontsize=7, loc="upper left")
    axis.set_title("Fragility", loc="left", fontsize=9, fontweight="bold")
    style.open_frame(axis)


def _line_curve(hazard: Hazard, line: int) -> Floats:
    """Failure of a line in winds that are the same along it."""
    lines = hazard.storm.lines
    mask, curve = lines.span_line == line, lines.series[0].curve
    spans = int(mask.sum())
    series = tuple(Series(s.curve, s.count[mask]) for s in lines.series)
    alone = SpannedLines((lines.names[line],), np.zeros(spans, np.intp), series, lines.correlation)
    measure = curve.averaging_s, curve.height_m, curve.exposure
    winds = (SpanWind(np.full((spans, 1), speed), *measure) for speed in CURVE_MPS)
    return np.array([failure_probability(alone, even)[0] for even in winds])
