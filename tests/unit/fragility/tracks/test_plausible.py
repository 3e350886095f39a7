"""Winds and legs that no storm has: what is found, and which real storms must not be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.earth.averaging import AGENCIES, KNOT_MPS, NAMELESS, to_one_minute
from resilience.earth.plausible import leaps, too_strong, usual_wind_kt
from resilience.errors import CaseError
from resilience.fragility.tracks import Track, read_track, track_of
from tests.best_tracks import BEST_TRACKS, BestTrack
from tests.shared import shared

REAL = [
    ("rammasun_2014_cma.csv", "cma"),
    ("harvey_2017_hurdat2.csv", "usa"),
    ("koinu_2023_ibtracs.csv", "cma"),
]
STORMS = {
    "usual, one minute": (60.0, [(955, 91), (940, 108), (925, 125)]),
    "weak": (60.0, [(1004, 40), (1000, 50), (997, 50)]),
    "weak and small": (60.0, [(1000, 55), (995, 60), (998, 55)]),
    "small and intense": (60.0, [(985, 80), (990, 70), (960, 118)]),
    "most intense known": (60.0, [(872, 185), (880, 185), (892, 160)]),
    "intense, ten minutes": (600.0, [(910, 110), (900, 115), (890, 125)]),
    "two minutes": (120.0, [(888, 140), (910, 117), (935, 101)]),
    "large and weak for its pressure": (60.0, [(945, 70), (950, 70), (960, 65)]),
}


def columns(intensity: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Pressures and knots."""
    n = len(intensity)
    return {
        "time": np.datetime64("2020-09-01T00:00") + 360 * np.arange(n),
        "lat": np.full(n, 20.0),
        "lon": 130.0 - np.arange(n),
        "pressure_hpa": [pressure for pressure, _ in intensity],
        "vmax_kt": [knots for _, knots in intensity],
    }


@pytest.mark.parametrize("name", STORMS)
def test_plausible_storms_pass(name: str) -> None:
    averaging_s, intensity = STORMS[name]
    track = track_of(columns(intensity), averaging_s=averaging_s)
    assert track.vmax_mps[0] == pytest.approx(intensity[0][1] * KNOT_MPS)


@pytest.mark.parametrize("name", [name for name in STORMS if not name.startswith("large")])
def test_their_knots_taken_for_metres_per_second_do_not(name: str) -> None:
    averaging_s, intensity = STORMS[name]
    given = columns(intensity)
    given["vmax_mps"] = given.pop("vmax_kt")
    with pytest.raises(CaseError) as caught:
        track_of(given, averaging_s=averaging_s)
    assert {problem.key for problem in caught.value.mistakes} == {"vmax_mps"}
    if max(knots for _, knots in intensity) <= 110:
        (found,) = caught.value.mistakes
        assert found.table == "track"
        assert "m/s at" in found.value
        assert "vmax_kt" in found.hint


def has_plausible_winds(track: Track, agency: str) -> None:
    """The figures of the docstring: at most 0.86 of the limit, median 0.75; in knots 1.04."""
    places = track.lat, track.lon, track.pressure_hpa
    assert too_strong(*places, track.vmax_mps, AGENCIES[agency]) is None
    odd = too_strong(*places, track.vmax_mps / KNOT_MPS, AGENCIES[agency])
    assert odd is not None
    assert odd.usual_mps < odd.limit_mps < odd.wind_mps
    wind = to_one_minute(track.vmax_mps, AGENCIES[agency]) / KNOT_MPS
    stormy = (wind > 34.0) & (track.pressure_hpa <= 1000.0)
    share = (wind / (1.4 * usual_wind_kt(*places) + 15.0))[stormy]
    assert np.median(share) < 0.75
    assert share.max() < 0.87


@pytest.mark.parametrize("best", BEST_TRACKS, ids=lambda best: best.name)
def test_rows_of_real_tracks_pass_and_their_knots_do_not(best: BestTrack) -> None:
    has_plausible_winds(best.track(), best.agency)


