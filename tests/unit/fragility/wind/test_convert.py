"""Kinds of wind: factors by hand, round trips, and refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from resilience.errors import UsageError
from resilience.fragility.wind import AVERAGING, Wind


def sea(speed_mps: float = 40.0) -> Wind:
    return Wind(np.full((2, 3), speed_mps), np.full((2, 3), 90.0), 60.0, 10.0, "water")


def test_by_hand() -> None:
    """Over land 0.8 of 40 m/s, in gusts of 3 s 1.49 times that; at sea 1.11 times 40."""
    land = sea().to(averaging_s=3, exposure="land")
    np.testing.assert_allclose(land.speed_mps, 40 * 0.8 * 1.49)
    assert land.kind == (3.0, 10.0, "land")
    assert land.factors == ("Harper 2010, in-land: 1.49", "knaff2011: water to land")
    np.testing.assert_allclose(sea().to(averaging_s=3).speed_mps, 44.4)
    np.testing.assert_allclose(sea().to(averaging_s=600).speed_mps, 37.2)
    ten = sea().to(averaging_s=600, exposure="land")
    np.testing.assert_allclose(ten.speed_mps, 32 / 1.21)
    # ln(20 / 0.05) / ln(10 / 0.05) = 1.1308 in open country
    tall = sea().to(exposure="land", height_m=20)
    np.testing.assert_allclose(tall.speed_mps, 32 * np.log(400) / np.log(200))
    # z0 is 0.003 m at sea
    low = sea().to(averaging_s=600, height_m=4)
    np.testing.assert_allclose(low.speed_mps, 37.2 * np.log(4 / 0.003) / np.log(10 / 0.003))


@pytest.mark.parametrize(
    ("averaging_s", "exposure", "factor"),
    [
        (3.0, "water", 1.11),  # Harper, Kepert and Ginger 2010, WMO/TD-No. 1555: at sea
        (3.0, "land", 1.49),  # in-land
        (600.0, "water", 0.93),
        (600.0, "land", 1 / 1.21),
        (0.2, "land", 1.35),  # TCRM, Geoscience Australia: from one minute to 0.2 s
    ],
)
def test_every_averaging_time_by_its_source(
    averaging_s: float, exposure: str, factor: float
) -> None:
    over_land = 0.8 if exposure == "land" else 1.0
    found = sea(37.0).to(averaging_s=averaging_s, exposure=exposure)
    np.testing.assert_allclose(found.speed_mps, 37.0 * over_land * factor)
    table = {(where, s): value for (where, s), (value, _) in AVERAGING.items() if s != 60.0}
    assert len(table) == 5
    assert table[exposure, averaging_s] == factor


def test_inland_decay() -> None:
    found = sea().to(exposure="land", roughness="tchazards", inland_km=[0.0, 0.4])
    np.testing.assert_allclose(found.speed_mps[:, 0], [40.0, 40 * (0.66 + 0.34 / math.e)])


def test_there_and_back() -> None:
    kinds = [("water", 60, 30), ("water", 600, 5), ("land", 3, 10), ("land", 0.2, 10)]
    kinds += [("land", 600, 40), ("water", 3, 10)]
    for exposure, averaging_s, height_m in kinds:
        there = sea().to(averaging_s=averaging_s, height_m=height_m, exposure=exposure)
        back = there.to(averaging_s=60, height_m=10, exposure="water")
        np.testing.assert_allclose(back.speed_mps, 40.0)
    assert sea().to().speed_mps is not None
    assert sea().to().factors == ()


def test_a_path_does_not_matter() -> None:
    straight = sea().to(averaging_s=3, exposure="land").speed_mps
    for first in ({"averaging_s": 3}, {"exposure": "land"}, {"averaging_s": 600}):
        step = sea().to(**first)
        np.testing.assert_allclose(step.to(averaging_s=3, exposure="land").speed_mps, straight)


@pytest.mark.parametrize("exposure", ["water", "land"])
def test_longer_means_are_smaller(exposure: str) -> None:
    speeds = [sea().to(averaging_s=s, exposure=exposure).speed_mps[0, 0] for s in (3, 60, 600)]
    assert speeds == sorted(speeds, reverse=True)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ({"averaging_s": 120}, "60 s and 120 s over water; allowed: 3, 60, 600 s"),
        ({"averaging_s": 0.2}, "0.2 s over water"),
        ({"averaging_s": 3, "height_m": 20}, "heights of 10 m and 20 m for 3 s"),
        ({"height_m": 500}, "allowed: 2 to 200 m"),
        ({"exposure": "forest"}, "exposure 'forest'; allowed: water, land"),
        ({"exposure": "land", "roughness": "none"}, "allowed: knaff2011, tchazards"),
        ({"exposure": "land", "roughness": "tchazards"}, "without inland_km"),
        ({"exposure": "land", "inland_km": [1, 2, 3]}, "inland_km of 3 points; allowed: 2"),
        ({"exposure": "land", "inland_km": -1}, "inland_km -1"),
    ],
)
def test_refusals(kind: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError) as caught:
        sea().to(**kind)
    assert message in str(caught.value)


def test_an_unlabelled_wind_is_not_converted() -> None:
    odd = Wind(np.ones((1, 1)), np.zeros((1, 1)), 60.0, 10.0, "city")
    with pytest.raises(UsageError, match="exposure 'city'"):
        odd.to(averaging_s=3)


def test_gust_factors_do_not_compose() -> None:
    """Table 1.1 of Harper et al. 2010: 3 s in 600 s is 1.66 in-land and 1.23 at sea."""
    for exposure, gust in (("land", 1.66), ("water", 1.23)):
        ten = sea().to(averaging_s=600, exposure=exposure)
        fast = ten.to(averaging_s=3)
        np.testing.assert_allclose(fast.speed_mps, gust * ten.speed_mps)
        np.testing.assert_allclose(fast.to(averaging_s=600).speed_mps, ten.speed_mps)
        assert "3 s in 600 s" in fast.factors[-1]
