"""Tracks from files: every format, its units and its averaging time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.errors import CaseError, UsageError
from resilience.fragility.tracks import read_track
from tests.best_tracks import BEST_TRACKS, BestTrack
from tests.shared import shared

HURDAT2 = """\
AL092017,             HARVEY,      3,
20170825, 1800,  , HU, 27.1N,  96.3W, 105,  943,  140,  100,   60,   90,   70,   50,   40,   50
20170826, 0000,  , HU, 27.8N,  96.8W, 115, -999,  120,  100,   60,   90,   70,   50,   40,   50
20170826, 0300, L, HU, 28.0N,  96.9W, 115,  937,  120,  100,   60,   90,   70,   50,   40,   50
AL112017,               IRMA,      2,
20170905, 1200,  , HU, 16.7N,  57.7W, 155,  929,  150,  120,   80,  120,   75,   60,   40,   60, \
  45,   35,   25,   35,   15
20170905, 1800,  , HU, 16.9N,  59.2W, 155,  926,  150,  120,   80,  120,   75,   60,   40,   60, \
  45,   35,   25,   35,   15
"""
CMA = """\
66666 1409    3 0011 1409 0 6                 Rammasun              20150324
2014071800 6 191 1123  900      65
2014071806 6 199 1113  888      72
2014071812 6 203 1103  910       0
66666 0000    2 0012 1410 0 6               (nameless)              20150324
2014071800 1 191 1797 1004      13
2014071806 1 199 1803 1004       9
"""
IBTRACS = """\
SID,SEASON,NUMBER,BASIN,SUBBASIN,NAME,ISO_TIME,NATURE,LAT,LON,WMO_WIND,WMO_PRES,WMO_AGENCY,\
TRACK_TYPE,USA_LAT,USA_LON,USA_WIND,USA_PRES,USA_POCI,USA_RMW,TOKYO_LAT,TOKYO_LON,TOKYO_WIND,\
TOKYO_PRES,CMA_LAT,CMA_LON,CMA_WIND,CMA_PRES
 ,Year, , , , , , ,degrees_north,degrees_east,kts,mb, , ,degrees_north,degrees_east,kts,mb,mb,\
nmile,degrees_north,degrees_east,kts,mb,degrees_north,degrees_east,kts,mb
2023271N14144,2023,1,WP,MM,KOINU,2023-10-04 12:00:00,TS,21.9,121.6,85,940,tokyo,main,22.0,121.7,\
120,935,1004,15,21.9,121.6,85,940,21.8,121.5,106,930
2023271N14144,2023,1,WP,MM,KOINU,2023-10-04 15:00:00,TS,22.0,121.2, , , ,main, , , , , , , , , , ,\
21.9,121.1,106,930
2023271N14144,2023,1,WP,MM,KOINU,2023-10-04 18:00:00,TS,22.1,120.9,80,945,tokyo,main,22.1,120.9,\
115,938,1003,20,22.0,120.9,80,945,22.0,120.8,106,930
2023271N14144,2023,1,WP,MM,KOINU,2023-10-04 18:00:00,TS,22.1,120.9,80,945,tokyo,spur-split,22.1,\
120.9,115,938,1003,20,22.0,120.9,80,945,22.0,120.8,106,930
2023001N14144,2023,2,SP,MM,OTHER,2023-01-04 18:00:00,TS,-12.1,179.9,45,985,nadi,main, , , , , , , ,\
 , , , , , ,
2023001N14144,2023,2,SP,MM,OTHER,2023-01-05 00:00:00,TS,-12.6,-179.7,50,980,nadi,main, , , , , , ,\
 , , , , , , ,
