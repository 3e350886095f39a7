"""Costs of network files, against sums by hand."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.case.networks.costs import PIECES, piecewise_cost, polynomial_cost


def test_a_straight_polynomial_has_a_slope_and_a_cost_of_being_on() -> None:
    cost = polynomial_cost([0.0, 35.0, 12.0], 0.4, 2.5, start=70.0)
    assert (cost.per_mwh, cost.per_h, cost.start, cost.curve) == (35.0, 12.0, 70.0, None)


def test_chords_lie_above_a_parabola_and_touch_it_at_their_ends() -> None:
    """Between two of them a chord is at most c (width / 2)^2 above it."""
    cost = polynomial_cost([8.0, 20.0, 5.0], 0.4, 2.4)
    assert cost.curve is not None
    assert cost.is_chords
    assert [p for p, _ in cost.curve] == pytest.approx([0.4, 0.9, 1.4, 1.9, 2.4])
    assert len(cost.curve) == PIECES + 1
    assert [y for _, y in cost.curve] == pytest.approx(
        [8 * p**2 + 20 * p + 5 for p in (0.4, 0.9, 1.4, 1.9, 2.4)]
    )
    assert cost.per_mwh == pytest.approx(20.0 + 8.0 * (0.4 + 2.4))


@pytest.mark.parametrize("p_max_mw", [0.4, np.inf])
def test_a_parabola_over_no_range_is_a_line_that_is_named_as_one(p_max_mw: float) -> None:
    cost = polynomial_cost([8.0, 20.0, 5.0], 0.4, p_max_mw)
    assert cost.curve is None
    assert cost.is_chords
    assert cost.per_mwh == pytest.approx(20.0 + 2 * 8.0 * 0.4)


def test_points_are_drawn_out_to_the_range_of_the_unit() -> None:
    cost = piecewise_cost(((0.5, 60.0), (1.0, 90.0), (1.5, 150.0)), 0.2, 2.0)
    assert cost.curve is not None
    np.testing.assert_allclose(cost.curve, ((0.2, 42.0), (1.0, 90.0), (2.0, 210.0)))
    assert cost.per_mwh == pytest.approx((210.0 - 42.0) / 1.8)


def test_points_on_one_line_are_no_curve() -> None:
    cost = piecewise_cost(((0.5, 60.0), (1.0, 95.0), (1.5, 130.0)), 0.2, 2.0)
    assert cost.curve is None
    assert [cost.per_mwh, cost.per_h] == pytest.approx([70.0, 25.0])


@pytest.mark.parametrize("points", [((0.5, 60.0),), ((0.5, 60.0), (0.5, 70.0))])
def test_points_that_do_not_rise_are_refused(points: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="rising"):
        piecewise_cost(points, 0.2, 2.0)
