"""Without losses reactive power is free; a plan of `lp` must not send it round in circles."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.planning.ac_check import ac_check_plan


def test_the_tie_break_costs_nothing_and_spares_the_wires() -> None:
    """AC losses of the linear plan are those of the AC optimum to a quarter, not nine times."""
    linear = rs.solve("ieee33", "lp")
    optimum = rs.solve("ieee33", "minlp")
    assert linear.gap == pytest.approx(0.0, abs=1e-9)
    assert max(linear.audit.values()) < 1e-9
    found = ac_check_plan(linear)
    assert found.loss_mwh == pytest.approx(optimum.energy_mwh["losses"], rel=0.25)


def test_two_inverters_do_not_feed_each_other() -> None:
    """Both could serve the load's reactive power at no cost: no line carries more than it asks."""
    plan = rs.solve("ieee33", "lp", outages="none")
    q = plan.tables["line_reactive"].values
    demand = plan.tables["demand"].values.sum(0) * np.tan(np.arccos(0.95))
    assert (np.abs(q).max(0) <= demand + 1e-6).all()