"""
PLAIN = """\
# a comment
time,lat,lon,vmax_kt,pressure_hpa,averaging_s,note
2014-07-18T06:00Z,19.9,111.3,140,888,120,first
2014-07-18T20:00+08:00,20.3,110.3,,910,120,second
"""


def written(folder: Path, text: str, name: str = "track.txt") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_hurdat2(tmp_path: Path) -> None:
    path = written(tmp_path, HURDAT2)
    track = read_track(path, storm="Harvey")
    assert (track.name, track.averaging_s, track.agency) == ("HARVEY", 60.0, "usa")
    np.testing.assert_allclose(track.lon, [-96.3, -96.8, -96.9])
    np.testing.assert_allclose(track.vmax_mps, np.array([105, 115, 115]) * 0.514444)
    assert track.time[2] == np.datetime64("2017-08-26T03:00")
    # 1026.3401 - 0.05504 * 27.8 + 0.03536 * 96.8 - 0.7357 * 115, in knots
    assert track.pressure_hpa[1] == pytest.approx(943.62733)
    assert track.filled == {
        "penv_hpa": "3 of 3: 1010 hPa, basin NA",
        "pressure_hpa": "1 of 3: regression on the wind",
        "rmw_km": "3 of 3: regression ibtracs",
    }
    irma = read_track(path, storm="AL112017")
    np.testing.assert_allclose(irma.rmw_km, 15 * 1.852)
    with pytest.raises(UsageError, match="2 storms: AL092017, AL112017; allowed: one"):
        read_track(path)
    with pytest.raises(UsageError, match=r"storm 'Maria' is not in track\.txt"):
        read_track(path, storm="Maria")


def test_cma_text(tmp_path: Path) -> None:
    path = written(tmp_path, CMA)
    track = read_track(path, storm="1409")
    assert (track.name, track.averaging_s, track.agency) == ("Rammasun", 120.0, "cma")
    np.testing.assert_allclose(track.lat, [19.1, 19.9, 20.3])
    np.testing.assert_allclose(track.vmax_mps[:2], [65.0, 72.0])
    # 1216.5223 - 0.04086 * 20.3 - 0.04190 * 110.3 - 1.1797 * 910, one-minute knots, times 0.871
    assert track.vmax_mps[2] == pytest.approx(137.54422 * 0.514444 * 0.871, rel=1e-6)
    assert track.penv_hpa[0] == 1005.0
    nameless = read_track(path, storm="1410")
    np.testing.assert_allclose(nameless.lon, [179.7, -179.7])
    np.testing.assert_allclose(nameless.vmax_mps, [13.0, 9.0])


def test_ibtracs_agencies_have_their_averaging_times(tmp_path: Path) -> None:
    path = written(tmp_path, IBTRACS)
    usa = read_track(path, storm="koinu")
    assert (usa.averaging_s, usa.agency, len(usa.time)) == (60.0, "usa", 2)
    np.testing.assert_allclose(usa.rmw_km, [27.78, 37.04])
    np.testing.assert_allclose(usa.penv_hpa, [1004.0, 1003.0])
    assert usa.filled == {}
    cma = read_track(path, storm="KOINU 2023", agency="cma")
    assert (cma.averaging_s, len(cma.time)) == (120.0, 3)
    np.testing.assert_allclose(cma.lat, [21.8, 21.9, 22.0])
    for agency in ("tokyo", "wmo"):
        tokyo = read_track(path, storm="2023271N14144", agency=agency)
        assert (tokyo.averaging_s, tokyo.agency) == (600.0, "tokyo")
        np.testing.assert_allclose(tokyo.vmax_mps, np.array([85, 80]) * 0.514444)


def test_ibtracs_wmo_where_usa_says_nothing(tmp_path: Path) -> None:
    track = read_track(written(tmp_path, IBTRACS), storm="other")
    assert (track.averaging_s, track.agency) == (600.0, "nadi")
    np.testing.assert_allclose(track.lon, [179.9, -179.7])
    assert track.penv_hpa[0] == 1004.0


@pytest.mark.parametrize("agency", [None, "cma"])
@pytest.mark.parametrize("separator", [";", "\t"])
def test_ibtracs_saved_by_a_spreadsheet(separator: str, agency: str | None, tmp_path: Path) -> None:
    # 937.5 hPa within an isobar of 935.5 is an agency's slip, with a comma as with a point.
    text = IBTRACS.replace("115,938,1003", "115,937.5,935.5")
    usual = read_track(written(tmp_path, text), storm="koinu", agency=agency)
    saved = text.replace(",", separator).replace(".", ",").replace("SID", '"SID"', 1)
    again = read_track(written(tmp_path, saved), storm="koinu", agency=agency)
    for field in ("time", "lat", "lon", "vmax_mps", "pressure_hpa", "rmw_km", "penv_hpa"):
        np.testing.assert_array_equal(getattr(again, field), getattr(usual, field))
    assert again.agency == usual.agency
    assert again.filled == usual.filled
    mixed = saved.replace("22,1", "22.1")
    with pytest.raises(CaseError, match="a number with a decimal comma"):
        read_track(written(tmp_path, mixed), storm="koinu")


@pytest.mark.parametrize("heading", ['"SID,SEASON', 'X,"SID,Y",SEASON'])
def test_ibtracs_with_a_stray_quotation_mark_is_refused(heading: str, tmp_path: Path) -> None:
    path = written(tmp_path, IBTRACS.replace("SID,SEASON", heading, 1))
    with pytest.raises(UsageError, match=r"track\.txt has a heading with a stray quotation mark"):
        read_track(path, storm="koinu")


def test_ibtracs_refuses_what_it_cannot_know(tmp_path: Path) -> None:
    path = written(tmp_path, IBTRACS)
    with pytest.raises(UsageError, match="KOINU 2023 = 2023271N14144, OTHER 2023"):
        read_track(path)
    with pytest.raises(UsageError, match=r"allowed: those of track\.txt: usa, tokyo, cma, wmo"):
        read_track(path, storm="koinu", agency="jma")
    with pytest.raises(UsageError, match="allowed: KOINU 2023, OTHER 2023"):
        read_track(path, storm="noname")
    with pytest.raises(CaseError, match="found:   600"):
        read_track(path, storm="koinu", averaging_s=600.0)
    mixed = IBTRACS.replace("80,945,tokyo,main", "80,945,bom,main")
    with pytest.raises(CaseError, match="bom, tokyo"):
        read_track(written(tmp_path, mixed), storm="koinu", agency="wmo")
    metric = IBTRACS.replace("degrees_east,kts,mb,mb,nmile", "degrees_east,m/s,mb,mb,nmile")
    with pytest.raises(CaseError, match="row 2 USA_WIND"):
        read_track(written(tmp_path, metric), storm="koinu")


def test_plain_csv(tmp_path: Path) -> None:
    track = read_track(written(tmp_path, PLAIN))
    assert track.averaging_s == 120.0
    assert track.time[1] == np.datetime64("2014-07-18T12:00")
    assert track.vmax_mps[0] == pytest.approx(72.02216)
    assert track.filled["vmax_mps"] == "1 of 2: regression on the pressure"


SHEET = """\
\ufeff# Rammasun, as a spreadsheet writes it where the comma is the decimal sign
Time;Lat;Lon;vmax_mps;Pressure_hPa;Averaging_s;note
2014-07-18T06:00;19,9;110,8;60,5;905;120;7.5
2014-07-18T12:00;20,3;109,75;;912,5;120,0;"landfall; 1.5 km off"
"""


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_spreadsheet_s_semicolons_and_decimal_commas(separator: str, tmp_path: Path) -> None:
    track = read_track(written(tmp_path, SHEET.replace(";", separator), "sheet.csv"))
    assert track.lat.tolist() == [19.9, 20.3]
    assert track.lon.tolist() == [110.8, 109.75]
    assert track.pressure_hpa.tolist() == [905.0, 912.5]
    assert (track.vmax_mps[0], track.averaging_s) == (60.5, 120.0)


def test_a_point_among_decimal_commas_is_a_mistake(tmp_path: Path) -> None:
    mixed = SHEET.replace("20,3;", "20.3;").replace("912,5", "1.012,5")
    with pytest.raises(CaseError) as caught:
        read_track(written(tmp_path, mixed, "sheet.csv"))
    assert [(wrong.table, wrong.key, wrong.value) for wrong in caught.value.mistakes] == [
        ("row 4", "lat", "20.3"),
        ("row 4", "pressure_hpa", "1.012,5"),
    ]


def test_eight_storms_of_a_file_are_named_and_the_others_counted(tmp_path: Path) -> None:
    rows = [f"s{k},2014-07-18T{k:02}:00,20,115,40" for k in range(11)]
    path = written(tmp_path, "\n".join(["storm,time,lat,lon,vmax_mps", *rows]))
    listing = "s0, s1, s2, s3, s4, s5, s6, s7 and 3 more; allowed: one"
    with pytest.raises(UsageError, match=f"has 11 storms: {listing}"):
        read_track(path, averaging_s=600)
    path = written(tmp_path, "\n".join(["storm,time,lat,lon,vmax_mps", *rows[:8]]))
    with pytest.raises(UsageError, match=r"has 8 storms: s0, .*, s7; allowed: one"):
        read_track(path, averaging_s=600)


def test_a_longitude_of_minus_99_is_a_place(tmp_path: Path) -> None:
    text = "time,lat,lon,vmax_mps\n2020-01-01,28,-98,40\n2020-01-01T06:00,28,-99,-999\n"
    track = read_track(written(tmp_path, text + "2020-01-01T12:00,28,-100,30\n"), averaging_s=60)
    assert track.lon[1] == -99.0
    assert track.filled["vmax_mps"] == "1 of 3: linear in time"
    assert track.vmax_mps[1] == 35.0


@pytest.mark.parametrize(
    ("text", "options", "own"),
    [
        (CMA, {"storm": "1409"}, "120, as cma"),
        (HURDAT2, {"storm": "HARVEY"}, "60, as usa"),
        (IBTRACS, {"storm": "koinu", "agency": "tokyo"}, "600, as tokyo"),
        (PLAIN, {"format": "cma"}, "120, as cma"),
        (PLAIN.replace(",120,", ",60,"), {"format": "hurdat2"}, "60, as usa"),
        (PLAIN, {"agency": "CMA"}, "120, as cma"),
    ],
)
def test_an_averaging_time_must_not_contradict_the_format(
    text: str, options: dict[str, Any], own: str, tmp_path: Path
) -> None:
    path = written(tmp_path, text)
    stated = float(own.partition(",")[0])
    assert read_track(path, averaging_s=stated, **options).averaging_s == stated
    assert read_track(path, **options).averaging_s == stated
    for other in {60.0, 120.0, 180.0, 600.0} - {stated}:
        with pytest.raises(CaseError) as caught:
            read_track(path, averaging_s=other, **options)
        (found,) = caught.value.mistakes
        assert (found.key, found.allowed) == ("averaging_s", own)
        assert f"{other:g}" in found.value
        assert "leave it out" in found.hint


def test_a_column_must_not_contradict_the_format_either(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="60, as usa"):
        read_track(written(tmp_path, PLAIN), format="hurdat2")


def test_another_agency_than_the_format_s_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="agency 'tokyo' of a file in format cma; allowed: cma"):
        read_track(written(tmp_path, CMA), storm="1409", agency="tokyo")
    with pytest.raises(UsageError, match="looks like csv, not ibtracs"):
        read_track(written(tmp_path, PLAIN), format="ibtracs")


def test_the_basin_of_the_caller_wins(tmp_path: Path) -> None:
    for text, storm, own, value in (
        (HURDAT2, "HARVEY", "NA", 1010.0),
        (HURDAT2.replace("AL092017", "WP092017"), "WP092017", "WP", 1005.0),
        (CMA, "1409", "WP", 1005.0),
        (IBTRACS.replace(",WP,MM", ",SP,MM").replace(",1004,15,", ",,15,"), "KOINU", "SP", 1004.0),
    ):
        path = written(tmp_path, text)
        track = read_track(path, storm=storm)
        assert track.penv_hpa[0] == value
        assert track.filled["penv_hpa"].endswith(f"basin {own}")
        other = "SP" if own != "SP" else "NA"
        asked = read_track(path, storm=storm, basin=other)
        assert asked.penv_hpa[0] == {"SP": 1004.0, "NA": 1010.0}[other]
        assert asked.filled["penv_hpa"].endswith(f"basin {other}")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("27.8N", "27.8", "lat"),
        ("96.8W", "96.8", "lon"),
        ("27.8N", "27.8W", "lat"),
        ("96.8W", "-96.8", "lon"),
        ("96.8W", "96.8N", "lon"),
        ("27.8N", "", "lat"),
    ],
)
def test_hurdat2_places_need_their_hemisphere(old: str, new: str, key: str, tmp_path: Path) -> None:
    path = written(tmp_path, HURDAT2.replace(old, new).replace("HU, 28.0N", "HU, 28.0"))
    with pytest.raises(CaseError) as caught:
        read_track(path, storm="HARVEY")
    found = caught.value.mistakes
    assert [(p.table, p.key) for p in found] == [("row 3", key), ("row 4", "lat")]
    assert found[0].value == (new or "nothing")
    assert found[0].allowed.startswith("degrees and ")


@pytest.mark.parametrize("best", BEST_TRACKS, ids=lambda best: best.name)
def test_rows_of_best_tracks_as_csv(best: BestTrack, tmp_path: Path) -> None:
    """Each row that the agency published, in the columns of the files that are shared."""
    head = "time_utc,lat_deg,lon_deg,central_pressure_hpa,max_sustained_wind_ms,status"
    rows = [
        f"{time}:00:00Z,{lat},{lon},{pressure},{wind},cat"
        for time, lat, lon, pressure, wind in best.rows
    ]
    path = written(tmp_path, "\n".join([f"# {best.source}", head, *rows]), "track.csv")
    track = read_track(path, averaging_s=best.averaging_s)
    assert (track.averaging_s, len(track.time)) == (best.averaging_s, len(best.rows))
    time, lat, lon, pressure, wind = zip(*best.rows, strict=True)
    assert (track.time == np.array(time, "datetime64[s]")).all()
    np.testing.assert_array_equal([track.lat, track.lon], [lat, lon])
    np.testing.assert_array_equal([track.pressure_hpa, track.vmax_mps], [pressure, wind])
    assert track.filled["rmw_km"] == f"{len(rows)} of {len(rows)}: regression ibtracs"


@pytest.mark.parametrize(
    ("file", "options", "peak", "deepest", "points"),
    [
        ("rammasun_2014_cma.csv", {"format": "cma"}, 72.0, 888.0, 40),
        ("harvey_2017_hurdat2.csv", {"format": "hurdat2"}, 59.2, 937.0, 74),
        ("koinu_2023_ibtracs.csv", {"averaging_s": 120.0}, 54.5, 930.0, 117),
    ],
)
def test_shared_tracks(
    file: str, options: dict[str, str], peak: float, deepest: float, points: int
) -> None:
    track = read_track(shared("data", "tracks", file), **options)  # type: ignore[arg-type]
    assert len(track.time) == points
    assert track.vmax_mps.max() == pytest.approx(peak, abs=0.05)
    assert track.pressure_hpa.min() == deepest
    assert track.filled["rmw_km"] == f"{points} of {points}: regression ibtracs"


def test_shared_peaks_are_where_they_should_be() -> None:
    folder = shared("data", "tracks")
    rammasun = read_track(folder / "rammasun_2014_cma.csv", averaging_s=120)
    at = int(rammasun.vmax_mps.argmax())
    assert rammasun.time[at] == np.datetime64("2014-07-18T06:00")
    assert (rammasun.lat[at], rammasun.lon[at]) == (19.9, 111.3)
    harvey = read_track(folder / "harvey_2017_hurdat2.csv", averaging_s=60)
    at = int(np.searchsorted(harvey.time, np.datetime64("2017-08-26T03:00")))
    assert (harvey.lat[at], harvey.lon[at], harvey.pressure_hpa[at]) == (28.0, -96.9, 937.0)
    koinu = read_track(folder / "koinu_2023_ibtracs.csv", averaging_s=120)
    strong = koinu.time[koinu.vmax_mps == koinu.vmax_mps.max()]
    assert strong[0] == np.datetime64("2023-10-04T12:00")
    assert strong[-1] == np.datetime64("2023-10-04T18:00")


# Rows of the best tracks of the east and central Pacific, CP022002 and EP121976.
ELE = """\
CP022002,                ELE,      4,
20020826, 0000,  , TD, 10.4N, 162.0W,  15, 9999, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
20020826, 0600,  , TD, 10.4N, 163.1W,  25, 1008, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
20020827, 0600,  , TS, 10.2N, 168.7W,  40, 1002, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
20020827, 1200,  , TS, 10.0N, 170.9W,  60,  990, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
"""
LIZA = """\
EP121976,               LIZA,      3,
19760930, 1800,  , HU, 22.6N, 108.9W, 120,  971, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
19761001, 0600,  , HU, 25.0N, 109.4W, 115, -999, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
19761001, 1200,  , HU, 26.3N, 109.4W, 110, -999, -999, -999, -999, -999, -999, -999, -999, -999, \
-999, -999, -999, -999,
"""


def test_9999_is_a_gap_in_hurdat2(tmp_path: Path) -> None:
    track = read_track(written(tmp_path, ELE))
    assert track.filled["pressure_hpa"] == "1 of 4: regression on the wind"
    np.testing.assert_allclose(track.pressure_hpa[1:], [1008.0, 1002.0, 990.0])
    assert track.pressure_from_wind is not None
    np.testing.assert_array_equal(track.pressure_from_wind, [1, 0, 0, 0])


def test_odd_winds_are_the_storms_own_where_the_format_fixes_the_unit(tmp_path: Path) -> None:
    """971 hPa go with 74.7 kt there, so that 120 kt would be too strong in a plain CSV file."""
    track = read_track(written(tmp_path, LIZA))
    np.testing.assert_allclose(track.vmax_mps, 0.514444 * np.array([120, 115, 110]))
    rows = "time,lat,lon,vmax_kt,pressure_hpa\n1976-09-30T18:00,22.6,-108.9,120,971\n"
    plain = written(tmp_path, rows + "1976-10-01T06:00,25.0,-109.4,115,\n", "plain.csv")
    with pytest.raises(CaseError, match=r"61\.73 m/s at 971 hPa in row 2"):
        read_track(plain, averaging_s=60)
    with pytest.raises(CaseError, match=r"61\.73 m/s at 971 hPa in row 2"):
        read_track(plain, format="hurdat2")  # whose heading says the unit, as any CSV file's does
    cma = CMA.replace("900      65", "985      65").replace("888      72", "985      72")
    assert read_track(written(tmp_path, cma), storm="1409").pressure_hpa[0] == 985.0
    ibtracs = IBTRACS.replace("120,935,", "120,990,").replace("115,938,", "115,990,")
    assert read_track(written(tmp_path, ibtracs), storm="koinu").pressure_hpa[0] == 990.0
