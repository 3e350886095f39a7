"""The picture in the docstring of `standard`: where the copies of a stage stand in a program."""

from __future__ import annotations

import numpy as np

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Standard, reach
from resilience.models.program.unroll import unroll


def storage_over_two_slots() -> Standard:
    stage = Stage(1.0)
    unit = ["ess1"]
    now, after = stage.state("energy", unit, 0.0, 4.0, unit="MWh")
    charge, discharge = (stage.var(name, unit, 0.0, 1.0) for name in ("charge", "discharge"))
    stage.eq("dynamics", after, now + charge - discharge)
    stage.cost("wear", discharge, 0.2)
    return unroll([stage], Tree.chain(["0", "1"]))


def test_copies_of_a_stage_stand_where_the_picture_has_them() -> None:
    standard = storage_over_two_slots()
    (stage,) = standard.copies
    assert stage.form.n_now == 1
    assert stage.nodes.tolist() == [0, 1]
    assert stage.columns.tolist() == [[0, 2, 3, 4], [2, 5, 6, 7]]
    assert stage.rows.tolist() == [[0], [1]]
    assert [standard.column_name(j) for j in range(standard.n_columns)] == [
        "energy[ess1, start]",
        "future[1]",
        "energy[ess1, 0]",
        "charge[ess1, 0]",
        "discharge[ess1, 0]",
        "energy[ess1, 1]",
        "charge[ess1, 1]",
        "discharge[ess1, 1]",
    ]
    np.testing.assert_array_equal(
        standard.a.toarray(),
        [[-1, 0, 1, -1, 1, 0, 0, 0], [0, 0, -1, 0, 0, 1, -1, 1]],
    )


def test_numbers_of_a_form_are_bounds_sides_and_prices() -> None:
    form = storage_over_two_slots().form
    lower, upper, sides, prices = form.numbers(np.zeros((0, 1)))
    assert lower.ravel().tolist() == [0.0, 0.0, 0.0]
    assert upper.ravel().tolist() == [4.0, 1.0, 1.0]
    assert sides.ravel().tolist() == [0.0]
    assert prices.ravel().tolist() == [0.0, 0.0, 0.0, 0.2]
    np.testing.assert_array_equal(form.prices(np.zeros((0, 1))), prices)


def test_a_bound_that_a_slope_does_not_touch_may_be_infinite() -> None:
    """2 x - 3 y over 1 .. 4 and -5 .. 7, whatever a third and a fourth value may be."""
    beta = np.array([[2.0, -3.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5]])
    low, high = np.array([1.0, -5.0, -np.inf, 2.0]), np.array([4.0, 7.0, np.inf, np.inf])
    least, greatest = reach(beta, low, high)
    assert least.tolist() == [2.0 - 21.0, 1.0]
    assert greatest.tolist() == [8.0 + 15.0, np.inf]
