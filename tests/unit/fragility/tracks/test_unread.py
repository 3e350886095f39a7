"""Formats that are not read are refused by their own name, and those that are read never are."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from resilience.errors import CaseError, UsageError
from resilience.fragility.tracks import read_track
from tests.unit.fragility.tracks.test_readers import CMA, HURDAT2, IBTRACS, PLAIN

# Rows as their agencies publish them, where a format has such.
B_DECK = (
    "AL, 11, 2017083000,   , BEST,   0, 161N,  269W,  30, 1008, TD,   0,    ,    0,    0,    0,"
    "    0, 1012,  180,  60,   0,   0,   L,   0,    , 274,  14,     INVEST,,,,,,,,\n"
    "AL, 11, 2017083006,   , BEST,   0, 162N,  283W,  35, 1007, TS,  34, NEQ,   30,    0,    0,"
    "    0, 1012,  180,  60,   0,   0,   L,   0,    , 274,  14,     INVEST,,,,,,,,\n"
)
A_DECK = (
    "WP, 09, 2014071800, 03, OFCL,   0, 190N, 1120E,  90,    0, TY,  34, NEQ,  110,  100,\n"
    "WP, 09, 2014071800, 03, OFCL,  12, 199N, 1107E, 110,    0, TY,  34, NEQ,  110,  100,\n"
)
F_DECK = "AL, 09, 201708251200, 10, DVTS, CI,  , 2630N,  9580W,  , 2,  90, 2,  966, 2, DVRK,\n"
TOKYO = """\
66666 1501  032 0001 1501 0 6             MEKKHALA              20150217
15011300 002 2 087 1429 1006     000
15011306 002 2 085 1424 1004     000
15011312 002 3 086 1417 1002     035     00000 0000 80210 0150
"""
TOKYO_1951 = """\
66666 5101   10      5101 0 6                              19901017
51021906 002 2 200 1385 1010
51021912 002 2 200 1385 1010
"""
JTWC = """\
WTPN31 PGTW 180300
MSGID/GENADMIN/JOINT TYPHOON WRNCEN PEARL HARBOR HI//
SUBJ/TROPICAL CYCLONE WARNING//
"""
NHC = """\
ZCZC MIATCMAT4 ALL
TTAA00 KNHC DDHHMM

HURRICANE HARVEY FORECAST/ADVISORY NUMBER  21
NWS NATIONAL HURRICANE CENTER MIAMI FL       AL092017
"""
UNISYS = """\
Date: 25-AUG-2017
Hurricane-4 HARVEY
ADV  LAT    LON      TIME     WIND  PR  STAT
  1  13.10  -58.60 08/17/21Z   40  1004 TROPICAL STORM
