r"""What a track does not say, from what it says: published regressions on best tracks.

As CLIMADA uses them, fitted to IBTrACS: pressure and wind from each other and the place, the radius
of maximum wind piecewise linear in the pressure (r2 0.79), the environment's pressure by basin.
Other regressions for the radius are as coded in TCHazaRds, dp in hPa and R in km.

A pressure regressed on the wind is at most what the wind can go with: with air of density $\rho$
the largest wind of Holland's profile is $\sqrt{b \Delta p / \rho e}$, and $b$ is at most 2.025, his
limit of 2.5 times the square of 0.9, the factor to the surface (Holland 1980, 2008).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

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
MIN_HPA = 850.0
DENSITY = 1.15  # of air, kg/m3
MAX_SURFACE_B = 2.5 * 0.9**2
HPA_PER_KNOT = -0.7357


def rmw_ibtracs(pressure_hpa: Floats, **_: Floats) -> Floats:
    """(n,) km, piecewise linear in the central pressure (CLIMADA)."""
    pressures = (872.0, 940.0, 980.0, 1021.0)
    return NAUTICAL_MILE_KM * np.interp(pressure_hpa, pressures, (14.907, 15.727, 25.742, 56.857))


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


@dataclass(frozen=True)
class FillSettings:
    """What the filling of gaps needs to know of a track.

    Attributes:
        averaging_s: of its winds, s.
        agency: whose winds they are, a name of `AGENCIES`, or empty.
        basin: a key of `PENV_HPA`, or empty.
        penv_hpa: pressure of the environment; by basin if None.
        rmw: regression for the radius of maximum wind, a key of `RADII`.
    """

    averaging_s: float
    agency: str
    basin: str
    penv_hpa: float | None
    rmw: str


def with_gaps_filled(
    fields: dict[str, Floats], settings: FillSettings
) -> tuple[dict[str, Floats], dict[str, str]]:
    """The fields of a track without gaps, and what was filled in.

    Args:
        fields: (n,) seconds, lat, lon, pressure_hpa, vmax_mps, rmw_km, penv_hpa; NaN is a gap.
        settings: how to fill them.

    Returns:
        The fields, with `pressure_from_wind` as `Track` has it where that is not None, and what
        was filled by field.

    Raises:
        UsageError: an unknown regression for the radius, or basin.
    """
    if settings.rmw not in RADII:
        raise UsageError(
            f"regression {settings.rmw!r} for the radius of maximum wind; "
            f"allowed: {', '.join(RADII)}",
            hint="ibtracs needs the pressure alone",
        )
    if settings.basin and settings.basin not in PENV_HPA:
        raise UsageError(
            f"basin {settings.basin!r}; allowed: {', '.join(PENV_HPA)}",
            hint="it stands for the pressure around the storm, which `penv_hpa` states outright",
        )
    complete, notes = dict(fields), _Notes(len(fields["lat"]))
    _fill_environment(complete, settings, notes)
    _fill_intensity(complete, settings, notes)
    gap = np.isnan(complete["rmw_km"])
    if gap.any():
        agency = relation(settings.averaging_s, settings.agency)
        radius = RADII[settings.rmw](
            pressure_hpa=complete["pressure_hpa"],
            dp_hpa=np.maximum(complete["penv_hpa"] - complete["pressure_hpa"], 0.0),
            v_mps=to_one_minute(complete["vmax_mps"], agency),
            lat=complete["lat"],
        )
        notes.add("rmw_km", gap, f"regression {settings.rmw}")
        complete["rmw_km"] = np.where(gap, radius, complete["rmw_km"])
    return complete, notes.text


def _fill_environment(fields: dict[str, Floats], settings: FillSettings, notes: _Notes) -> None:
    gap = np.isnan(fields["penv_hpa"])
    value, basin = settings.penv_hpa, settings.basin
    how = (
        "as asked for"
        if value is not None
        else f"basin {basin}"
        if basin in PENV_HPA
        else "default"
    )
    value = PENV_HPA.get(basin, PENV_DEFAULT_HPA) if value is None else value
    notes.add("penv_hpa", gap, f"{value:g} hPa, {how}")
    fields["penv_hpa"] = np.where(gap, value, fields["penv_hpa"])


def _fill_intensity(fields: dict[str, Floats], settings: FillSettings, notes: _Notes) -> None:
    """Pressure and wind from each other; where neither is given, from their neighbours in time."""
    agency = relation(settings.averaging_s, settings.agency)
    lat, lon = fields["lat"], (fields["lon"] + 180.0) % 360.0 - 180.0
    pc, v = fields["pressure_hpa"], fields["vmax_mps"]
    no_pc, no_v = np.isnan(pc), np.isnan(v)
    knots = to_one_minute(v, agency) / KNOT_MPS
    from_v = 1026.3401 - 0.05504 * lat - 0.03536 * lon + HPA_PER_KNOT * knots
    least_deficit_pa = DENSITY * math.e * (KNOT_MPS * knots) ** 2 / MAX_SURFACE_B
    from_v = np.minimum(from_v, fields["penv_hpa"] - least_deficit_pa / 100.0)
    from_v = np.maximum(from_v, MIN_HPA)
    from_pc = from_one_minute(np.maximum(usual_wind_kt(lat, lon, pc), 0.0) * KNOT_MPS, agency)
    notes.add("pressure_hpa", no_pc & ~no_v, "regression on the wind")
    notes.add("vmax_mps", no_v & ~no_pc, "regression on the pressure")
    both, seconds = no_pc & no_v, fields["seconds"]
    for key, gap, values in (("pressure_hpa", no_pc, from_v), ("vmax_mps", no_v, from_pc)):
        notes.add(key, both, "linear in time")
        fields[key] = np.where(gap, values, fields[key])
    keys = ["pressure_hpa", "vmax_mps"]
    if (no_pc & ~no_v).any():
        fields["pressure_from_wind"] = no_pc.astype(float)
        keys.append("pressure_from_wind")
    for key in keys:
        fields[key][both] = np.interp(seconds[both], seconds[~both], fields[key][~both])


class _Notes:
    """Says how many values of a field were filled, and how."""

    def __init__(self, n: int) -> None:
        self.n = n
        self.text: dict[str, str] = {}

    def add(self, key: str, gap: Bools, how: str) -> None:
        if not gap.any():
            return
        note = f"{int(gap.sum())} of {self.n}: {how}"
        self.text[key] = f"{self.text[key]}; {note}" if key in self.text else note
