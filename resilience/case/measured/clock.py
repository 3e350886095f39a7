"""When a row of an export begins: from local text to UTC, with the hours of clock changes named."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from resilience.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd

ZONES = {
    "UTC": "UTC",
    "CET/CEST": "Europe/Berlin",
    "EET/EEST": "Europe/Helsinki",
    "WET/WEST": "Europe/Lisbon",
}
"""What exports call a clock, and where it is read off; all zones of a name change it together."""
ROW = (
    r"^(?P<day>\d\d)[./](?P<month>\d\d)[./](?P<year>\d{4}) (?P<clock>\d\d:\d\d)(?::\d\d)?"
    r"(?: \((?P<mark>\w+)\))?(?: - .*?(?:\((?P<zone>[\w/]+)\))?)?$"
)
SUMMER = ("CEST", "EEST", "WEST")


def to_utc(path: Path, starts: pd.Series[str], zone: str, is_empty: pd.Series[bool]) -> pd.Series:
    """When slots begin, in UTC; NaT for rows without values whose hour the clock leaves out.

    Args:
        path: of the file, for messages.
        starts: (rows,) as `01.07.2022 00:00 - 01.07.2022 00:15`, `26/10/2025 02:00:00 (CEST) - ...`
            or `2022-06-30 22:00:00`.
        zone: the clock of all rows, a key of `ZONES`; empty: every row says it at its end.
        is_empty: (rows,) whether a row has no values.

    Raises:
        UsageError: a text or clock that is not known; an hour that the clock leaves out, with
            values; or one that it repeats, without telling which is which.
    """
    import pandas as pd

    split = starts.str.extract(ROW)
    is_local = split["clock"].notna()
    if not is_local.any() and zone == "UTC":
        return _iso(path, starts)
    if not is_local.all():
        row = int((~is_local).to_numpy().argmax())
        raise UsageError(
            f"{path}: time {starts.iloc[row]!r} in data row {row + 1}; allowed: "
            "`01.07.2022 00:00 - 01.07.2022 00:15`, or the same with slashes",
            hint="export the file again, as CSV",
        )
    names = {zone} if zone else set(split["zone"].fillna(""))
    if len(names) != 1 or not names <= set(ZONES):
        raise UsageError(
            f"{path}: times of the clock {', '.join(sorted(names)) or 'none'}; allowed: "
            f"{', '.join(ZONES)}",
            hint="export the file in UTC or CET/CEST",
        )
    text = split["year"] + "-" + split["month"] + "-" + split["day"] + " " + split["clock"]
    naive = pd.to_datetime(text, format="%Y-%m-%d %H:%M", errors="coerce")
    if naive.isna().any():
        row = int(naive.isna().to_numpy().argmax())
        raise UsageError(f"{path}: {starts.iloc[row]!r} in data row {row + 1} is no time")
    return _localised(path, naive, ZONES[names.pop()], split["mark"], is_empty)


def _iso(path: Path, starts: pd.Series[str]) -> pd.Series:
    import pandas as pd

    times = pd.to_datetime(starts, utc=True, errors="coerce", format="ISO8601")
    if times.isna().any():
        row = int(times.isna().to_numpy().argmax())
        raise UsageError(
            f"{path}: time {starts.iloc[row]!r} in data row {row + 1}; allowed: ISO date and time"
        )
    return times


def _localised(
    path: Path, naive: pd.Series, zone: str, mark: pd.Series[str], is_empty: pd.Series[bool]
) -> pd.Series:
    """Naive local times in UTC; of an hour that is repeated, the first is summer without marks."""
    left_out = naive.dt.tz_localize(zone, ambiguous=True, nonexistent="NaT").isna()
    if (wrong := left_out & ~is_empty).any():
        first = naive[wrong].iloc[0]
        raise UsageError(
            f"{path}: values from {first:%Y-%m-%d %H:%M}, an hour that {zone} leaves out in "
            "spring; allowed there: empty cells",
            hint="is the file in another clock than its header says?",
        )
    local = naive[~left_out]
    if mark.notna().any():
        summer = mark[~left_out].isin(SUMMER).to_numpy()
    else:
        summer = ~local.duplicated().to_numpy()
        repeated = local.dt.tz_localize(zone, ambiguous="NaT").isna()
        if (alone := repeated & ~local.duplicated(keep=False)).any():
            raise UsageError(
                f"{path}: {local[alone].iloc[0]:%Y-%m-%d %H:%M} is there once, an hour that {zone} "
                "repeats in autumn; allowed: both, or rows marked (CEST) and (CET)",
                hint="export the file in UTC",
            )
    times = local.dt.tz_localize(zone, ambiguous=summer).dt.tz_convert("UTC")
    return times.reindex(naive.index)
