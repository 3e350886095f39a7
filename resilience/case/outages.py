"""Outages as text: `6-26@14:00-17:30`, a CSV file with the columns line, start, stop, or none.

A unit may stand in place of a line: `gen3@14:00-17:30`. A name that is both is the line's.

A time is `14:30` (its first occurrence in the horizon), `d2 14:30` (on the horizon's second
calendar day) or a full date and time. `24:00` is midnight at the end of a day.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Protocol

from resilience.case.data import Outage
from resilience.case.networks.network import Network
from resilience.case.window import Window
from resilience.errors import CaseError, Mistake, did_you_mean, shortened
from resilience.inputs import read_table

_TIME = r"(?:\d{4}-\d\d-\d\d[T ]|d\d+ )?\d{1,2}:\d\d(?::\d\d)?"
_TIMES = re.compile(rf"(?P<start>{_TIME})\s*-\s*(?P<stop>{_TIME})", re.ASCII)
_CLOCK = re.compile(r"(?:d(?P<day>\d{1,9}) )?(?P<h>\d{1,2}):(?P<m>\d\d)(?::(?P<s>\d\d))?", re.ASCII)
_COLUMNS = ("line", "start", "stop")
_FORM = "LINE@START-STOP, as in 6-26@14:00-17:30"
LINE_OR_UNIT = "a line of the network, or a unit"


OutageWords = str | tuple[str, str | datetime, str | datetime]
"""`6-26@14:00-17:30`, or its three parts."""


def in_words(entry: OutageWords | object) -> str:
    """An outage as text, `LINE@START-STOP`; what is none comes back as text that is refused."""
    if not (isinstance(entry, tuple | list) and len(entry) == 3):
        return str(entry)
    line, *times = entry
    start, stop = (f"{t:%Y-%m-%d %H:%M:%S}" if isinstance(t, datetime) else str(t) for t in times)
    return f"{line}@{start}-{stop}"


class HasHorizon(Protocol):
    """Anything with a network, units and a horizon; a `Case` is one."""

    @property
    def network(self) -> Network:
        """The network whose lines go out."""

    @property
    def units(self) -> Collection[str]:
        """Names of the devices that may be out of order, too."""

    @property
    def window(self) -> Window:
        """The horizon."""


@dataclass(frozen=True)
class WrittenOutage:
    """One outage as text.

    Attributes:
        where: it stands: `outages #2`, `row 3`.
        text: all of it.
        line: name of the line, or of the unit.
        start: time at which it begins.
        stop: time at which it ends.
    """

    where: str
    text: str
    line: str
    start: str
    stop: str


class _TimeError(Exception):
    """What is wrong with the times of an outage: `(allowed, hint)`."""


def parse_outages(text: str | Path | Sequence[OutageWords], case: HasHorizon) -> tuple[Outage, ...]:
    """Outages for a case from text (comma or semicolon separated), a CSV file, or `none`.

    A list of texts, as a case file has it, is taken, too, and of tuples
    `("6-26", "14:00", "17:30")`, in which times may be `datetime`.

    Raises:
        CaseError: every mistake in them.
        UsageError: the file cannot be read; the row is named.
    """
    if not isinstance(text, str | Path):
        specs, mistakes = split_specs(map(in_words, text), "outages", "outages")
        file = "outages"
    elif isinstance(text, Path) or text.strip().lower().endswith(".csv"):
        specs, mistakes = _read_csv(Path(str(text).strip()))
        file = str(text)
    elif text.strip().lower() in ("", "none"):
        return ()
    else:
        specs, mistakes = split_specs(re.split(r"[,;]", text), "outages", "outages")
        file = "outages"
    outages, more = place_outages(specs, file, case.network, case.window, case.units)
    if mistakes or more:
        raise CaseError([*mistakes, *more])
    return outages


def split_specs(
    texts: Iterable[str], file: str, table: str
) -> tuple[list[WrittenOutage], list[Mistake]]:
    """Outages as written, split into their parts, and mistakes: those that have another form."""
    specs, mistakes = [], []
    for number, text in enumerate(texts, start=1):
        line, _, times = text.strip().rpartition("@")
        match = _TIMES.fullmatch(times.strip())
        if match is None or not line.strip():
            hint, value = "write the line's name, @, and two times as HH:MM", shortened(repr(text))
            mistakes.append(Mistake(file, table, f"#{number}", value, _FORM, hint))
        else:
            where = f"{table} #{number}"
            specs.append(WrittenOutage(where, text.strip(), line.strip(), *match.groups()))
    return specs, mistakes


def _read_csv(path: Path) -> tuple[list[WrittenOutage], list[Mistake]]:
    table = read_table(path, is_padded=True)
    if missing := [column for column in _COLUMNS if column not in table.columns]:
        value = shortened(", ".join(table.columns)) or "no columns"
        allowed, hint = ", ".join(_COLUMNS), "the first row of the file names the columns"
        return [], [Mistake(table.name, "header", missing[0], value, allowed, hint)]
    return [
        WrittenOutage(
            f"row {number}",
            f"{row['line']}@{row['start']}-{row['stop']}",
            *(row[column] for column in _COLUMNS),
        )
        for number, row in zip(table.numbers, table.records(), strict=True)
    ], []


def place_outages(
    specs: Iterable[WrittenOutage],
    file: str,
    network: Network | None,
    window: Window | None,
    units: Collection[str] = (),
) -> tuple[tuple[Outage, ...], list[Mistake]]:
    """Written outages as slots, and mistakes: what cannot be placed and why.

    Either of `network` and `window` may be missing: what needs it is then not checked.
    """
    outages, mistakes = [], []
    for spec in specs:
        is_unit = spec.line in units
        if network is not None and not (is_unit or network.has_line(spec.line)):
            allowed, hint = LINE_OR_UNIT, element_hint(spec.line, network, units)
            value = shortened(repr(spec.line))
            mistakes.append(Mistake(file, spec.where, "line", value, allowed, hint))
        if window is None:
            continue
        try:
            first, stop = _slots(spec, window)
        except _TimeError as error:
            allowed, hint = error.args
            value = shortened(repr(spec.text))
            mistakes.append(Mistake(file, spec.where, "", value, allowed, hint))
        else:
            outages.append(Outage(spec.line, first, stop))
    return tuple(outages), mistakes


def element_hint(name: str, network: Network, units: Collection[str]) -> str:
    """What to write instead of a name that is neither a line's nor a unit's."""
    close = did_you_mean(name, units)
    return close if close.startswith("did you mean") else network.line_hint(name)


def _slots(spec: WrittenOutage, window: Window) -> tuple[int, int]:
    start = _time(spec.start, window, None)
    stop = _time(spec.stop, window, start)
    if stop <= start:
        hint = "swap the two times, or mark the day: 22:00-d2 02:00"
        raise _TimeError("an end after the start", hint)
    first, last = window.span(start, stop)
    if first >= last:
        raise _TimeError(f"times within the horizon, {window}", "move the outage or the horizon")
    return first, last


def _time(text: str, window: Window, after: datetime | None) -> datetime:
    """The time that a text means; `after` is the start of the outage when `text` is its end."""
    match = _CLOCK.fullmatch(text)
    try:
        if match is None:
            return _local(datetime.fromisoformat(text))
        hours, minutes, seconds = (int(match[k] or 0) for k in "hms")
        if (hours, minutes, seconds) > (24, 0, 0) or minutes > 59 or seconds > 59:
            raise ValueError
    except ValueError:
        allowed, hint = f"times as HH:MM, not {text!r}", "hours run to 24, minutes to 59"
        raise _TimeError(allowed, hint) from None
    midnight = window.start.replace(hour=0, minute=0, second=0, microsecond=0)
    clock = timedelta(hours=hours, minutes=minutes, seconds=seconds)
    if match["day"] is not None:
        return _on_day(midnight + clock, int(match["day"]), window)
    if after is not None and window.longer_than_a_day:
        return after.replace(hour=0, minute=0, second=0, microsecond=0) + clock
    when = midnight + clock
    too_early = when <= window.start if after is not None else when < window.start
    return when + timedelta(days=1) if too_early else when


def _local(when: datetime) -> datetime:
    """A time without a zone; with one, it is refused."""
    if when.tzinfo is not None:
        allowed, hint = "a time without offset", "outages are in the case's local time"
        raise _TimeError(allowed, hint)
    return when


def _on_day(when: datetime, day: int, window: Window) -> datetime:
    """A time of the first day as that of another day, 1 for the first."""
    try:
        return when + timedelta(days=day - 1)
    except OverflowError:
        allowed, hint = f"times within the horizon, {window}", "d2 is its second day"
        raise _TimeError(allowed, hint) from None


def outage_texts(outages: Iterable[Outage], window: Window) -> list[str]:
    """Outages as a case file and `--outages` have them: the inverse of reading them."""
    return [
        f"{outage.line}@{window.label(outage.first)}-{_end_text(outage.stop, window)}"
        for outage in outages
    ]


def _end_text(stop: int, window: Window) -> str:
    """When slot `stop` begins; midnight is `24:00` of the day that ends."""
    end = window.time(stop)
    if end.time() != time():
        return window.text(end)
    *day, _ = window.label(stop - 1).split(" ")
    return " ".join([*day, "24:00"])
