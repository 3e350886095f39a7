"""CSV files with a heading: time, lat, lon, pressure_hpa, vmax_mps or vmax_kt, and more.

Lines that begin with `#` are comments. A column `storm` or `name` tells several storms apart. Cells
are separated by commas, or as spreadsheets do it where a comma is the decimal sign: by semicolons
or tabulators.
"""

from __future__ import annotations

import csv

from resilience.errors import CaseError, UsageError
from resilience.fragility.tracks.columns import QUANTITIES, SYNONYMS, About, build
from resilience.fragility.tracks.track import Track
from resilience.inputs import has_decimal_commas, separator_of

MAX_LISTED = 8  # names of storms in a message


def parse(text: str, about: About, storm: str | None) -> Track:
    """One storm of a CSV file.

    Raises:
        CaseError: mistakes in the file.
        UsageError: the storm is not in it, or must be named.
    """
    separator = heading_separator(text)
    rows, numbers = data_rows(text, separator)
    heading = [cell.strip() for cell in rows[0]] if rows else []
    lower = [cell.lower() for cell in heading]
    body = []
    for row, number in zip(rows[1:], numbers[1:], strict=True):
        if len(row) != len(heading):
            about.wrong(
                number,
                "columns",
                len(row),
                f"{len(heading)}, as the heading has",
                "count the separators",
            )
        else:
            body.append((row, number))
    column = next((lower.index(key) for key in ("storm", "name") if key in lower), None)
    if column is None:
        if storm is not None:
            about.name = storm
    else:
        about.name = named_storm([row[column] for row, _ in body], storm, about.file)
        body = [(row, k) for row, k in body if _same(row[column], about.name)]
    if len(set(lower)) < len(lower):
        about.wrong("heading", "columns", "a name twice", "each name once", "rename one of them")
        raise CaseError(about.mistakes, "the track")
    about.rows = [number for _, number in body]
    columns = {key: [row[k] for row, _ in body] for k, key in enumerate(heading)}
    if has_decimal_commas((row for row, _ in body), separator):
        columns = with_points(columns, about)
    return build(columns, about)


def heading_separator(text: str) -> str:
    """What stands between the cells of a file, by its heading."""
    heads = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return separator_of(next(heads, ""))


def with_points(columns: dict[str, list[str]], about: About) -> dict[str, list[str]]:
    """Columns with points for the decimal commas of numbers; points among them are mistakes."""
    changed = dict(columns)
    for heading, cells in columns.items():
        key = SYNONYMS.get(heading.lower(), heading.lower())
        if key not in (*QUANTITIES, "averaging_s"):
            continue
        for number, cell in zip(about.rows or (), cells, strict=True):
            if "." in cell:
                hint = "among decimal commas a point separates thousands, or is a slip"
                about.wrong(number, key, cell, "a number with a decimal comma, or nothing", hint)
        changed[heading] = ["" if "." in cell else cell.replace(",", ".") for cell in cells]
    return changed


def data_rows(text: str, separator: str = ",") -> tuple[list[list[str]], list[int]]:
    """The rows of a CSV file without comments and blanks, and their lines from 1."""
    lines = [
        (line, k)
        for k, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    # Line by line: a stray quotation mark must not swallow the rows below it.
    return [row for line, _ in lines for row in csv.reader([line], delimiter=separator)], [
        k for _, k in lines
    ]


def named_storm(names: list[str], storm: str | None, file: str) -> str:
    """The storm that is meant, of the names in a file.

    Raises:
        UsageError: it is not there, or there are several and none is named.
    """
    distinct = list(dict.fromkeys(name.strip() for name in names))
    more = f" and {len(distinct) - MAX_LISTED} more" if len(distinct) > MAX_LISTED else ""
    listing = ", ".join(distinct[:MAX_LISTED]) + more
    if storm is None and len(distinct) == 1:
        return distinct[0]
    if storm is None:
        raise UsageError(
            f"{file} has {len(distinct)} storms: {listing or 'none'}; allowed: one",
            hint="say which with `storm`",
        )
    matches = [name for name in distinct if _same(name, storm)]
    if not matches:
        raise UsageError(
            f"storm {storm!r} is not in {file}; allowed: {listing or 'none'}",
            hint="an identifier or a name",
        )
    return matches[0]


def _same(name: str, storm: str) -> bool:
    """Whether two names differ in case and blanks only."""
    return name.strip().casefold() == storm.strip().casefold()