"""
STORM_CATALOGUE = (
    "0.0,6.0,0.0,0.0,1.0,10.6,140.1,998.4,18.7,46.3,0.0,0.0,1250.4\n"
    "0.0,6.0,0.0,1.0,1.0,10.9,139.6,997.1,19.9,45.9,0.0,0.0,1201.7\n"
)
HEADLESS = "2014-07-18T00:00Z,19.1,112.3,50,930\n2014-07-18T12:00Z,20.3,110.3,50,930\n"
HEADLESS_BLANKS = "20140718 00 19.1 112.3 930 50\n20140718 06 19.9 111.3 888 72\n"
KML = '<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n</kml>\n'
TEXTS = {
    "an ATCF deck": (B_DECK, A_DECK, F_DECK, "# Irma\n" + B_DECK, A_DECK.replace(",", ";")),
    "HURDAT2 without its commas": (HURDAT2.replace(",", ";"), HURDAT2.replace(",", "\t")),
    "RSMC Tokyo's best-track text": (TOKYO, TOKYO_1951),
    "a warning bulletin": (JTWC, NHC),
    "a Unisys track": (UNISYS,),
    "HURDAT's old format": ("00005 06/25/1851 M= 4  1 SNBR=   1 NOT NAMED   XING=1 SSS=1\n",),
    "a TC Vitals record": (
        "NHC  09L HARVEY    20170825 1200 263N 0958W 320 046 0949 1007 0334 49 037\n",
    ),
    "KML": (KML,),
    "CXML": ('<?xml version="1.0"?>\n<cxml>\n</cxml>\n',),
    "a web page": ("<!DOCTYPE html>\n<html><body>not found</body></html>\n",),
    "XML": ("<gml:FeatureCollection/>\n",),
    "GeoJSON": ('{"type": "FeatureCollection", "features": []}\n',),
    "JSON": ('[{"time": "2014-07-18T00:00", "lat": 19.1}]\n',),
    "a catalogue of STORM": (STORM_CATALOGUE,),
    "rows without a heading": (HEADLESS, HEADLESS_BLANKS, "2011,01,30,-13.2,163.1\n"),
}
BINARIES = {
    "a netCDF file": (b"CDF\x01\x00\x00\x00\x00", b"\x89HDF\r\n\x1a\n\x00\x00"),
    "a GRIB file": (b"GRIB\x00\x00\x00\x02",),
    "a BUFR file": (b"BUFR\x00\x00\xf1\x04", b"ISXX03 ECMF 180000\r\r\nBUFR\x00\x00\xf1\x04"),
    "a shapefile": (b"\x00\x00\x27\x0a\x00\x00",),
    "a Parquet file": (b"PAR1\x15\x04\x15\x00",),
    "a zip archive": (b"PK\x03\x04\x14\x00\x00\x00",),
    "a gzip archive": (gzip.compress(B_DECK.encode()),),
}
CASES = [
    *((name, text.encode()) for name, texts in TEXTS.items() for text in texts),
    *((name, raw) for name, files in BINARIES.items() for raw in files),
]


@pytest.mark.parametrize(("name", "raw"), CASES)
def test_a_format_that_is_not_read_is_refused_by_its_name(
    name: str, raw: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "track.dat"
    path.write_bytes(raw)
    for storm, averaging_s in ((None, None), ("HARVEY", 60.0)):
        with pytest.raises(UsageError) as caught:
            read_track(path, storm=storm, averaging_s=averaging_s)
        message = str(caught.value)
        no_text = "no text but " if name in BINARIES else ""
        assert message.startswith(f"track.dat is {no_text}{name}")
        assert "is not read; allowed: IBTrACS 4 CSV, HURDAT2, the CMA's" in message
        assert caught.value.hint


@pytest.mark.parametrize(
    ("text", "storm"),
    [
        (HURDAT2, "HARVEY"),
        (CMA, "Rammasun"),
        (IBTRACS, "KOINU"),
        (PLAIN, None),
        ("\ufeff" + PLAIN, None),
        (CMA.replace("2014071800 6", "\n# a remark\n2014071800 6"), "Rammasun"),
        ("Time, Lat, Lon, vmax_kt, averaging_s\n" + "2020-09-01 00:00,20,115,90,60\n"
         "2020-09-01 06:00,20,114,90,60\n", None),
    ],
)  # fmt: skip
def test_formats_that_are_read_are_not_refused(
    text: str, storm: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "track.txt"
    path.write_text(text, encoding="utf-8")
    assert len(read_track(path, storm=storm).time) >= 2


def test_mistakes_of_a_track_are_in_the_track(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text(PLAIN.replace("19.9,", "199,"), encoding="utf-8")
    with pytest.raises(CaseError, match=r"^1 mistake in the track:"):
        read_track(path)


@pytest.mark.parametrize("time", ["20140718", "20140718T06", "2014-W29-5", "2014-W29-5T06"])
def test_digits_in_a_row_and_weeks_are_no_times(time: str, tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text(PLAIN.replace("2014-07-18T06:00Z", time), encoding="utf-8")
    with pytest.raises(CaseError, match="allowed: a time as 2014-07-18T06:00Z"):
        read_track(path)


def test_columns_of_no_agency_are_refused_as_such(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text(IBTRACS.replace("USA_", "X_").replace("TOKYO_", "Y_").replace("CMA_", "Z_")
                    .replace("WMO_", ""), encoding="utf-8")  # fmt: skip
    with pytest.raises(UsageError, match=r"track\.csv has no agency's winds or pressures"):
        read_track(path, storm="koinu")


def test_pressures_alone_choose_their_agency(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    rows = [line.split(",") for line in IBTRACS.splitlines()]
    for row in rows[2:]:
        for column, heading in enumerate(rows[0]):
            if heading.endswith("_WIND") or heading in ("USA_PRES", "WMO_PRES", "TOKYO_PRES"):
                row[column] = " "
    path.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    track = read_track(path, storm="koinu")
    assert track.agency == "cma"
    assert set(track.pressure_hpa) == {930.0}
