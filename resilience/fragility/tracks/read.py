"""A track from a file, whatever the format."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypedDict, Unpack

from resilience.errors import UsageError
from resilience.fragility.tracks import cma, hurdat2, ibtracs, plain
from resilience.fragility.tracks.columns import About
from resilience.fragility.tracks.track import Track
from resilience.fragility.tracks.unread import refuse_unread
from resilience.inputs import check_root, checked_path, separator_of

HEAD_LINES, HEAD_BYTES = 20, 2000  # enough to tell formats apart
Parser = Callable[[str, About, str | None, str | None], Track]


@dataclass(frozen=True)
class TrackFormat:
    """A format of track files.

    Attributes:
        matches: whether what a file begins with, comments left out, is of this format.
        parse: the track from a file's text, what is known of the file, the storm, the agency.
        fixed_units: every file of it has winds in one unit.
        agency: whose best tracks they are; "" where files say, or the caller.
        basin: of the agency's storms; "" where files say.
    """

    matches: Callable[[str], bool]
    parse: Parser
    fixed_units: bool = True
    agency: str = ""
    basin: str = ""


def _of_one_agency(parse: Callable[[str, About, str | None], Track]) -> Parser:
    """The parser of a format in which there is no agency to choose."""
    return lambda text, about, storm, _: parse(text, about, storm)


def _has_headings(head: str, *headings: str) -> bool:
    """Whether the first line names columns."""
    first = head.partition("\n")[0]
    cells = first.split(separator_of(first))
    return set(headings) <= {cell.strip().strip('"').upper() for cell in cells}


FORMATS: dict[str, TrackFormat] = {
    "ibtracs": TrackFormat(lambda head: _has_headings(head, "SID", "ISO_TIME"), ibtracs.parse),
    "hurdat2": TrackFormat(
        lambda head: re.match(r"\s*[A-Z]{2}\d{6}\s*,", head) is not None,
        _of_one_agency(hurdat2.parse),
        agency="usa",
    ),
    "cma": TrackFormat(
        # RSMC Tokyo's text has the same header, and eight digits of time below it instead of ten.
        lambda head: re.match(r"66666\s(?![^\n]*\n\d{8}\s)", head) is not None,
        _of_one_agency(cma.parse),
        agency="cma",
        basin="WP",
    ),
    "csv": TrackFormat(lambda head: False, _of_one_agency(plain.parse), fixed_units=False),
}
"""Every format; a file that matches none is a CSV file."""


class TrackOptions(TypedDict, total=False):
    """What to read of a track's file, and what to take where it says nothing."""

    agency: str | None
    penv_hpa: float | None
    rmw: str | None
    basin: str | None


def read_track(
    path: str | Path,
    *,
    format: str | None = None,
    averaging_s: float | None = None,
    storm: str | None = None,
    **options: Unpack[TrackOptions],
) -> Track:
    """Reads one storm.

    Args:
        path: of the file.
        format: `ibtracs` (CSV, version 4), `hurdat2`, `cma` (the agency's best-track text) or
            `csv`; by the look of the file if omitted. `hurdat2` and `cma` also read a plain CSV
            file of these agencies, and know its averaging time.
        averaging_s: of the wind, s, for a CSV file without such a column. What the format
            or agency states must not be contradicted.
        storm: identifier or name (`AL092017`, `HARVEY`), needed where a file has several.
        options: `agency` (IBTrACS: usa, wmo, tokyo, cma, hko, ...; by default usa where it has
            winds for at least half of the points, else whoever has most; CSV: whose winds they
            are), `penv_hpa`, `rmw` and `basin` as in `track_of`, before what the file says.

    Raises:
        CaseError: the file has mistakes; all of them are listed, with their rows.
        UsageError: no such file, or none that can be read; no such format, storm, agency, basin
            or option.
    """
    path = Path(path)
    _check(path, format, options)
    text = _text(path)
    looks = _look(text)
    if looks == "csv":
        refuse_unread(path.name, _head(text))
    kind = looks if format is None else format
    stated = FORMATS[kind]
    if kind != looks and not (looks == "csv" and stated.agency):
        raise UsageError(
            f"{path.name} looks like {looks}, not {kind}; allowed: its own format",
            hint="leave out the format",
        )
    agency = options.get("agency")
    about = About(file=path.name, averaging_s=averaging_s, fixed_units=FORMATS[looks].fixed_units)
    about.agency, about.basin = stated.agency or (agency or "").lower(), stated.basin
    if stated.agency and agency not in (None, stated.agency):
        raise UsageError(
            f"agency {agency!r} of a file in format {kind}; allowed: {about.agency}",
            hint="leave out the agency",
        )
    about.penv_hpa = options.get("penv_hpa")
    rmw, basin = options.get("rmw"), options.get("basin")
    about.rmw = about.rmw if rmw is None else rmw
    about.basin = about.basin if basin is None else basin
    try:
        return FORMATS[looks].parse(text, about, storm, agency)
    except csv.Error as error:
        raise UsageError(
            f"{path.name} cannot be read as CSV: {error}; allowed: rows of text, commas between",
            hint="is it another file?",
        ) from None


def _text(path: Path) -> str:
    """What a file says.

    Raises:
        UsageError: it cannot be read, is no text, or is empty.
    """
    try:
        raw = checked_path(path).read_bytes()
    except OSError as error:
        raise UsageError(
            f"track file {path} cannot be read: {error.strerror or error}; allowed: a text file",
            hint="look at its rights",
        ) from None
    if b"\0" in raw:
        refuse_unread(path.name, raw[:HEAD_BYTES].decode("latin-1"), is_text=False)
        raise UsageError(
            f"track file {path} is no text; allowed: text in UTF-8",
            hint="unpack or export it as CSV; IBTrACS comes as CSV, too",
        )
    text = raw.decode("utf-8-sig", errors="replace")
    if not _head(text):
        raise UsageError(
            f"track file {path} has no rows; allowed: a heading, and a row per point",
            hint="lines that begin with # are comments",
        )
    return text


def _check(path: Path, format: str | None, options: Collection[str]) -> None:
    """Refuses options and formats that do not exist, and a path that is no file."""
    allowed = TrackOptions.__annotations__
    unknown = set(options) - set(allowed)
    if unknown:
        raise UsageError(
            f"option {min(unknown)!r} of a track; allowed: {', '.join(allowed)}",
            hint="averaging_s, format and storm are arguments of their own",
        )
    if format is not None and format not in FORMATS:
        raise UsageError(
            f"track format {format!r}; allowed: {', '.join(FORMATS)}",
            hint="leave it out: files are told apart by their look",
        )
    check_root(path)
    if not path.is_file():
        complaint = "is no file" if path.exists() else "does not exist"
        raise UsageError(f"track file {path} {complaint}", hint="give the path of a file")


def _look(text: str) -> str:
    """The format of a file, from how it begins."""
    head = _head(text)
    return next((name for name, kind in FORMATS.items() if kind.matches(head)), "csv")


def _head(text: str) -> str:
    """The first lines that are no comment, or nothing."""
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return "\n".join(islice(lines, HEAD_LINES))
