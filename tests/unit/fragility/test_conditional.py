"""Futures conditioned on what is known: their frequencies against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.fragility.beliefs.belief import BellBelief
from resilience.fragility.beliefs.conditional import (
    DayDraw,
    LineHistory,
    chances,
    days_reached,
    expected_left,
    futures,
    strata,
)
from resilience.fragility.outages.bell import Bell

DAY = 96
NEVER = np.full(1, -1)


def known(t: int, centre: int, since: int = -1, spent: bool = False) -> LineHistory:
    return LineHistory(t, centre, np.array([since]), np.array([spent]))


def days(seed: int, paths: int, n: int = 2) -> list[DayDraw]:
    rng = np.random.default_rng(seed)
    return [DayDraw.draw(1, paths, rng) for _ in range(n)]


def test_strata_hit_every_part_of_the_unit_interval_once() -> None:
    u = strata(50, np.random.default_rng(0))
    assert sorted((u * 50).astype(int)) == list(range(50))


@pytest.mark.parametrize(("t", "centre"), [(0, 48), (45, 48), (50, 48)])
def test_an_outage_yet_to_come_is_as_likely_as_the_bell_says(t: int, centre: int) -> None:
    """Given that it has not failed by t: 1 - prod of (1 - p) over the slots after t."""
    bell = Bell()
    n = 400
    down = futures(bell, known(t, centre), DAY - t - 1, DAY, days(1, n))
    chance = bell.slot_probability(np.array([centre]))[0, t + 1 :]
    expected = 1.0 - np.prod(1.0 - chance)
    assert down[0].any(0).mean() == pytest.approx(expected, abs=1.0 / n)


def test_a_line_that_failed_today_does_not_fail_again() -> None:
    down = futures(Bell(), known(40, 48, spent=True), 50, DAY, days(2, 100))
    assert not down.any()
    down = futures(Bell(refail=True), known(40, 48, spent=True), 50, DAY, days(2, 100))
    assert down.any()


def test_an_outage_under_way_lasts_as_long_as_its_age_allows() -> None:
    """After 13 slots (0 to 12) of 12 .. 15: at most two more are left, 0, 1 and 2 alike likely."""
    down = futures(Bell(), known(52, 48, since=40), 20, DAY, days(3, 300))
    left = down[0].sum(0)
    assert np.bincount(left).tolist() == [100, 100, 100]
    assert not np.diff(down[0].astype(int), axis=0).max() > 0


def test_the_night_ends_an_outage_and_brings_a_new_centre() -> None:
    down = futures(Bell(), known(94, 90, since=92), 1 + DAY, DAY, days(4, 200, 3))
    assert down[0, 0].all()
    assert not down[0, 1].all()
    fresh = down[0, 1:].any(0).mean()
    chance = Bell().day_probability(np.arange(DAY)).mean()
    assert fresh == pytest.approx(chance, abs=0.03)


@pytest.mark.parametrize(
    ("t", "slots", "days_touched"),
    [(80, 15, 1), (80, 16, 2), (80, 48, 2), (95, 1, 2), (30, 161, 2), (30, 162, 3)],
)
def test_a_look_ahead_touches_the_days_that_it_reaches(
    t: int, slots: int, days_touched: int
) -> None:
    """Its last slot is t + slots: 95 is today's last, 96 tomorrow's first."""
    assert days_reached(t, slots, DAY) == days_touched


def test_in_the_evening_tomorrow_is_seen() -> None:
    """From slot 80, 48 slots ahead: 15 of today, in which a line that failed stands, then 33."""
    n = 500
    here = known(80, 60, spent=True)
    down = futures(Bell(), here, 48, DAY, days(8, n, 2))[0]
    assert not down[:15].any()
    tomorrow = Bell().slot_probability(np.arange(DAY))[:, :33]
    failed = 1.0 - np.prod(1.0 - tomorrow, axis=1).mean()
    assert down.any(0).mean() == pytest.approx(failed, abs=4 * np.sqrt(0.25 / n))
    begins = chances(Bell(), here, 48, DAY)[0]
    assert (begins[:15] == 0.0).all()
    assert begins.sum() == pytest.approx(failed, abs=1e-9)
    first = tomorrow[:, 7] * np.prod(1.0 - tomorrow[:, :7], axis=1)
    assert begins[15 + 7] == pytest.approx(first.mean(), abs=1e-12)


def test_midnight_ends_an_outage_that_is_yet_to_come() -> None:
    """It begins about slot 94 and would last 12 slots or more; tomorrow's begin about slot 60."""
    bell = Bell(height=0.9, centres=(60,))
    down = futures(bell, known(85, 94), 10 + 30, DAY, days(9, 100))[0]
    assert down[:10].any(0).mean() > 0.8
    assert down[9].mean() > 0.5
    assert not down[10:].any()


