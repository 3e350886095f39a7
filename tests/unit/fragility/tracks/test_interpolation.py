"""Tracks at other times."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from resilience.errors import UsageError
from resilience.fragility.tracks import interpolated, track_of
from resilience.fragility.wind import MODELS, wind
from tests.cyclones import cyclone


def test_a_cubic_path_is_reproduced_and_intensity_is_linear() -> None:
    hours = np.arange(0.0, 49.0, 6.0)
    path = 10.0 + 0.1 * hours - 2e-3 * hours**2 + 2e-5 * hours**3
    track = cyclone(lat=path, vmax_mps=40.0 + hours / 3)
    at = np.datetime64("2020-09-01T00") + np.arange(49)
    found = interpolated(track, at)
    t = np.arange(49.0)
    np.testing.assert_allclose(found.lat, 10.0 + 0.1 * t - 2e-3 * t**2 + 2e-5 * t**3)
    np.testing.assert_allclose(found.vmax_mps, 40.0 + t / 3)


def test_the_track_at_its_own_times_is_itself() -> None:
    track = cyclone(move=(0.05, -0.1), vmax_mps=np.linspace(30, 60, 9))
    found = interpolated(track, track.time)
    for key in ("lat", "lon", "vmax_mps", "pressure_hpa", "rmw_km"):
        np.testing.assert_allclose(getattr(found, key), getattr(track, key), atol=1e-12)


def test_longitudes_go_on_across_the_dateline() -> None:
    track = cyclone(at=(15.0, 178.0), move=(0.0, 0.1))
    assert track.lon.min() < -175.0
    found = interpolated(track, np.arange(track.time[0], track.time[-1], np.timedelta64(900, "s")))
    np.testing.assert_allclose(np.diff(found.lon), 0.025, atol=1e-9)
    assert found.lon.max() > 180.0


@pytest.mark.parametrize("model", MODELS)
def test_no_storm_outside_its_time(model: str) -> None:
    track = cyclone(n=2, move=(0.05, 0.0))
    at = np.datetime64("2020-08-31T18") + np.arange(19)
    found = interpolated(track, at)
    inside = (at >= track.time[0]) & (at <= track.time[-1])
    assert (found.present == inside).all()
    speed = wind(found, 20.0, 115.4, model=model).speed_mps[0]
    assert (speed[~inside] == 0.0).all()
    assert (speed[inside] > 10.0).all()
    alone = interpolated(track, at[inside])
    np.testing.assert_allclose(
        wind(alone, 20.0, 115.4, model=model).speed_mps[0], speed[inside], atol=1e-12
    )


def test_times_must_rise() -> None:
    track = cyclone()
    twice = ["2020-09-01T06", "2020-09-01T09", "2020-09-01T09"]
    for times in ([], ["2020-09-02", "2020-09-01"], twice, ["NaT"]):
        with pytest.raises(UsageError, match="rising times"):
            interpolated(track, times)


def test_three_points_are_enough() -> None:
    columns: dict[str, Any] = {
        "time": ["2020-09-01T00:00", "2020-09-01T06:00", "2020-09-01T12:00"],
        "lat": [20.0, 20.0, 20.0],
        "lon": [115.0, 115.6, 116.2],
        "pressure_hpa": [950.0, None, 940.0],
    }
    track = track_of(columns, averaging_s=60)
    assert interpolated(track, ["2020-09-01T03:00"]).lon[0] == pytest.approx(115.3)
    assert track.pressure_hpa[1] == 945.0
