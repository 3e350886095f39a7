"""The five wind fields against closed forms; a storm that does not move unless it is said."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from resilience.fragility.tracks import Track, ensemble, interpolated
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
    track = cyclone(at=EQUATOR)  # no storm of 50 m/s is as deep: a reader would refuse it
    deep = replace(track, pressure_hpa=np.full(9, 850.0), penv_hpa=np.full(9, 1050.0))
    found = along_a_ray("holland1980", deep, np.array([R]))[0]
    assert found == pytest.approx(0.9 * np.sqrt(20_000 / (1.15 * math.e)), rel=1e-6)


def test_holland_2008_sees_deepening() -> None:
    """0.03 per hPa an hour: falling by 6 hPa in 3 hours, b is 0.06 less than 1.4844."""
    falling = cyclone(at=EQUATOR, step_h=3.0, pressure_hpa=988.0 - 6.0 * np.arange(9.0))
    lat, lon = around(EQUATOR, R, 90.0)
    found = wind(falling, lat, lon, model="holland2008").speed_mps[0, 8]
    b = -4.4e-5 * 70**2 + 0.7 + 1.0 - 0.06
    assert found == pytest.approx(np.sqrt(b * 7000 / (1.15 * math.e)), rel=1e-6)


def test_holland_2008_sees_motion() -> None:
    """0.15 v^x, x = 0.6 (1 - 60/215): at 12 N, with 60 hPa, moving west at 0.2 degrees an hour."""
    moving = cyclone(n=2, step_h=4.0, at=(12.0, 115.0), move=(0.0, -0.2), pressure_hpa=950.0)
    speed = math.radians(0.2) * math.cos(math.radians(12.0)) * 6_371_000.0 / 3600.0
    b = -4.4e-5 * 60**2 + 0.6 - 0.014 * 12 + 0.15 * speed ** (0.6 * (1 - 60 / 215)) + 1.0
    lat, lon = around((12.0, float(moving.lon[1])), R, 200.0)
    found = wind(moving, lat, lon, model="holland2008", asymmetry="none").speed_mps[0, 1]
    top = math.sqrt(b * 6000 / (1.15 * math.e))
    assert found == pytest.approx(gradient(top, R, 12.0), rel=1e-6)


def gradient(top: float, radius_m: float, lat: float) -> float:
    """Gradient wind at R of Holland's profile whose cyclostrophic wind there is `top`, m/s."""
    half = radius_m * 7.29e-5 * math.sin(math.radians(lat))
    return math.sqrt(top**2 + half**2) - half


def test_b_of_holland_2008_has_limits() -> None:
    """20 hPa at 35 N: b of 0.69 counts as 0.81. Filling by 8 hPa an hour at 15 m/s: as 2.025."""
    shallow = cyclone(at=(35.0, 115.0), vmax_mps=22.0, pressure_hpa=990.0, rmw_km=60.0)
    b = -4.4e-5 * 20**2 + 0.01 * 20 - 0.014 * 35 + 1.0
    assert b < 0.7
    found = along_a_ray("holland2008", shallow, np.array([60e3]))[0]
    top = math.sqrt(0.81 * 2000 / (1.15 * math.e))
    assert found == pytest.approx(gradient(top, 60e3, 35.0), rel=1e-6)

    filling = cyclone(
        n=2, step_h=2.5, at=(3.0, 115.0), move=(0.0, 0.48), pressure_hpa=np.array([880.0, 900.0])
    )
    speed = math.radians(0.48) * math.cos(math.radians(3.0)) * 6_371_000.0 / 3600.0
    moving = 0.15 * speed ** (0.6 * (1 - 110 / 215))
    b = -4.4e-5 * 110**2 + 0.01 * 110 + 0.03 * 8 - 0.014 * 3 + moving + 1.0
    assert b > 2.08
    lat, lon = around((3.0, float(filling.lon[1])), R, 40.0)
    found = wind(filling, lat, lon, model="holland2008", asymmetry="none").speed_mps[0, 1]
    top = math.sqrt(2.025 * 11_000 / (1.15 * math.e))
    assert found == pytest.approx(gradient(top, R, 3.0), rel=1e-6)


