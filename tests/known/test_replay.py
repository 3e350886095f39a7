"""Law 5: a plan of any method, done again at its own physics, has its cost and its states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.planning.plan import Plan
from resilience.planning.tables import SlotTable
from resilience.simulation.replay import Replayed, replay
from resilience.testing import small_case

METHODS = [
    ("lp", "copperplate"),
    ("milp", "copperplate"),
    ("lp", "lindistflow"),
    ("milp", "lindistflow"),
    ("socp", "distflow"),
    ("nlp", "distflow"),
    ("minlp", "distflow"),
]
ANALYTIC = [name for name in rs.case_names() if name.startswith("analytic/")]
ACCURACY = 1e-6


def kept(plan: Plan) -> dict[str, np.ndarray]:
    """Variables of a plan by kind, (labels, slots)."""
    table = plan.tables["variables"]
    found: dict[str, Any] = {}
    for label, values in zip(table.labels, table.values, strict=True):
        found.setdefault(label.split("[")[0], []).append(values)
    return {kind: np.array(rows) for kind, rows in found.items()}


def misfit(plan: Plan, found: Replayed) -> float:
    """Largest difference in cost (relative) and states, and in what rows are violated by."""
    cost = abs(found.operating_cost - plan.operating_cost) / (1.0 + abs(plan.operating_cost))
    values = kept(plan)
    states = [np.abs(x - values[name]).max() for name, x in found.states.items()]
    worse = found.audit.maximum - max(plan.audit.values())
    return max(cost, worse, *states)


@pytest.mark.parametrize("name", ANALYTIC)
@pytest.mark.parametrize(("method", "physics"), METHODS)
def test_analytic_cases(name: str, method: str, physics: Any) -> None:
    assert len(ANALYTIC) == 6
    plan = rs.solve(rs.load_case(name), method, physics=physics)
    assert isinstance(plan, rs.Plan)
    found = replay(plan)
    assert misfit(plan, found) < ACCURACY
    energy = plan.tables["energy"].values
    np.testing.assert_allclose(found.states["ess.energy"], energy, atol=ACCURACY)


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_ieee33_by_lp(physics: Any) -> None:
    plan = rs.solve("ieee33", "lp", physics=physics)
    assert misfit(plan, replay(plan)) < ACCURACY


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ieee33", "ieee33-commitment"])
@pytest.mark.parametrize(("method", "physics"), METHODS)
def test_ieee33_with_and_without_commitment_by_every_method(
    name: str, method: str, physics: Any
) -> None:
    plan = rs.solve(name, method, physics=physics, relative_gap=0.02)
    assert isinstance(plan, rs.Plan)
    assert misfit(plan, replay(plan)) < ACCURACY


@pytest.fixture(scope="module")
def everything() -> Plan:
    """Blocks, ramps, minimum times, a curve, switching at a cost, a rating and an outage."""
    load = {"p_max_mw": 0.8, "shed_cost_per_mwh": 20.0, "power_factor": 0.95}
    case = small_case(
        slots=6,
        buses=3,
        lines=[(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01), (1, 3, 0.01, 0.01)],
        line_tables=[
            {"name": "1-3", "switchable": True, "switching_cost": 0.1},
            {"name": "2-3", "switchable": True, "switching_cost": 0.2},
            {"name": "1-2", "rating_mva": 1.5, "breakpoint": True},
        ],
        outages=["1-2@02:00-04:00"],
        load=[
            {**load, "bus": "2", "block": True, "profile": "demand"},
            {**load, "bus": "3", "profile": "demand"},
        ],
        profiles={"demand": [0.3, 0.9, 1.0, 0.9, 0.6, 1.0], "sun": [0.0, 0.5, 1.0, 1.0, 0.4, 0.0]},
        pv=[{"bus": "3", "p_max_mw": 0.6, "profile": "sun", "s_mva": 0.7}],
        ess=[{"bus": "3", "p_max_mw": 0.5, "e_mwh": 1.0, "efficiency_charge": 0.9, "s_mva": 0.6}],
        generator=[
            {
                "bus": "2",
                "p_max_mw": 1.0,
                "p_min_mw": 0.3,
                "start_cost": 0.5,
                "no_load_cost_per_h": 0.1,
                "min_up_h": 2.0,
                "min_down_h": 2.0,
                "ramp_up_mw_per_h": 0.4,
                "cost_curve": [[0.0, 0.0], [0.5, 1.0], [1.0, 3.0]],
                "q_min_mvar": -0.5,
                "q_max_mvar": 0.5,
            }
        ],
        grid=[{"import_max_mw": 1.0, "import_cost_per_mwh": 4.0}],
        terminal_value_per_mwh=1.0,
    )
    return rs.solve(case, "milp", physics="lindistflow", relative_gap=0.0)


def test_a_plan_with_every_kind_of_decision(everything: Plan) -> None:
    found = replay(everything)
    assert misfit(everything, found) < ACCURACY
    assert {"ess.energy", "generator.on", "generator.up_left", "line.closed"} <= found.states.keys()
    assert found.costs == pytest.approx(everything.costs)


def test_a_wrong_decision_is_caught(everything: Plan) -> None:
    """Whatever single decision is moved by 0.01, cost, states or a row no longer fit.

    States follow, but for lines that are closed, and so does what a storage lacks to form an
    island: replay makes it the largest of what it stands for, whatever the plan says.
    """
    table = everything.tables["variables"]
    states = replay(everything).states
    for k, label in enumerate(table.labels):
        kind = label.split("[")[0]
        values = table.values.copy()
        values[k, 3] += 0.01 if values[k, 3] < 0.5 else -0.01
        moved = SlotTable(table.labels, values)
        wrong = replace(everything, tables={**everything.tables, "variables": moved})
        found = replay(wrong)
        follows = kind in states and kind != "line.closed"
        if follows or kind == "ess.lacks":
            assert misfit(everything, found) < ACCURACY, label
        else:
            assert misfit(everything, found) > 10 * ACCURACY, label


def test_a_saved_plan_is_replayed_alike(everything: Plan, tmp_path: Path) -> None:
    back = rs.load_plan(everything.save(tmp_path / "plan"))
    assert replay(back).operating_cost == pytest.approx(everything.operating_cost)


def test_what_cannot_be_replayed_is_refused(everything: Plan) -> None:
    with pytest.raises(rs.UsageError, match="`variables`"):
        replay(replace(everything, case=None))
    other = replace(everything, physics="copperplate")
    with pytest.raises(rs.UsageError, match="not those of its case"):
        replay(other)
