"""Storms made up for tests: one moves on a straight line, or not at all."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyproj import Geod

from resilience.fragility.tracks import Track, track_of

SPHERE = Geod(a=6_371_000.0, b=6_371_000.0)


def cyclone(
    *,
    n: int = 9,
    step_h: float = 6.0,
    at: tuple[float, float] = (20.0, 115.0),
    move: tuple[float, float] = (0.0, 0.0),
    averaging_s: float = 60.0,
    **columns: Any,
) -> Track:
    """Begins `at` (latitude, longitude) and moves by degrees per hour; the intensity is constant.

    Columns are those of `track_of`, as numbers or arrays; 50 m/s, 940 hPa, 40 km in 1010 hPa if not
    given; None leaves a column out.
    """
    hours = step_h * np.arange(n)
    values = {"vmax_mps": 50.0, "pressure_hpa": 940.0, "rmw_km": 40.0, "penv_hpa": 1010.0} | columns
    lon = (at[1] + move[1] * hours + 180.0) % 360.0 - 180.0
    columns = {
        "time": np.datetime64("2020-09-01T00:00:00") + (3600 * hours).astype("timedelta64[s]"),
        "lat": at[0] + move[0] * hours,
        "lon": lon,
        **{k: np.broadcast_to(v, n) for k, v in values.items() if v is not None},
    }
    return track_of(columns, averaging_s=averaging_s, name="made up")


def around(
    at: tuple[float, float], distance_m: Any, azimuth_deg: Any
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Latitudes and longitudes at distances from a place, by pyproj on the same sphere."""
    distance, azimuth = np.broadcast_arrays(
        np.atleast_1d(np.asarray(distance_m, float)), np.asarray(azimuth_deg, float)
    )
    start = (np.full(len(distance), at[1]), np.full(len(distance), at[0]))
    lon, lat, _ = SPHERE.fwd(*start, azimuth, distance)
    return np.asarray(lat), np.asarray(lon)