@pytest.mark.parametrize("centre", [0, 3, 95])
def test_a_centre_is_known_at_either_end_of_the_day(centre: int) -> None:
    """Slot 0 is a slot like all others, and not the sign of a centre that is not known."""
    bell, n, t = Bell(), 400, 1
    here = known(t, centre)
    chance = bell.slot_probability(np.array([centre]))[0, t + 1 :]
    failed = 1.0 - np.prod(1.0 - chance)
    down = futures(bell, here, DAY - t - 1, DAY, days(10, n))[0]
    assert down.any(0).mean() == pytest.approx(failed, abs=1.0 / n)
    begins = chances(bell, here, DAY - t - 1, DAY)[0]
    np.testing.assert_allclose(begins[:3], chance[:3] * np.cumprod([1.0, *(1.0 - chance[:2])]))


@pytest.mark.parametrize("shared", [True, False])
def test_lines_are_shifted_together_or_each_by_itself(shared: bool) -> None:
    """A bell of one slot: the first line fails at the centre, the others 2 slots around it."""
    bell = Bell(height=0.999, sigma_slots=0.2, shift_slots=2, shared_shift=shared)
    up = LineHistory(20, 40, np.full(3, -1), np.zeros(3, bool))
    down = futures(bell, up, 60, DAY, [DayDraw.draw(3, 200, np.random.default_rng(11))])
    first = down.argmax(1)[:, down.any(1).all(0)] + 21
    assert first.shape[1] > 190
    assert (first[0] == 40).all()
    assert set(first[1]) == set(first[2]) == {38, 39, 40, 41, 42}
    assert (first[1] == first[2]).all() == shared
    if not shared:
        assert (first[1] == first[2]).mean() == pytest.approx(0.2, abs=0.12)


@pytest.mark.parametrize("centre", [48, -1])
@pytest.mark.parametrize("line", [0, 1])
def test_chances_are_the_frequencies_of_sampled_futures(centre: int, line: int) -> None:
    """Of a line that follows the centre, and of one that is shifted against it."""
    bell, n, slots = Bell(), 20_000, 120
    rng = np.random.default_rng(6)
    up = LineHistory(30, centre, np.full(2, -1), np.zeros(2, bool))
    draws = [DayDraw.draw(2, n, rng) for _ in range(2)]
    down = futures(bell, up, slots, DAY, draws)[line]
    begins = down & ~np.pad(down, ((1, 0), (0, 0)))[:-1]
    chance = chances(bell, up, slots, DAY)[line]
    assert chance.sum() > 0.5
    np.testing.assert_allclose(begins.mean(1), chance, atol=4 * np.sqrt(0.1 * 0.9 / n))


def test_the_same_draws_move_a_failure_later_as_time_goes_by() -> None:
    """No path that is still up at noon fails earlier, seen from noon, than it did before."""
    draws = days(7, 50)
    first, later = (
        np.where(down.any(0), down.argmax(0) + t + 1, DAY)
        for t in (40, 48)
        for down in [futures(Bell(), known(t, 48), DAY - t - 1, DAY, draws)[0]]
    )
    still_up = first > 48
    assert 5 < still_up.sum() < 45
    assert (later[still_up] >= first[still_up]).all()


def test_what_is_expected_to_be_left_ends_at_midnight() -> None:
    """Since slots 83 and 70: 13 slots of 11 to 14, and 1 of 0 and 1; slot 95 is the last."""
    belief = BellBelief(Bell(), DAY, 3)
    for t, left in ((83, 12), (80, 13)):
        since = np.array([t, -1, t - 13])
        history = LineHistory(t, 60, since, since >= 0)
        assert belief.expected_left(history).tolist() == [left, 0, 1]


def test_the_mean_of_what_is_left() -> None:
    assert expected_left(Bell(), 0, DAY) == 13  # of 11, 12, 13, 14
    assert expected_left(Bell(), 13, DAY) == 1  # of 0 and 1
    assert expected_left(Bell(), 40, DAY) == 0
