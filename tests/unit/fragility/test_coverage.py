"""A track that ends while it blows, or lies on other days, is told apart from a calm."""

from __future__ import annotations

from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.checks.geography import geography_findings
from resilience.case.schema import GeographyTable
from resilience.errors import CaseError, UsageError
from resilience.fragility.chain import case_track, slot_times, storm
from resilience.fragility.coverage import check_ends, check_overlap
from resilience.fragility.lines.geography import geography
from resilience.fragility.tracks import Track


@pytest.fixture(scope="module")
def koinu() -> Case:
    return rs.load_case("ieee33_koinu")


def cut(track: Track, keep: slice) -> Track:
    names = ("time", "lat", "lon", "vmax_mps", "pressure_hpa", "rmw_km", "penv_hpa")
    return replace(track, **{name: getattr(track, name)[keep] for name in names})


def test_a_track_that_ends_in_the_storm_is_no_calm(koinu: Case) -> None:
    whole = case_track(koinu)
    near = int(np.argmin(np.hypot(whole.lat - 22.0, whole.lon - 120.74)))
    with pytest.raises(UsageError, match=r"ends at d2 .* while it blows \d+ m/s at the feeder"):
        storm(koinu, cut(whole, slice(0, near + 1)))
    with pytest.raises(UsageError, match=r"begins at d2 .* while it blows"):
        storm(koinu, cut(whole, slice(near, None)))
    assert koinu.storm is not None
    errors = koinu.storm.forecast.model_copy(update={"members": 3, "cross_km_per_day": 5.0})
    forecast = koinu.replace(storm=koinu.storm.model_copy(update={"forecast": errors}))
    with pytest.raises(UsageError, match="ends at d2"):
        storm(forecast, cut(whole, slice(0, near + 1)))
    gone = cut(whole, slice(0, len(whole.time) - 3))
    assert gone.time[-1] < np.datetime64("2023-10-06T04:00")
    np.testing.assert_allclose(
        storm(koinu, gone).failed_by[:, -1], storm(koinu).failed_by[:, -1], atol=1e-3
    )


def test_a_track_may_begin_and_end_with_the_horizon_in_the_storm(koinu: Case) -> None:
    """It blows in the first two and the last two slots; a second less of a track cuts it off."""
    track, times = case_track(koinu), slot_times(koinu)
    speed = np.full((2, koinu.slots), [[3.0], [2.0]])
    speed[:, [0, 1, -2, -1]] = [[61.0], [43.0]]
    begun = replace(track, time=track.time + (times[0] - track.time[0]))
    ended = replace(track, time=track.time + (times[-1] - track.time[-1]))
    check_ends(koinu, begun, times, speed)
    check_ends(koinu, ended, times, speed)
    short = np.timedelta64(1, "s")
    with pytest.raises(UsageError, match=r"begins at d1 .* while it blows 61 m/s"):
        check_ends(koinu, replace(begun, time=begun.time + short), times, speed)
    with pytest.raises(UsageError, match=r"ends at d3 .* while it blows 61 m/s"):
        check_ends(koinu, replace(ended, time=ended.time - short), times, speed)


def test_the_day_on_which_a_storm_is_nearest_is_named(koinu: Case) -> None:
    track = case_track(koinu)
    later = replace(track, time=track.time + np.timedelta64(30, "D"))
    nearest = date(2023, 10, 5) + timedelta(days=30)
    with pytest.raises(UsageError, match="misses the horizon") as caught:
        storm(koinu, later)
    first, last = (later.time[k].astype("datetime64[m]").item() for k in (0, -1))
    assert f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} UTC, misses" in str(caught.value)
    assert f"day = {nearest}" in caught.value.hint
    assert "laid_on" in caught.value.hint


def test_a_moment_in_common_is_enough_and_times_are_utc_of_the_storm(koinu: Case) -> None:
    """The case's times are 8 h ahead of UTC."""
    track, times, place = case_track(koinu), slot_times(koinu), geography(koinu)
    ended = replace(track, time=track.time + (times[0] - track.time[-1]))
    check_overlap(koinu, ended, place, times)
    begun = replace(track, time=track.time + (times[-1] - track.time[0]))
    check_overlap(koinu, begun, place, times)
    short = np.timedelta64(1, "s")
    with pytest.raises(UsageError, match="2023-10-04 04:00 to 2023-10-06 04:00 UTC of the storm"):
        check_overlap(koinu, replace(ended, time=ended.time - short), place, times)
    with pytest.raises(UsageError, match="misses the horizon"):
        check_overlap(koinu, replace(begun, time=begun.time + short), place, times)


def test_hours_that_the_law_of_repair_cannot_have_are_listed_with_the_rest(koinu: Case) -> None:
    assert koinu.storm is not None
    table = koinu.storm.repair.model_copy(update={"law": "lognormal", "hours": (6.0, 30.0)})
    bad = koinu.storm.model_copy(update={"repair": table, "pole": "polle"})
    with pytest.raises(CaseError) as caught:
        storm(koinu.replace(storm=bad))
    found = {(one.table, one.key): one for one in caught.value.mistakes}
    assert found.keys() == {("[storm]", "pole"), ("[storm.repair]", "hours")}
    assert "uniform" in found["[storm.repair]", "hours"].hint


def test_a_slip_in_one_coordinate_is_found(koinu: Case) -> None:
    case = rs.load_case("ieee33")
    earth = storm(koinu).geography
    places = zip(earth.bus_lon_deg.tolist(), earth.bus_lat_deg.tolist(), strict=True)
    right = dict(zip(case.network.bus_names, places, strict=True))
    asked = GeographyTable(degrees=True)
    assert not list(geography_findings(asked, case.network, right, inline=False, grid_bus="1"))
    wrong = right | {"25": (right["25"][0] - 100.0, right["25"][1])}
    (found,) = geography_findings(asked, case.network, wrong, inline=False, grid_bus="1")
    assert "1 line too long for the reactance: 24-25" in found[1]
