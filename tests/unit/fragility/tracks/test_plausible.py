"""Winds and legs that no storm has: what is found, and which real storms must not be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.earth.averaging import AGENCIES, KNOT_MPS, NAMELESS, to_one_minute
from resilience.earth.plausible import leaps, odd_winds, usual_wind_kt
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
    assert odd_winds(*places, track.vmax_mps, AGENCIES[agency]) is None
    odd = odd_winds(*places, track.vmax_mps / KNOT_MPS, AGENCIES[agency])
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
    """165 kt at 930 hPa and 20 N 120 E: 1.4 * 113.60 + 15 = 174.0 kt; 177.4 kt over one minute."""
    one = (np.array([20.0]), np.array([120.0]), np.array([930.0]), np.array([165.0 * KNOT_MPS]))
    assert odd_winds(*one, NAMELESS[60.0]) is None
    odd = odd_winds(*one, NAMELESS[600.0])
    assert odd is not None
    assert odd.limit_mps == pytest.approx(174.03 * KNOT_MPS * 0.93, rel=1e-3)
    assert odd.usual_mps == pytest.approx(113.60 * KNOT_MPS * 0.93, rel=1e-3)
    east = one[0], one[1] - 360.0, *one[2:]
    assert odd_winds(*east, NAMELESS[600.0]) == odd


def test_nothing_is_found_where_nothing_is_known() -> None:
    nan = np.array([np.nan, np.nan])
    place = np.array([20.0, 20.0])
    assert odd_winds(place, place, nan, np.array([90.0, 90.0]), NAMELESS[60.0]) is None
    assert odd_winds(nan, place, place + 900.0, place + 70.0, NAMELESS[60.0]) is None
    assert leaps(nan, place, place + np.array([0.0, 90.0])) == []
    assert leaps(np.array([0.0, 1.0]), place, nan) == []


def test_a_leap_is_longer_than_200_km_an_hour() -> None:
    """A degree of the equator is 111.19 km."""
    hours, lat = np.array([0.0, 1.0, 2.0, 1.5]), np.zeros(4)
    (leap,) = leaps(hours, lat, np.array([0.0, 1.79, 3.59, 90.0]))
    assert (leap.point, leap.hours) == (2, 1.0)
    assert leap.km == pytest.approx(200.15, abs=0.01)
    assert leaps(hours[:2], lat[:2], np.array([179.5, -179.5])) == []


# HURDAT2, AL121988 from 24 November 18:00 and AL141972, points with a pressure: the weakest winds
# for their pressures of all storms with ten points at 985 hPa or less, and of all.
KEITH = (
    (34.0, -66.0, 55, 985), (36.0, -60.0, 50, 982), (39.0, -54.0, 50, 976), (40.0, -49.0, 50, 964),
    (44.0, -45.0, 55, 960), (48.0, -43.0, 65, 950), (52.0, -42.0, 65, 945), (52.5, -44.0, 65, 945),
    (52.0, -46.0, 65, 950),
)  # fmt: skip
CHARLIE = ((46.0, -40.0, 60, 992), (52.0, -36.0, 60, 944))


@pytest.mark.parametrize("rows", [KEITH, CHARLIE], ids=["Keith", "Charlie"])
def test_the_weakest_storms_for_their_pressures_pass(
    rows: tuple[tuple[float, float, float, float], ...],
) -> None:
    lat, lon, knots, pressure = zip(*rows, strict=True)
    times = np.datetime64("1988-11-24T18:00") + 720 * np.arange(len(rows))
    rest: dict[str, Any] = {"vmax_kt": knots, "pressure_hpa": pressure}
    places: dict[str, Any] = {"time": times, "lat": lat, "lon": lon}
    track = track_of(places | rest, averaging_s=60)
    np.testing.assert_allclose(track.vmax_mps, KNOT_MPS * np.array(knots))


@pytest.mark.parametrize("unit", ["mps", "kmh"])
def test_a_wind_in_a_column_of_a_smaller_unit_is_too_weak(unit: str) -> None:
    """Rammasun's m/s as knots, and its knots as km/h: 0.51 and 0.54 of what they are."""
    rows = [(930, 50.0), (900, 65.0), (888, 72.0), (910, 60.0), (945, 48.0), (998, 10.0)]
    slip = columns(rows)
    if unit == "kmh":
        slip["vmax_kmh"] = [knots / KNOT_MPS for knots in slip.pop("vmax_kt")]
    with pytest.raises(CaseError) as caught:
        track_of(slip, averaging_s=60)
    (found,) = caught.value.mistakes
    assert (found.table, found.key) == ("track", "vmax_mps")
    assert "or more there" in found.allowed
    assert "leave out winds that are unknown" in found.hint
    right = columns(rows)
    right["vmax_mps"] = right.pop("vmax_kt")
    assert track_of(right, averaging_s=120, agency="cma").vmax_mps.max() == 72.0


def test_a_calm_that_stands_for_a_gap_is_too_weak() -> None:
    calm = columns([(950, 0), (930, 0), (970, 0), (998, 0)])
    with pytest.raises(CaseError, match=r"0 m/s at 950 hPa in row 1, and most points alike"):
        track_of(calm, averaging_s=60)


def test_the_limit_is_055_of_the_usual_wind() -> None:
    """970 hPa at 20 N 120 E: 1216.5223 - 0.8172 - 5.028 - 1144.309 = 66.368 kt, 36.5 of them."""
    place = (np.array([20.0]), np.array([120.0]), np.array([970.0]))
    below, above = (np.array([share * 66.368 * KNOT_MPS]) for share in (0.549, 0.551))
    assert odd_winds(*place, above, NAMELESS[60.0]) is None
    odd = odd_winds(*place, below, NAMELESS[60.0])
    assert odd is not None
    assert odd.weak
    assert odd.limit_mps == pytest.approx(0.55 * 66.368 * KNOT_MPS, rel=1e-4)
    shallow = (*place[:2], np.array([985.1]))
    assert odd_winds(*shallow, np.array([1.0]), NAMELESS[60.0]) is None


def test_a_relation_that_weakens_weak_winds_makes_none_too_weak() -> None:
    """RSMC Tokyo's 35 kt are 19.5 kt by its relation: Dianmu 2016, which had 985 hPa, is real."""
    place = (np.array([19.4]), np.array([110.0]), np.array([985.0]))
    assert odd_winds(*place, np.array([35.0 * KNOT_MPS]), AGENCIES["tokyo"]) is None


def test_a_longer_mean_is_never_nearer_to_one_minute() -> None:
    """Harper, Kepert and Ginger 2010, at sea: 1.05, 1.02 and 1.00 for one, two and three in ten."""
    raised = [float(to_one_minute(np.array([50.0]), NAMELESS[s])[0]) for s in sorted(NAMELESS)]
    assert raised == sorted(raised)
    assert raised == pytest.approx([50.0, 50.0 * 1.05 / 1.02, 50.0 * 1.05, 50.0 / 0.93])
    assert not {id(agency) for agency in NAMELESS.values()} & {id(a) for a in AGENCIES.values()}