def test_holland_2010_falls_no_slower_than_by_an_exponent_of_0_4() -> None:
    """Of 21 m/s at R, 17 at 300 km would be an exponent of 0.17 there."""
    weak = cyclone(at=(10.0, 115.0), vmax_mps=22.0, pressure_hpa=995.0)
    b = -4.4e-5 * 15**2 + 0.01 * 15 - 0.014 * 10 + 1.0
    top = math.sqrt(b * 1500 / (1.15 * math.e))
    assert math.log(17 / top) / (b * math.log(40 / 300) + 1 - (40 / 300) ** b) < 0.3
    q = (40 / 290) ** b
    found = along_a_ray("holland2010", weak, np.array([290e3]))[0]
    assert found == pytest.approx(top * (q * math.exp(1 - q)) ** 0.4, rel=1e-6)


@pytest.mark.parametrize("model", ["holland2008", "holland2010"])
def test_a_vortex_weaker_than_its_translation_is_none(model: str) -> None:
    """4 hPa give less than 10 m/s: on both sides the share of the translation alone is left."""
    weak = cyclone(
        n=2, step_h=3.0, at=(28.0, 115.0), move=(0.4, 0.0), vmax_mps=16.0, pressure_hpa=1008.0
    )
    speed = math.radians(0.4) * 6_371_000.0 / 3600.0
    lat, lon = around((float(weak.lat[1]), 115.0), 1.25 * R, np.array([75.0, 285.0]))
    found = wind(weak, lat, lon, model=model)
    np.testing.assert_allclose(found.speed_mps[:, 1], speed / 1.25, rtol=1e-6)
    np.testing.assert_allclose(np.cos(np.radians(found.direction_deg[:, 1])), 1.0, atol=1e-9)


@pytest.mark.parametrize(("asymmetry", "left"), [("none", 0.0), ("phadke2003", 1.0)])
def test_the_wind_of_a_moving_storm_is_the_tracks_on_its_right(asymmetry: str, left: float) -> None:
    """Of 7 m/s the share at R is none, or half, which is taken out of the track's wind before."""
    speed = 7.0
    degrees = math.degrees(speed * 3600 / 6_371_000.0)
    track = cyclone(n=2, step_h=2.0, at=(4.0, 115.0), move=(degrees, 0.0))
    at = float(track.lat[1])
    lat, lon = around((at, 115.0), R, np.array([90.0, 270.0]))
    found = wind(track, lat, lon, model="holland1980", asymmetry=asymmetry).speed_mps[:, 1]
    own = 0.9 * gradient((50.0 - 0.5 * left * speed) / 0.9, R, at)
    carried = 0.5 * left * speed
    np.testing.assert_allclose(found, [own + carried, own - carried], rtol=1e-5)


def test_holland_2010_meets_its_outer_point() -> None:
    track = cyclone(at=EQUATOR)
    assert along_a_ray("holland2010", track, np.array([3e5]))[0] == pytest.approx(17.0, rel=1e-6)


def test_emanuel_by_hand() -> None:
    """At twice R: M is 8/5 of that at R, r twice, so 4/5 of v at R."""
    track = cyclone(at=EQUATOR)
    two = along_a_ray("emanuel2011", track, np.array([2 * R]))[0]
    assert two == pytest.approx(0.8 * 50.0, rel=1e-6)


def test_emanuel_turns_with_the_earth() -> None:
    """At 18 S, at 5/2 of R: M is 50/29 of that at R, which has f R^2 / 2 in it."""
    track = cyclone(at=(-18.0, 115.0), vmax_mps=44.0, rmw_km=30.0)
    spin = 30e3 * 7.29e-5 * math.sin(math.radians(18.0))
    found = along_a_ray("emanuel2011", track, np.array([75e3]))[0]
    assert found == pytest.approx((44.0 + spin) * 50 / 29 / 2.5, rel=1e-6)


