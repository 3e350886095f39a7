"""Without losses reactive power is free; a plan of `lp` must not send it round in circles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods.tidy import with_least_circulation
from resilience.planning.ac_check import ac_check_plan
from resilience.testing import small_case


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


def street(**devices: Any) -> CaseProgram:
    """A load far from the grid, which feeds at most 0.7 MW and any reactive power; a store beside
    the load has an inverter of 1 MVA.
    """
    store = {"bus": "3", "p_max_mw": 0.8, "e_mwh": 3.4, "soc_initial": 0.9, "s_mva": 1.0}
    case = small_case(
        slots=2,
        buses=3,
        lines=[(1, 2, 0.011, 0.013), (2, 3, 0.017, 0.019)],
        grid=[{"import_max_mw": 0.7, "import_cost_per_mwh": 2.0, "q_max_mvar": 6.0}],
        ess=[store | {"efficiency_discharge": 0.8, "degradation_cost_per_mwh": 3.0}],
        **devices,
    )
    return horizon(case, "lindistflow")


def planned(program: CaseProgram) -> Solution:
    solver = Highs(lower(program.standard, modes={}, discs="inner"))
    solver.update(program.vectors)
    return solver.solve()


def reactive(program: CaseProgram, plan: Solution) -> tuple[Floats, Floats]:
    """What the store gives (slots,) and the lines carry (lines, slots), Mvar."""
    columns = program.standard.columns
    return plan.point[columns("ess.q")][0], plan.point[columns("line.q")]


LOAD = {"bus": "3", "p_max_mw": 1.5, "power_factor": 0.85, "shed_cost_per_mwh": 9.0}
EDGE = (np.cos(np.pi / 12) - 0.8 * np.cos(np.pi / 6)) / np.sin(np.pi / 6)
"""Mvar beside 0.8 MW on the side of the inner polygon whose normal is at 30 degrees: 0.546."""


def test_an_inverter_gives_the_reactive_power_that_its_rating_leaves() -> None:
    """The store discharges 0.8 of 1.5 MW, so 0.6 of the load's 0.93 Mvar would fit, 0.546 within
    the polygon, and the lines carry the others.
    """
    program = street(load=[LOAD])
    before = planned(program)
    after = with_least_circulation(program, before, 20.0)
    assert after.objective == before.objective
    given, carried = reactive(program, after)
    assert given == pytest.approx([EDGE] * 2)
    assert carried == pytest.approx(np.full((2, 2), 1.5 * np.tan(np.arccos(0.85)) - EDGE))


def test_an_inverter_takes_the_reactive_power_that_its_rating_leaves() -> None:
    """A dear unit, which has to run, feeds 1.2 Mvar with its 0.4 MW: more than loads want. In the
    second slot, where they want nearly all of it, the store takes the others.
    """
    unit = {"bus": "3", "p_min_mw": 0.3, "p_max_mw": 0.9, "cost_per_mwh": 5.0}
    unit |= {"q_min_mvar": 1.2, "q_max_mvar": 1.2}
    loads = [
        LOAD | {"p_max_mw": 2.0, "power_factor": 0.98, "profile": "falling"},
        LOAD | {"p_max_mw": 0.3, "power_factor": 0.3, "profile": "rising"},
    ]
    profiles = {"falling": [0.935, 0.8], "rising": [0.1, 0.9]}
    program = street(load=loads, generator=[unit], profiles=profiles)
    given, carried = reactive(program, with_least_circulation(program, planned(program), 20.0))
    p = np.array([profiles["falling"], profiles["rising"]]) * [[2.0], [0.3]]
    surplus = 1.2 - np.tan(np.arccos([0.98, 0.3])) @ p
    assert surplus[0] > EDGE > surplus[1] > 0.01
    assert given == pytest.approx([-EDGE, -surplus[1]])
    assert carried == pytest.approx(np.array([[EDGE - surplus[0], 0.0]] * 2), abs=1e-7)


def test_no_load_is_shed_for_another_to_spare_the_wires() -> None:
    """0.6 of 2.1 MW are missing: the cheaper load is shed, though the other asks for more Mvar."""
    cheap = LOAD | {"bus": "2", "p_max_mw": 0.9, "power_factor": 0.98, "shed_cost_per_mwh": 7.0}
    program = street(load=[LOAD | {"p_max_mw": 1.2}, cheap])
    after = with_least_circulation(program, planned(program), 20.0)
    shed = after.point[program.standard.columns("load.shed")]
    assert shed == pytest.approx(np.array([[0.0, 0.0], [0.6, 0.6]]), abs=1e-7)


def test_a_plan_beyond_a_rating_comes_back_within_it() -> None:
    """The polygon around the disc would let 0.614 Mvar pass, less than before, and too much."""
    program = street(load=[LOAD])
    within = planned(program)
    z = within.point.copy()
    z[program.standard.columns("ess.q")] = 0.9
    after = with_least_circulation(program, replace(within, z=z), 20.0)
    assert reactive(program, after)[0] == pytest.approx([EDGE] * 2)


def test_no_time_changes_no_plan() -> None:
    program = street(load=[LOAD])
    before = planned(program)
    assert with_least_circulation(program, before, 0.0) is before
