"""Named columns to a track: units by name, every mistake at once, gaps filled.

All readers end here, and so does a storm stated in a case. A column's name carries its unit:
`vmax_mps`, `vmax_kt`, `vmax_kmh`, `rmw_km`, `rmw_nmi`, `pressure_hpa`, `penv_hpa`; `time`, `lat`,
`lon` and the usual variants of these names are known too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, TypedDict, Unpack

import numpy as np

from resilience.arrays import Floats, Ints, Times
from resilience.earth.averaging import AGENCIES, KNOT_MPS, NAUTICAL_MILE_KM
from resilience.errors import CaseError, Mistake
from resilience.fragility.tracks.checks import mistakes
from resilience.fragility.tracks.fill import FillSettings, with_gaps_filled
from resilience.fragility.tracks.track import Track

QUANTITIES: dict[str, tuple[str, float]] = {
    "lat": ("lat", 1.0),
    "lon": ("lon", 1.0),
    "pressure_hpa": ("pressure_hpa", 1.0),
    "vmax_mps": ("vmax_mps", 1.0),
    "vmax_kt": ("vmax_mps", KNOT_MPS),
    "vmax_kmh": ("vmax_mps", 1.0 / 3.6),
    "vmax_mph": ("vmax_mps", 0.44704),
    "rmw_km": ("rmw_km", 1.0),
    "rmw_nmi": ("rmw_km", NAUTICAL_MILE_KM),
    "penv_hpa": ("penv_hpa", 1.0),
}
SYNONYMS: dict[str, str] = {
    "time_utc": "time",
    "iso_time": "time",
    "datetime": "time",
    "lat_deg": "lat",
    "latitude": "lat",
    "lon_deg": "lon",
    "longitude": "lon",
    "central_pressure_hpa": "pressure_hpa",
    "pc_hpa": "pressure_hpa",
    "vmax_ms": "vmax_mps",
    "max_sustained_wind_ms": "vmax_mps",
    "max_sustained_wind_kt": "vmax_kt",
    "vmax_kn": "vmax_kt",
    "environmental_pressure_hpa": "penv_hpa",
}
FIELDS = ("lat", "lon", "pressure_hpa", "vmax_mps", "rmw_km", "penv_hpa")
NAMES = [key for key in QUANTITIES if key not in ("lat", "lon")]
UNITLESS = ("vmax", "wind", "vm", "pressure", "pc", "pres", "rmw", "penv")
QUANTITY_LIKE = re.compile("vmax|wind|pressure|rmw|penv")
QUANTITY_WORDS = {"vm", "pc", "pres", "msw", "mslp", "pmin", "poci", "rmax"}
QUALIFIERS = {"direction", "dir", "radii", "source", "quality", "flag", "note"}
DATE = re.compile(r"\s*\d{4}-\d{2}-\d{2}")
EMPTY = ("", "na", "n/a", "nan", "none", "-")
GAPS = (-99.0, -999.0, -9999.0, 9999.0)  # in agencies' files; a longitude may well be -99


@dataclass
class About:
    """What is known of a track besides its rows.

    Attributes:
        file: name for messages.
        name, source: of the storm, of the analysis.
        averaging_s: of the wind, s; None if unknown, an error unless a column or the agency
            says it. It must not contradict them.
        agency: a name of `AGENCIES`, or empty.
        basin: NA, EP, SA, NI, SI, WP or SP, for the environment's pressure; or empty.
        penv_hpa: pressure of the environment where no column says it; by basin if None.
        rmw: regression for a missing radius of maximum wind, a name of `RADII`.
        rows: (n,) line of the file of each row, for messages; from 1 if omitted.
        fixed_units: the file's format fixes the unit of winds.
        mistakes: noted so far.
    """

    file: str = "track"
    name: str = ""
    source: str = ""
    averaging_s: float | None = None
    agency: str = ""
    basin: str = ""
    penv_hpa: float | None = None
    rmw: str = "ibtracs"
    rows: Sequence[int] | None = None
    fixed_units: bool = False
    mistakes: list[Mistake] = field(default_factory=list)

    def wrong(self, row: int | str, key: str, value: object, allowed: str, hint: str) -> None:
        """Notes a mistake."""
        where = f"row {row}" if isinstance(row, int | np.integer) else row
        self.mistakes.append(Mistake(self.file, where, key, str(value), allowed, hint))


class TrackFacts(TypedDict, total=False):
    """What is known of a track besides its columns; see `About`."""

    file: str
    name: str
    source: str
    averaging_s: float | None
    agency: str
    basin: str
    penv_hpa: float | None
    rmw: str
    rows: Sequence[int] | None


def track_of(columns: Mapping[str, Sequence[Any]], **about: Unpack[TrackFacts]) -> Track:
    """A track from columns of numbers or text.

    Args:
        columns: (n,) each, by name: `time` (ISO 8601 or datetime, UTC unless it says otherwise),
            `lat`, `lon`, and `pressure_hpa` or `vmax_mps` (`vmax_kt`, `vmax_kmh`) or both; maybe
            `rmw_km` (`rmw_nmi`), `penv_hpa`, `averaging_s`. None, NaN and empty text are gaps.
        about: fields of `About`: `averaging_s` (mandatory unless a column or `agency` says it),
            `name`, `source`, `basin`, `penv_hpa`, `rmw`.

    Raises:
        CaseError: any mistake; all of them are listed, by row.
        UsageError: an unknown regression or basin.
    """
    return build(columns, About(**about))


def build(columns: Mapping[str, Sequence[Any]], about: About) -> Track:
    """As `track_of`, with what a reader knows of the file."""
    named = _named(columns, about)
    n = len(named["time"])
    rows: Ints = np.arange(1, n + 1) if about.rows is None else np.asarray(about.rows, np.intp)
    time = _times(named["time"], rows, about)
    fields = {key: np.full(n, np.nan) for key in FIELDS}
    for key, (target, scale) in QUANTITIES.items():
        if key in named:
            fields[target] = scale * _numbers(key, named[key], rows, about)
    about.averaging_s = _averaging(named, rows, about)
    reported = {(mistake.table, mistake.key) for mistake in about.mistakes}
    more = mistakes(
        about.file, time, fields, rows, about.averaging_s, about.agency,
        fixed_units=about.fixed_units,
    )  # fmt: skip
    about.mistakes += [m for m in more if (m.table, m.key) not in reported]
    if about.mistakes:
        raise CaseError(sorted(about.mistakes, key=_row), "the track")
    return _finished(time, fields, about)


def _row(mistake: Mistake) -> int:
    """Order of mistakes: those of the whole file, then row by row."""
    _, _, row = mistake.table.partition("row ")
    return int(row) if row.isdigit() else 0


def _finished(time: Times, fields: dict[str, Floats], about: About) -> Track:
    """The track of fields without mistakes, longitudes from -180 to 180, gaps filled."""
    fields["lon"] = np.where(fields["lon"] > 180.0, fields["lon"] - 360.0, fields["lon"])
    seconds = (time - time[0]).astype("timedelta64[s]").astype(float)
    assert about.averaging_s is not None  # a mistake otherwise
    settings = FillSettings(about.averaging_s, about.agency, about.basin, about.penv_hpa, about.rmw)
    complete, notes = with_gaps_filled(fields | {"seconds": seconds}, settings)
    del complete["seconds"]
    return Track(
        about.name,
        about.source or about.file,
        time,
        **complete,
        averaging_s=float(about.averaging_s),
        filled=notes,
        agency=about.agency,
    )


def _named(columns: Mapping[str, Sequence[Any]], about: About) -> dict[str, Sequence[Any]]:
    """The columns that are known, by their one name; mistakes in the heading are noted."""
    named: dict[str, Sequence[Any]] = {}
    source: dict[str, str] = {}
    for heading, values in columns.items():
        key = heading.strip().lower()
        key = SYNONYMS.get(key, key)
        target = QUANTITIES.get(key, (key, 1.0))[0]
        if target in source:
            about.wrong(
                "heading",
                heading,
                f"besides {source[target]!r}",
                "one of them",
                "they say the same",
            )
            continue
        if _is_meant(key):
            problem = "no unit" if key in UNITLESS else "an unknown name"
            hint = "units stand in the name; call a column that means something else otherwise"
            about.wrong("heading", heading, problem, f"one of {', '.join(NAMES)}", hint)
        if key in QUANTITIES or key in ("time", "averaging_s"):
            source[target] = heading
            named[key] = values
    missing = [key for key in ("time", "lat", "lon") if key not in named]
    for key in missing:
        about.wrong("heading", key, "no such column", f"a column {key}", "columns need a heading")
    if len({len(values) for values in named.values()}) > 1:
        lengths = ", ".join(f"{key} {len(values)}" for key, values in named.items())
        about.wrong(
            "heading", "columns", lengths, "columns of one length", "fill gaps with nothing"
        )
        missing.append("length")
    if missing:
        raise CaseError(about.mistakes, "the track")
    return named


def _is_meant(key: str) -> bool:
    """Whether an unknown name looks like a wind, a pressure or a radius of maximum wind."""
    words = set(re.split(r"[^a-z]+", key))
    if key in QUANTITIES or words & QUALIFIERS:
        return False
    return bool(QUANTITY_LIKE.search(key) or words & QUANTITY_WORDS)


def _times(values: Sequence[Any], rows: Ints, about: About) -> Times:
    """(n,) times of a column, NaT where they cannot be read, which is noted as a mistake."""
    times = np.full(len(values), "NaT", "datetime64[s]")
    for k, value in enumerate(values):
        try:
            times[k] = _moment(value)
        except ValueError:
            about.wrong(
                int(rows[k]), "time", value, "a time as 2014-07-18T06:00Z", "times are in UTC"
            )
    return times


def _moment(value: Any) -> np.datetime64:
    """Accepts text, datetime and datetime64; what has no zone is UTC."""
    if isinstance(value, str):
        if not DATE.match(value):  # nor eight digits nor a week, which Python takes for one
            raise ValueError(value)
        value = datetime.fromisoformat(value.strip())
    if isinstance(value, datetime):
        value = value.astimezone(UTC).replace(tzinfo=None) if value.tzinfo else value
    moment = np.datetime64(value, "s")
    if np.isnat(moment):
        raise ValueError(value)
    return moment


def _numbers(key: str, values: Sequence[Any], rows: Ints, about: About) -> Floats:
    """(n,) numbers of a column, NaN in gaps; what is no number is noted as a mistake."""
    numbers = np.full(len(values), np.nan)
    for k, value in enumerate(values):
        text = "" if value is None else str(value).strip()
        if text.lower() in EMPTY:
            continue
        try:
            number = float(text)
            if not np.isfinite(number):
                raise ValueError(text)
        except ValueError:
            about.wrong(int(rows[k]), key, value, "a number, or nothing", "a point is the decimal")
            continue
        if key == "lon" or number not in GAPS:
            numbers[k] = number
    return numbers


def _averaging(named: Mapping[str, Sequence[Any]], rows: Ints, about: About) -> float | None:
    """The averaging time, from the column, the caller and the agency; they must agree."""
    stated = set()
    if "averaging_s" in named:
        column = _numbers("averaging_s", named["averaging_s"], rows, about)
        stated = set(column[~np.isnan(column)].tolist())
    if about.averaging_s is not None:
        stated.add(float(about.averaging_s))
    source = AGENCIES.get(about.agency)
    if about.agency and source is None:
        hint = "leave it out where none of these made the winds"
        about.wrong("track", "agency", about.agency, ", ".join(AGENCIES), hint)
    allowed = f"{source.averaging_s:g}, as {about.agency}" if source else "one averaging time"
    if len(stated) > 1 or (source and stated - {source.averaging_s}):
        values = ", ".join(f"{value:g}" for value in sorted(stated))
        hint = "leave it out: the agency's is known" if source else "convert one of them first"
        about.wrong("track", "averaging_s", values, allowed, hint)
    return source.averaging_s if source else min(stated, default=None)
