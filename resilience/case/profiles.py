"""Profiles: columns of a file or of the case, cut to the horizon.

A profile file is CSV (also `.csv.gz`) or Parquet. Its first column is `time`, the start of each
slot as ISO date and time without a zone; every other column is one profile, in per unit of the
peak of the device that names it. A slot of the case that covers several rows has their mean; finer
than the file a case cannot be. CSV files with semicolons and decimal commas are read, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from decimal import Decimal
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from resilience.arrays import Floats, Ints, Times
from resilience.case.document import Finding
from resilience.case.schema.fields import MAX_PRICE_PER_MWH
from resilience.case.window import Window
from resilience.errors import UsageError, shortened
from resilience.files import reading
from resilience.inputs import InputFileError, checked_path, read_table, shown_name, to_number

if TYPE_CHECKING:
    import pyarrow as pa

Cell = str | float | None
"""Of a column: text in a CSV file, a number or nothing in Parquet."""

MAX_PU = 2.0
"""Most that a profile of a device may ask for, per unit of its peak."""


class ProfileError(UsageError):
    """A profile file that cannot be read or does not fit.

    Args:
        key: of `[profiles]`, or the column.
        value: what stands there.
        allowed: what may stand there.
        hint: what to do about it.
    """

    def __init__(self, key: str, value: str, allowed: str, hint: str) -> None:
        super().__init__(f"profiles, {key}: {value}; allowed: {allowed}", hint)
        self.finding = self.args = (key, value, allowed, hint)


@dataclass
class ProfileFile:
    """The columns of one file, turned into numbers when asked for.

    Attributes:
        path: of the file.
        times: (rows,) when each slot starts, without a zone.
        raw: the cells of every other column by name, (rows,) each.
        rows: (rows,) the line of a CSV file in which each row stands, from 1; else empty.
        number: what the text of a cell states; None where that is no number.
    """

    path: Path
    times: Times
    raw: Mapping[str, Sequence[Cell]]
    rows: Sequence[int] = ()
    number: Callable[[str], float | None] = to_number
    _numbers: dict[str, Floats] = field(default_factory=dict)

    def place(self, k: int) -> str:
        """Where row `k`, from 0, stands in the file."""
        return f"row {self.rows[k]}" if self.rows else f"data row {k + 1}"

    def column(self, name: str) -> Floats:
        """A column as floats, (rows,); empty cells are NaN."""
        if name not in self._numbers:
            self._numbers[name] = self._to_numbers(name)
        return self._numbers[name]

    def _to_numbers(self, name: str) -> Floats:
        cells = self.raw[name]
        if self.number is to_number and all(isinstance(cell, str) for cell in cells):
            text = "".join(map(str, cells))
            with suppress(ValueError):  # row by row where a cell is empty or wrong
                if text.isascii() and "_" not in text:
                    return np.array(cells).astype(np.float64)
        numbers = np.full(len(cells), np.nan)
        for row, cell in enumerate(cells):
            if isinstance(cell, int | float | Decimal) and not isinstance(cell, bool):
                numbers[row] = cell
            elif cell is not None and cell != "":
                number = self.number(cell) if isinstance(cell, str) else None
                if number is None:
                    value = f"{shortened(repr(cell))} in {self.place(row)}"
                    hint = "decimals take a point, or a comma throughout between semicolons"
                    raise ProfileError(name, value, "a number", hint)
                numbers[row] = number
        return numbers


def read_profile_file(path: Path) -> ProfileFile:
    """A profile file, from memory if it is unchanged.

    Raises:
        ProfileError: it cannot be read.
    """
    try:
        file = checked_path(path)
        stat = file.stat()
        return _read(file, stat.st_mtime_ns, stat.st_size)
    except InputFileError as error:
        wrong = error.mistake
        value = f"{wrong.value} in {wrong.table}" if wrong.table else f"{path} {wrong.value}"
        raise ProfileError("file", value, wrong.allowed, wrong.hint) from None


@lru_cache(maxsize=16)
def _read(path: Path, _mtime: int, _size: int) -> ProfileFile:
    if path.suffix == ".parquet":
        return _read_parquet(path)
    if path.name.endswith((".csv", ".csv.gz")):
        return _read_csv(path)
    raise ProfileError("file", path.name, "a .csv, .csv.gz or .parquet file", "convert the file")


def _read_csv(path: Path) -> ProfileFile:
    table = read_table(path)
    if not table.columns or table.columns[0] != "time":
        value = shortened(repr(table.columns[0])) if table.columns else "an empty file"
        hint = "name the column of times `time`"
        raise ProfileError("file", value, "`time` as the first column", hint)
    columns = {name: table.cells(name) for name in table.columns if name}
    times = _to_times(columns.pop("time"), [f"row {number}" for number in table.numbers])
    return ProfileFile(path, times, columns, table.numbers, table.number)


def _read_parquet(path: Path) -> ProfileFile:
    import pyarrow.parquet as pq

    try:
        with reading(path, "Parquet table"):
            table = pq.read_table(path)
            names = table.column_names
            cells = {name: table.column(name).to_pylist() for name in names if name != "time"}
            stamps = _stamps(table.column("time")) if "time" in names else ()
    except UsageError as error:
        raise ProfileError("file", path.name, "a Parquet file", error.hint) from None
    if "time" not in names:
        value = shortened(", ".join(cells), 200)
        raise ProfileError("file", value, "a column `time`", "name the column of times `time`")
    places = [f"data row {k + 1}" for k in range(len(stamps))]
    if not isinstance(stamps, np.ndarray):
        return ProfileFile(path, _to_times(stamps, places), cells)
    if (missing := np.isnat(stamps)).any():
        value, hint = f"nothing in {places[int(missing.argmax())]}", "leave the row out"
        raise ProfileError("time", value, "a date and time", hint)
    return ProfileFile(path, stamps.astype("datetime64[s]"), cells)


def _stamps(column: pa.ChunkedArray) -> Times | Sequence[str]:
    """The times of a Parquet file; as text where they have a zone or are none."""
    import pyarrow as pa

    if pa.types.is_timestamp(column.type) and column.type.tz is None:
        return cast(Times, column.cast(pa.timestamp("s"), safe=False).to_numpy())
    return tuple(map(str, column.to_pylist()))


def _to_times(texts: Sequence[str], places: Sequence[str]) -> Times:
    stamps = []
    for text, place in zip(texts, places, strict=True):
        try:
            stamp = datetime.fromisoformat(text.strip())
        except ValueError:
            stamp = None
        if stamp is None or stamp.tzinfo is not None:
            value = f"{shortened(repr(text))} in {place}"
            hint = "write local times as 2016-07-12 14:30"
            raise ProfileError("time", value, "ISO date and time without a zone", hint)
        stamps.append(stamp)
    return np.array(stamps, dtype="datetime64[s]")


def find_window(file: ProfileFile, window: Window) -> Ints:
    """(slots, rows of a slot) the rows that cover the horizon.

    Raises:
        ProfileError: none do exactly, or a time of the horizon is there twice.
    """
    times, start = file.times, np.datetime64(window.start)
    per_slot = rows_per_slot(times, window)
    step_min = window.step_min / per_slot
    if not (times == start).any():
        value = f"rows from {times[0]} to {times[-1]}".replace("T", " ")
        hint = "move [time] start, or use other data"
        raise ProfileError("file", value, f"a row at {window.start}", hint)
    rows = np.flatnonzero((times >= start) & (times < np.datetime64(window.stop)))
    _check_once(file, rows)
    step = timedelta(minutes=step_min)
    for row, (earlier, later) in zip(rows[1:], pairwise(times[rows].tolist()), strict=True):
        if later - earlier != step:
            value = f"{later} after {earlier}, {file.place(row)}"
            allowed = f"a step of {step_min:g} min"
            raise ProfileError("file", value, allowed, "fill the gap in the file, or sort it")
    if len(rows) < per_slot * window.slots:
        value = f"{len(rows)} rows from {window.start} to {times[-1]}".replace("T", " ")
        allowed = f"at least slots = {window.slots}"
        allowed += "" if per_slot == 1 else f" of {per_slot} rows"
        raise ProfileError("file", value, allowed, "shorten [time] slots, or use a longer file")
    return rows.reshape(window.slots, per_slot)


def _check_once(file: ProfileFile, rows: Ints) -> None:
    """Refuses times that are there twice: the hour that clocks repeat in autumn tells no slot."""
    times = file.times[rows]
    unique, count = np.unique(times, return_counts=True)
    if (repeated := count > 1).any():
        time = unique[repeated][0]
        both = " and ".join(file.place(row) for row in rows[times == time][:2])
        value = f"{time} in {both}".replace("T", " ")
        hint = "the hour that clocks repeat? write times of a clock without changes, as UTC"
        raise ProfileError("file", value, "every time of the horizon once", hint)


def rows_per_slot(times: Times, window: Window) -> int:
    """How many rows of a file with these times a slot covers.

    Raises:
        ProfileError: no whole number of them.
    """
    if len(times) < 2:
        value, hint = f"{len(times)} rows", "the file holds no time series"
        raise ProfileError("file", value, "one row per slot", hint)
    step_min = float(np.median(np.diff(times).astype(np.int64))) / 60.0
    rows = window.step_min / step_min if step_min > 0.0 else 0.0
    if rows < 1.0 or rows != int(rows):
        allowed = f"step_min = {window.step_min:g}, or a step that divides it"
        hint = "resample the profiles to the step of the case, or change [time] step_min"
        raise ProfileError("file", f"a time step of {step_min:g} min", allowed, hint)
    return int(rows)


def read_profiles(
    path: str | None,
    inline: Mapping[str, Sequence[float]],
    window: Window,
    uses: Mapping[str, bool],
) -> tuple[dict[str, Floats], set[str] | None, list[tuple[str, Finding]]]:
    """The profiles that a case uses, and all inline ones, cut to the horizon.

    Args:
        path: the profile file, if there is one.
        inline: columns of the case itself, which start with the horizon.
        window: the horizon.
        uses: for the name of each profile that a device follows, whether it is a price.

    Returns:
        The arrays, (slots,) each; the names that exist, `None` where the file cannot be read; and
        what is wrong, with the file that it stands in, empty where that is the case's own.
    """
    arrays: dict[str, Floats] = {}
    findings: list[tuple[str, Finding]] = []
    names: set[str] | None = set(inline)
    file_name = shown_name(path) if path else ""
    if path:
        names = None
        try:
            file = read_profile_file(Path(path))
            names = set(inline) | set(file.raw)
            rows = find_window(file, window)
            for name in sorted(uses.keys() & file.raw.keys() - inline.keys()):
                arrays[name] = file.column(name)[rows].mean(axis=1)
        except ProfileError as error:
            findings.append((file_name, error.finding))
    for name, values in inline.items():
        if len(values) < window.slots:
            allowed, hint = f"at least slots = {window.slots}", "give one value per slot"
            findings.append(("", (name, f"{len(values)} values", allowed, hint)))
        else:
            arrays[name] = np.array(values[: window.slots], dtype=np.float64)
    for name, array in arrays.items():
        array.setflags(write=False)
        is_power, source = not uses.get(name, True), "" if name in inline else file_name
        wrong = _wrong_values(
            name, array, window, is_power=is_power, is_price=uses.get(name, False)
        )
        findings += [(source, finding) for finding in wrong]
    return arrays, names, findings


def _wrong_values(
    name: str, values: Floats, window: Window, *, is_power: bool, is_price: bool = False
) -> Iterator[Finding]:
    checks = [(~np.isfinite(values), "NaN or infinite", "finite numbers", "fill the gaps")]
    if is_price:
        limit, hint = MAX_PRICE_PER_MWH, "a profile of prices multiplies those of the grid"
        beyond = np.isfinite(values) & (np.abs(values) > limit)
        checks.append((beyond, f"beyond {limit:,.0f}", f"-{limit:,.0f} to {limit:,.0f}", hint))
    if is_power:
        hint = "consumption and production are both positive here"
        checks.append((values < 0, "negative", "0 or more", hint))
        hint = "divide the column by its peak, and put the peak into p_max_mw"
        checks.append((values > MAX_PU, f"above {MAX_PU:g}", "per unit of the device's peak", hint))
    for wrong, fault, allowed, hint in checks:
        count = int(np.count_nonzero(wrong))
        if count:
            t = int(np.argmax(wrong))
            first = f"the first at {window.time(t):%Y-%m-%d %H:%M} (slot {t + 1}: {values[t]:g})"
            yield name, f"{count} of {len(values)} values {fault}, {first}", allowed, hint
