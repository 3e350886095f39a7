"""Futures conditioned on what is known: their frequencies against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.fragility.beliefs.conditional import (
    DayDraw,
    LineHistory,
    chances,
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


def test_the_mean_of_what_is_left() -> None:
    assert expected_left(Bell(), 0, DAY) == 13  # of 11, 12, 13, 14
    assert expected_left(Bell(), 13, DAY) == 1  # of 0 and 1
    assert expected_left(Bell(), 40, DAY) == 0
