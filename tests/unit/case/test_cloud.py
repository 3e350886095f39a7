"""PV under a storm's cloud: off by default, and as declared where it is on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case, case_text, load_case
from resilience.case.schema import CloudTable


@pytest.fixture(scope="module")
def clear() -> Case:
    return rs.load_case("ieee33_koinu")


@pytest.fixture(scope="module")
def cloudy(clear: Case) -> Case:
    assert clear.storm is not None
    cloud = CloudTable(factor=0.2, radius_km=300.0)
    return clear.replace(storm=clear.storm.model_copy(update={"cloud": cloud}))


def left(case: Case, clear: Case, k: int = 0) -> np.ndarray:
    """What the cloud leaves of a plant's output, nan by night."""
    with np.errstate(invalid="ignore"):
        found: np.ndarray = case.profile(case.pv[k].profile) / clear.profile(clear.pv[k].profile)
    return found


def test_without_the_table_nothing_is_reduced(clear: Case) -> None:
    assert clear.storm is not None
    assert clear.storm.cloud is None
    assert [plant.profile for plant in clear.pv] == ["PV7", "PV2", "PV3", "PV1", "PV8", "PV5"]


def test_the_eye_leaves_its_factor_and_the_rim_all_of_it(clear: Case, cloudy: Case) -> None:
    """From 08:00 to 11:00 the eye goes from 120.9 to 120.5 E at 21.9 N; the anchor: 120.74 E, 22 N.
    At noon of the last day it is beyond 117.4 E, more than 340 km away."""
    share = left(cloudy, clear)
    eye_lon = 120.9 - 0.4 * 67.5 / 180.0  # at 09:07:30, the middle of the slot
    north_km = 111.195 * 0.1
    east_km = 111.195 * (eye_lon - 120.74) * np.cos(np.radians(21.95))
    expected = 0.2 + 0.8 * np.hypot(north_km, east_km) / 300.0
    assert share[4 * 21] == pytest.approx(expected, rel=1e-4)
    assert share[-1] == 1.0
    assert np.nanmin(share) >= 0.2


def test_every_plant_has_the_same_sky_and_loads_have_none(clear: Case, cloudy: Case) -> None:
    one, two = left(cloudy, clear, 0), left(cloudy, clear, 3)
    both = np.isfinite(one) & np.isfinite(two)
    np.testing.assert_allclose(one[both], two[both], rtol=1e-12)
    assert [load.profile for load in cloudy.load] == [load.profile for load in clear.load]
    for load in clear.load:
        np.testing.assert_array_equal(cloudy.profile(load.profile), clear.profile(load.profile))


def test_the_cloud_is_written_once_and_never_twice(cloudy: Case, tmp_path: Path) -> None:
    path = tmp_path / "cloudy.toml"
    path.write_text(case_text(cloudy), encoding="utf-8")
    assert load_case(path).equals(cloudy)
    again = cloudy.replace(pv=list(cloudy.pv), slots=cloudy.slots - 4)
    np.testing.assert_array_equal(
        again.profile(again.pv[0].profile), cloudy.profile(cloudy.pv[0].profile)[:-4]
    )


def test_a_plan_under_cloud_is_dearer(clear: Case, cloudy: Case) -> None:
    costs = [rs.solve(case, "lp", physics="copperplate").objective for case in (clear, cloudy)]
    assert costs[1] > costs[0] + 1.0
