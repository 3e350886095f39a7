"""Measured load and solar power on one regular grid of times, and a case that follows them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.case.load import load_case
from resilience.case.measured.clock import to_utc
from resilience.case.measured.exports import LOAD, SOLAR, Export, read_export
from resilience.errors import UsageError
from resilience.files import replacing_file

if TYPE_CHECKING:
    import pandas as pd

MISSING = ("", "n/e", "-", "N/A")
"""Cells without a value."""
STEPS_MIN = (15, 30, 60)
LEAST_DAYS = 4  # the last quarter is for tests, and a day of that


@dataclass(frozen=True)
class Measured:
    """Load and solar power.

    Attributes:
        times: (rows,) UTC, when each slot begins; evenly spaced.
        step_min: length of a slot, min.
        mw: series, `load` and `solar`, to (rows,) MW.
        notes: what was done to the files' numbers, in words.
    """

    times: pd.DatetimeIndex
    step_min: float
    mw: Mapping[str, Floats]
    notes: tuple[str, ...] = ()


def read_measured(
    paths: Sequence[str | Path], step_min: float | None = None, area: str | None = None
) -> Measured:
    """Load and solar power from files of any shape of `exports`.

    Args:
        paths: a file that has both, or one of load and one of generation.
        step_min: length of a slot, min; a longer one of a file is divided, its mean power being
            that of every piece. That of the file if omitted.
        area: where a file has several.

    Raises:
        UsageError: a file that cannot be read, gaps, a series that is missing or there twice, or
            no time in common.
    """
    columns: dict[str, pd.Series] = {}
    for path in paths:
        for name, series in _series_of(read_export(Path(path), area)).items():
            if name in columns:
                raise UsageError(
                    f"{path} has {name} again; allowed: once in all files", hint="leave one out"
                )
            columns[name] = series
    return joined_series(", ".join(map(str, paths)), columns, step_min)


def joined_series(
    subject: str, columns: Mapping[str, pd.Series], step_min: float | None = None
) -> Measured:
    """Series over the time that they have in common.

    Args:
        subject: whose, for messages.
        columns: series by name, MW by UTC time.
        step_min: as in `read_measured`.

    Raises:
        UsageError: a series that is missing, no time in common, or other steps than asked for.
    """
    import pandas as pd

    if absent := [name for name in (LOAD, SOLAR) if name not in columns]:
        raise UsageError(
            f"no {' and no '.join(absent)} in {subject}; allowed: both, in one file or two",
            hint="name the file of total load and that of generation per type",
        )
    divided = {name: _divided(name, series, step_min) for name, series in columns.items()}
    table = pd.concat({name: series for name, (series, _) in divided.items()}, axis=1, join="inner")
    if len(table) < 2:
        spans = "; ".join(f"{name} {s.index[0]} to {s.index[-1]}" for name, s in columns.items())
        raise UsageError(f"no time in common: {spans}", hint="export the same days")
    times = pd.DatetimeIndex(table.index)
    mw = {name: table[name].to_numpy(float) for name in (LOAD, SOLAR)}
    notes = tuple(note for _, words in divided.values() for note in words)
    return Measured(times, _step_min(subject, times), mw, notes)


def _series_of(export: Export) -> dict[str, pd.Series]:
    """MW by UTC time of every series of a file, without gaps."""
    import pandas as pd

    missing = {name: cells.isin(MISSING) for name, cells in export.cells.items()}
    is_empty = pd.DataFrame(missing).all(axis=1)
    times = to_utc(export.path, export.starts, export.zone, is_empty)
    there = times.notna().to_numpy()
    index = pd.DatetimeIndex(times[there])
    series = {}
    for name, cells in export.cells.items():
        texts, is_missing = cells[there].to_numpy(), missing[name][there].to_numpy()
        stated = [export.number(text) for text in texts]
        numbers = np.array([np.nan if number is None else number for number in stated], float)
        wrong = ~np.isfinite(numbers) & ~is_missing
        if wrong.any():
            raise UsageError(
                f"{export.path}: {name} {texts[wrong][0]!r} of {index[wrong][0]}; allowed: MW",
                hint="decimals take a point, and thousands nothing",
            )
        series[name] = checked_series(str(export.path), name, pd.Series(numbers, index))
    return series


def checked_series(subject: str, name: str, values: pd.Series) -> pd.Series:
    """MW by time, in order.

    Args:
        subject: whose, for messages.
        name: of the series.
        values: MW by UTC time; NaN where nothing was measured.

    Raises:
        UsageError: times that are there twice, a gap between the first and the last, or less than
            0 MW.
    """
    import pandas as pd

    values = values.sort_index()
    index = pd.DatetimeIndex(values.index)
    if index.has_duplicates:
        twice = index[index.duplicated()]
        raise UsageError(
            f"{subject}: {name} is there more than once at {twice[0]}, {len(twice)} times in all",
            hint="keep the latest version of every row",
        )
    step = _step_min(subject, index)
    slots = (index[-1] - index[0]) / pd.Timedelta(minutes=step) + 1
    if slots > 100 * len(index):
        raise UsageError(
            f"{subject}: {name} has {len(index)} rows between {index[0]} and {index[-1]}; "
            f"allowed: one every {step:g} min",
            hint="is the year of a row wrong?",
        )
    every = pd.date_range(index[0], index[-1], freq=f"{step:g}min")
    filled = values.reindex(every)
    odd = index.difference(every)
    if len(odd) or filled.isna().any():
        first = odd[0] if len(odd) else every[filled.isna().to_numpy()][0]
        raise UsageError(
            f"{subject}: {name} has a gap from {first}, and {int(filled.isna().sum())} slots "
            "without values in all; allowed: none",
            hint="fill them, or leave their days out",
        )
    if (filled < 0).any():
        first = every[(filled < 0).to_numpy()][0]
        raise UsageError(f"{subject}: {name} is negative at {first}; allowed: 0 MW or more")
    return filled


def _step_min(subject: str, index: pd.DatetimeIndex) -> float:
    steps = np.diff(index.to_numpy()).astype("timedelta64[s]").astype(float) / 60.0
    step = float(steps.min()) if len(steps) else 0.0
    if step not in STEPS_MIN:
        raise UsageError(
            f"{subject}: a time step of {step:g} min; allowed: {', '.join(map(str, STEPS_MIN))}",
            hint="export quarters of an hour, or hours",
        )
    return step


def _divided(name: str, series: pd.Series, step_min: float | None) -> tuple[pd.Series, list[str]]:
    """A series at a shorter step; and what was done, in words."""
    import pandas as pd

    begins = pd.DatetimeIndex(series.index)
    step = _step_min(name, begins)
    if step_min is None or step == step_min:
        return series, []
    pieces = step / step_min
    if pieces < 1.0 or pieces != round(pieces):
        raise UsageError(
            f"{name} has slots of {step:g} min, asked for are {step_min:g}; allowed: as long, or "
            "a part of them",
            hint="change [time] step_min of the case",
        )
    n = round(pieces)
    offsets = np.tile(np.arange(n) * np.timedelta64(round(step_min * 60), "s"), len(series))
    index = begins.repeat(n) + offsets
    note = f"{name}: means of {step:g} min, each repeated over {n} slots"
    return pd.Series(series.to_numpy().repeat(n), index), [note]


def write_measured_case(
    base: str | Path, measured: Measured, folder: Path, zone: str = "Europe/Berlin"
) -> Path:
    """Writes a case that follows measured series, and its profiles; the case's file.

    All loads follow the load and all PV the solar power, each per unit of its own maximum. Days
    begin at midnight of the clock that is in force at the first row, which stays as it is: every
    day has 24 hours. What comes before the first midnight and after the last one is left out.

    Args:
        base: a case, by name or file.
        measured: what it is to follow, at its step.
        folder: where `case.toml` is written, after the profiles, which are called after a digest of
            theirs: an earlier case keeps its own until the new one is there.
        zone: whose midnight.

    Raises:
        UsageError: another step than the case's, fewer than four days, or a series without power.
    """
    case = load_case(base)
    if measured.step_min != case.step_min:
        raise UsageError(
            f"profiles of {measured.step_min:g} min for {case.name}; allowed: {case.step_min:g}",
            hint="read them with step_min of the case",
        )
    profiles = _profiles(measured, zone)
    text = profiles.to_csv(index=False, date_format="%Y-%m-%d %H:%M")
    profiles_file = f"profiles-{hashlib.sha256(text.encode()).hexdigest()[:12]}.csv"
    first = profiles["time"].iloc[0]
    loads = [{"name": load.name, "profile": LOAD} for load in case.load]
    plants = [{"name": pv.name, "profile": SOLAR} for pv in case.pv]
    reference = str(case.path) if case.path else case.name
    data: dict[str, Any] = {
        "extends": reference,
        "name": f"{case.name}-measured",
        "description": f"{case.name} on measured load and solar power",
        "time": {"start": first, "slots": case.window.slots_per_day, "step_min": case.step_min},
        "profiles": {"file": profiles_file},
        "load": loads,
        "pv": plants,
    }
    import tomli_w

    with replacing_file(folder / profiles_file) as fresh:
        fresh.write_text(text, encoding="utf-8", newline="")
    with replacing_file(folder / "case.toml") as fresh:
        fresh.write_text(tomli_w.dumps(data), encoding="utf-8")
    for earlier in folder.glob("profiles-*.csv"):
        if earlier.name != profiles_file:
            earlier.unlink()
    return folder / "case.toml"


def _profiles(measured: Measured, zone: str) -> pd.DataFrame:
    """Whole days of `time`, `load` and `solar`, per unit of their maxima."""
    import pandas as pd

    first = measured.times[0].tz_convert(zone)
    local = measured.times.tz_localize(None) + (
        first.tz_localize(None) - measured.times.tz_localize(None)[0]
    )
    per_day = round(24 * 60 / measured.step_min)
    midnights = np.flatnonzero(local == local.normalize())
    days = (len(local) - int(midnights[0])) // per_day if len(midnights) else 0
    if days < LEAST_DAYS:
        raise UsageError(
            f"{days} whole days of load and solar power; allowed: {LEAST_DAYS} or more",
            hint="the paper has two months",
        )
    rows = slice(int(midnights[0]), int(midnights[0]) + days * per_day)
    columns: dict[str, Any] = {"time": local[rows]}
    for name, mw in measured.mw.items():
        peak = float(mw[rows].max())
        if peak <= 0.0:
            raise UsageError(f"{name} is 0 MW throughout; allowed: more", hint="another file?")
        columns[name] = mw[rows] / peak
    return pd.DataFrame(columns)
