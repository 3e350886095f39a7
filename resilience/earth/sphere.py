"""Distances and directions on a sphere, fast for many points and times.

The sphere has the mean radius of the Earth. It differs from the ellipsoid by less than 0.6 % in
distance, far less than a storm's centre is known. Everything is products of unit vectors, so that
neither pole nor dateline is special and a point is exact however close it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats

RADIUS_M = 6_371_000.0
MIN_SINE = 1e-20  # of the angle to a point; smaller squares would underflow


def seen_from(
    eye: tuple[ArrayLike, ArrayLike], points: tuple[ArrayLike, ArrayLike]
) -> list[Floats]:
    """Where points lie, seen from eyes: distance and direction at the eye.

    Args:
        eye: latitude and longitude (times,), degrees.
        points: latitude and longitude (points,), degrees.

    Returns:
        Three arrays (points, times): distance, m, and the east and north component of the
        direction, together of length 1; of no meaning where the point is the eye.
    """
    up, east, north = _frame(*eye)
    towards = _frame(*points)[0]
    e, n, u = towards @ east.T, towards @ north.T, towards @ up.T
    across = np.sqrt(e * e + n * n)
    distance = RADIUS_M * np.arctan2(across, u)
    np.maximum(across, MIN_SINE, out=across)
    e /= across
    n /= across
    return [distance, e, n]


def legs(lat: ArrayLike, lon: ArrayLike) -> list[Floats]:
    """Legs of a path of n points: (n - 1,) length, m, and direction at first, east and north."""
    up, east, north = _frame(lat, lon)
    e, n, u = ((axis[:-1] * up[1:]).sum(axis=1) for axis in (east, north, up))
    across = np.hypot(e, n)
    safe = np.maximum(across, MIN_SINE)
    return [RADIUS_M * np.arctan2(across, u), e / safe, n / safe]


def destination(
    lat: ArrayLike, lon: ArrayLike, east_m: ArrayLike, north_m: ArrayLike
) -> tuple[Floats, Floats]:
    """Latitude and longitude, degrees, of points moved along the great circle of a displacement."""
    up, east, north = _frame(lat, lon)
    e, n = np.asarray(east_m, float), np.asarray(north_m, float)
    length = np.hypot(e, n)
    angle = length / RADIUS_M
    along = np.stack([e, n], -1) / np.maximum(length, MIN_SINE)[..., None]
    towards = along[..., :1] * east + along[..., 1:] * north
    place = np.cos(angle)[..., None] * up + np.sin(angle)[..., None] * towards
    new_lat = np.degrees(np.arctan2(place[..., 2], np.hypot(place[..., 0], place[..., 1])))
    return new_lat, np.degrees(np.arctan2(place[..., 1], place[..., 0]))


def _frame(lat: ArrayLike, lon: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Unit vectors (..., 3) up, east and north at each place."""
    phi, lam = np.radians(np.asarray(lat, float)), np.radians(np.asarray(lon, float))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(phi), np.cos(phi), np.sin(lam), np.cos(lam)
    up = np.stack([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat], -1)
    east = np.stack([-sin_lon, cos_lon, np.zeros_like(phi)], -1)
    north = np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat], -1)
    return up, east, north
