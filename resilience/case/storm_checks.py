"""Rules for the storm of a case: times that rise, points on the earth, winds in m/s."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from statistics import median

from resilience.case.parts import Parts
from resilience.case.storm_tables import StormTable
from resilience.case.tables import show

Finding = tuple[str, str, str, str]
"""`(key, value, allowed, hint)`."""

_LIMITS = (
    (1, "latitude", -90.0, 90.0, "degrees north come after the time"),
    (2, "longitude", -180.0, 180.0, "degrees east; west is negative"),
    (3, "pressure_hpa", 850.0, 1040.0, "hPa in the centre; write nan where it is unknown"),
    (4, "vmax_mps", 0.0, 110.0, "probably knots; multiply by 0.514444"),
)
_KNOTS, _STORMY_MPS = 1.55, 17.0
_AVERAGES = (60.0, 120.0, 180.0, 600.0)


def check_storm(parts: Parts) -> None:
    """Note what is wrong with `[storm]`."""
    storm = parts.storm
    if storm is None:
        return
    for key, *rest in findings(storm):
        parts.document.add(("storm", key), "[storm]", key, *rest)
    _check_day(parts, storm)
    _check_priority(parts, storm)


def findings(storm: StormTable) -> Iterator[Finding]:
    """Yield what is wrong with the points of a storm, and with what they mean."""
    points = storm.points or ()
    if not points:
        return
    if storm.averaging_s is None:
        hint = "NHC and JTWC average over 60 s, CMA over 120, JMA and most others over 600"
        yield "averaging_s", "nothing", "the seconds over which vmax is averaged", hint
    elif storm.averaging_s not in _AVERAGES:
        found, allowed = f"{storm.averaging_s:g}", ", ".join(f"{s:g}" for s in _AVERAGES)
        yield "averaging_s", found, allowed, "seconds, not minutes"
    if len(points) < 2:
        yield "points", f"{len(points)} point", "2 or more", "a track goes from point to point"
    yield from _times(storm)
    for number, point in enumerate(points, start=1):
        for k, what, low, high, hint in _LIMITS:
            value = float(point[k])  # type: ignore[arg-type]
            if not math.isnan(value) and not low <= value <= high:
                key = f"points[{number}][{k + 1}]"
                yield key, f"{what} {value:g}", f"{low:g} to {high:g}", hint
        if math.isnan(point[3]) and math.isnan(point[4]):
            hint = "one of them can be regressed from the other"
            yield f"points[{number}]", "neither pressure nor wind", "one of the two", hint
    yield from _in_knots(storm)


def _times(storm: StormTable) -> Iterator[Finding]:
    times = [point[0] for point in storm.points]
    for number, time in enumerate(times, start=1):
        if time.tzinfo is not None:
            hint = "points are in local time, utc_offset_h says how far from UTC"
            yield f"points[{number}][1]", show(time), "a time without offset", hint
            return
    for number, (one, other) in enumerate(pairwise(times), start=2):
        if other <= one:
            found = f"{show(other)} after {show(one)}"
            yield f"points[{number}][1]", found, "a later time than the point before", "sort them"


def _in_knots(storm: StormTable) -> Iterator[Finding]:
    """The regression of wind on pressure of the IBTrACS archive, as CLIMADA 6.1 has it."""
    ratios = [
        vmax / (0.514444 * (1216.5223 - 0.04086 * lat - 0.04190 * lon - 1.1797 * pressure))
        for _, lat, lon, pressure, vmax in storm.points
        if 850.0 <= pressure <= 995.0 and vmax > _STORMY_MPS
    ]
    if len(ratios) > 1 and median(ratios) > _KNOTS and all(p[4] <= 110.0 for p in storm.points):
        found = f"vmax {median(ratios):.2g} times what the pressures go with"
        hint = "probably knots given as m/s; multiply by 0.514444"
        yield "points", found, f"up to {_KNOTS:g} times", hint


def _check_priority(parts: Parts, storm: StormTable) -> None:
    """Note lines that crews should prefer and that are not there."""
    network = parts.network
    if network is None or storm.repair is None:
        return
    for name in storm.repair.priority:
        if not network.has_line(name):
            where, allowed = ("storm", "repair"), "a line of the network"
            hint = network.line_hint(name)
            parts.document.add(where, "[storm.repair]", "priority", show(name), allowed, hint)


def _check_day(parts: Parts, storm: StormTable) -> None:
    """Note half a date, and a storm that is over before the horizon or begins after it."""
    for key, other in (("day", "laid_on"), ("laid_on", "day")):
        if getattr(storm, key) is None and getattr(storm, other) is not None:
            hint = f"{other} needs it: the storm's `day` stands on the horizon's `laid_on`"
            parts.document.add(("storm", key), "[storm]", key, "nothing", "a date", hint)
            return
    if not storm.points or parts.window is None or any(p[0].tzinfo for p in storm.points):
        return
    first, last = (storm.on_horizon(storm.points[k][0]) for k in (0, -1))
    if last <= parts.window.start or first >= parts.window.stop:
        found = f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} on the horizon's calendar"
        hint = "day and laid_on move the storm by whole days"
        allowed = f"times within the horizon, {parts.window}"
        parts.document.add(("storm", "points"), "[storm]", "points", found, allowed, hint)
