"""Cuts by hand: the highest one depends on its constant, on the levels, and on the state."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.dispatch.sddp.model import Cuts

CUTS = Cuts(
    np.array([3.0, 10.0, -2.0]),
    np.array([[2.0, -0.5], [-1.0, 0.25], [0.75, 3.0]]),
    np.array([[0.5], [2.0], [4.0]]),
)
STATE = np.array([1.5, 2.5])  # slopes times state: 1.75, -0.875, 8.625


@pytest.mark.parametrize(
    ("level", "value", "slope"),
    [(0.3, 10.6 - 0.875, [-1.0, 0.25]), (5.0, 18.0 + 8.625, [0.75, 3.0])],
)
def test_the_highest_cut_gives_value_and_slope(
    level: float, value: float, slope: list[float]
) -> None:
    levels = np.array([level])
    assert CUTS.value(STATE, levels) == pytest.approx(value)
    assert CUTS.slope(STATE, levels).tolist() == slope


def test_a_mixture_of_cuts_is_worth_the_mixture_of_their_worths() -> None:
    weights, levels = np.array([[0.2, 0.3, 0.5], [0.6, 0.1, 0.3]]), np.array([1.7])
    each = CUTS.constants(levels) + CUTS.beta @ STATE
    mixed = CUTS.mixed(weights)
    np.testing.assert_allclose(mixed.constants(levels) + mixed.beta @ STATE, weights @ each)


def test_joined_cuts_are_those_of_all_batches_in_their_order() -> None:
    joined = Cuts.joined([CUTS[1:], CUTS[:2]])
    levels = np.array([2.3])
    every = CUTS.constants(levels)
    np.testing.assert_allclose(joined.constants(levels), every[[1, 2, 0, 1]])
    assert joined.n == 4


def test_what_remains_is_worth_its_price() -> None:
    cuts = Cuts.of_prices(np.array([4.0, 7.0]), levels=2)
    assert cuts.value(STATE, np.array([3.0, 9.0])) == pytest.approx(-(4.0 * 1.5 + 7.0 * 2.5))
