"""Outage paths drawn from the bell."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from resilience.arrays import Bools
from resilience.case import Case, Outage
from resilience.errors import UsageError
from resilience.fragility import (
    Bell,
    Scenarios,
    breakpoints,
    fixed,
    outages_from,
    sample_bell,
    sample_outages,
    summary,
)
from resilience.fragility.draw import BATCH, Day, outage_paths, shifts
from resilience.testing import small_case
from tests.unit.fragility.storms import LINES, feeder

NOON = Bell(centres=(48,))
CASE = feeder()


def days_with_outage(scenarios: Scenarios, line: int) -> int:
    return int(scenarios.down[line].any(axis=0).sum())


def within_999(count: int, n: int, chance: float) -> bool:
    low, high = binom.interval(0.999, n, chance)
    return bool(low <= count <= high)


@pytest.mark.parametrize("bell", [NOON, Bell(), Bell(height=0.1, sigma_slots=8, rate=True)])
def test_chance_of_an_outage_is_the_closed_form(bell: Bell) -> None:
    n = 3000
    found = sample_bell(CASE, bell, n, 1)
    assert found.centre is not None
    # Line 1-2 peaks at the centre itself, which is known: the chance is that of these centres.
    closed = 1 - np.prod(1 - bell.slot_probability(bell.centre_slots()), axis=-1)
    assert within_999(days_with_outage(found, 0), n, float(closed.mean()))
    assert not within_999(days_with_outage(found, 0), n, float(closed.mean()) - 0.06)


@pytest.mark.parametrize(("rate", "finer"), [(True, 0.8), (False, 0.96)])
def test_halving_the_step(rate: bool, finer: float) -> None:
    bell, n = replace(NOON, rate=rate), 2000
    assert within_999(days_with_outage(sample_bell(CASE, bell, n, 2), 0), n, 0.8)
    halved = sample_bell(feeder(step_min=7.5), bell, n, 2)
    assert within_999(days_with_outage(halved, 0), n, finer)


def test_published_figures_of_a_severe_storm() -> None:
    """Height 0.3, width 8: 13.3 slots a day, 23.4 with refailure; all four fail on 98.5 %."""
    bell, n = Bell(height=0.3, sigma_slots=8), 1500
    found = sample_bell(CASE, bell, n, 3)
    assert found.down[0].sum() / n == pytest.approx(13.3, abs=0.2)
    all_fail = int(found.down.any(axis=1).all(axis=0).sum())
    assert within_999(all_fail, n, 0.985)
    assert found.down.all(axis=0).sum() / n == pytest.approx(3.7, abs=0.4)
    again = sample_bell(CASE, replace(bell, refail=True), n, 3)
    assert again.down[0].sum() / n == pytest.approx(23.4, abs=0.5)


def test_durations_and_one_outage_a_day() -> None:
    found = sample_bell(CASE, Bell(), 500, 4)
    events = found.events()
    assert len({(s, line) for s, line, *_ in events}) == len(events)
    lengths = {stop - first for _, _, first, stop in events if stop < 96}
    assert lengths == {12, 13, 14, 15}
    assert all(stop == 96 for *_, first, stop in events if stop - first < 12)
    again = sample_bell(CASE, Bell(refail=True), 500, 4).events()
    assert len({(s, line) for s, line, *_ in again}) < len(again)


@pytest.mark.parametrize(("step_min", "lengths"), [(7.5, {24, 26, 28, 30}), (60.0, {3, 4})])
def test_durations_in_hours_do_not_depend_on_the_step(step_min: float, lengths: set[int]) -> None:
    found = sample_bell(feeder(step_min=step_min), replace(NOON, rate=True), 100, 5)
    assert {stop - first for *_, first, stop in found.events()} == lengths


def test_shifts_are_within_three_slots_and_all_occur() -> None:
    rng = np.random.default_rng(6)
    drawn = np.array([shifts(Bell(), 4, rng) for _ in range(300)])
    assert (drawn[:, 0] == 0).all()
    assert set(drawn[:, 1:].ravel()) == set(range(-3, 4))
    shared = np.array([shifts(Bell(shared_shift=True), 4, rng) for _ in range(300)])
    assert (shared[:, 1:] == shared[:, 1:2]).all()
    assert set(shared[:, 1]) == set(range(-3, 4))


def test_a_common_draw_fails_all_lines_together() -> None:
    bell = Bell(common_draw=True, shift_slots=0)
    down = np.asarray(sample_bell(CASE, bell, 100, 7).down.any(axis=1))
    assert (down == down[0]).all()
    apart = np.asarray(sample_bell(CASE, replace(bell, common_draw=False), 100, 7).down.any(axis=1))
    assert not (apart == apart[0]).all()


def test_a_seed_repeats_and_more_begins_alike() -> None:
    few = sample_bell(CASE, Bell(), 5, 8)
    assert np.array_equal(few.down, sample_bell(CASE, Bell(), 5, 8).down)
    assert not np.array_equal(few.down, sample_bell(CASE, Bell(), 5, 9).down)
    assert np.array_equal(few.down, sample_bell(CASE, Bell(), 9, 8).down[:, :, :5])
    longer = sample_bell(CASE, Bell(), 5, 8, days=3)
    assert longer.slots == 3 * 96
    assert np.array_equal(few.down, longer.down[:, :96])
    assert np.array_equal(longer.down, sample_bell(feeder(days=3), Bell(), 5, 8).down)


def test_outages_end_at_midnight_unless_they_run_on() -> None:
    late = Bell(height=0.9, centres=(92,), overnight=False)
    cut = sample_bell(CASE, late, 20, 10, days=2)
    on = sample_bell(CASE, replace(late, overnight=True), 20, 10, days=2)
    assert not (cut.down[:, 95] & cut.down[:, 96]).any()
    assert {stop - first for *_, first, stop in on.events() if stop < 192} <= {12, 13, 14, 15}
    assert (on.down[:, 95] & on.down[:, 96]).any()


def day_of_ten_slots(lengths: dict[int, int]) -> Day:
    """A day in which one line fails in some slots if it is up: until it is back, so many slots."""
    fails, slots = np.zeros((1, 1, 10), bool), np.full((1, 1, 10), 99)
    fails[..., list(lengths)], slots[..., list(lengths)] = True, list(lengths.values())
    return Day(np.array([5]), fails, slots)


@pytest.mark.parametrize(
    ("overnight", "refail", "spans"),
    [
        # Back at every midnight; of two failures on a day the first counts.
        (False, False, [(0, 2), (11, 20), (22, 27), (30, 34)]),
        (False, True, [(0, 2), (7, 10), (11, 20), (22, 27), (30, 34), (36, 38)]),
        # Down until slot 23: the failure of slot 22 hits nothing, that of slot 24 does.
        (True, False, [(0, 2), (11, 23), (24, 27), (30, 34)]),
        # Slot 13 hits a line that is just back; all of the third day and slot 30 hit nothing.
        (True, True, [(0, 2), (7, 17), (18, 31), (36, 38)]),
    ],
)
def test_a_path_of_four_days_by_hand(
    overnight: bool, refail: bool, spans: list[tuple[int, int]]
) -> None:
    failures = ({0: 2, 7: 6}, {1: 12, 2: 2, 3: 4, 8: 13}, {2: 5, 4: 3}, {0: 4, 6: 2})
    days = [day_of_ten_slots(lengths) for lengths in failures]
    path = outage_paths(days, Bell(overnight=overnight, refail=refail))
    assert path.shape == (1, 1, 40)
    down = [slot for start, stop in spans for slot in range(start, stop)]
    assert np.flatnonzero(path).tolist() == down


def test_days_begin_at_midnight_whenever_the_horizon_does() -> None:
    case = Case(**{**vars(CASE), "start": datetime(2016, 7, 12, 6), "slots": 48})
    found = sample_bell(case, Bell(), 30, 11)
    whole = sample_bell(CASE, Bell(), 30, 11)
    assert np.array_equal(found.down, whole.down[:, 24:72])
    odd = Case(**{**vars(CASE), "start": datetime(2016, 7, 12, 6, 7)})
    with pytest.raises(UsageError, match="do not meet midnight"):
        sample_bell(odd, Bell(), 1, 0)


def test_the_forecast_of_the_centre_may_be_off_while_the_storm_is_the_same() -> None:
    sharp, vague = (
        sample_bell(CASE, Bell(centre_error_slots=k, centres=(30, 60)), 50, 12) for k in (0, 2)
    )
    assert sharp.centre is not None
    assert vague.centre is not None
    assert set(sharp.centre.ravel()) == {30, 60}
    assert set((vague.centre - sharp.centre).ravel()) == {-2, -1, 0, 1, 2}
    assert np.array_equal(sharp.down, vague.down)


def test_outages_of_a_plan() -> None:
    drawn = outages_from(" Bell", CASE, 13)
    assert drawn == sample_outages(CASE, Bell(), 13)
    assert np.array_equal(fixed(CASE, drawn).line_up(LINES), one_scenario(13).line_up(LINES))
    assert CASE.replace(outages=drawn).outages == drawn
    assert outages_from("2-3@01:00-02:00", CASE) == (Outage("2-3", 4, 8),)
    assert outages_from("none", CASE) == ()
    with pytest.raises(UsageError, match="seed 1 without a draw"):
        outages_from("none", CASE, 1)


def test_a_draw_without_a_seed_is_that_of_seed_0() -> None:
    drawn = outages_from("bell", CASE)
    assert drawn == sample_outages(CASE, Bell(), 0)
    assert drawn != sample_outages(CASE, Bell(), 1)


def one_scenario(seed: int) -> Scenarios:
    return sample_bell(CASE, Bell(), 1, seed)


def test_no_breakpoint_and_bad_numbers() -> None:
    assert breakpoints(CASE) == LINES
    plain = small_case(grid=[{"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}])
    with pytest.raises(UsageError, match="no breakpoint"):
        breakpoints(plain)
    for n, seed, days in ((0, 0, None), (1, -1, None), (1, 0, 0)):
        with pytest.raises(UsageError, match="allowed: 1 or more"):
            sample_bell(CASE, Bell(), n, seed, days=days)


def peak_bytes(work: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_draw_and_its_summary_take_little_more_memory_than_the_outages() -> None:
    case, bell = feeder(days=2), Bell()
    drawn = sample_bell(case, bell, 2000, 3)
    assert peak_bytes(lambda: sample_bell(case, bell, 2000, 3)) < 1.5 * drawn.down.nbytes
    assert peak_bytes(lambda: summary(drawn, case)) < 1.5 * drawn.down.nbytes


def down_by_the_letter(bell: Bell, lines: int, days: int, rng: np.random.Generator) -> Bools:
    """(lines, 96 * days) of one scenario, slot by slot."""
    down, until = np.zeros((lines, 96 * days), bool), [0] * lines
    for day in range(days):
        peak = int(rng.choice(bell.centre_slots()))
        shift = rng.integers(-bell.shift_slots, bell.shift_slots + 1, lines)
        draws, length = rng.random((lines, 96)), bell.lengths(15.0)
        chosen = rng.integers(0, len(length), (lines, 96))
        rng.integers(-bell.centre_error_slots, bell.centre_error_slots + 1)
        for k in range(lines):
            earlier = shift[-1] if bell.shared_shift else shift[k]
            chance = bell.slot_probability(peak + (earlier if k else 0))
            has_failed = False
            for t in range(96):
                now = 96 * day + t
                is_hit = draws[0 if bell.common_draw else k, t] < chance[t]
                if is_hit and now >= until[k] and (bell.refail or not has_failed):
                    has_failed, until[k] = True, now + int(length[chosen[k, t]])
                    if not bell.overnight:
                        until[k] = min(until[k], 96 * (day + 1))
                down[k, now] = now < until[k]
    return down


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"refail": True, "sigma_slots": 20.0, "probability": 0.95},
        {"overnight": True, "duration_slots": (20, 150)},
        {"overnight": True, "refail": True, "duration_slots": (3, 120), "probability": 0.9},
        {"common_draw": True, "shared_shift": True, "centres": (0, 50, 95)},
        {"rate": True, "wrap": True, "centre_error_slots": 4},
    ],
)
def test_draws_are_those_of_the_process_by_the_letter(settings: dict[str, Any]) -> None:
    """With the stream that the seed spawns for every scenario, in the first batch as in others."""
    case, bell, n = feeder(days=3), Bell(**settings), BATCH + 3
    drawn = sample_bell(case, bell, n, 11)
    streams = np.random.default_rng(11).spawn(n)
    for k in (0, 1, 2, 3, BATCH - 1, BATCH, n - 1):
        by_the_letter = down_by_the_letter(bell, len(drawn.lines), 3, streams[k])
        assert np.array_equal(drawn.down[:, :, k], by_the_letter)


def test_the_summary_of_a_list() -> None:
    case = feeder(days=2)
    outages = [Outage("1-2", 8, 16), Outage("1-2", 90, 100), Outage("2-3", 12, 20)]
    found = summary(fixed(case, outages), case)
    one = found["lines"]["1-2"]
    # Out from 2:00 to 4:00 and over midnight: two outages, both of which begin on the first day.
    assert one == {
        "outage_chance": 1.0,
        "hours_out": 4.5,
        "outage_chance_per_day": 0.5,
        "hours_out_per_day": 2.25,
        "hours_per_outage": 2.25,
    }
    assert found["all_out_chance_per_day"] == 0.5
    assert found["all_out_chance"] == 1.0
    assert summary(fixed(case, []), case)["all_out_chance_per_day"] == 0.0
