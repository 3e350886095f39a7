"""Rules for the storm of a case: times that rise, points on the earth, winds in m/s."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from resilience.arrays import Floats
from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.reading import show
from resilience.case.schema import StormTable
from resilience.earth.averaging import AGENCIES, KNOT_MPS, NAMELESS
from resilience.earth.plausible import LON_HIGH, LON_LOW, leaps, odd_winds

_LIMITS = (
    (1, "latitude", -90.0, 90.0, "degrees north come after the time"),
    (2, "longitude", LON_LOW, LON_HIGH, "degrees east; west is negative, or counted on from 180"),
    (3, "pressure_hpa", 850.0, 1040.0, "hPa in the centre; write nan where it is unknown"),
    (4, "vmax_mps", 0.0, 110.0, f"probably knots; multiply by {KNOT_MPS}"),
)


def check_storm(parts: Parts, storm: StormTable) -> None:
    """Notes what is wrong with `[storm]`."""
    parts.document.add_findings(("storm",), "[storm]", storm_findings(storm))
    _check_day(parts, storm)
    _check_priority(parts, storm)


def storm_findings(storm: StormTable) -> Iterator[Finding]:
    """What is wrong with the points of a storm, and with what they mean."""
    points = storm.points or ()
    if not points:
        return
    yield from _averaging(storm)
    if len(points) < 2:
        yield "points", f"{len(points)} point", "2 or more", "a track goes from point to point"
    yield from _times(storm)
    for number, point in enumerate(points, start=1):
        for k, quantity, low, high, hint in _LIMITS:
            value = float(point[k])  # type: ignore[arg-type]
            if not math.isnan(value) and not low <= value <= high:
                key = f"points[{number}][{k + 1}]"
                yield key, f"{quantity} {value:g}", f"{low:g} to {high:g}", hint
    if all(math.isnan(point[3]) and math.isnan(point[4]) for point in points):
        allowed = "one of them, in one point at least"
        hint = "one is regressed from the other, points with neither are filled in time"
        yield "points", "neither pressure nor wind in any point", allowed, hint
    yield from _leaps(storm)
    yield from _odd_winds(storm)


def _averaging(storm: StormTable) -> Iterator[Finding]:
    agency = AGENCIES.get(storm.agency)
    if storm.agency and agency is None:
        hint = "leave it out where none of these made the winds"
        yield "agency", show(storm.agency), ", ".join(AGENCIES), hint
    if storm.averaging_s is None and not storm.agency:
        hint = "NHC and JTWC average over 60 s, CMA over 120, JMA and most others over 600"
        yield "averaging_s", "nothing", "the seconds over which vmax is averaged", hint
    elif storm.averaging_s is not None and storm.averaging_s not in NAMELESS:
        allowed = ", ".join(f"{s:g}" for s in NAMELESS)
        yield "averaging_s", f"{storm.averaging_s:g}", allowed, "seconds, not minutes"
    elif agency and storm.averaging_s not in (None, agency.averaging_s):
        allowed, hint = f"{agency.averaging_s:g}, as {storm.agency}", "leave one of the two out"
        yield "averaging_s", f"{storm.averaging_s:g}", allowed, hint


def _times(storm: StormTable) -> Iterator[Finding]:
    times = [point[0] for point in storm.points]
    for number, time in enumerate(times, start=1):
        if time.tzinfo is not None:
            hint = "points are in local time, utc_offset_h says how far from UTC"
            yield f"points[{number}][1]", show(time), "a time without offset", hint
            return
    for number, (earlier, later) in enumerate(pairwise(times), start=2):
        if later <= earlier:
            value = f"{show(later)} after {show(earlier)}"
            yield f"points[{number}][1]", value, "a later time than the point before", "sort them"


def _leaps(storm: StormTable) -> Iterator[Finding]:
    if any(point[0].tzinfo for point in storm.points):
        return
    lat, lon, _, _ = _columns(storm)
    first = storm.points[0][0]
    hours = np.array([(point[0] - first).total_seconds() / 3600.0 for point in storm.points])
    for leap in leaps(hours, lat, lon):
        yield f"points[{leap.point + 1}]", leap.text, leap.allowed, leap.hint


def _odd_winds(storm: StormTable) -> Iterator[Finding]:
    """A wind beyond its limit is a finding of its own."""
    if any(point[4] > _LIMITS[-1][3] for point in storm.points):
        return
    nameless = NAMELESS.get(storm.averaging_s or 0.0, NAMELESS[60.0])
    agency = AGENCIES.get(storm.agency, nameless)
    lat, lon, pressure, vmax = _columns(storm)
    odd = odd_winds(lat, lon, pressure, vmax, agency)
    if odd is not None:
        hint = f"probably knots given as m/s; multiply by {KNOT_MPS}"
        if odd.weak:
            hint = "points hold m/s, hPa before them; write nan where the wind is unknown"
        yield "points", odd.text(f"points[{odd.point + 1}]"), odd.allowed, hint


def _columns(storm: StormTable) -> Floats:
    """Latitudes, longitudes, pressures and winds, (4, n); a place off the earth is NaN."""
    columns = np.array([point[1:] for point in storm.points], float).T
    for k, _, low, high, _ in _LIMITS[:2]:
        columns[k - 1][~((columns[k - 1] >= low) & (columns[k - 1] <= high))] = np.nan
    return columns


def _check_priority(parts: Parts, storm: StormTable) -> None:
    """Notes lines that crews should prefer and that are not there."""
    network = parts.network
    if network is None or storm.repair is None or not parts.inline.complete:
        return
    for name in storm.repair.priority:
        if not network.has_line(name):
            where, allowed = ("storm", "repair"), "a line of the network"
            hint = network.line_hint(name)
            parts.document.add(where, "[storm.repair]", "priority", show(name), allowed, hint)


def _check_day(parts: Parts, storm: StormTable) -> None:
    """Notes half a date, and a storm that is over before the horizon or begins after it."""
    for key, partner in (("day", "laid_on"), ("laid_on", "day")):
        if getattr(storm, key) is None and getattr(storm, partner) is not None:
            hint = f"{partner} needs it: the storm's `day` stands on the horizon's `laid_on`"
            parts.document.add(("storm", key), "[storm]", key, "nothing", "a date", hint)
            return
    if not storm.points or parts.window is None or any(p[0].tzinfo for p in storm.points):
        return
    first, last = (storm.on_horizon(storm.points[k][0]) for k in (0, -1))
    if last <= parts.window.start or first >= parts.window.stop:
        value = f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} on the horizon's calendar"
        hint = "day and laid_on move the storm by whole days"
        allowed = f"times within the horizon, {parts.window}"
        parts.document.add(("storm", "points"), "[storm]", "points", value, allowed, hint)
