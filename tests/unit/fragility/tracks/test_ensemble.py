"""Forecast ensembles: the size of errors, how they grow, and what does not change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from resilience.errors import UsageError
from resilience.fragility.tracks import ensemble
from resilience.fragility.wind import wind
from tests.cyclones import SPHERE, cyclone

TRACK = cyclone(n=13, at=(20.0, 125.0), move=(0.0, -0.2), averaging_s=120.0)
ISSUED = TRACK.time[4]  # 24 h after the start; lead times up to 48 h
N = 3000


def errors(index: int, **spread: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along and across the path, km, and in wind, m/s, of every member at a point."""
    members = ensemble(TRACK, N, np.random.default_rng(5), issued=ISSUED, **spread)
    lon, lat = (np.array([getattr(m, key)[index] for m in members]) for key in ("lon", "lat"))
    start = np.full(N, TRACK.lon[index]), np.full(N, TRACK.lat[index])
    azimuth, _, distance = SPHERE.inv(*start, lon, lat)
    heading, _, _ = SPHERE.inv(  # of a chord that is centred on the point
        TRACK.lon[index - 1], TRACK.lat[index], TRACK.lon[index], TRACK.lat[index]
    )
    away = np.radians(azimuth - heading)
    wind_error = np.array([m.vmax_mps[index] for m in members]) - TRACK.vmax_mps[index]
    return distance / 1000 * np.cos(away), distance / 1000 * np.sin(away), wind_error


def test_deviations_after_a_day() -> None:
    """Of 3,000 members a standard deviation is known to 1.3 %: four of these are allowed."""
    along, cross, strength = errors(8, along_km_per_day=60.0, cross_km_per_day=30.0)
    assert along.std() == pytest.approx(60.0, rel=0.055)
    assert cross.std() == pytest.approx(30.0, rel=0.055)
    assert strength.std() == pytest.approx(5.0, rel=0.055)
    for error, deviation in ((along, 60.0), (cross, 30.0), (strength, 5.0)):
        assert abs(error.mean()) < 4 * deviation / np.sqrt(N)
    assert abs(np.corrcoef([along, cross, strength])[np.triu_indices(3, 1)]).max() < 4 / np.sqrt(N)


def test_the_mean_distance_is_that_of_the_docstring() -> None:
    """sqrt(pi / 2) * 40 = 50.1 km after one day; its own deviation is 26 km."""
    along, cross, _ = errors(8)
    assert np.hypot(along, cross).mean() == pytest.approx(50.13, abs=4 * 26.2 / np.sqrt(N))


def test_an_error_is_one_draw_that_grows() -> None:
    day, two = errors(8), errors(12)
    np.testing.assert_allclose(two[1], 2 * day[1], atol=0.5)  # the path bends against the meridians
    np.testing.assert_allclose(two[2], np.sqrt(2) * day[2], atol=1e-9)


def test_known_points_stay() -> None:
    for member in ensemble(TRACK, 5, np.random.default_rng(1), issued=ISSUED):
        for key in ("lat", "lon", "vmax_mps", "pressure_hpa", "rmw_km"):
            np.testing.assert_allclose(getattr(member, key)[:5], getattr(TRACK, key)[:5])
        assert (np.abs(member.vmax_mps[5:] - TRACK.vmax_mps[5:]) > 0).all()


def test_stronger_is_deeper_and_smaller() -> None:
    """-0.7357 hPa per one-minute knot: winds of this track are over two minutes, as CMA's."""
    track = replace(TRACK, agency="cma")
    for member in ensemble(track, 20, np.random.default_rng(2)):
        gain_kt = (member.vmax_mps - TRACK.vmax_mps) / 0.871 / 0.514444
        np.testing.assert_allclose(member.pressure_hpa, 940.0 - 0.7357 * gain_kt)
        deeper = member.pressure_hpa < 940.0 - 1e-9
        assert (member.rmw_km[deeper] < TRACK.rmw_km[deeper]).all()


def test_without_deviations_nothing_changes_and_seeds_decide() -> None:
    none: dict[str, Any] = {"along_km_per_day": 0.0, "cross_km_per_day": 0.0, "intensity_mps": 0.0}
    same = ensemble(TRACK, 1, np.random.default_rng(3), **none)[0]
    np.testing.assert_allclose(same.lat, TRACK.lat, atol=1e-9)
    a, b = (ensemble(TRACK, k, np.random.default_rng(4)) for k in (2, 7))
    assert (a[1].lat == b[1].lat).all()  # more members begin with the same ones


def test_a_storm_that_stands_still_or_turns_back() -> None:
    still = ensemble(cyclone(), 50, np.random.default_rng(0))
    assert np.ptp([m.lat[-1] for m in still]) > 0.5
    turning = cyclone(n=5, lon=[115.0, 115.5, 116.0, 115.5, 115.0])
    for member in (*still, *ensemble(turning, 50, np.random.default_rng(0))):
        assert np.isfinite(member.lat + member.lon).all()
        assert np.isfinite(wind(member, 20.0, 115.0).speed_mps).all()


def test_weak_storms_do_not_blow_backwards() -> None:
    weak = cyclone(vmax_mps=4.0, pressure_hpa=1009.0)
    members = ensemble(weak, 200, np.random.default_rng(0), intensity_mps=20.0)
    assert min(m.vmax_mps.min() for m in members) == 0.0
    assert max(m.pressure_hpa.max() for m in members) <= 1010.0


def test_ensembles_that_cannot_be() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(UsageError, match="ensemble of 0 members"):
        ensemble(TRACK, 0, rng)
    with pytest.raises(UsageError, match="along -1"):
        ensemble(TRACK, 1, rng, along_km_per_day=-1.0)
