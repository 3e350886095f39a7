"""Best tracks of the China Meteorological Administration: 2-min means, m/s.

The agency's text (tcdata.typhoon.org.cn; Ying et al. 2014, Lu et al. 2021) has a header
`66666 0000 nn ssss cccc f h name date`, nn being the number of rows, and rows
`YYYYMMDDHH grade lat lon pressure wind`, latitude and longitude in 0.1 degrees north and east.
Wind 0 is a gap; 9 stands for less than 10 m/s and is taken as it is.
"""

from __future__ import annotations

import re

from resilience.fragility.tracks.columns import About, build
from resilience.fragility.tracks.plain import named_storm
from resilience.fragility.tracks.track import Track

Row = tuple[list[str], int]


def parse(text: str, about: About, storm: str | None) -> Track:
    """One storm of a file, by name or by international or Chinese number.

    Raises:
        CaseError: mistakes in the storm's rows.
        UsageError: the storm is not in the file, or must be named.
    """
    storms = _storms(text)
    keys = (7, 4, 1)
    key = next((k for k in keys if storm and storm.casefold() in _names(storms, k)), 7)
    name = named_storm([head[key] for head, _ in storms], storm, about.file)
    same = [entry for entry in storms if entry[0][key] == name]
    if len(same) > 1:
        name = named_storm([head[4] for head, _ in same], None, about.file)
    head, rows = same[0]
    about.name = head[7]
    about.source = f"{about.file}: {head[4]}, CMA best track"
    if head[2].lstrip("0") != str(len(rows)):
        about.wrong(
            name,
            "rows",
            len(rows),
            f"{head[2] or 'a number'}, as its header says",
            "rows are missing",
        )
    return build(_columns(rows, about), about)


def _names(storms: list[tuple[list[str], list[Row]]], key: int) -> list[str]:
    return [head[key].casefold() for head, _ in storms]


def _storms(text: str) -> list[tuple[list[str], list[Row]]]:
    """Header of at least nine parts, and rows, of every storm."""
    storms: list[tuple[list[str], list[Row]]] = []
    for number, line in enumerate(text.splitlines(), 1):
        parts = line.split()
        if not parts or line.startswith("#"):
            continue
        if parts[0] == "66666":
            storms.append((_header(parts), []))
        elif storms:
            storms[-1][1].append((parts, number))
    return storms


def _header(parts: list[str]) -> list[str]:
    """Exactly nine parts: the name may be missing, or be more than one word, or all of it cut."""
    parts = parts + [""] * (8 - len(parts))
    if len(parts) == 8:
        return [*parts[:7], "(nameless)", parts[7]]
    return [*parts[:7], " ".join(parts[7:-1]) or "(nameless)", parts[-1]]


def _columns(rows: list[Row], about: About) -> dict[str, list[str]]:
    """Text by column; rows that are none are noted as mistakes."""
    columns: dict[str, list[str]] = {
        key: [] for key in ("time", "lat", "lon", "pressure_hpa", "vmax_mps")
    }
    numbers = []
    for parts, number in rows:
        if len(parts) < 6 or len(parts[0]) != 10:
            about.wrong(
                number,
                "row",
                " ".join(parts),
                "YYYYMMDDHH grade lat lon pressure wind",
                "six parts",
            )
            continue
        numbers.append(number)
        moment, _, lat, lon, pressure, wind = parts[:6]
        columns["time"].append(f"{moment[:4]}-{moment[4:6]}-{moment[6:8]}T{moment[8:]}:00")
        columns["lat"].append(_tenths(lat))
        columns["lon"].append(_tenths(lon))
        columns["pressure_hpa"].append(pressure)
        columns["vmax_mps"].append("" if wind == "0" else wind)
    about.rows = numbers
    return columns


def _tenths(text: str) -> str:
    """`199` as `19.9`; what is no whole number stays, to be reported."""
    is_whole = re.fullmatch(r"-?\d{1,6}", text, re.ASCII)
    return f"{int(text) / 10:.1f}" if is_whole else f"{text}?"
