"""Outage paths: when a line fails and when it is back, drawn from a process or listed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.days import check_days
from resilience.case.window import DAY_MIN
from resilience.errors import UsageError
from resilience.fragility.outages.bell import REFERENCE_SLOTS, Bell, BellSettings, case_bell
from resilience.fragility.outages.blackout import case_blackout
from resilience.fragility.outages.breakpoints import breakpoints
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.units import with_units

if TYPE_CHECKING:
    from resilience.case import Case, Outage
    from resilience.case.outages import OutageWords

BATCH = 16
"""Scenarios drawn at once: their generators and numbers take more memory than their outages."""
DRAWN = ("bell", "storm", "blackout")
"""Outages that are drawn, as a user names them."""


@dataclass(frozen=True)
class Day:
    """What is drawn for one day in some scenarios, whatever becomes of it.

    Attributes:
        forecast: (scenarios,) slot of 15 minutes in which the hazard is expected to peak.
        fails: (scenarios, lines, slots) True where a line fails if it is up and may fail.
        lengths: (scenarios, lines, slots) slots until a line that fails there is back.
    """

    forecast: Ints
    fails: Bools
    lengths: Ints


def sample_bell(case: Case, bell: Bell, n: int, seed: int, *, days: int | None = None) -> Scenarios:
    """`n` equally likely outage paths over the case's horizon, or over `days` whole days.

    Days begin at midnight, also where the horizon does not. Everything is drawn up front from
    `seed`, a stream per scenario and day by day, so that a longer horizon or more scenarios of the
    same seed begin alike.

    Raises:
        UsageError: no breakpoint, no scenario, a negative seed, or slots that do not divide a day.
    """
    lines = breakpoints(case)
    if n < 1 or seed < 0 or (days is not None and days < 1):
        raise UsageError(
            f"{n} scenarios of {days or 'all'} days, seed {seed}; "
            "allowed: 1 or more scenarios and days, seed 0 or more",
            hint="200 scenarios show a chance of 50 % to within 7 %",
        )
    check_calendar(case)
    per_day, offset = case.window.slots_per_day, case.window.slots_before_start
    slots = case.slots if days is None else days * per_day
    count = -(-(offset + slots) // per_day)
    down = np.zeros((len(lines), slots, n), bool)
    forecast_peaks = np.zeros((count, n), np.intp)
    root = np.random.default_rng(seed)
    for first in range(0, n, BATCH):
        batch = slice(first, min(first + BATCH, n))
        streams = root.spawn(batch.stop - first)
        drawn = [draw_day(bell, len(lines), per_day, streams) for _ in range(count)]
        forecast_peaks[:, batch] = [day.forecast for day in drawn]
        paths = outage_paths(drawn, bell)[:, :, offset : offset + slots]
        down[:, :, batch] = paths.transpose(1, 2, 0)
    of_lines = Scenarios(lines, down, np.full(n, 1.0 / n), forecast_peaks, seed, str(bell))
    return with_units(case, of_lines, seed)


def check_calendar(case: Case) -> None:
    """Refuses a horizon whose slots do not meet midnight: a bell is drawn day by day.

    Raises:
        UsageError: slots that do not divide a day, or a start between two of them.
    """
    if not case.window.meets_midnight:
        raise UsageError(
            f"slots of {case.step_min:g} min from {case.start:%H:%M} do not meet midnight; "
            "allowed: slots that divide a day, from a multiple of them on",
            hint="slots of 15 min from 00:00 are usual",
        )


def draw_day(bell: Bell, lines: int, slots: int, streams: Sequence[np.random.Generator]) -> Day:
    """Draws one day of `slots` slots with every stream, that of a scenario each."""
    n, step_min = len(streams), DAY_MIN / slots
    usual, lengths = bell.centre_slots(), bell.lengths(step_min)
    draws: Floats = np.empty((n, lines, slots))
    storm_peak, error = np.empty(n, np.intp), np.empty(n, np.intp)
    shift, length = np.empty((n, lines), np.intp), np.empty((n, lines, slots), np.intp)
    for k, rng in enumerate(streams):
        storm_peak[k] = usual[rng.integers(len(usual))]
        shift[k] = shifts(bell, lines, rng)
        rng.random(out=draws[k])
        length[k] = lengths[rng.integers(0, len(lengths), (lines, slots))]
        error[k] = rng.integers(-bell.centre_error_slots, bell.centre_error_slots + 1)
    if bell.common_draw:
        draws[:] = draws[:, :1]
    peaks, place = np.unique(storm_peak[:, None] + shift, return_inverse=True)
    chance = bell.slot_probability(peaks, step_min, slots)[place.reshape(shift.shape)]
    forecast = np.clip(storm_peak + error, 0, REFERENCE_SLOTS - 1)
    return Day(forecast, draws < chance, length)


def shifts(bell: Bell, lines: int, rng: np.random.Generator) -> Ints:
    """(lines,) slots by which each line's bell is shifted; the first line's is not."""
    shifts: Ints = rng.integers(-bell.shift_slots, bell.shift_slots + 1, lines)
    if bell.shared_shift:
        shifts[:] = shifts[-1]
    shifts[0] = 0
    return shifts


def outage_paths(days: Sequence[Day], bell: Bell) -> Bools:
    """(scenarios, lines, slots) where each line is down, days one after the other."""
    n, lines, slots = days[0].fails.shape
    down = np.zeros((n, lines, len(days) * slots), bool)
    slot = np.arange(slots)
    up = np.zeros((n, lines, 1), np.intp)  # first slot of the day in which the line is up
    for number, day in enumerate(days):
        today = down[:, :, number * slots : (number + 1) * slots]
        today |= slot < up
        hits = day.fails & ~today
        while hits.any():
            first = hits.argmax(axis=-1, keepdims=True)
            stop = first + np.take_along_axis(day.lengths, first, axis=-1)
            stop = np.where(hits.any(axis=-1, keepdims=True), stop, 0)
            today |= (slot >= first) & (slot < stop)
            up = np.maximum(up, stop)
            hits &= (slot >= up) if bell.refail else False
        up = np.maximum(up - slots, 0) if bell.overnight else np.zeros_like(up)
    return down


def sample_blackout(case: Case, n: int, seed: int) -> Scenarios:
    """`n` equally likely outage paths of a case's blackout, and of its units that fail.

    Raises:
        UsageError: the case has none, or as `Blackout.sample`.
    """
    return with_units(case, case_blackout(case).sample(n, seed), seed)


def sample_case(case: Case, n: int, seed: int) -> Scenarios:
    """`n` outage paths of the case's own process: its blackout, its storm, or else its bell.

    Raises:
        CaseError, UsageError: as `Blackout.sample`, `storm_scenarios` or `sample_bell`.
    """
    if case.blackout is not None:
        return sample_blackout(case, n, seed)
    if case.storm is not None and case.storm.points:
        from resilience.fragility.chain import storm_scenarios

        return storm_scenarios(case, n, seed)
    return sample_bell(case, case_bell(case), n, seed)


def draw(  # noqa: PLR0913 every one is an option of the command line
    case: Case,
    n: int,
    seed: int,
    *,
    days: int | None = None,
    track: str | Path | None = None,
    storm: str | None = None,
    averaging_s: float | None = None,
    agency: str | None = None,
    shift: float = 0.0,
    **bell: Unpack[BellSettings],
) -> Scenarios:
    """`n` outage paths as a user asks for them: of a track, the case's blackout or storm, the bell.

    Args:
        case: the case.
        n: how many.
        seed: of the draw.
        days: whole days, of the bell only; the case's horizon if omitted.
        track: file of a storm in place of the case's.
        storm: which one, of several in the file.
        averaging_s: of the file's winds, where it does not say.
        agency: whose winds, of several in the file, or where it does not say.
        shift: of the common strength of a storm's poles; see `storms.Sampling`.
        bell: settings of the bell; any of them that is not None asks for it.

    Raises:
        CaseError, UsageError: as `storm_scenarios` and `sample_bell`, both asked for, or more days
            than the case's profiles have.
    """
    from resilience.fragility.chain import reader, storm_scenarios

    settings = [key for key, value in bell.items() if value is not None]
    if case.blackout is not None and track is None and not settings:
        return _blackout(case, n, seed, days, shift)
    stormy = track is not None or (case.storm is not None and bool(case.storm.points))
    if track is not None and settings:
        raise UsageError(
            f"a track and {settings[0]} of the bell; allowed: one of the two",
            hint="a storm on its track has no bell",
        )
    if not stormy or settings:
        if shift:
            raise UsageError(
                f"shift {shift:g} of a bell; allowed: of a storm only",
                hint="give a track, or state a storm in the case",
            )
        if days is not None:
            check_days(case, days)
        return sample_bell(case, case_bell(case, **bell), n, seed, days=days)
    if days is not None:
        raise UsageError(
            f"{days} days of a storm; allowed: the case's horizon, {case.window}",
            hint="a storm comes once; leave out --days",
        )
    read = reader(case, track, storm=storm, averaging_s=averaging_s, agency=agency)
    return storm_scenarios(case, n, seed, read, shift)


def _blackout(case: Case, n: int, seed: int, days: int | None, shift: float) -> Scenarios:
    """Draws of a case's blackout, which has no days and no poles."""
    if days is not None or shift:
        option = f"shift {shift:g}" if shift else f"{days} days"
        raise UsageError(
            f"{option} of a blackout; allowed: neither of them",
            hint=f"it comes once, over the case's horizon, {case.window}",
        )
    return sample_blackout(case, n, seed)