@pytest.mark.parametrize(
    ("lat", "vmax", "rmw_km", "inside_km", "outside_km"),
    [
        (0.0, 50.0, 40.0, 10.0, 90.0),  # inside and outside the bridge, which is 25 km wide
        (25.0, 52.0, 43.0, 12.0, 90.0),
        (-25.0, 61.0, 36.0, 9.0, 75.0),
        (25.0, 48.0, 15.0, 4.0, 21.0),  # 15 km wide: 25 km would begin at the eye, end beyond 22
        (40.0, 20.0, 55.0, 20.0, 130.0),  # far north a weak storm has one exponential
    ],
)
def test_willoughby_by_hand(
    lat: float, vmax: float, rmw_km: float, inside_km: float, outside_km: float
) -> None:
    """Equations 2 to 10 of Willoughby, Darling and Rahn 2006, with the Gulf's regressions."""
    track = cyclone(at=(lat, 115.0), vmax_mps=vmax, pressure_hpa=None, rmw_km=rmw_km)
    v, phi = vmax / 0.9, abs(lat)
    n, x1 = 0.4067 + 0.0144 * v - 0.0038 * phi, 317.1 - 2.026 * v + 1.915 * phi
    a = max(0.0696 + 0.0049 * v - 0.0064 * phi, 0.0)

    def out(r: float) -> float:
        away = r - rmw_km
        return v * ((1 - a) * math.exp(-away / x1) + a * math.exp(-away / 25.0))

    inner, outer, far = along_a_ray(
        "willoughby2006", track, 1e3 * np.array([inside_km, outside_km, 700.0])
    )
    assert inner == pytest.approx(0.9 * v * (inside_km / rmw_km) ** n, rel=1e-6)
    to_surface = 0.9 - 0.15 * max(outside_km - 100.0, 0.0) / 600.0
    assert outer == pytest.approx(to_surface * out(outside_km), rel=1e-6)
    assert far == pytest.approx(0.75 * out(700.0), rel=1e-6)


def test_the_bridge_of_willoughby_by_hand() -> None:
    """w is 126 x^5 - 420 x^6 + 540 x^7 - 315 x^8 + 70 x^9; at R = 18 km it is n L / (n L + R)."""
    track = cyclone(at=(25.0, 115.0), vmax_mps=48.0, rmw_km=18.0)
    v = 48.0 / 0.9
    n, x1 = 0.4067 + 0.0144 * v - 0.0038 * 25, 317.1 - 2.026 * v + 1.915 * 25
    a = 0.0696 + 0.0049 * v - 0.0064 * 25
    length = (1 - a) * x1 + a * 25.0

    def weight(x: float) -> float:
        return 126 * x**5 - 420 * x**6 + 540 * x**7 - 315 * x**8 + 70 * x**9

    x_at_r = brentq(lambda x: weight(x) - n * length / (n * length + 18.0), 0.0, 1.0, xtol=1e-14)
    for r in (14.0, 17.0, 20.0):
        share = weight(x_at_r + (r - 18.0) / 15.0)
        assert 0.05 < share < 0.999
        away = r - 18.0
        out = (1 - a) * math.exp(-away / x1) + a * math.exp(-away / 25.0)
        exact = 0.9 * v * ((1 - share) * (r / 18.0) ** n + share * out)
        found = along_a_ray("willoughby2006", track, np.array([1e3 * r]))[0]
        assert found == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_no_wind_without_a_storm(model: str) -> None:
    calm = cyclone(vmax_mps=0.0, pressure_hpa=1012.0)
    assert (wind(calm, 20.0, 115.2, model=model).speed_mps == 0.0).all()


def test_a_radius_of_maximum_wind_where_the_profile_is_pinned_has_its_top() -> None:
    """Holland 2010 is pinned at 300 km, which says nothing of a storm that is as wide itself."""
    wide = 300_000.0
    inside = np.array([0.4, 0.7, 1.0]) * wide
    track = cyclone(at=EQUATOR, rmw_km=wide / 1000.0)
    speed = along_a_ray("holland2010", track, inside)
    deficit, b = 70.0, -4.4e-5 * 70**2 + 0.01 * 70 + 1.0
    top = math.sqrt(b * 100.0 * deficit / (1.15 * math.e))
    q = (wide / inside) ** b
    np.testing.assert_allclose(speed, top * np.sqrt(q * np.exp(1.0 - q)), rtol=1e-4)


