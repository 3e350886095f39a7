"""Belief in a storm: exact before it, exact given what is seen, and honest about repair."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.storm_belief import StormBelief
from resilience.fragility.lines.damage import Timing, accumulated, failed_by
from resilience.fragility.lines.spans import (
    SpannedLines,
    SpanWind,
    factor_nodes,
    poles_in_series,
    scores,
    span_speed,
)
from resilience.fragility.outages.repair import Repair
from resilience.fragility.outages.storms import sample_storms
from tests.histories import history

SLOTS = 12
SPEED = 62.0 - 4.0 * np.abs(np.arange(SLOTS) - 6.0)  # rises to slot 6, then falls
NAMES = ("a", "b", "c")
FIXED = Repair("fixed", (1.0,), wind_limit_mps=200.0)


def lines(correlation: float) -> SpannedLines:
    """Three lines of 3, 5 and 2 poles."""
    return poles_in_series(NAMES, np.repeat([0, 1, 2], [3, 5, 2]), correlation=correlation)


def blown() -> SpanWind:
    speed = SPEED + np.linspace(0.0, 3.0, 10)[:, None]
    return SpanWind(speed, 3.0, 10.0, "land")


def belief(correlation: float, repair: Repair = FIXED) -> StormBelief:
    found, wind = lines(correlation), blown()
    z, weight = factor_nodes(correlation)
    fallen = np.zeros((len(z), 3, SLOTS + 1))
    score = scores(found, span_speed(found, wind))
    fallen[:, :, 1:] = accumulated(found, score, z, Timing(step_h=0.25)).transpose(2, 0, 1)
    return StormBelief(fallen, weight, np.ones((3, SLOTS), bool), repair, 0.25)


def known(t: int, **failed: int) -> LineHistory:
    """Lines that failed in a slot and are down still; all others are up."""
    first = np.array([failed.get(name, SLOTS) for name in NAMES])
    return history(np.arange(t + 1) >= first[:, None])


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.8])
def test_before_the_storm_it_is_the_exact_probability(correlation: float) -> None:
    chance = belief(correlation).chances(known(-1), SLOTS)
    exact = failed_by(lines(correlation), blown(), Timing(step_h=0.25))
    np.testing.assert_allclose(np.cumsum(chance, axis=1), exact, atol=1e-9)


def test_after_the_peak_nothing_fails_any_more() -> None:
    assert belief(0.3).chances(known(6), SLOTS)[:, : SLOTS - 7].max() == 0.0


@pytest.mark.parametrize("correlation", [0.3, 0.8])
def test_what_is_seen_counts_as_in_a_hundred_thousand_storms(correlation: float) -> None:
    """Line b failed in slot 4, a and c stand in slot 5: how often do they fail later?"""
    storms = sample_storms(
        lines(correlation), blown(), 400_000, 7, repair=None, timing=Timing(step_h=0.25)
    )
    down = storms.down
    first = np.where(down.any(axis=1), down.argmax(axis=1), SLOTS)
    alike = (first[1] == 4) & (first[0] > 5) & (first[2] > 5)
    assert alike.sum() > 2_000
    chance = belief(correlation).chances(known(5, b=4), SLOTS).sum(axis=1)
    for line in (0, 2):
        often = (first[line, alike] < SLOTS).mean()
        error = np.sqrt(often * (1 - often) / alike.sum())
        assert abs(chance[line] - often) < 4.0 * error
    assert chance[1] == 0.0


def test_a_failure_makes_others_likelier_only_where_strengths_go_together() -> None:
    def of_a(correlation: float, **failed: int) -> float:
        return float(belief(correlation).chances(known(5, **failed), SLOTS)[0].sum())

    assert of_a(0.5, b=3) > 1.3 * of_a(0.5)
    assert of_a(0.0, b=3) == pytest.approx(of_a(0.0), rel=1e-12)


def test_paths_are_as_frequent_as_their_chances() -> None:
    found = belief(0.3)
    now = known(3, b=2)
    down = found.paths(now, SLOTS - 4, 20_000)
    begun = np.maximum.accumulate(down, axis=1)[[0, 2]].mean(axis=2)
    chance = np.cumsum(found.chances(now, SLOTS - 4), axis=1)[[0, 2]]
    np.testing.assert_allclose(begun, chance, atol=0.012)


def test_a_repair_of_an_hour_ends_an_hour_after_the_failure() -> None:
    """Four slots of work from slot 2 on: down in 2 to 5, so two more after slot 3."""
    found = belief(0.3)
    assert found.expected_left(known(3, b=2)).tolist() == [0, 2, 0]
    assert found.paths(known(3, b=2), 6, 50)[1].sum(axis=0).tolist() == [2] * 50


def test_an_outage_is_expected_to_last_for_the_mean_of_what_it_may() -> None:
    """From one to three hours, 5 to 12 slots alike, of which two are over: 3 to 10 more, or 8 where
    the horizon ends, on average 6.125.
    """
    found = belief(0.3, Repair("uniform", (1.0, 3.0), wind_limit_mps=200.0))
    assert found.expected_left(known(3, b=2)).tolist() == [0, 7, 0]


def test_no_crew_works_in_the_wind() -> None:
    found = belief(0.3)
    found.calm[:, :8] = False
    assert found.expected_left(known(3, b=2))[1] == 8 - 4 + 4
    assert found.longest_slots > belief(0.3).longest_slots == 4


def test_one_crew_mends_one_line_after_the_other() -> None:
    found = belief(0.3, Repair("fixed", (1.0,), crews=1, wind_limit_mps=200.0))
    down = found.paths(known(7, a=7, b=7), SLOTS - 8, 20)
    assert (down[0].sum(axis=0) + down[1].sum(axis=0) >= 4).all()
    both = belief(0.3).paths(known(7, a=7, b=7), SLOTS - 8, 20)
    assert both[:2].sum() < down[:2].sum()


def test_a_crew_that_was_free_came_with_the_failure() -> None:
    """Five slots of work: of a, down in 2 to 4, three are done, and of b, down in 4, one."""
    found = belief(0.3, Repair("fixed", (1.25,), crews=2, wind_limit_mps=200.0))
    assert found.expected_left(known(4, a=2, b=4)).tolist() == [2, 4, 0]


def test_a_mended_line_is_believed_to_hold() -> None:
    down = np.zeros((3, 6), bool)
    down[1, 1] = True
    mended = history(down)
    assert belief(0.3).chances(mended, SLOTS)[1].sum() == 0.0
