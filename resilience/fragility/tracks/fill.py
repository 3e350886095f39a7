"""What a track does not say, from what it says: published regressions on best tracks.

As CLIMADA uses them, fitted to IBTrACS: pressure and wind from each other and the place, the radius
of maximum wind piecewise linear in the pressure (r2 0.79), the environment's pressure by basin.
Other regressions for the radius are as coded in TCHazaRds, dp in hPa and R in km.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.earth.averaging import (
    KNOT_MPS,
    NAUTICAL_MILE_KM,
    from_one_minute,
    relation,
    to_one_minute,
)
from resilience.earth.plausible import usual_wind_kt
from resilience.errors import UsageError

PENV_HPA = {"NA": 1010.0, "EP": 1010.0, "SA": 1010.0, "NI": 1005.0, "SI": 1005.0, "WP": 1005.0}
PENV_HPA |= {"SP": 1004.0}
PENV_DEFAULT_HPA = 1010.0
LEAST_HPA = 850.0
HPA_PER_KNOT = -0.7357


def rmw_ibtracs(pressure_hpa: Floats, **_: Floats) -> Floats:
    """(n,) km, piecewise linear in the central pressure (CLIMADA)."""
    at = (872.0, 940.0, 980.0, 1021.0)
    return NAUTICAL_MILE_KM * np.interp(pressure_hpa, at, (14.907, 15.727, 25.742, 56.857))


def rmw_vickery(dp_hpa: Floats, lat: Floats, **_: Floats) -> Floats:
    """(n,) km, Vickery and Wadhera 2008."""
    return np.exp(3.015 - 6.291e-5 * dp_hpa**2 + 0.0337 * np.abs(lat))


def rmw_powell(dp_hpa: Floats, lat: Floats, **_: Floats) -> Floats:
    """(n,) km, Powell 2005 as in Arthur 2021."""
    bend = 0.813 * np.exp(-0.0022 * dp_hpa**2)
    return np.exp(3.543 - 0.00378 * dp_hpa + bend + 0.00157 * lat**2)


def rmw_willoughby_rahn(v_mps: Floats, lat: Floats, **_: Floats) -> Floats:
    """(n,) km, Willoughby and Rahn 2004."""
    return 51.6 * np.exp(-0.0223 * v_mps + 0.0281 * np.abs(lat))


RADII: dict[str, Callable[..., Floats]] = {
    "ibtracs": rmw_ibtracs,
    "vickery2008": rmw_vickery,
    "powell2005": rmw_powell,
    "willoughby2004": rmw_willoughby_rahn,
}


def filled(
    given: dict[str, Floats], meta: dict[str, Any]
) -> tuple[dict[str, Floats], dict[str, str]]:
    """The fields of a track without gaps, and what was filled in.

    Args:
        given: (n,) seconds, lat, lon, pressure_hpa, vmax_mps, rmw_km, penv_hpa; NaN is a gap.
        meta: `averaging_s`, `agency`, `basin`, `penv_hpa` (None: by basin), `rmw`, a key of
            `RADII`.

    Raises:
        UsageError: an unknown regression for the radius, or basin.
    """
    if meta["rmw"] not in RADII:
        raise UsageError(
            f"regression {meta['rmw']!r} for the radius of maximum wind; "
            f"allowed: {', '.join(RADII)}",
            hint="ibtracs needs the pressure alone",
        )
    if meta["basin"] and meta["basin"] not in PENV_HPA:
        raise UsageError(
            f"basin {meta['basin']!r}; allowed: {', '.join(PENV_HPA)}",
            hint="it stands for the pressure around the storm, which `penv_hpa` states outright",
        )
    found, notes = dict(given), _Notes(len(given["lat"]))
    _fill_environment(found, meta, notes)
    _fill_intensity(found, meta, notes)
    gap = np.isnan(found["rmw_km"])
    if gap.any():
        agency = relation(meta["averaging_s"], meta["agency"])
        radius = RADII[meta["rmw"]](
            pressure_hpa=found["pressure_hpa"],
            dp_hpa=np.maximum(found["penv_hpa"] - found["pressure_hpa"], 0.0),
            v_mps=to_one_minute(found["vmax_mps"], agency),
            lat=found["lat"],
        )
        notes.add("rmw_km", gap, f"regression {meta['rmw']}")
        found["rmw_km"] = np.where(gap, radius, found["rmw_km"])
    return found, notes.text


def _fill_environment(found: dict[str, Floats], meta: dict[str, Any], notes: _Notes) -> None:
    gap = np.isnan(found["penv_hpa"])
    value, basin = meta["penv_hpa"], meta["basin"]
    how = (
        "as asked for"
        if value is not None
        else f"basin {basin}"
        if basin in PENV_HPA
        else "default"
    )
    value = PENV_HPA.get(basin, PENV_DEFAULT_HPA) if value is None else value
    notes.add("penv_hpa", gap, f"{value:g} hPa, {how}")
    found["penv_hpa"] = np.where(gap, value, found["penv_hpa"])


def _fill_intensity(found: dict[str, Floats], meta: dict[str, Any], notes: _Notes) -> None:
    """Pressure and wind from each other; where neither is given, from their neighbours in time."""
    agency = relation(meta["averaging_s"], meta["agency"])
    lat, lon = found["lat"], (found["lon"] + 180.0) % 360.0 - 180.0
    pc, v = found["pressure_hpa"], found["vmax_mps"]
    no_pc, no_v = np.isnan(pc), np.isnan(v)
    knots = to_one_minute(v, agency) / KNOT_MPS
    from_v = 1026.3401 - 0.05504 * lat - 0.03536 * lon + HPA_PER_KNOT * knots
    from_v = np.clip(from_v, LEAST_HPA, found["penv_hpa"])
    from_pc = from_one_minute(np.maximum(usual_wind_kt(lat, lon, pc), 0.0) * KNOT_MPS, agency)
    notes.add("pressure_hpa", no_pc & ~no_v, "regression on the wind")
    notes.add("vmax_mps", no_v & ~no_pc, "regression on the pressure")
    both = no_pc & no_v
    for key, gap, values in (("pressure_hpa", no_pc, from_v), ("vmax_mps", no_v, from_pc)):
        notes.add(key, both, "linear in time")
        value = np.where(gap, values, found[key])
        value[both] = np.interp(found["seconds"][both], found["seconds"][~both], value[~both])
        found[key] = value


class _Notes:
    """Says how many values of a field were filled, and how."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.text: dict[str, str] = {}

    def add(self, key: str, gap: Bools, how: str) -> None:
        if not gap.any():
            return
        said = f"{int(gap.sum())} of {self.n}: {how}"
        self.text[key] = f"{self.text[key]}; {said}" if key in self.text else said
