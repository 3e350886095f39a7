"""Which days of the profiles are for tests: nothing is tuned or trained on them."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path

import numpy as np

from resilience.arrays import Times
from resilience.case.data import Case
from resilience.case.profiles import read_profile_file, rows_per_slot
from resilience.case.schema.tables import MAX_SLOTS
from resilience.errors import UsageError

USUAL_DAYS = 16
TEST_SHARE = 0.25  # of the days of the profiles, the last ones: nothing is tuned on them


def held_out(case: Case, days: int | None = None) -> Case:
    """The case over the last `days` days of its profiles, which nothing is tuned on.

    A case with a storm or a blackout keeps its own horizon, without the outages to plan for.

    Raises:
        UsageError: more days than the last quarter of the profiles has; other days than those of a
            case without a profile file, which keeps its own horizon; days of a case with a storm.
    """
    if case.is_dated:
        if days is not None:
            raise UsageError(
                f"--days {days} of case {case.name!r}; allowed: its own horizon, {case.window}",
                hint="leave out --days: its outages come once, on the days that the case says",
            )
        return case.replace(outages=())
    per_day, times = case.window.slots_per_day, profile_times(case)
    if times is None and days is None:
        return case.replace(outages=())
    days = USUAL_DAYS if days is None else days
    if times is None:
        if case.slots != days * per_day:
            raise UsageError(
                f"case {case.name!r} has no profile file beyond its {case.slots} slots; "
                f"allowed: --days {case.slots // per_day}",
                hint="name a profile file in [profiles] to evaluate on more days",
            )
        return case
    total = len(times) // per_day
    max_days = math.ceil(TEST_SHARE * total)
    if not 0 < days <= max_days:
        allowed = f"1 to {max_days}, the last quarter of the {total} in the profiles"
        raise UsageError(
            f"--days {days}; allowed: {allowed}",
            hint="the days before are for tuning and training",
        )
    first: datetime = times[(total - days) * per_day].astype("datetime64[s]").item()
    return case.replace(start=first, slots=days * per_day, outages=())


def training(case: Case) -> Case:
    """The case over all days of its profiles before those that `held_out` may keep for tests.

    A case with a storm or a blackout keeps its own horizon: what differs between training and test
    are the draws.

    Raises:
        UsageError: a case whose profiles have no day before the last quarter.
    """
    if case.is_dated:
        return case.replace(outages=())
    per_day, times = case.window.slots_per_day, profile_times(case)
    total = case.slots // per_day if times is None else len(times) // per_day
    days = total - math.ceil(TEST_SHARE * total)
    if days < 1:
        raise UsageError(
            f"case {case.name!r} has profiles of {total} days, and the last quarter is for tests; "
            "allowed: a day or more before it",
            hint="name a profile file in [profiles] with more days",
        )
    if times is None:
        return case.replace(slots=days * per_day, outages=())
    first: datetime = times[0].astype("datetime64[s]").item()
    return case.replace(start=first, slots=days * per_day, outages=())


def check_days(case: Case, days: int) -> None:
    """Refuses more whole days than the profiles have; without a file, than a case may have slots.

    Raises:
        UsageError: they are more.
    """
    times = profile_times(case)
    max_days = (MAX_SLOTS if times is None else len(times)) // case.window.slots_per_day
    if days > max_days:
        limit = f"{MAX_SLOTS:,} slots" if times is None else f"the {max_days} of its profiles"
        raise UsageError(
            f"--days {days} of case {case.name!r}; allowed: 1 to {max_days}, {limit}",
            hint="-n draws more storms instead",
        )


def profile_times(case: Case) -> Times | None:
    """(slots,) starts of the slots that a case's profile file can fill; None without a file."""
    file = case.source.get("profiles", {}).get("file")
    if file is None:
        return None
    times = read_profile_file(Path(file)).times
    per_slot = rows_per_slot(times, case.window)
    first = int(np.flatnonzero(times == np.datetime64(case.start))[0]) % per_slot
    return times[first : len(times) - (len(times) - first) % per_slot : per_slot]
