"""Wind at points: hemispheres, dateline, motion, inflow, and storms that never come near."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resilience.errors import UsageError
from resilience.fragility.tracks import Track
from resilience.fragility.wind import ASYMMETRIES, INFLOWS, MODELS, wind
from resilience.fragility.wind.wind import BLOCK
from tests.cyclones import around, cyclone

R = 40_000.0
MOVING: dict[str, Any] = {"at": (15.0, 120.0), "move": (0.08, -0.12)}


def mirrored(track: Track) -> Track:
    return replace(track, lat=-track.lat)


@settings(max_examples=60, deadline=None)
@given(
    lat=st.floats(-60.0, 60.0),
    lon=st.floats(-180.0, 180.0),
    model=st.sampled_from(sorted(MODELS)),
    asymmetry=st.sampled_from([None, *ASYMMETRIES]),
    inflow=st.sampled_from([None, *INFLOWS]),
)
def test_the_southern_hemisphere_is_a_mirror(
    lat: float, lon: float, model: str, asymmetry: str | None, inflow: str | None
) -> None:
    track = cyclone(at=(20.0, 115.0), move=(0.05, -0.1), pressure_hpa=945.0)
    north = wind(track, lat, lon, model=model, asymmetry=asymmetry, inflow=inflow)
    south = wind(mirrored(track), -lat, lon, model=model, asymmetry=asymmetry, inflow=inflow)
    np.testing.assert_allclose(south.speed_mps, north.speed_mps, atol=1e-9)
    blows = north.speed_mps > 1e-6
    turned = np.radians(south.direction_deg - (180.0 - north.direction_deg))[blows]
    np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    start=st.tuples(st.floats(-80.0, 80.0), st.floats(-180.0, 180.0)),
    point=st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 360.0)),
    vmax=st.floats(0.0, 110.0),
    pressure=st.floats(860.0, 1020.0),
    radius=st.floats(5.0, 400.0),
    model=st.sampled_from(sorted(MODELS)),
)
def test_wind_is_a_number_whatever_the_storm(
    start: tuple[float, float],
    point: tuple[float, float],
    vmax: float,
    pressure: float,
    radius: float,
    model: str,
) -> None:
    still = cyclone(at=start, move=(0.1, 0.2), vmax_mps=None, pressure_hpa=pressure, rmw_km=radius)
    track = replace(still, vmax_mps=np.full(9, vmax))
    found = wind(track, *point, model=model, inflow="phadke2003")
    assert np.isfinite(found.speed_mps).all()
    assert (found.speed_mps >= 0.0).all()
    assert ((found.direction_deg >= 0.0) & (found.direction_deg <= 360.0)).all()
    assert found.speed_mps.max() < 200.0


@pytest.mark.parametrize("model", MODELS)
def test_the_dateline_is_no_place(model: str) -> None:
    points = np.array([15.5, 16.0, 15.2]), np.array([-0.5, 0.3, 1.2])
    here = cyclone(at=(15.0, 120.0), move=(0.02, 0.1))
    there = cyclone(at=(15.0, 179.0), move=(0.02, 0.1))
    a = wind(here, points[0], points[1] + 121.0, model=model)
    b = wind(there, points[0], (points[1] + 360.0) % 360.0 - 180.0, model=model)
    assert np.ptp(there.lon) > 300.0
    np.testing.assert_allclose(b.speed_mps, a.speed_mps, atol=1e-8)
    np.testing.assert_allclose(b.direction_deg, a.direction_deg, atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_a_stationary_storm_is_round(model: str) -> None:
    """Seen from the eye the wind is at a right angle to the left of the bearing."""
    azimuth = np.arange(0.0, 360.0, 15.0)
    lat, lon = around((20.0, 115.0), 60_000.0, azimuth)
    found = wind(cyclone(), lat, lon, model=model)
    assert np.ptp(found.speed_mps) < 1e-6
    turned = found.direction_deg[:, 0] - (azimuth - 90.0)
    np.testing.assert_allclose(np.cos(np.radians(turned)), 1.0, atol=1e-12)


def test_directions_go_round_once() -> None:
    """North of east of the eye it blows a little to the west of north, south of it to the east."""
    azimuth = np.array([89.4, 90.6])
    lat, lon = around((20.0, 115.0), 60_000.0, azimuth)
    found = wind(cyclone(), lat, lon, model="holland1980").direction_deg[:, 2]
    np.testing.assert_allclose(found, [359.4, 0.6], atol=1e-9)


def test_motion_adds_on_the_right_and_takes_away_on_the_left() -> None:
    """Northwards at 6 m/s: 50 m/s on the right at R, which contains the motion, 38 on the left."""
    speed = 6.0
    track = cyclone(at=(0.0, 115.0), move=(np.degrees(speed * 3600 / 6_371_000.0), 0.0), n=2)
    lat, lon = around((float(track.lat[1]), 115.0), R, np.array([90.0, 270.0]))
    found = wind(track, lat, lon, model="holland1980").speed_mps[:, 1]
    f_loss = R * 7.29e-5 * np.sin(np.radians(track.lat[1]))
    np.testing.assert_allclose(found, [50.0, 50.0 - 2 * speed], atol=f_loss)
    half = wind(track, lat, lon, model="willoughby2006").speed_mps[:, 1]
    np.testing.assert_allclose(half, [50.0, 50.0 - speed], atol=1e-6)
    still = wind(track, lat, lon, model="willoughby2006", asymmetry="none").speed_mps[:, 1]
    np.testing.assert_allclose(still, 50.0, atol=1e-6)


@pytest.mark.parametrize(
    ("asymmetry", "ratio", "share"),
    [
        ("climada", 2.0, 1.0),
        ("climada", 1.25, 1.0),
        ("climada", 0.625, 0.625),
        ("phadke2003", 2.0, 0.4),
        ("phadke2003", 0.5, 0.4),
        ("none", 2.0, 0.0),
    ],
)
def test_the_share_of_the_translation(asymmetry: str, ratio: float, share: float) -> None:
    """Of 8 m/s, at R / ratio: the right is twice the share faster than the left."""
    speed = 8.0
    degrees = np.degrees(speed * 3600 / 6_371_000.0)
    track = cyclone(at=(12.0, 115.0), move=(degrees, 0.0), n=3, step_h=2.0)
    lat, lon = around((float(track.lat[2]), 115.0), R / ratio, np.array([90.0, 270.0]))
    found = wind(track, lat, lon, model="emanuel2011", asymmetry=asymmetry).speed_mps[:, 2]
    assert found[0] - found[1] == pytest.approx(2 * share * speed, abs=1e-3)


def test_motion_is_capped_at_thirty_knots() -> None:
    track = cyclone(at=(0.0, 115.0), move=(0.9, 0.0), n=2, step_h=1.0)  # 27.8 m/s
    lat, lon = around((float(track.lat[1]), 115.0), R, np.array([90.0, 270.0]))
    right, left = wind(track, lat, lon, model="willoughby2006").speed_mps[:, 1]
    assert right - left == pytest.approx(30.0 * 0.514444, abs=1e-6)


@pytest.mark.parametrize(
    ("inflow", "ratio", "angle"),
    [
        ("phadke2003", 0.5, 15.0),
        ("phadke2003", 1.0, 20.0),
        ("phadke2003", 1.1, 22.5),
        ("phadke2003", 1.2, 25.0),
        ("phadke2003", 4.0, 25.0),
        ("phadke2003-land", 1.0, 40.0),
        ("hubbert1991", 0.3, 25.0),
    ],
)
def test_inflow_turns_towards_the_eye(inflow: str, ratio: float, angle: float) -> None:
    """South of the eye the tangential wind blows east; turned left by the angle, to the eye."""
    lat, lon = around((20.0, 115.0), ratio * R, 180.0)
    found = wind(cyclone(), lat, lon, inflow=inflow)
    np.testing.assert_allclose(found.direction_deg, 90.0 - angle, atol=1e-6)
    plain = wind(cyclone(), lat, lon)
    np.testing.assert_allclose(found.speed_mps, plain.speed_mps)


@pytest.mark.parametrize("model", MODELS)
def test_a_storm_that_never_comes_near(model: str) -> None:
    far = wind(cyclone(**MOVING), [52.0, -40.0, 90.0], [5.0, -70.0, 0.0], model=model)
    assert np.isfinite(far.speed_mps).all()
    assert far.speed_mps.max() < 1.0
    assert (wind(cyclone(**MOVING), 52.0, 5.0, model=model, cutoff_km=300).speed_mps == 0).all()


def test_many_points_are_as_few() -> None:
    """More than are worked on together: points and times beyond `BLOCK`."""
    track = cyclone(**MOVING)
    lat = np.linspace(14.0, 19.0, 2 * BLOCK // len(track.time) + 7)
    found = wind(track, lat, 131.0 - lat, inflow="hubbert1991")
    some = np.array([0, 5, 2221, 2222, 2223, len(lat) - 1])
    few = wind(track, lat[some], 131.0 - lat[some], inflow="hubbert1991")
    np.testing.assert_array_equal(found.speed_mps[some], few.speed_mps)
    np.testing.assert_array_equal(found.direction_deg[some], few.direction_deg)
    assert np.isfinite(found.speed_mps).all()
    assert (np.abs(np.diff(found.speed_mps, axis=0)) < 1.0).all()


def test_limits_are_off_unless_asked_for() -> None:
    track = cyclone()
    lat, lon = around((20.0, 115.0), np.array([50e3, 299e3, 301e3]), 45.0)
    free = wind(track, lat, lon).speed_mps[:, 0]
    assert (free > 5.0).all()
    near = wind(track, lat, lon, cutoff_km=300.0).speed_mps[:, 0]
    np.testing.assert_allclose(near, [free[0], free[1], 0.0])
    strong = wind(track, lat, lon, threshold_mps=17.5).speed_mps[:, 0]
    np.testing.assert_allclose(strong, np.where(free >= 17.5, free, 0.0))


def test_wind_says_what_it_is() -> None:
    found = wind(cyclone(averaging_s=600.0), [20.0, 21.0], [115.0, 116.0], model="emanuel2011")
    assert (found.averaging_s, found.height_m, found.exposure) == (60.0, 10.0, "water")
    assert found.speed_mps.shape == found.direction_deg.shape == (2, 9)
    one = wind(cyclone(), [20.0, 21.0], [115.0, 116.0], model="emanuel2011")
    spin = 7.29e-5 * np.sin(np.radians(20.0)) * R  # the Coriolis part, f R / 2, is not scaled
    exact = (50.0 / 0.93 + spin) / (50.0 + spin)
    assert found.speed_mps[1, 0] / one.speed_mps[1, 0] == pytest.approx(exact)


def test_every_mistake_of_a_call() -> None:
    with pytest.raises(UsageError) as caught:
        wind(cyclone(), [20.0, 115.0], [115.0, 500.0])
    assert "point 1: latitude 115" in str(caught.value)
    assert "point 1: longitude 500" in str(caught.value)
    with pytest.raises(UsageError, match=r"shape \(2,\), longitudes of \(1,\)"):
        wind(cyclone(), [20.0, 21.0], [115.0])
    with pytest.raises(UsageError) as caught:
        wind(cyclone(), 20.0, 115.0, model="holland", asymmetry="some", inflow="none")
    for word in ("model 'holland'; allowed: holland1980", "asymmetry 'some'", "inflow 'none'"):
        assert word in str(caught.value)


@pytest.mark.parametrize("model", MODELS)
def test_the_eye_and_its_antipode_are_points_too(model: str) -> None:
    found = wind(cyclone(**MOVING), [15.0, -15.0], [120.0, -60.0], model=model)
    assert np.isfinite(found.speed_mps + found.direction_deg).all()
