"""Wind of Rammasun (2014) at Zhanjiang: Holland 2008 on a given track, from its equations."""

from __future__ import annotations

import csv

import numpy as np
from numpy.typing import NDArray

from tests.shared import shared

LAT, LON = 21.27, 110.36
STEP_S = 900.0
RADIUS_KM = 6371.0

HOURLY_MPS = (
    5.892, 3.564, 3.902, 4.344, 4.893, 5.552, 6.314, 7.821, 8.800, 9.832, 10.942, 12.159, 13.515,
    14.325, 16.035, 18.064, 20.427, 23.114, 26.060, 25.641, 27.878, 29.957, 31.836, 33.520, 35.082,
    36.383, 37.623, 38.156, 37.386, 34.993, 31.257, 28.092, 24.336, 20.993, 18.572, 16.586, 15.003,
    13.057, 12.094, 11.178, 10.262, 9.306, 8.282, 7.443, 6.441, 5.513, 5.018, 4.480, 3.909,
)  # fmt: skip
"""What `rammasun` gives, hourly from 12:00 on 17 July 2014; CLIMADA 6.1.0 has 38.177 at 15:00."""


def rammasun() -> NDArray[np.float64]:
    """(steps,) m/s, one-minute wind at 10 m over water, every 15 minutes."""
    with shared("data", "tracks", "rammasun_2014_climada_interp15min.csv").open() as file:
        rows = list(csv.DictReader(file))
    lat, lon, pc, penv = (
        np.array([float(r[k]) for r in rows]) for k in ("lat", "lon", "pc", "penv")
    )
    north, east = _offset(lat, lon, np.roll(lat, 1), np.roll(lon, 1))
    velocity = -1000.0 * np.stack([north, east]) / STEP_S
    velocity[:, 0] = 0.0
    forward = np.hypot(*velocity)
    velocity *= np.minimum(1.0, 15.433 / np.maximum(forward, 1e-9))
    forward = np.hypot(*velocity)
    radius = 1.852 * np.interp(pc, (872, 940, 980, 1021), (14.907, 15.727, 25.742, 56.857))
    drop, change = penv - pc, np.diff(pc, prepend=pc[0]) / 0.25
    x = 0.6 * (1.0 - drop / 215.0)
    b = -4.4e-5 * drop**2 + 0.01 * drop + 0.03 * change - 0.014 * np.abs(lat)
    b = np.clip(b + 0.15 * forward**x + 1.0, 0.81, 2.025)
    north, east = _offset(lat, lon, LAT, LON)
    away = np.hypot(north, east)
    half = 0.5 * 1000.0 * away * 2.0 * 7.29e-5 * np.sin(np.radians(lat))
    near = (radius / away) ** b
    speed = np.sqrt(b / 1.15 * near * 100.0 * drop * np.exp(-near) + half**2) - half
    share = np.minimum(1.0, radius / away)
    speed = np.maximum(speed - forward * share, 0.0)
    turning = np.stack([east, -north]) / away
    return np.hypot(*(speed * turning + share * velocity))


def _offset(
    lat: NDArray[np.float64], lon: NDArray[np.float64], to_lat: object, to_lon: object
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Kilometres north and east, by haversine distance and initial bearing."""
    a, b = np.radians(lat), np.radians(np.asarray(to_lat, float))
    across = np.radians(np.asarray(to_lon, float)) - np.radians(lon)
    h = np.sin((b - a) / 2) ** 2 + np.cos(a) * np.cos(b) * np.sin(across / 2) ** 2
    away = 2.0 * RADIUS_KM * np.arcsin(np.sqrt(h))
    bearing = np.arctan2(
        np.sin(across) * np.cos(b),
        np.cos(a) * np.sin(b) - np.sin(a) * np.cos(b) * np.cos(across),
    )
    return away * np.cos(bearing), away * np.sin(bearing)
