"""What is filled in: hand-worked values, and tracks that say only one thing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resilience.earth.averaging import from_one_minute, to_one_minute
from resilience.fragility.tracks import AGENCIES, RADII, one_minute
from resilience.fragility.wind import MODELS, wind
from tests.cyclones import cyclone

KNOT = 0.514444


def test_pressure_missing_throughout() -> None:
    """100 kt at 20 N 115 E: 1026.3401 - 1.1008 - 4.0664 - 73.57 = 947.6029 hPa."""
    track = cyclone(vmax_mps=100 * KNOT, pressure_hpa=None, rmw_km=None, penv_hpa=None)
    np.testing.assert_allclose(track.pressure_hpa, 947.6029)
    assert track.filled == {
        "penv_hpa": "9 of 9: 1010 hPa, default",
        "pressure_hpa": "9 of 9: regression on the wind",
        "rmw_km": "9 of 9: regression ibtracs",
    }
    for model in MODELS:
        speed = wind(track, [20.0, 20.0], [115.3, 116.0], model=model).speed_mps
        assert np.isfinite(speed).all()
        assert (speed > 20.0).all()


def test_wind_missing_throughout() -> None:
    """950 hPa at 20 N 115 E: 1216.5223 - 0.8172 - 4.8185 - 1120.715 = 90.1716 kt."""
    track = cyclone(vmax_mps=None, pressure_hpa=950.0)
    np.testing.assert_allclose(track.vmax_mps, 90.1716 * KNOT)
    ten = cyclone(vmax_mps=None, pressure_hpa=950.0, averaging_s=600.0)
    np.testing.assert_allclose(ten.vmax_mps, 0.93 * 90.1716 * KNOT)


def test_the_radius_by_ibtracs() -> None:
    """Halfway between 940 and 980 hPa: halfway between 15.727 and 25.742 nautical miles."""
    track = cyclone(pressure_hpa=960.0, rmw_km=None)
    np.testing.assert_allclose(track.rmw_km, 1.852 * (15.727 + 25.742) / 2)


@pytest.mark.parametrize(
    ("name", "radius"),
    [
        ("vickery2008", np.exp(3.015 - 6.291e-5 * 2500 + 0.0337 * 20)),
        ("powell2005", np.exp(3.543 - 0.189 + 0.813 * np.exp(-5.5) + 0.628)),
        ("willoughby2004", 51.6 * np.exp(-1.115 + 0.562)),
    ],
)
def test_other_radii(name: str, radius: float) -> None:
    """50 hPa of deficit, 50 m/s, 20 degrees either side of the equator."""
    rest = {"dp_hpa": np.array([50.0]), "v_mps": np.array([50.0]), "pressure_hpa": np.array([1.0])}
    for lat in (20.0, -20.0):
        assert RADII[name](lat=np.array([lat]), **rest) == pytest.approx(radius)


def test_environment_by_basin() -> None:
    for basin, value in (("WP", 1005.0), ("SP", 1004.0), ("NA", 1010.0), ("", 1010.0)):
        track = cyclone(penv_hpa=None)
        found = _again(track, basin=basin)
        np.testing.assert_allclose(found.penv_hpa, value)
    np.testing.assert_allclose(_again(cyclone(), basin="WP", penv_hpa=1008.0).penv_hpa, 1008.0)


def _again(track, **about):
    from resilience.fragility.tracks import track_of

    keys = ("time", "lat", "lon", "pressure_hpa", "vmax_mps")
    return track_of({key: getattr(track, key) for key in keys}, averaging_s=60, **about)


def test_averaging_times_of_agencies() -> None:
    """CMA's 72 m/s are 82.66 over one minute, JMA's 85 kt are 102.8 kt."""
    nameless = cyclone(vmax_mps=72.0, pressure_hpa=888.0, averaging_s=120.0)
    two = replace(nameless, agency="cma")
    np.testing.assert_allclose(one_minute(two).vmax_mps, 72.0 / 0.871)
    tokyo = to_one_minute(np.array([85.0 * KNOT]), AGENCIES["tokyo"])
    np.testing.assert_allclose(tokyo / KNOT, (85.0 - 23.3) / 0.6)
    usual = cyclone(vmax_mps=47.0, averaging_s=60.0)
    assert one_minute(usual) is usual
    assert one_minute(one_minute(two)).averaging_s == 60.0


@pytest.mark.parametrize("name", AGENCIES)
def test_conversions_undo_each_other(name: str) -> None:
    v = np.array([0.0, 20.0, 50.0, 80.0])
    there = from_one_minute(v, AGENCIES[name])
    np.testing.assert_allclose(to_one_minute(there, AGENCIES[name]), v)
    assert (np.diff(there) > 0).all()
