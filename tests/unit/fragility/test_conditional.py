"""Futures conditioned on what is known: their frequencies against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.fragility.bell import Bell
from resilience.fragility.conditional import Known, futures, strata

DAY = 96
NEVER = np.full(1, -1)


def known(t: int, centre: int, since: int = -1, spent: bool = False) -> Known:
    return Known(t, centre, np.array([since]), np.array([spent]))


def test_strata_hit_every_part_of_the_unit_interval_once() -> None:
    u = strata(50, np.random.default_rng(0))
    assert sorted((u * 50).astype(int)) == list(range(50))


@pytest.mark.parametrize(("t", "centre"), [(0, 48), (45, 48), (50, 48)])
def test_an_outage_yet_to_come_is_as_likely_as_the_bell_says(t: int, centre: int) -> None:
    """Given that it has not failed by t: 1 - prod of (1 - p) over the slots after t."""
    bell = Bell()
    n = 400
    down = futures(bell, known(t, centre), DAY - t - 1, DAY, n, np.random.default_rng(1))
    chance = bell.slot_probability(np.array([centre]))[0, t + 1 :]
    expected = 1.0 - np.prod(1.0 - chance)
    assert down[0].any(0).mean() == pytest.approx(expected, abs=1.0 / n)


def test_a_line_that_failed_today_does_not_fail_again() -> None:
    rng = np.random.default_rng(2)
    down = futures(Bell(), known(40, 48, spent=True), 50, DAY, 100, rng)
    assert not down.any()
    down = futures(Bell(refail=True), known(40, 48, spent=True), 50, DAY, 100, rng)
    assert down.any()


def test_an_outage_under_way_lasts_as_long_as_its_age_allows() -> None:
    """After 13 slots (0 to 12) of 12 .. 15: at most two more are left, 0, 1 and 2 alike likely."""
    down = futures(Bell(), known(52, 48, since=40), 20, DAY, 300, np.random.default_rng(3))
    left = down[0].sum(0)
    assert np.bincount(left).tolist() == [100, 100, 100]
    assert not np.diff(down[0].astype(int), axis=0).max() > 0


def test_the_night_ends_an_outage_and_brings_a_new_centre() -> None:
    down = futures(Bell(), known(94, 90, since=92), 1 + DAY, DAY, 200, np.random.default_rng(4))
    assert down[0, 0].all()
    assert not down[0, 1].all()
    fresh = down[0, 1:].any(0).mean()
    chance = Bell().day_probability(np.arange(DAY)).mean()
    assert fresh == pytest.approx(chance, abs=0.03)
