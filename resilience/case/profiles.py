"""Profiles: columns of a file or of the case, cut to the horizon.

A profile file is CSV (also `.csv.gz`) or Parquet. Its first column is `time`, the start of each
slot as ISO date and time without a zone; every other column is one profile, in per unit of the
peak of the device that names it. The step of the file must be the step of the case.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from resilience.arrays import Floats, Times
from resilience.case.document import Finding
from resilience.case.window import Window

Cell = str | float | None
"""Of a column: text in a CSV file, a number or nothing in Parquet."""

MAX_PU = 2.0
"""Most that a profile of a device may ask for, per unit of its peak."""


class ProfileError(Exception):
    """A profile file that cannot be read or does not fit.

    Args:
        key: of `[profiles]`, or the column.
        value: what stands there.
        allowed: what may stand there.
        hint: what to do about it.
    """

    def __init__(self, key: str, value: str, allowed: str, hint: str) -> None:
        super().__init__(key, value, allowed, hint)
        self.finding = (key, value, allowed, hint)


@dataclass
class ProfileFile:
    """The columns of one file, turned into numbers when asked for.

    Attributes:
        times: (rows,) when each slot starts, without a zone.
        raw: the cells of every other column by name, (rows,) each.
    """

    times: Times
    raw: Mapping[str, Sequence[Cell]]
    _numbers: dict[str, Floats] = field(default_factory=dict)

    def column(self, name: str) -> Floats:
        """A column as floats, (rows,); empty cells are NaN."""
        if name not in self._numbers:
            self._numbers[name] = _to_numbers(name, self.raw[name])
        return self._numbers[name]


def read_profile_file(path: Path) -> ProfileFile:
    """A profile file, from memory if it is unchanged.

    Raises:
        ProfileError: it cannot be read.
    """
    if not path.is_file():
        hint = "paths start at the case file's folder"
        raise ProfileError("file", str(path), "a file that exists", hint)
    stat = path.stat()
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=16)
def _read(path: Path, _mtime: int, _size: int) -> ProfileFile:
    if path.suffix == ".parquet":
        return _read_parquet(path)
    if path.name.endswith((".csv", ".csv.gz")):
        return _read_csv(path)
    raise ProfileError("file", path.name, "a .csv, .csv.gz or .parquet file", "convert the file")


def _read_csv(path: Path) -> ProfileFile:
    data = path.read_bytes()
    try:
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode("utf-8-sig")
    except (OSError, EOFError, UnicodeDecodeError) as error:
        hint = f"the file is damaged: {error}"
        raise ProfileError("file", path.name, "UTF-8 text", hint) from None
    rows = [r for r in csv.reader(io.StringIO(text)) if r and not r[0].startswith("#")]
    if not rows or rows[0][0].strip() != "time":
        value = repr(rows[0][0]) if rows else "an empty file"
        hint = "name the column of times `time`"
        raise ProfileError("file", value, "`time` as the first column", hint)
    names = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            value = f"{len(row)} cells in data row {number}"
            allowed = f"{len(names)}, as the header"
            hint = "a comma is missing or too many; decimals take a point"
            raise ProfileError("file", value, allowed, hint)
    cells = zip(*rows[1:], strict=True) if len(rows) > 1 else [()] * len(names)
    columns: dict[str, tuple[str, ...]] = dict(zip(names, cells, strict=True))
    return ProfileFile(_to_times(columns.pop("time")), columns)


def _read_parquet(path: Path) -> ProfileFile:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        hint = f"the file is damaged: {error}"
        raise ProfileError("file", path.name, "a Parquet file", hint) from None
    if "time" not in table.column_names:
        names = ", ".join(table.column_names)
        raise ProfileError("file", names, "a column `time`", "name the column of times `time`")
    times = table.column("time")
    if pa.types.is_timestamp(times.type) and times.type.tz is None:
        stamps = times.cast(pa.timestamp("s")).to_numpy().astype("datetime64[s]")
    else:
        stamps = _to_times(tuple(map(str, times.to_pylist())))
    columns = [name for name in table.column_names if name != "time"]
    return ProfileFile(stamps, {name: table.column(name).to_pylist() for name in columns})


def _to_times(texts: Sequence[str]) -> Times:
    stamps = []
    for row, text in enumerate(texts, start=1):
        try:
            stamp = datetime.fromisoformat(text.strip())
        except ValueError:
            stamp = None
        if stamp is None or stamp.tzinfo is not None:
            value = f"{text!r} in data row {row}"
            hint = "write local times as 2016-07-12 14:30"
            raise ProfileError("time", value, "ISO date and time without a zone", hint)
        stamps.append(stamp)
    return np.array(stamps, dtype="datetime64[s]")


def _to_numbers(name: str, cells: Sequence[Cell]) -> Floats:
    try:
        return np.array([np.nan if c is None else c for c in cells]).astype(np.float64)
    except ValueError:
        pass
    numbers = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if cell is None or not str(cell).strip():
            continue
        try:
            numbers[row] = float(cell)
        except ValueError:
            value, hint = f"{cell!r} in data row {row + 1}", "decimals take a point"
            raise ProfileError(name, value, "a number", hint) from None
    return numbers


def find_window(file: ProfileFile, window: Window) -> slice:
    """The rows that cover the horizon.

    Raises:
        ProfileError: none do exactly.
    """
    times, start = file.times, np.datetime64(window.start)
    _check_step(times, window)
    first = int(np.searchsorted(times, start))
    if first == len(times) or times[first] != start:
        value = f"rows from {times[0]} to {times[-1]}".replace("T", " ")
        hint = "move [time] start, or use other data"
        raise ProfileError("file", value, f"a row at {window.start}", hint)
    if first + window.slots > len(times):
        value = f"{len(times) - first} rows from {window.start} to {times[-1]}".replace("T", " ")
        hint = "shorten [time] slots, or use a longer file"
        raise ProfileError("file", value, f"at least slots = {window.slots}", hint)
    rows = slice(first, first + window.slots)
    step = timedelta(minutes=window.step_min)
    for row, (earlier, later) in enumerate(pairwise(times[rows].tolist()), start=first + 2):
        if later - earlier != step:
            value = f"{later} after {earlier}, data row {row}"
            allowed = f"a step of {window.step_min:g} min"
            raise ProfileError("file", value, allowed, "fill the gap in the file")
    return rows


def _check_step(times: Times, window: Window) -> None:
    if len(times) < 2:
        value, hint = f"{len(times)} rows", "the file holds no time series"
        raise ProfileError("file", value, "one row per slot", hint)
    step_min = float(np.median(np.diff(times).astype(np.int64))) / 60.0
    if step_min != window.step_min:
        allowed = f"step_min = {window.step_min:g}"
        hint = "resample the profiles to the step of the case, or change [time] step_min"
        raise ProfileError("file", f"a time step of {step_min:g} min", allowed, hint)


def read_profiles(
    path: str | None,
    inline: Mapping[str, Sequence[float]],
    window: Window,
    uses: Mapping[str, bool],
) -> tuple[dict[str, Floats], set[str] | None, list[Finding]]:
    """The profiles that a case uses, and all inline ones, cut to the horizon.

    Args:
        path: the profile file, if there is one.
        inline: columns of the case itself, which start with the horizon.
        window: the horizon.
        uses: for the name of each profile that a device follows, whether it is a price.

    Returns:
        The arrays, (slots,) each; the names that exist, `None` where the file cannot be read; and
        what is wrong.
    """
    arrays: dict[str, Floats] = {}
    findings: list[Finding] = []
    names: set[str] | None = set(inline)
    if path:
        names = None
        try:
            file = read_profile_file(Path(path))
            names = set(inline) | set(file.raw)
            rows = find_window(file, window)
            for name in sorted(uses.keys() & file.raw.keys() - inline.keys()):
                arrays[name] = file.column(name)[rows].copy()
        except ProfileError as error:
            findings.append(error.finding)
    for name, values in inline.items():
        if len(values) < window.slots:
            allowed, hint = f"at least slots = {window.slots}", "give one value per slot"
            findings.append((name, f"{len(values)} values", allowed, hint))
        else:
            arrays[name] = np.array(values[: window.slots], dtype=np.float64)
    for name, array in arrays.items():
        array.setflags(write=False)
        is_power = not uses.get(name, True)
        findings.extend(_wrong_values(name, array, window, is_power=is_power))
    return arrays, names, findings


def _wrong_values(
    name: str, values: Floats, window: Window, *, is_power: bool
) -> Iterator[Finding]:
    checks = [(~np.isfinite(values), "NaN or infinite", "finite numbers", "fill the gaps")]
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
