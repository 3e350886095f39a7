"""Distances, directions and displacements against pyproj, on the sphere and the ellipsoid."""

from __future__ import annotations

import numpy as np
from pyproj import Geod

from resilience.earth.sphere import destination, legs, seen_from
from tests.cyclones import SPHERE

RNG = np.random.default_rng(7)
LAT, LON = np.degrees(np.arcsin(RNG.uniform(-1, 1, 300))), RNG.uniform(-180, 180, 300)


def pairs() -> tuple[np.ndarray, ...]:
    eyes, points = slice(0, 20), slice(20, 300)
    i, j = np.meshgrid(np.arange(280), np.arange(20), indexing="ij")
    return LAT[eyes][j], LON[eyes][j], LAT[points][i], LON[points][i]


def test_distances_and_directions() -> None:
    lat0, lon0, lat1, lon1 = pairs()
    distance, east, north = seen_from((LAT[:20], LON[:20]), (LAT[20:], LON[20:]))
    azimuth, _, exact = SPHERE.inv(lon0, lat0, lon1, lat1)
    np.testing.assert_allclose(distance, exact, rtol=1e-9)
    np.testing.assert_allclose(east, np.sin(np.radians(azimuth)), atol=1e-8)
    np.testing.assert_allclose(north, np.cos(np.radians(azimuth)), atol=1e-8)


def test_the_ellipsoid_is_within_six_per_mille() -> None:
    lat0, lon0, lat1, lon1 = pairs()
    distance, _, _ = seen_from((LAT[:20], LON[:20]), (LAT[20:], LON[20:]))
    _, _, exact = Geod(ellps="WGS84").inv(lon0, lat0, lon1, lat1)
    ratio = distance / exact
    assert abs(ratio - 1).max() < 6e-3


def test_a_metre_is_a_metre() -> None:
    """No digits are lost near the eye, nor at the eye."""
    lat, lon = destination(20.0, 179.9999999, 1.0, 0.0)
    distance, east, north = seen_from(
        ([20.0], [179.9999999]), (np.atleast_1d(lat), np.atleast_1d(lon))
    )
    np.testing.assert_allclose([distance[0, 0], east[0, 0]], 1.0, atol=1e-7)
    assert abs(north[0, 0]) < 1e-6
    assert seen_from(([20.0], [115.0]), ([20.0], [115.0]))[0] < 1e-8
    tiny = seen_from(([0.0], [0.0]), ([0.0], [4.6e-211]))
    assert np.hypot(tiny[1], tiny[2]) <= 1.0


def test_legs_and_moves() -> None:
    azimuth, _, exact = SPHERE.inv(LON[:-1], LAT[:-1], LON[1:], LAT[1:])
    length, east, north = legs(LAT, LON)
    np.testing.assert_allclose(length, exact, rtol=1e-9)
    np.testing.assert_allclose(np.hypot(east, north), 1.0)
    lat, lon = destination(LAT[:-1], LON[:-1], 5e5 * east, 5e5 * north)
    end_lon, end_lat, _ = SPHERE.fwd(LON[:-1], LAT[:-1], azimuth, np.full(299, 5e5))
    np.testing.assert_allclose(lat, end_lat, atol=1e-8)
    np.testing.assert_allclose(np.cos(np.radians(lon - end_lon)), 1.0, atol=1e-9)
