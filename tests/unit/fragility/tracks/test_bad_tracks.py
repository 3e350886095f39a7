"""Bad tracks: one error that lists every mistake, by row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from resilience.errors import CaseError, UsageError
from resilience.fragility.tracks import read_track, track_of

BAD = """\
time,lat,lon,vmax_mps,pressure_hpa,rmw_km,wind
2020-09-01T00:00,20,115,120,940,40,1
2020-09-01T06:00,20.5,115,50,94000,40,1
2020-09-01T06:00,95,115,50,940,0.5,1
2020-09-01T03:00,21,400,fifty,940,40,1
noon,21,,50,700,40,1
2020-09-01T12:00,21,115
"""
TIMES = ["2020-09-01T00:00", "2020-09-01T06:00"]
GOOD: dict[str, Any] = {"time": TIMES, "lat": [20, 21], "lon": [115, 116], "vmax_mps": [40, 40]}


def mistakes(columns: dict[str, Any], **about: Any) -> list[tuple[str, str]]:
    with pytest.raises(CaseError) as caught:
        track_of(columns, **({"averaging_s": 60} | about))
    return [(problem.table, problem.key) for problem in caught.value.mistakes]


def test_every_mistake_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text(BAD, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        read_track(tmp_path / "bad.csv")
    found = [(problem.table, problem.key) for problem in caught.value.mistakes]
    rows = [table for table, _ in found if table.startswith("row")]
    assert rows == sorted(rows)
    assert set(found) == {
        ("heading", "wind"),
        ("track", "averaging_s"),
        ("row 2", "vmax_mps"),
        ("row 3", "pressure_hpa"),
        ("row 4", "time"),
        ("row 4", "lat"),
        ("row 4", "rmw_km"),
        ("row 5", "time"),
        ("row 5", "lon"),
        ("row 5", "vmax_mps"),
        ("row 6", "time"),
        ("row 6", "lon"),
        ("row 6", "pressure_hpa"),
        ("row 7", "columns"),
    }
    assert "`vmax_kt`" in str(caught.value)
    assert "2020-09-01T06:00:00, twice" in str(caught.value)


def test_knots_for_metres_per_second_are_suspected() -> None:
    for wind in (111, 140):
        assert mistakes(GOOD | {"vmax_mps": [wind, 40]}) == [("row 1", "vmax_mps")]
    assert track_of(GOOD | {"vmax_mps": [110, 40]}, averaging_s=60).vmax_mps[0] == 110.0


def test_an_averaging_time_is_needed_and_must_be_one() -> None:
    assert mistakes(GOOD, averaging_s=None) == [("track", "averaging_s")]
    assert mistakes(GOOD, averaging_s=3) == [("track", "averaging_s")]
    assert mistakes(GOOD | {"averaging_s": [60, 600]}) == [("track", "averaging_s")]


def test_a_storm_needs_two_points_places_and_an_intensity() -> None:
    one = {key: values[:1] for key, values in GOOD.items()}
    assert mistakes(one) == [("track", "points")]
    nothing: dict[str, list[float]] = {key: [] for key in GOOD}
    assert ("track", "points") in mistakes(nothing)
    assert mistakes({"time": TIMES, "lat": [1, 2], "lon": [1, 2]}) == [("track", "vmax_mps")]
    assert mistakes({"vmax_mps": [1]}) == [("heading", key) for key in ("time", "lat", "lon")]
    assert mistakes(GOOD | {"lat": [20]}) == [("heading", "columns")]
    assert mistakes(GOOD | {"vmax_kt": [80, 80]}) == [("heading", "vmax_kt")]


def test_a_leap_is_a_slip() -> None:
    assert mistakes(GOOD | {"lon": [115, -116]}) == [("row 2", "lat, lon")]
    assert mistakes(GOOD | {"vmax_mps": [40, float("inf")]}) == [("row 2", "vmax_mps")]


def test_calls_that_cannot_mean_anything(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    with pytest.raises(UsageError, match="does not exist"):
        read_track(path)
    path.write_text(BAD, encoding="utf-8")
    with pytest.raises(UsageError, match="allowed: ibtracs, hurdat2, cma, csv"):
        read_track(path, format="netcdf")
    with pytest.raises(UsageError, match="option 'agencies'"):
        read_track(path, agencies="usa")  # type: ignore[call-arg]
    path.write_text("AL092017, X, 0,\n", encoding="utf-8")
    with pytest.raises(UsageError, match="looks like hurdat2, not ibtracs"):
        read_track(path, format="ibtracs", averaging_s=60)
    with pytest.raises(UsageError, match="allowed: ibtracs, vickery2008"):
        track_of(GOOD, averaging_s=60, rmw="guess")


def test_rows_missing_from_agency_files(tmp_path: Path) -> None:
    path = tmp_path / "t.txt"
    path.write_text("66666 1409  3 0011 1409 0 6 X 20150324\n2014071800 6 191\n", "utf-8")
    with pytest.raises(CaseError) as caught:
        read_track(path)
    assert {(p.table, p.key) for p in caught.value.mistakes} == {
        ("X", "rows"),
        ("row 2", "row"),
        ("track", "points"),
    }
    path.write_text("AL092017, X, 2,\n20170825, 1800,  , HU, 27.1N\n", "utf-8")
    with pytest.raises(CaseError) as caught:
        read_track(path)
    assert {(p.table, p.key) for p in caught.value.mistakes} == {
        ("AL092017", "rows"),
        ("row 2", "columns"),
    }


def test_a_file_without_rows_or_without_text_is_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    for content, found in (
        (b"", "has no rows"),
        (b"\xef\xbb\xbf\n# only a comment\n\n", "has no rows"),
        (b"\x89HDF\r\n\x1a\n\x00\x00\x00", "is no text"),
        ("time,lat,lon\n".encode("utf-16"), "is no text"),
        (b'time,lat,lon\n"' + b"1" * 200_000, "cannot be read as CSV"),
    ):
        path.write_bytes(content)
        with pytest.raises(UsageError, match=f"{found}.*; allowed: ") as caught:
            read_track(path)
        assert "track.csv" in caught.value.message
        assert caught.value.hint
    with pytest.raises(UsageError, match="is no file"):
        read_track(tmp_path)


def test_a_file_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(path: Path) -> bytes:
        raise PermissionError(13, "Permission denied", str(path))

    path = tmp_path / "track.csv"
    path.write_text(BAD, encoding="utf-8")
    monkeypatch.setattr(Path, "read_bytes", refused)
    with pytest.raises(UsageError, match="cannot be read: Permission denied"):
        read_track(path)


def test_a_heading_alone_and_a_header_cut_short(tmp_path: Path) -> None:
    path = tmp_path / "t.txt"
    path.write_text("time,lat,lon,vmax_mps\n", "utf-8")
    with pytest.raises(CaseError, match="found:   0"):
        read_track(path, averaging_s=60)
    path.write_text("66666 1409\n2014071800 6 191 1123 900 65\n", "utf-8")
    with pytest.raises(CaseError, match="a number, as its header says"):
        read_track(path)


def test_a_stray_quotation_mark_spoils_one_row(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = '2020-09-01T00:00,20,115,"40\n2020-09-01T06:00,20.5,115,4O\n'
    path.write_text("time,lat,lon,vmax_mps\n" + rows, "utf-8")
    with pytest.raises(CaseError) as caught:
        read_track(path, averaging_s=60)
    assert [(p.table, p.key) for p in caught.value.mistakes] == [("row 3", "vmax_mps")]


@pytest.mark.parametrize(
    "heading",
    ["vmax_knots", "wind_kt", "Wind (kt)", "WINDSPEED", "max_wind_ms", "pressure_pa", "PC_mb",
     "central pressure", "rmw_m", "RMW (miles)", "penv_pa", "pres_mb", "mslp", "rmax_km"],
)  # fmt: skip
def test_a_heading_that_means_a_field_in_another_unit_is_refused(heading: str) -> None:
    columns = GOOD | {"pressure_hpa": [950, 950], heading: [40, 40]}
    with pytest.raises(CaseError) as caught:
        track_of(columns, averaging_s=60)
    (found,) = caught.value.mistakes
    assert (found.table, found.key) == ("heading", heading)
    for name in ("vmax_mps", "vmax_kt", "pressure_hpa", "rmw_nmi", "penv_hpa"):
        assert name in found.allowed


def test_headings_of_other_things_are_left_alone() -> None:
    others = ("status", "radii34_50_64kt_ne_se_sw_nw_nmi", "wind_direction", "pressure_source",
              "wind_radii_34kt_nmi", "basin", "speed_kmh", "pcode", "presumed")  # fmt: skip
    track = track_of(GOOD | {key: [1, 2] for key in others}, averaging_s=60)
    assert track.vmax_mps.tolist() == [40.0, 40.0]


def test_a_cell_that_cannot_be_read_is_one_mistake() -> None:
    assert mistakes(GOOD | {"lat": [20, "north"]}) == [("row 2", "lat")]


def test_a_leap_is_found_beside_other_mistakes() -> None:
    found = mistakes(GOOD | {"lon": [115, -116], "vmax_mps": [40, 140]})
    assert set(found) == {("row 2", "lat, lon"), ("row 2", "vmax_mps")}


def test_a_track_across_the_dateline_may_count_on() -> None:
    assert track_of(GOOD | {"lon": [179, 181]}, averaging_s=60).lon.tolist() == [179.0, -179.0]
    assert mistakes(GOOD | {"lon": [179, 400]}) == [("row 2", "lon")]


def test_an_unknown_basin_or_agency_is_refused() -> None:
    with pytest.raises(UsageError, match="basin 'WPAC'; allowed: NA, EP, SA, NI, SI, WP, SP"):
        track_of(GOOD, averaging_s=60, basin="WPAC")
    assert mistakes(GOOD, agency="jma") == [("track", "agency")]


def test_an_averaging_time_must_be_the_agency_s() -> None:
    assert track_of(GOOD, agency="cma").averaging_s == 120.0
    for about in ({"averaging_s": 60}, {"averaging_s": 600}):
        assert mistakes(GOOD, agency="cma", **about) == [("track", "averaging_s")]
    column = GOOD | {"averaging_s": [60, 60]}
    assert mistakes(column, agency="cma", averaging_s=None) == [("track", "averaging_s")]
