"""Typhoon Rammasun 2014 against winds that CLIMADA 6.1.0 computed from the same track."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from resilience.fragility.tracks import Track, interpolated, read_track, track_of
from resilience.fragility.wind import wind
from tests.best_tracks import RAMMASUN
from tests.shared import shared

MODELS = {
    "H1980": "holland1980",
    "H08": "holland2008",
    "H10": "holland2010",
    "ER11": "emanuel2011",
}


def reference() -> pd.DataFrame:
    return pd.read_csv(shared("data", "tracks", "rammasun_2014_reference_vmax.csv"))


def given_track() -> Track:
    """The interpolated track behind the reference winds, its wind taken as tabulated."""
    table = pd.read_csv(shared("data", "tracks", "rammasun_2014_climada_interp15min.csv"))
    table = table.rename(columns={"pc": "pressure_hpa", "vm": "vmax_mps", "penv": "penv_hpa"})
    return track_of({str(key): table[key].tolist() for key in table}, averaging_s=60.0)


def raw_track() -> Track:
    path = shared("data", "tracks", "rammasun_2014_cma.csv")
    return read_track(path, format="cma", penv_hpa=1010.0)


POINTS = ((20.04, 110.32), (19.54, 110.80), (20.33, 110.17), (21.27, 110.36), (21.48, 109.12))
CLIMADA_MAXIMA = {
    "H1980": ((54.393, "10:00"), (48.965, "07:00"), (55.985, "11:00"), (37.902, "14:45"),
              (49.449, "20:00")),
    "H08": ((65.302, "10:15"), (53.448, "07:15"), (67.785, "11:00"), (38.177, "15:00"),
            (58.327, "19:45")),
    "H10": ((66.130, "10:00"), (54.825, "07:15"), (68.585, "11:00"), (40.624, "15:00"),
            (59.045, "19:45")),
    "ER11": ((60.543, "10:00"), (51.295, "07:00"), (62.300, "11:00"), (34.616, "15:15"),
             (57.279, "19:45")),
}  # fmt: skip
"""m/s of CLIMADA 6.1.0 (`TropCyclone.from_tracks`, metrics of each model) from the track below at
Haikou, Wenchang, Xuwen, Zhanjiang and Beihai, and the time of 18 July 2014."""
CLIMADA_AT_HAIKOU = {
    "H1980": (("04:00", -10.239, -28.505), ("07:00", -4.602, -42.099), ("10:00", 20.129, -50.531),
              ("12:00", 49.729, 6.215), ("16:00", 24.629, 22.468)),
    "H08": (("04:15", -10.023, -29.506), ("07:15", -3.874, -45.264), ("10:15", 30.848, -57.557),
            ("12:15", 61.236, 14.970), ("16:15", 22.675, 21.049)),
}  # fmt: skip
"""Likewise m/s eastwards and northwards."""


def short_track() -> Track:
    """The best track about the landfall, every 15 minutes, its wind taken as tabulated."""
    track = RAMMASUN.track(averaging_s=60.0, penv_hpa=1010.0)
    step = np.timedelta64(15, "m")
    times = np.arange(np.datetime64("2014-07-17T12:00"), np.datetime64("2014-07-19T12:00"), step)
    return interpolated(track, times.astype("datetime64[s]"))


@pytest.mark.parametrize("name", MODELS)
def test_maxima_of_climada_from_rows_of_the_best_track(name: str) -> None:
    """Measured 0.12 m/s at most: the radius is interpolated here, and regressed again there."""
    track = short_track()
    lat, lon = np.array(POINTS).T
    found = wind(track, lat, lon, model=MODELS[name]).speed_mps
    exact, times = map(np.array, zip(*CLIMADA_MAXIMA[name], strict=True))
    np.testing.assert_allclose(found.max(axis=1), exact, atol=0.2)
    when = np.array([f"2014-07-18T{time}" for time in times], "datetime64[s]")
    assert (abs(track.time[found.argmax(axis=1)] - when) <= np.timedelta64(15, "m")).all()


@pytest.mark.parametrize("name", CLIMADA_AT_HAIKOU)
def test_directions_of_climada_from_rows_of_the_best_track(name: str) -> None:
    track = short_track()
    found = wind(track, *POINTS[0], model=MODELS[name])
    times, east, north = map(np.array, zip(*CLIMADA_AT_HAIKOU[name], strict=True))
    stamps = np.array([f"2014-07-18T{time}" for time in times], "datetime64[s]")
    at = np.searchsorted(track.time, stamps)
    towards, speed = np.radians(found.direction_deg[0, at]), found.speed_mps[0, at]
    np.testing.assert_allclose(speed * np.sin(towards), east, atol=0.25)
    np.testing.assert_allclose(speed * np.cos(towards), north, atol=0.25)


@pytest.mark.parametrize("name", MODELS)
def test_every_maximum_on_the_given_track(name: str) -> None:
    table = reference()
    table = table[table.model == name]
    assert len(table) == 6
    found = wind(given_track(), table.lat, table.lon, model=MODELS[name])
    np.testing.assert_allclose(found.speed_mps.max(axis=1), table.vmax_ms, atol=0.05)
    when = given_track().time[found.speed_mps.argmax(axis=1)]
    assert (when == table.time_of_max.to_numpy("datetime64[s]")).all()


def test_every_component_over_time() -> None:
    """Haikou, hour by hour: east and north, so that the direction is tested too."""
    table = pd.read_csv(shared("data", "tracks", "rammasun_2014_reference_series.csv"))
    track = given_track()
    assert set(table.model) == {"H1980", "H08"}
    for name, rows in table.groupby("model"):
        found = wind(track, 20.04, 110.32, model=MODELS[str(name)])
        at = np.searchsorted(track.time, rows.time.to_numpy("datetime64[s]"))
        towards = np.radians(found.direction_deg[0, at])
        speed = found.speed_mps[0, at]
        np.testing.assert_allclose(speed * np.sin(towards), rows.u, atol=0.05)
        np.testing.assert_allclose(speed * np.cos(towards), rows.v, atol=0.05)


@pytest.mark.parametrize("name", MODELS)
def test_every_maximum_from_the_raw_track(name: str) -> None:
    """Measured 0.12 m/s at most: the radius is interpolated here, and regressed again there."""
    track = replace(raw_track(), averaging_s=60.0, agency="usa")
    track = interpolated(track, given_track().time)
    table = reference()
    table = table[table.model == name]
    found = wind(track, table.lat, table.lon, model=MODELS[name]).speed_mps.max(axis=1)
    np.testing.assert_allclose(found, table.vmax_ms, atol=1.5)
    np.testing.assert_allclose(found, table.vmax_ms, atol=0.2)


def test_the_spline_is_that_of_the_reference() -> None:
    given = given_track()
    found = interpolated(raw_track(), given.time)
    np.testing.assert_allclose(found.lat, given.lat, atol=1e-5)  # five decimals are given
    np.testing.assert_allclose(found.lon, given.lon, atol=1e-5)
    np.testing.assert_allclose(found.pressure_hpa, given.pressure_hpa, atol=1e-5)


def test_two_minute_means_raise_the_wind() -> None:
    """72 m/s over 2 minutes are 82.7 over one; Holland 2008 takes the pressure alone."""
    two, one = raw_track(), replace(raw_track(), averaging_s=60.0, agency="usa")
    for model, same in (("holland2008", True), ("emanuel2011", False)):
        a, b = (wind(track, 20.04, 110.32, model=model).speed_mps.max() for track in (two, one))
        assert np.isclose(a, b) == same
        assert a >= b
