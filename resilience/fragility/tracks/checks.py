"""What can be wrong with a track, all of it, with the row of the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from resilience.arrays import Bools, Floats, Ints, Times
from resilience.earth.averaging import AGENCIES, NAMELESS
from resilience.earth.plausible import LON_HIGH, LON_LOW, leaps, odd_winds
from resilience.errors import Mistake


@dataclass(frozen=True)
class Limit:
    """Lowest and highest value a field may have.

    Attributes:
        low, high: in the unit.
        unit: for messages.
        hint: what a value beyond them usually is.
    """

    low: float
    high: float
    unit: str
    hint: str


LIMITS: dict[str, Limit] = {
    "lat": Limit(-90.0, 90.0, "degrees north", "south is negative"),
    "lon": Limit(LON_LOW, LON_HIGH, "degrees east", "west is negative, or counted on from 180"),
    "vmax_mps": Limit(
        0.0, 110.0, "m/s", "winds in knots belong in a column `vmax_kt`, in km/h in `vmax_kmh`"
    ),
    "pressure_hpa": Limit(850.0, 1080.0, "hPa", "1 hPa is 1 mbar, 100 Pa, 0.75 mmHg"),
    "penv_hpa": Limit(900.0, 1080.0, "hPa", "1010 hPa is usual"),
    "rmw_km": Limit(1.0, 500.0, "km", "a radius in nautical miles belongs in a column `rmw_nmi`"),
}
WEAK_HINT = (
    "m/s belong in a column `vmax_mps`, knots in `vmax_kt`; leave out winds that are unknown"
)


def mistakes(
    file: str,
    time: Times,
    fields: dict[str, Floats],
    rows: Ints,
    averaging_s: float | None,
    agency: str = "",
    *,
    fixed_units: bool = False,
) -> Iterator[Mistake]:
    """Every mistake of a track.

    Args:
        file: name for messages.
        time: (n,) NaT where it could not be read, which the reader has reported.
        fields: (n,) by name, NaN is a gap.
        rows: (n,) line of the file, for messages.
        averaging_s: of the wind; None if unknown.
        agency: whose winds they are, a name of `AGENCIES`, or empty.
        fixed_units: the file's format fixes the unit of winds: an odd one is the storm's own.
    """
    yield from _averaging(file, averaging_s)
    if len(time) < 2:
        yield Mistake(
            file, "track", "points", str(len(time)), "2 or more", "a storm needs a path to move on"
        )
    yield from _times(file, time, rows)
    yield from _ranges(file, fields, rows)
    yield from _gaps(file, fields, rows)
    yield from _leaps(file, time, fields, rows)
    if not fixed_units:
        yield from _strength(file, fields, rows, averaging_s, agency)


def _averaging(file: str, averaging_s: float | None) -> Iterator[Mistake]:
    if averaging_s not in NAMELESS:
        yield Mistake(
            file,
            "track",
            "averaging_s",
            "missing" if averaging_s is None else f"{averaging_s:g}",
            f"the averaging time of the wind, s: {', '.join(f'{key:g}' for key in NAMELESS)}",
            "60 for NHC and JTWC, 120 for CMA, 600 for JMA and most others; "
            "as a column, or by --averaging-s, `averaging_s` in Python",
        )


def _times(file: str, time: Times, rows: Ints) -> Iterator[Mistake]:
    readable = np.flatnonzero(~np.isnat(time))
    for before, after in pairwise(readable):
        if time[after] <= time[before]:
            same = time[after] == time[before]
            yield Mistake(
                file,
                f"row {rows[after]}",
                "time",
                f"{time[after]}{', twice' if same else f' after {time[before]}'}",
                "times that rise from row to row",
                "leave one of the two out" if same else "sort the rows by time",
            )


def _ranges(file: str, fields: dict[str, Floats], rows: Ints) -> Iterator[Mistake]:
    """Values beyond `LIMITS`."""
    for key, limit in LIMITS.items():
        value = fields[key]
        for k in np.flatnonzero(_outside(key, value)):
            allowed = f"{limit.low:g} to {limit.high:g} {limit.unit}"
            yield Mistake(file, f"row {rows[k]}", key, f"{value[k]:g}", allowed, limit.hint)


def _outside(key: str, value: Floats) -> Bools:
    limit = LIMITS[key]
    return ~np.isnan(value) & ~((limit.low <= value) & (value <= limit.high))


def _gaps(file: str, fields: dict[str, Floats], rows: Ints) -> Iterator[Mistake]:
    """Gaps that nothing fills: a place, or all winds and pressures."""
    for key in ("lat", "lon"):
        for k in np.flatnonzero(np.isnan(fields[key])):
            yield Mistake(
                file, f"row {rows[k]}", key, "nothing", "a number", "leave out rows without a place"
            )
    if len(rows) and (np.isnan(fields["pressure_hpa"]) & np.isnan(fields["vmax_mps"])).all():
        yield Mistake(
            file,
            "track",
            "vmax_mps",
            "neither wind nor pressure in any row",
            "one of them, in one row at least",
            "columns are `vmax_mps` or `vmax_kt`, and `pressure_hpa`",
        )


def _leaps(file: str, time: Times, fields: dict[str, Floats], rows: Ints) -> Iterator[Mistake]:
    """Legs that no storm can travel."""
    if not len(time):
        return
    start = np.datetime64("2000-01-01", "s")
    hours = np.where(np.isnat(time), np.nan, (time - start).astype(float) / 3600.0)
    lat, lon = (np.where(_outside(key, fields[key]), np.nan, fields[key]) for key in ("lat", "lon"))
    for leap in leaps(hours, lat, lon):
        row = f"row {rows[leap.point]}"
        yield Mistake(file, row, "lat, lon", leap.text, leap.allowed, leap.hint)


def _strength(
    file: str, fields: dict[str, Floats], rows: Ints, averaging_s: float | None, agency: str
) -> Iterator[Mistake]:
    """Winds in another unit, or none, told by the pressures; beyond `LIMITS` is reported there."""
    if _outside("vmax_mps", fields["vmax_mps"]).any():
        return
    whose = AGENCIES.get(agency) or NAMELESS.get(averaging_s or 0.0, AGENCIES["usa"])
    odd = odd_winds(fields["lat"], fields["lon"], fields["pressure_hpa"], fields["vmax_mps"], whose)
    if odd is not None:
        hint = WEAK_HINT if odd.weak else LIMITS["vmax_mps"].hint
        wind = odd.text(f"row {rows[odd.point]}")
        yield Mistake(file, "track", "vmax_mps", wind, odd.allowed, hint)
