"""The map of a plan shows the moments that matter, each line and bus in its state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.plots.feeder.picture import moments
from resilience.plots.feeder.view import CLOSED, OUT, feeder_map
from resilience.plots.saved import draw_plan
from tests.unit.pages.results import two_islands


def test_view_holds_flows_sheds_and_states_of_the_plan() -> None:
    plan = two_islands()
    assert plan.case is not None
    view = feeder_map(plan, plan.case)
    assert view.line_state.tolist() == [[CLOSED, CLOSED, OUT, OUT]] * 2
    # East takes 1 MW for its loads and 1 MW for storage while the grid is there, west 1.5 MW.
    np.testing.assert_allclose(view.flow_mw[:, :2], [[2.0, 2.0], [1.5, 1.5]], atol=1e-6)
    np.testing.assert_allclose(view.flow_mw[:, 2:], 0.0, atol=1e-6)
    assert view.shed_mw.sum() == pytest.approx(0.4)
    np.testing.assert_allclose(view.demand_mw.sum(axis=0), 2.5)
    assert moments(view)[0] == 1
    assert set(moments(view)) <= {1, 2, 3}


def test_moments_of_a_calm_plan_are_its_peak() -> None:
    plan = rs.solve("analytic/arbitrage", "lp")
    assert plan.case is not None
    assert len(moments(feeder_map(plan, plan.case))) == 1


def test_a_picture_called_map_is_the_map(tmp_path: Path) -> None:
    figure = rs.plot_map(two_islands())
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles[0].startswith("13:00: 2.50 MW asked for, 0.00 shed")
    assert "out: grid-east, grid-west" in titles[1]
    for name in ("map.png", "map.svg", "plan.svg"):
        draw_plan(two_islands(), tmp_path / name)
    text = {name: (tmp_path / name).read_text() for name in ("map.svg", "plan.svg")}
    assert len(text["map.svg"]) != len(text["plan.svg"])


def test_slots_of_a_map_are_those_of_the_plan() -> None:
    with pytest.raises(rs.UsageError, match="slots 4; allowed: 0 to 3"):
        rs.plot_map(two_islands(), slots=(4,))