@pytest.mark.parametrize("wide_km", [300.0, 350.0, 480.0])
@pytest.mark.parametrize(("deficit", "vmax_mps"), [(70.0, 50.0), (9.0, 20.0)])
def test_outside_a_radius_that_wide_the_wind_falls_slowly(
    wide_km: float, deficit: float, vmax_mps: float
) -> None:
    """An exponent of 0.4, whether the top is above 17 m/s or below: 57.7 and 15.1."""
    track = cyclone(at=EQUATOR, rmw_km=wide_km, pressure_hpa=1010.0 - deficit, vmax_mps=vmax_mps)
    outside = np.array([1.02, 1.3, 2.1])
    speed = along_a_ray("holland2010", track, 1000.0 * wide_km * outside)
    b = -4.4e-5 * deficit**2 + 0.01 * deficit + 1.0
    top = math.sqrt(b * 100.0 * deficit / (1.15 * math.e))
    q = outside**-b
    np.testing.assert_allclose(speed, top * (q * np.exp(1.0 - q)) ** 0.4, rtol=1e-6)


@pytest.mark.parametrize("model", ["holland1980", "holland2008", "holland2010", "willoughby2006"])
@pytest.mark.parametrize("knots", [35.0, 65.0, 135.0, 165.0])
@pytest.mark.parametrize("lat", [20.0, -13.0])
def test_a_track_of_winds_alone_keeps_its_winds(model: str, knots: float, lat: float) -> None:
    """One-minute winds, no pressure, no radius: somewhere around the eye blows what was stated."""
    mps = knots * 0.514444
    track = cyclone(
        at=(lat, 120.0), move=(0.0, -0.17), vmax_mps=mps, pressure_hpa=None, rmw_km=None,
        penv_hpa=None,
    )  # fmt: skip
    here = float(track.lat[4]), float(track.lon[4])
    # North of a storm that moves west its motion adds to the wind, south of the equator south.
    places = around(here, np.linspace(5e3, 200e3, 4000), 0.0 if lat > 0 else 180.0)
    blown = wind(track, *places, model=model).speed_mps[:, 4].max()
    assert blown == pytest.approx(mps, rel=0.01, abs=0.3)


def test_a_stated_pressure_decides_where_it_was_stated() -> None:
    """165 kt with 894 hPa: what Holland 2008 makes of the pressure, whatever the wind."""

    def top(vmax_mps: float) -> float:
        track = cyclone(at=EQUATOR, vmax_mps=vmax_mps, pressure_hpa=894.0)
        return float(wind(track, *around(EQUATOR, R, 90.0), model="holland2008").speed_mps[0, 4])

    assert top(84.9) == top(72.0)
    # Points without a pressure keep their wind, those between them with one are of the pressure.
    pressure = np.array([940.0, np.nan] * 4 + [940.0])
    mixed = cyclone(at=EQUATOR, pressure_hpa=pressure)
    np.testing.assert_array_equal(mixed.pressure_from_wind, [0, 1, 0, 1, 0, 1, 0, 1, 0])
    speeds = wind(mixed, *around(EQUATOR, R, 90.0), model="holland2008").speed_mps[0]
    assert speeds[1] == pytest.approx(50.0, rel=1e-6)
    b = 1.0 + 0.7 - 4.4e-5 * 70**2 + 0.03 * (940.0 - mixed.pressure_hpa[3]) / 6.0
    assert speeds[4] == pytest.approx(np.sqrt(b * 7000 / (1.15 * math.e)), rel=1e-6)
    between = interpolated(mixed, mixed.time[0] + np.timedelta64(3 * 3600, "s") * np.arange(3))
    assert between.pressure_from_wind is not None
    np.testing.assert_allclose(between.pressure_from_wind, [0.0, 0.5, 1.0])


def test_members_of_an_ensemble_of_winds_keep_theirs() -> None:
    track = cyclone(vmax_mps=60.0, pressure_hpa=None, rmw_km=None)
    for member in ensemble(
        track, 3, np.random.default_rng(5), along_km_per_day=0.0, cross_km_per_day=0.0
    ):
        here = float(member.lat[6]), float(member.lon[6])
        places = around(here, np.linspace(5e3, 200e3, 2000), 90.0)
        blown = wind(member, *places, model="holland2008").speed_mps[:, 6].max()
        assert blown == pytest.approx(member.vmax_mps[6], rel=0.01)
