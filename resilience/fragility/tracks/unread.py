"""Formats of tracks that are not read, told by how their files begin and refused by their name."""

from __future__ import annotations

import re
from dataclasses import dataclass

from resilience.errors import UsageError

ALLOWED = "IBTrACS 4 CSV, HURDAT2, the CMA's best-track text, or CSV with a heading"
BEST = "HURDAT2 and IBTrACS have the same best tracks"
AS_CSV = "write time, lat, lon, vmax_kt, pressure_hpa and averaging_s of one storm as CSV"


@dataclass(frozen=True)
class Unread:
    """A format that is not read.

    Attributes:
        name: as messages say it: the file is ...
        pattern: of how a file begins, comments and blank lines left out.
        hint: what to read in its place.
    """

    name: str
    pattern: str
    hint: str


UNREAD: tuple[Unread, ...] = (
    Unread(
        "a netCDF file", r"CDF[\x01\x02\x05]|\x89HDF", f"IBTrACS comes as CSV, too; or {AS_CSV}"
    ),
    Unread("a GRIB file", "GRIB", "wind fields are not read; a track of the same storm is"),
    Unread("a BUFR file", r"(?:.{0,80}\n)?BUFR", AS_CSV),
    Unread("a shapefile", r"\x00\x00\x27\x0a", AS_CSV),
    Unread("a Parquet file", "PAR1", AS_CSV),
    Unread("a gzip archive", r"\x1f\x8b", "unpack it: gunzip FILE"),
    Unread("a zip archive, as KMZ, shapefiles and spreadsheets are", "PK\x03\x04", AS_CSV),
    Unread(
        "an ATCF deck",
        r"[A-Z]{2}[,;\t]\s*\w{1,2}[,;\t]\s*\d{10,12}[,;\t]",
        f"use IBTrACS or HURDAT2; of a forecast {AS_CSV}",
    ),
    Unread(
        "HURDAT2 without its commas",
        r"[A-Z]{2}\d{6}\s*[;\t]",
        "a spreadsheet saved it: take the file of NHC as it is",
    ),
    Unread(
        "RSMC Tokyo's best-track text",
        r"66666\s[^\n]*\n\d{8}\s+\d{3}\s+\d\s",
        "it looks like the CMA's and is not; IBTrACS has the same tracks, with --agency tokyo",
    ),
    Unread("HURDAT's old format", r"\d{5}\s+\d{2}/\d{2}/\d{4}\s+M=", "HURDAT2 took its place"),
    Unread("a TC Vitals record", r"[A-Z]{3,4}\s+\d{2}[A-Z]\s+\S+\s+\d{8}\s+\d{4}\s", BEST),
    Unread(
        "a Unisys track", r"(?:[^\n]*\n){0,3}\s*ADV\s+LAT\s+LON\s+TIME\s+WIND\s+PR\s+STAT", BEST
    ),
    Unread(
        "a warning bulletin",
        r"(?s:.{0,300})\b(?:W[HT]|TC)[A-Z]{2}\d{2}\s+[A-Z]{4}\s+\d{6}\b"
        r"|(?s:.{0,600})(?:FORECAST/ADVISORY|TROPICAL CYCLONE WARNING|WRNCEN)",
        f"{AS_CSV}, from its forecast positions",
    ),
    Unread("KML", r"(?s:.{0,400})<kml\b", AS_CSV),
    Unread("CXML", r"(?s:.{0,400})<cxml\b", AS_CSV),
    Unread("a web page", r"(?is:.{0,400})<html\b", "download the data that it points to"),
    Unread("XML", r"<", AS_CSV),
    Unread("GeoJSON", r'\{(?s:.{0,400})"(?:FeatureCollection|Feature|LineString)"', AS_CSV),
    Unread("JSON", r"[{\[]", AS_CSV),
    Unread(
        "a catalogue of STORM, of synthetic tracks",
        r"(?:-?[\d.]+(?:e[+-]?\d+)?,){12}-?[\d.]+(?:e[+-]?\d+)?\s*\n",
        AS_CSV,
    ),
    Unread(
        "rows without a heading",
        r"(?:[^\n,;\t]*[,;\t])*\s*-?\d+(?:\.\d*)?\s*(?:[,;\t\n]|$)|\s*-?\d[\d.:/-]*\s",
        f"a heading names the columns: {AS_CSV}",
    ),
)
"""Every one, the more telling ones first."""


def refuse_unread(file: str, head: str, *, is_text: bool = True) -> None:
    """Refuses a file in a format that is known and not read.

    Args:
        file: its name, for messages.
        head: what it begins with, comments and blank lines left out.
        is_text: it could be a track by its bytes.

    Raises:
        UsageError: it is one of `UNREAD`.
    """
    for kind in UNREAD:
        if re.match(kind.pattern, head):
            name = kind.name if is_text else f"no text but {kind.name}"
            raise UsageError(
                f"{file} is {name}, which is not read; allowed: {ALLOWED}", hint=kind.hint
            )