@pytest.mark.parametrize(("file", "agency"), REAL)
def test_real_tracks_pass_and_their_knots_do_not(file: str, agency: str) -> None:
    path = shared("data", "tracks", file)
    has_plausible_winds(read_track(path, averaging_s=AGENCIES[agency].averaging_s), agency)


@pytest.mark.parametrize(("file", "agency"), REAL)
def test_a_real_file_with_knots_under_metres_per_second(
    file: str, agency: str, tmp_path: Path
) -> None:
    """Knots of at most 110, so that the range of winds does not find them first."""
    lines = shared("data", "tracks", file).read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if not line.startswith("#")]
    wind = rows[0].index("max_sustained_wind_ms")
    for row in rows[1:]:
        row[wind] = str(min(round(float(row[wind]) / KNOT_MPS), 110))
    text = "\n".join(",".join(row) for row in rows)
    (tmp_path / "slip.csv").write_text(text, encoding="utf-8")
    (tmp_path / "right.csv").write_text(text.replace("wind_ms", "wind_kt"), encoding="utf-8")
    averaging_s = AGENCIES[agency].averaging_s
    assert read_track(tmp_path / "right.csv", averaging_s=averaging_s).vmax_mps.max() < 57.0
    with pytest.raises(CaseError) as caught:
        read_track(tmp_path / "slip.csv", averaging_s=averaging_s)
    assert [(p.table, p.key) for p in caught.value.mistakes] == [("track", "vmax_mps")]


def test_a_column_in_knots_is_suspected_where_it_does_not_fit() -> None:
    kmh = columns([(955, 91 * 1.852), (940, 108 * 1.852), (925, 110 * 1.852)])
    with pytest.raises(CaseError, match="`vmax_kmh`"):
        track_of(kmh, averaging_s=60)


def test_one_odd_wind_is_left_alone() -> None:
    track = track_of(columns([(955, 91), (1000, 95), (925, 125)]), averaging_s=60)
    assert track.vmax_mps[1] == pytest.approx(95 * KNOT_MPS)


def test_winds_are_compared_over_one_minute() -> None:
    """165 kt at 930 hPa and 20 N 120 E: 1.4 * 113.60 + 15 = 174.0 kt; 187.5 kt over one minute."""
    one = (np.array([20.0]), np.array([120.0]), np.array([930.0]), np.array([165.0 * KNOT_MPS]))
    assert too_strong(*one, NAMELESS[60.0]) is None
    odd = too_strong(*one, NAMELESS[600.0])
    assert odd is not None
    assert odd.limit_mps == pytest.approx(174.03 * KNOT_MPS * 0.88, rel=1e-3)
    assert odd.usual_mps == pytest.approx(113.60 * KNOT_MPS * 0.88, rel=1e-3)
    east = one[0], one[1] - 360.0, *one[2:]
    assert too_strong(*east, NAMELESS[600.0]) == odd


def test_nothing_is_found_where_nothing_is_known() -> None:
    nan = np.array([np.nan, np.nan])
    place = np.array([20.0, 20.0])
    assert too_strong(place, place, nan, np.array([90.0, 90.0]), NAMELESS[60.0]) is None
    assert too_strong(nan, place, place + 900.0, place + 70.0, NAMELESS[60.0]) is None
    assert leaps(nan, place, place + np.array([0.0, 90.0])) == []
    assert leaps(np.array([0.0, 1.0]), place, nan) == []


def test_a_leap_is_longer_than_200_km_an_hour() -> None:
    """A degree of the equator is 111.19 km."""
    hours, lat = np.array([0.0, 1.0, 2.0, 1.5]), np.zeros(4)
    (leap,) = leaps(hours, lat, np.array([0.0, 1.79, 3.59, 90.0]))
    assert (leap.point, leap.hours) == (2, 1.0)
    assert leap.km == pytest.approx(200.15, abs=0.01)
    assert leaps(hours[:2], lat[:2], np.array([179.5, -179.5])) == []
