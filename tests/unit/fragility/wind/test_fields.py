"""The five wind fields against closed forms; a storm that does not move unless it is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from resilience.fragility.tracks import Track
from resilience.fragility.wind import MODELS, wind
from tests.cyclones import around, cyclone

R = 40_000.0
EQUATOR = (0.0, 115.0)


def along_a_ray(
    model: str, track: Track, distance_m: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    at = float(track.lat[0]), float(track.lon[0])
    lat, lon = around(at, distance_m, 90.0)
    return wind(track, lat, lon, model=model).speed_mps[:, 0]


def largest(model: str, track: Track) -> float:
    """Of each model at R: from its wind, or from its pressure deficit of 70 hPa."""
    f = 2 * 7.29e-5 * np.sin(np.radians(abs(track.lat[0])))
    b = -4.4e-5 * 70**2 + 0.01 * 70 - 0.014 * abs(track.lat[0]) + 1.0  # no motion, no deepening
    pressure = np.sqrt(b * 7000.0 / (1.15 * math.e))
    return float(
        {
            "holland1980": 50.0,
            "holland2008": pressure,
            "holland2010": pressure,
            "emanuel2011": 50.0 + f * R / 2,
            "willoughby2006": 50.0,
        }[model]
    )


@pytest.mark.parametrize("model", MODELS)
def test_the_largest_wind_is_at_the_radius_of_maximum_wind(model: str) -> None:
    """On the equator, where Holland's gradient wind is its cyclostrophic one."""
    track = cyclone(at=EQUATOR)
    at_r = along_a_ray(model, track, np.array([R]))[0]
    assert at_r == pytest.approx(largest(model, track), rel=1e-6)
    everywhere = along_a_ray(model, track, np.linspace(1e3, 3e5, 3000))
    # Willoughby's equation for the bridge puts the top a little beside R.
    slack = 5e-3 if model == "willoughby2006" else 1e-6
    assert everywhere.max() == pytest.approx(at_r, rel=slack)


@pytest.mark.parametrize("model", MODELS)
def test_away_from_the_equator_the_wind_at_r_is_nearly_that(model: str) -> None:
    """Holland's gradient wind is less than the cyclostrophic one by about R f / 2, 1 m/s here."""
    track = cyclone()
    found = along_a_ray(model, track, np.array([R]))[0]
    exact = largest(model, track)
    if model in ("holland1980", "holland2008"):
        turning = R * 7.29e-5 * np.sin(np.radians(20.0))
        factor = 0.9 if model == "holland1980" else 1.0
        top = exact / factor
        exact = factor * (np.sqrt(top**2 + turning**2) - turning)
    assert found == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_calm_in_the_eye(model: str) -> None:
    assert wind(cyclone(), 20.0, 115.0, model=model).speed_mps.max() < 0.01


@pytest.mark.parametrize("model", MODELS)
def test_falling_outside_rising_inside(model: str) -> None:
    for at in (EQUATOR, (30.0, 115.0)):
        outside = along_a_ray(model, cyclone(at=at), np.linspace(1.05 * R, 1.5e6, 2000))
        assert (np.diff(outside) < 0).all()
        inside = along_a_ray(model, cyclone(at=at), np.linspace(500.0, 0.8 * R, 400))
        assert (np.diff(inside) >= 0).all()


def test_holland_1980_has_limits_for_b() -> None:
    """A deficit of 200 hPa is too deep for 50 m/s: B = 1, sqrt(dp / (rho e)) 0.9 = 71.97 m/s."""
    deep = cyclone(at=EQUATOR, pressure_hpa=850.0, penv_hpa=1050.0)
    found = along_a_ray("holland1980", deep, np.array([R]))[0]
    assert found == pytest.approx(0.9 * np.sqrt(20_000 / (1.15 * math.e)), rel=1e-6)


def test_holland_2008_sees_deepening() -> None:
    """0.03 per hPa an hour: falling by 1 hPa an hour, b is 0.03 less than 1.4844."""
    falling = cyclone(at=EQUATOR, step_h=1.0, pressure_hpa=948.0 - np.arange(9.0))
    lat, lon = around(EQUATOR, R, 90.0)
    found = wind(falling, lat, lon, model="holland2008").speed_mps[0, 8]
    b = -4.4e-5 * 70**2 + 0.7 + 1.0 - 0.03
    assert found == pytest.approx(np.sqrt(b * 7000 / (1.15 * math.e)), rel=1e-6)


def test_holland_2010_meets_its_outer_point() -> None:
    track = cyclone(at=EQUATOR)
    assert along_a_ray("holland2010", track, np.array([3e5]))[0] == pytest.approx(17.0, rel=1e-6)


def test_emanuel_by_hand() -> None:
    """At twice R: M is 8/5 of that at R, r twice, so 4/5 of v at R."""
    track = cyclone(at=EQUATOR)
    two = along_a_ray("emanuel2011", track, np.array([2 * R]))[0]
    assert two == pytest.approx(0.8 * 50.0, rel=1e-6)


def test_willoughby_by_hand() -> None:
    """Inside and outside the bridge, which is at most 25 km wide and holds R = 40 km."""
    track = cyclone(at=EQUATOR)
    v = 50.0 / 0.9
    n, x1, a = 0.4067 + 0.0144 * v, 317.1 - 2.026 * v, 0.0696 + 0.0049 * v
    inner, outer, far = along_a_ray("willoughby2006", track, np.array([10e3, 90e3, 700e3]))
    assert inner == pytest.approx(0.9 * v * 0.25**n, rel=1e-6)
    assert outer == pytest.approx(0.9 * v * ((1 - a) * np.exp(-50 / x1) + a * np.exp(-2)), rel=1e-6)
    assert far == pytest.approx(0.75 * v * (1 - a) * np.exp(-660 / x1), rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_no_wind_without_a_storm(model: str) -> None:
    calm = cyclone(vmax_mps=0.0, pressure_hpa=1012.0)
    assert (wind(calm, 20.0, 115.2, model=model).speed_mps == 0.0).all()