def sample_of(case: Case, process: str, n: int, seed: int) -> Scenarios:
    """`n` outage paths of a process by its name in `DRAWN`, whatever else the case states.

    Raises:
        CaseError, UsageError: as `Blackout.sample`, `storm_scenarios` or `sample_bell`.
    """
    if process == "bell":
        return sample_bell(case, case_bell(case), n, seed)
    if process == "blackout":
        return sample_blackout(case, n, seed)
    from resilience.fragility.chain import storm_scenarios

    return storm_scenarios(case, n, seed)


def sample_outages(case: Case, bell: Bell | None, seed: int) -> tuple[Outage, ...]:
    """One draw as a list of outages, the first scenario of that seed: of the bell, or of the
    case's own process where there is none.

    Raises:
        CaseError, UsageError: as `sample_case` or `sample_bell`.
    """
    drawn = sample_case(case, 1, seed) if bell is None else sample_bell(case, bell, 1, seed)
    return listed(drawn)


def listed(drawn: Scenarios) -> tuple[Outage, ...]:
    """The outages of one scenario."""
    from resilience.case import Outage

    return tuple(Outage(line, first, stop) for _, line, first, stop in drawn.events())


def outages_from(
    text: str | Path | Sequence[OutageWords] | None, case: Case, seed: int | None = None
) -> tuple[Outage, ...]:
    """Outages as a user asks for them: a draw of the case's bell, storm or blackout, or what
    `parse_outages` reads.

    Args:
        text: one of `DRAWN`, `"6-26@14:00-17:30, ..."`, a CSV file, or `"none"`; the case's
            own if None.
        case: says which lines there are, and the horizon.
        seed: of the draw; 0 if omitted.

    Raises:
        CaseError: the outages have mistakes; all of them are listed.
        UsageError: a seed without a draw, a missing file, or as `sample_bell`.
    """
    from resilience.case import parse_outages

    word = str(text).strip().lower()
    if word in DRAWN:
        return listed(sample_of(case, word, 1, seed or 0))
    if seed is not None:
        raise UsageError(
            f"seed {seed} without a draw; allowed: a seed with the outages {', '.join(DRAWN)}",
            hint="add `--outages bell`, or leave out the seed",
        )
    return case.outages if text is None else parse_outages(text, case)


def fixed(case: Case, outages: Sequence[Outage]) -> Scenarios:
    """One certain scenario: a list of outages."""
    lines = tuple(dict.fromkeys(outage.line for outage in outages))
    down = np.zeros((len(lines), case.slots, 1), bool)
    for outage in outages:
        down[lines.index(outage.line), outage.first : outage.stop, 0] = True
    return Scenarios(lines, down, np.ones(1), process="a fixed list")
