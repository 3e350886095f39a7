"""IBTrACS version 4 CSV: every agency's best track side by side, winds in knots.

A heading, a row of units, and a row per storm and time; a spreadsheet may have put semicolons
between the cells, and decimal commas in them. `WMO_WIND` is that of the agency responsible for the
basin, named row by row in `WMO_AGENCY`; other columns begin with the agency. Averaging times follow
from the agency. Rows of spurs, and rows for which the chosen agency says neither wind nor pressure,
are left out; a place the agency does not say is IBTrACS' own.
"""

from __future__ import annotations

import re

from resilience.earth.averaging import AGENCIES
from resilience.errors import UsageError
from resilience.fragility.tracks.columns import About, build
from resilience.fragility.tracks.fill import PENV_HPA
from resilience.fragility.tracks.plain import (
    data_rows,
    heading_separator,
    named_storm,
    with_points,
)  # fmt: skip
from resilience.fragility.tracks.track import Track
from resilience.inputs import has_decimal_commas

RESPONSIBLE = {
    "hurdat_atl": "usa",
    "hurdat_epa": "usa",
    "atcf": "usa",
    "cphc": "usa",
    **{name: name for name in AGENCIES},
}
UNITS = {"WIND": "kts", "PRES": "mb", "RMW": "nmile", "POCI": "mb"}
Row = dict[str, str]


def parse(text: str, about: About, storm: str | None, agency: str | None) -> Track:
    """One storm of a file, by identifier (SID), name, or `NAME 2023`.

    Raises:
        CaseError: mistakes in the storm's rows, or units other than IBTrACS'.
        UsageError: the storm is not in the file, or must be named; no such agency.
    """
    separator = heading_separator(text)
    rows, numbers = data_rows(_narrowed(text, storm), separator)
    heading = [cell.strip().upper() for cell in rows[0]]
    if not {"SID", "ISO_TIME"} <= set(heading):
        raise UsageError(
            f"{about.file} has a heading with a stray quotation mark; allowed: columns SID, "
            "ISO_TIME and those of agencies",
            hint="take IBTrACS' own file",
        )
    table = [
        (dict(zip(heading, row, strict=False)), k) for row, k in zip(rows, numbers, strict=True)
    ]
    units = [row for row, _ in table[1:2] if not row.get("SID", "").strip()]
    body = [(row, k) for row, k in table[1 + len(units) :] if _main(row)]
    body = _storm(body, storm, about)
    who = _agency(body, agency, about.file)
    for unit_row in units:
        _check_units(unit_row, who, about)
    body = [(row, k) for row, k in body if _says(row, f"{who}_WIND") or _says(row, f"{who}_PRES")]
    about.agency = _agency_name(body, who, about)
    basin = body[0][0].get("BASIN", "").strip() if body else ""
    about.basin = about.basin or (basin if basin in PENV_HPA else "")
    about.source = f"{about.file}: {about.source}, IBTrACS, {who.lower()}"
    about.rows = [k for _, k in body]
    columns = _columns(body, who)
    if has_decimal_commas(columns.values(), separator):
        columns = with_points(columns, about)
    return build(_with_sound_environment(columns), about)


def _narrowed(text: str, storm: str | None) -> str:
    """The text without lines of other storms, as blanks: the archive has 700,000 lines.

    Nothing is left out where no line matches, so that the error can say which storms there are.
    """
    if storm is None:
        return text
    key = re.sub(r"\s+\d{4}$", "", storm.strip()).casefold()
    lines, headings = text.splitlines(), 0
    is_named = False
    for k, line in enumerate(lines):
        if headings < 2 and line.strip() and not line.startswith("#"):
            headings += 1
        elif key in line.casefold():
            is_named = True
        else:
            lines[k] = ""
    return "\n".join(lines) if is_named else text


def _main(row: Row) -> bool:
    return not row.get("TRACK_TYPE", "").strip().lower().startswith("spur")


def _says(row: Row, key: str) -> bool:
    return bool(row.get(key, "").strip())


