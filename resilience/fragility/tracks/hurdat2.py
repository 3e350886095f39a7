"""HURDAT2, the best tracks of the National Hurricane Center: 1-min means, knots.

A header `AL092017, HARVEY, 74,` and that many rows: date, time, record, status, latitude,
longitude, wind (kt), pressure (hPa), twelve radii, and since 2021 the radius of maximum wind
(nmi). -99, -999 and 9999 are gaps.
"""

from __future__ import annotations

import re

from resilience.errors import CaseError
from resilience.fragility.tracks.columns import About, build
from resilience.fragility.tracks.plain import named_storm
from resilience.fragility.tracks.track import Track

BASINS = {"AL": "NA", "EP": "EP", "CP": "EP", "WP": "WP"}
PLACE = re.compile(r"(\d+(?:\.\d*)?)\s*([NSEW])", re.IGNORECASE)
Row = tuple[list[str], int]


def parse(text: str, about: About, storm: str | None) -> Track:
    """One storm of a HURDAT2 file, by identifier or name.

    Raises:
        CaseError: mistakes in the storm's rows.
        UsageError: the storm is not in the file, or must be named.
    """
    storms = _storms(text)
    titles = [title for _, title, _, _ in storms]
    by_name = storm is not None and storm.casefold() in [title.casefold() for title in titles]
    names = titles if by_name else [identifier for identifier, _, _, _ in storms]
    name = named_storm(names, storm, about.file)
    same = [entry for entry, key in zip(storms, names, strict=True) if key == name]
    if len(same) > 1:
        name = named_storm([head[0] for head in same], None, about.file)
    identifier, title, count, rows = same[0]
    about.name = title
    about.basin = about.basin or BASINS.get(identifier[:2], "")
    about.source = f"{about.file}: {identifier}, HURDAT2"
    if count != str(len(rows)):
        about.wrong(
            identifier, "rows", len(rows), f"{count}, as its header says", "rows are missing"
        )
    return build(_columns(rows, about), about)


def _storms(text: str) -> list[tuple[str, str, str, list[Row]]]:
    """Identifier, name, number of rows stated, and the rows, of every storm."""
    storms: list[tuple[str, str, str, list[Row]]] = []
    for number, line in enumerate(text.splitlines(), 1):
        parts = [cell.strip() for cell in line.split(",")]
        if not line.strip() or line.startswith("#"):
            continue
        if parts[0][:2].isalpha() and len(parts) >= 3:
            storms.append((parts[0], parts[1], parts[2], []))
        elif storms:
            storms[-1][3].append((parts, number))
    return storms


def _columns(rows: list[Row], about: About) -> dict[str, list[str]]:
    """Text by column; rows that are too short are noted as mistakes."""
    columns: dict[str, list[str]] = {
        key: [] for key in ("time", "lat", "lon", "vmax_kt", "pressure_hpa", "rmw_nmi")
    }
    numbers = []
    for parts, number in rows:
        if len(parts) < 8:
            about.wrong(number, "columns", len(parts), "8 or more", "is it a row of HURDAT2?")
            continue
        numbers.append(number)
        day, hour = parts[0], parts[1]
        columns["time"].append(f"{day[:4]}-{day[4:6]}-{day[6:]}T{hour[:2]}:{hour[2:]}")
        columns["lat"].append(_signed("lat", parts[4], "NS", number, about))
        columns["lon"].append(_signed("lon", parts[5], "EW", number, about))
        columns["vmax_kt"].append(parts[6])
        columns["pressure_hpa"].append(parts[7])
        columns["rmw_nmi"].append(parts[20] if len(parts) > 20 else "")
    about.rows = numbers
    if not numbers and about.mistakes:
        raise CaseError(about.mistakes, "the track")
    return columns


def _signed(key: str, text: str, letters: str, row: int, about: About) -> str:
    """`45.8W` as `-45.8`; nothing, and a mistake, where the hemisphere is missing or another's."""
    match = PLACE.fullmatch(text)
    if match is None or match[2].upper() not in letters:
        allowed = f"degrees and {' or '.join(letters)}, as 45.8{letters[1]}"
        about.wrong(row, key, text or "nothing", allowed, "HURDAT2 has no signs")
        return ""
    return f"{'-' if match[2].upper() == letters[1] else ''}{match[1]}"
