r"""Forecast errors of a track: along it, across it, and in intensity, growing with lead time.

Member $k$ of an ensemble issued at time $t_0$ has, at lead time $\tau = t - t_0$ in days,

$$ a_k = \sigma_a z_{k1} \tau, \quad c_k = \sigma_c z_{k2} \tau, \quad
   \Delta v_k = \sigma_v z_{k3} \sqrt\tau $$

with three standard normal draws per storm: an error is the same storm's error all along, which only
grows. Before $t_0$ the track is known. The displacement follows the track's own heading.

The defaults are assumptions of this package, of the size of official errors in their published
verification: with 40 km a day in each direction the mean distance from the forecast is
$\sqrt{\pi/2} \cdot 40$ = 50 km after one day, 150 km after three; 5 m/s in wind after one day and
9 m/s after three have mean magnitudes of 4 and 7 m/s.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np

from resilience.arrays import Floats
from resilience.earth.averaging import KNOT_MPS, relation, to_one_minute
from resilience.earth.sphere import destination, legs
from resilience.errors import UsageError
from resilience.fragility.tracks.fill import HPA_PER_KNOT, MIN_HPA, rmw_ibtracs
from resilience.fragility.tracks.track import Track


def ensemble(
    track: Track,
    n: int,
    rng: np.random.Generator,
    *,
    issued: np.datetime64 | datetime | str | None = None,
    along_km_per_day: float = 40.0,
    cross_km_per_day: float = 40.0,
    intensity_mps: float = 5.0,
) -> tuple[Track, ...]:
    """`n` equally likely tracks around a forecast.

    Pressure follows the wind by the slope of the regression that fills gaps, -0.74 hPa per knot;
    the radius of maximum wind is scaled as its regression on the pressure says.

    Args:
        track: the forecast.
        n: members.
        rng: three numbers are drawn per member, member by member.
        issued: datetime64 or text; the start of the track if None. Earlier points stay.
        along_km_per_day: standard deviation along the track after one day; grows linearly.
        cross_km_per_day: the same across the track.
        intensity_mps: standard deviation of the largest wind after one day, in the track's own
            averaging time; grows with the square root of the lead time.

    Raises:
        UsageError: no member, or a negative deviation.
    """
    spread = {"along": along_km_per_day, "cross": cross_km_per_day, "intensity": intensity_mps}
    wrong = [f"{key} {value:g}" for key, value in spread.items() if not 0.0 <= value < np.inf]
    if n < 1 or wrong:
        raise UsageError(
            f"ensemble of {n} members, {', '.join(wrong) or 'all deviations valid'}; "
            "allowed: 1 member or more, deviations of 0 or more",
            hint="0 leaves a kind of error out",
        )
    start = track.time[0] if issued is None else np.datetime64(issued).astype("datetime64[s]")
    lead_s = (track.time - start).astype("timedelta64[s]").astype(float)
    lead_days = np.maximum(lead_s, 0.0) / 86_400.0
    along, cross, strength = rng.standard_normal((n, 3)).T
    east, north = _headings(track)
    return tuple(
        _member(
            track,
            1000.0 * lead_days * along[k] * along_km_per_day,
            1000.0 * lead_days * cross[k] * cross_km_per_day,
            np.sqrt(lead_days) * strength[k] * intensity_mps,
            (east, north),
        )
        for k in range(n)
    )


def _member(
    track: Track,
    ahead_m: Floats,
    right_m: Floats,
    stronger_mps: Floats,
    heading: tuple[Floats, Floats],
) -> Track:
    """The track displaced along and across its heading, m, and stronger by so many m/s, (n,)."""
    east, north = heading
    lat, lon = destination(
        track.lat, track.lon, ahead_m * east + right_m * north, ahead_m * north - right_m * east
    )
    agency = relation(track.averaging_s, track.agency)
    vmax = np.maximum(track.vmax_mps + np.where(track.present, stronger_mps, 0.0), 0.0)
    gain_kt = to_one_minute(vmax, agency) - to_one_minute(track.vmax_mps, agency)
    pressure = track.pressure_hpa + HPA_PER_KNOT * gain_kt / KNOT_MPS
    pressure = np.clip(pressure, MIN_HPA, np.maximum(track.penv_hpa, track.pressure_hpa))
    scale = rmw_ibtracs(pressure) / rmw_ibtracs(track.pressure_hpa)
    return replace(
        track, lat=lat, lon=lon, vmax_mps=vmax, pressure_hpa=pressure, rmw_km=track.rmw_km * scale
    )


def _headings(track: Track) -> tuple[Floats, Floats]:
    """(n,) east and north component of the heading, the mean of the legs that meet in a point.

    A point that does not move has the heading of the last leg that did; a storm that never moves
    is headed north.
    """
    length, east, north = legs(track.lat, track.lon)
    moves = length > 1.0
    if not moves.any():
        return np.zeros(len(track.lat)), np.ones(len(track.lat))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(length)), 0))
    last = np.where(moves[last], last, int(np.argmax(moves)))
    e, n = east[last], north[last]
    before, after = np.r_[0, np.arange(len(e))], np.r_[np.arange(len(e)), len(e) - 1]
    mean_e, mean_n = e[before] + e[after], n[before] + n[after]
    size = np.hypot(mean_e, mean_n)
    back = size < 1e-9  # straight back: the heading of the leg it comes from
    mean_e, mean_n = np.where(back, e[before], mean_e), np.where(back, n[before], mean_n)
    size = np.where(back, 1.0, size)
    return mean_e / size, mean_n / size