def _storm(body: list[tuple[Row, int]], storm: str | None, about: About) -> list[tuple[Row, int]]:
    """The rows of one storm; its name and identifier go to `about`."""
    titles = {}
    for row, _ in body:
        sid, name = row["SID"].strip(), row.get("NAME", "").strip()
        titles[sid] = (sid, name, f"{name} {row.get('SEASON', '').strip()}")
    names = [sid for sid, title in titles.items() if storm is None or _in(storm, title)]
    if storm is not None and not names:
        named_storm([title[2] for title in titles.values()], storm, about.file)
    if len(names) > 1:
        raise UsageError(
            f"{about.file} has {len(names)} storms{f' {storm!r}' if storm else ''}, among them "
            f"{', '.join(titles[sid][2] + ' = ' + sid for sid in names[:6])}; allowed: one",
            hint="say which with `storm`: identifier, name, or name and season",
        )
    sid = names[0] if names else ""
    about.name, about.source = titles[sid][1] if names else "", sid
    return [(row, k) for row, k in body if row["SID"].strip() == sid]


def _in(storm: str, title: tuple[str, ...]) -> bool:
    return storm.strip().casefold() in [text.casefold() for text in title]


def _agency(body: list[tuple[Row, int]], agency: str | None, file: str) -> str:
    """Prefix of the columns to read."""
    names = [name.upper() for name in (*AGENCIES, "wmo")]
    have, pressures = (
        {who: sum(_says(row, f"{who}_{key}") for row, _ in body) for who in names}
        for key in ("WIND", "PRES")
    )
    if agency is not None and agency.upper() in have:
        return agency.upper()
    if agency is not None:
        there = ", ".join(who.lower() for who in names if have[who])
        raise UsageError(
            f"agency {agency!r}; allowed: those of {file}: {there or 'none'}",
            hint="usa has 1-min winds, cma 2-min, most others 10-min",
        )
    if body and not any([*have.values(), *pressures.values()]):
        raise UsageError(
            f"{file} has no agency's winds or pressures; allowed: columns as USA_WIND, CMA_PRES",
            hint="columns WIND and PRES alone do not say whose they are; take IBTrACS' own file",
        )
    return (
        "USA"
        if 2 * have["USA"] >= len(body)
        else max(have, key=lambda who: (have[who], pressures[who]))
    )


def _agency_name(body: list[tuple[Row, int]], who: str, about: About) -> str:
    """The agency's name; that of `WMO` columns is in the rows, and must be one."""
    if who != "WMO":
        return who.lower()
    stated = {row.get("WMO_AGENCY", "").strip().lower() for row, _ in body} - {""}
    agencies = {RESPONSIBLE.get(name, "") for name in stated}
    if len(agencies) != 1 or agencies == {""}:
        about.wrong(
            "track",
            "WMO_AGENCY",
            ", ".join(sorted(stated)) or "nothing",
            "one agency, whose averaging time is known",
            f"choose the columns of one with `agency`: {', '.join(AGENCIES)}",
        )
        return "usa"
    return agencies.pop()


def _check_units(units: Row, who: str, about: About) -> None:
    for key, unit in UNITS.items():
        stated = units.get(f"{who}_{key}", unit).strip()
        if stated and stated != unit:
            about.wrong("row 2", f"{who}_{key}", stated, unit, "is it IBTrACS version 4?")


def _columns(body: list[tuple[Row, int]], who: str) -> dict[str, list[str]]:
    """Text by column of an agency; a place that it does not say is IBTrACS' own."""

    def place(row: Row, key: str) -> str:
        return row[f"{who}_{key}"] if _says(row, f"{who}_{key}") else row.get(key, "")

    columns = {
        "time": [row.get("ISO_TIME", "") for row, _ in body],
        "lat": [place(row, "LAT") for row, _ in body],
        "lon": [place(row, "LON") for row, _ in body],
    }
    headings = {"vmax_kt": "WIND", "pressure_hpa": "PRES", "rmw_nmi": "RMW", "penv_hpa": "POCI"}
    for target, key in headings.items():
        columns[target] = [row.get(f"{who}_{key}", "") for row, _ in body]
    return columns


def _with_sound_environment(columns: dict[str, list[str]]) -> dict[str, list[str]]:
    """Without closed isobars below the centre's own pressure: an agency's slips."""
    pairs = zip(columns["penv_hpa"], columns["pressure_hpa"], strict=True)
    penv = ["" if _below(penv, pressure) else penv for penv, pressure in pairs]
    return columns | {"penv_hpa": penv}


def _below(penv: str, pressure: str) -> bool:
    """Whether the environment's pressure is stated and not above the centre's."""
    try:
        return float(penv) <= float(pressure)
    except ValueError:
        return False
