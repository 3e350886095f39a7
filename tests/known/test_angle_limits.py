"""Limits of angles: closed forms, a published optimum, and what AC power flow says of them.

A line without resistance carries sin(theta) / x between two voltages of 1 pu; LinDistFlow has
theta / x in its place. PGLib's cases of small angle differences are in `test_pglib`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.networks.network import Network
from resilience.case.write import case_text
from resilience.models.case_program import horizon
from resilience.models.microgrid import Microgrid
from resilience.models.network.graph import bundle
from resilience.planning.ac_check import ac_check_plan
from resilience.testing import small_case
from tests.known.solving import solved

X = 0.2
HELD = {"v_min_pu": 1.0, "v_max_pu": 1.0}
GRID = {"import_max_mw": 9.0, "import_cost_per_mwh": 10.0, "q_max_mvar": 9.0, "v_pu": 1.0}
REACTIVE = {"bus": "2", "p_max_mw": 0.0, "q_min_mvar": -5.0, "q_max_mvar": 5.0}
TAP = {"tap_ratio": 1.25, "shift_degree": 20.0}


def pair(limits: dict[str, Any], **tables: Any) -> Case:
    """Bus 1 has the grid, bus 2 a load of 3 MW; voltages are held, and Mvar is no object."""
    keys: dict[str, Any] = {
        "slots": 1,
        "buses": 2,
        "lines": [(1, 2, 0.0, X, limits)],
        "grid": [GRID],
        "load": [{"bus": "2", "p_max_mw": 3.0, "shed_cost_per_mwh": 1000.0}],
        "generator": [REACTIVE],
        "bus_tables": {1: HELD, 2: HELD},
    }
    return small_case(**keys | tables)


def served(case: Case, method: str) -> float:
    """MW, of the load."""
    found = solved(case, method)
    assert found.violation < 1e-6
    assert found.answer.relaxed == []
    return float(3.0 - found["load.shed"][0, 0])


FORWARD = {
    "a limit": ({"angle_max_degree": 20.0}, 20.0, 1.0),
    "both": ({"angle_max_degree": 12.0, "angle_min_degree": -5.0}, 12.0, 1.0),
    # Of the voltages at the buses: a shift of 20 degrees leaves 10 of 30.
    "a shift": ({"angle_max_degree": 30.0} | TAP, 10.0, 1.25),
    "a full turn": ({"angle_max_degree": 180.0}, 90.0, 1.0),
}


@pytest.mark.parametrize("name", FORWARD)
def test_a_line_carries_what_its_angle_lets_through(name: str) -> None:
    limits, degrees, tap = FORWARD[name]
    case, angle = pair(limits), math.radians(degrees)
    most = math.sin(angle) / X / tap
    assert served(case, "nlp") == pytest.approx(min(most, 3.0), abs=1e-6)
    assert served(case, "minlp") == pytest.approx(min(most, 3.0), abs=1e-6)
    linear = angle / X / tap if degrees < 90.0 else 3.0
    assert served(case, "lp") == pytest.approx(min(linear, 3.0), abs=1e-6)
    check = ac_check_plan(rs.solve(case, "nlp"))
    assert check.ok
    if most < 3.0:
        assert check.angle is not None
        assert check.angle.value == pytest.approx(limits["angle_max_degree"], abs=1e-5)


@pytest.mark.parametrize(("sign", "limit"), [(1.0, "angle_max_degree"), (-1.0, "angle_min_degree")])
def test_it_is_the_first_bus_that_leads(sign: float, limit: str) -> None:
    """The load behind the line's second bus, or behind its first."""
    ends = (1, 2) if sign > 0 else (2, 1)
    other = "angle_min_degree" if sign > 0 else "angle_max_degree"
    binding = pair({}, lines=[(*ends, 0.0, X, {limit: sign * 15.0})])
    assert served(binding, "nlp") == pytest.approx(math.sin(math.radians(15.0)) / X, abs=1e-6)
    idle = pair({}, lines=[(*ends, 0.0, X, {other: -sign * 15.0})])
    assert served(idle, "nlp") == pytest.approx(3.0, abs=1e-6)


def test_a_line_that_is_out_keeps_its_limits() -> None:
    """And the island behind it lives on; with the line back, the limit binds again."""
    limits = {"angle_max_degree": 20.0, "angle_min_degree": -1.0}
    unit = {"bus": "2", "p_max_mw": 2.0, "q_min_mvar": -2.0, "q_max_mvar": 2.0,
            "cost_per_mwh": 900.0, "grid_forming": True}  # fmt: skip
    breaks = [{"name": "1-2", "breakpoint": True}]
    out = ["1-2@00:00-01:00"]
    case = pair(limits, slots=2, generator=[unit], line_tables=breaks, outages=out)
    found = solved(case, "nlp")
    assert found["generator.p"][0, 0] == pytest.approx(2.0, abs=1e-5)
    assert found["line.p"][0] == pytest.approx([0.0, math.sin(math.radians(20.0)) / X], abs=1e-5)


@pytest.mark.parametrize("method", ["milp", "minlp"])
def test_of_two_ways_the_one_whose_angle_allows_it_is_chosen(method: str) -> None:
    """The near way carries 0.87 MW of 3, the far one all of it."""
    lines = [
        (1, 2, 0.0, X, {"name": "near", "angle_max_degree": 10.0}),
        (1, 3, 0.0, 0.5 * X, {"name": "far"}),
        (3, 2, 0.0, 0.5 * X, {"name": "tie", "in_service": False}),
    ]
    switches = [{"name": name, "switchable": True} for name in ("near", "far", "tie")]
    found = solved(pair({}, buses=3, lines=lines, line_tables=switches), method)
    assert float(found["load.shed"].sum()) == pytest.approx(0.0, abs=1e-6)
    assert not found.of("line.closed", "near").any()
    assert found.of("line.closed", "tie").all()


def test_power_flow_sees_what_a_copper_plate_does_not() -> None:
    """1.5 MW without Mvar: sin(2 theta) = 2 x P, 18.4 degrees."""
    load = [{"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 1000.0}]
    case = pair({"angle_max_degree": 12.0}, bus_tables={}, load=load)
    plan = rs.solve(case, "lp", physics="copperplate")
    check = ac_check_plan(plan)
    assert check.angle is not None
    degrees = 0.5 * math.degrees(math.asin(2.0 * X * 1.5))
    assert check.angle.value == pytest.approx(degrees, abs=1e-6)
    assert check.angle.excess == pytest.approx(degrees - 12.0, abs=1e-6)
    assert check.angle.limit == 12.0
    assert not check.ok


REACH = {  # of a line of 0.3 pu between voltages of 1 and of 0.9 to 1.1 pu; whether rows are there
    # asin(0.3 / 0.9) = 19.5 degrees is the most that 1 MVA needs.
    "a rating that leaves room": ({"rating_mva": 1.0}, 19.6, False),
    "a rating that does not": ({"rating_mva": 1.0}, 19.4, True),
    "no rating": ({}, 89.0, True),
    # Of the 1 MVA, charging may hide 0.2: asin(0.3 * 1.2 / 0.9) = 23.6 degrees.
    "charging": ({"rating_mva": 1.0, "b_us": 4000.0}, 23.5, True),
    "less charging": ({"rating_mva": 1.0, "b_us": 4000.0}, 23.7, False),
    # V' = 1 / 1.1 is less: asin(0.3 * 1.1 / 0.9) = 21.5 degrees.
    "a tap": ({"rating_mva": 1.0, "tap_ratio": 1.1}, 21.4, True),
    "less of a tap": ({"rating_mva": 1.0, "tap_ratio": 1.1}, 21.6, False),
}


@pytest.mark.parametrize("name", REACH)
def test_limits_that_a_rating_keeps_by_itself_are_no_rows(name: str) -> None:
    keys, degrees, there = REACH[name]
    limits = {"angle_min_degree": -degrees, "angle_max_degree": degrees}
    case = pair(limits | keys, bus_tables={})
    case = replace(case, network=replace(case.network, x_pu=np.array([0.3])))
    rows = {row.name for row in horizon(case, "distflow").standard.form.stage.rows}
    assert rows >= {"line.voltage"}
    assert ({"line.angle_min", "line.angle_max"} <= rows) == there
    assert bool({"line.angle_min", "line.angle_max"} & rows) == there


def test_a_line_without_impedance_keeps_every_limit_by_itself() -> None:
    """With no rating, too: there is no angle between its ends."""
    case = pair({}, lines=[(1, 2, 0.0, 0.0, {"angle_max_degree": 1.0})])
    assert served(case, "nlp") == pytest.approx(3.0, abs=1e-6)
    rows = {row.name for row in horizon(case, "distflow").standard.form.stage.rows}
    assert "line.angle_max" not in rows


def test_parallel_lines_made_one_have_the_narrowest_limits() -> None:
    """Limits of a line that points the other way count the other way round."""
    network = small_case(
        buses=2,
        lines=[
            (1, 2, 0.1, 0.1, {"angle_min_degree": -9.0, "angle_max_degree": 30.0}),
            (2, 1, 0.1, 0.1, {"angle_min_degree": -20.0, "angle_max_degree": 8.0}),
            (1, 2, 0.1, 0.1, {}),
        ],
        grid=[GRID],
    ).network
    one = bundle(network, np.zeros(3, bool))
    assert one.line_names == ("1-2",)
    assert (one.angle_min_degree[0], one.angle_max_degree[0]) == (-8.0, 20.0)


def test_limits_come_back_from_a_case_written_out(tmp_path: Path) -> None:
    case = pair({"angle_min_degree": -9.0, "angle_max_degree": 12.5})
    (tmp_path / "case.toml").write_text(case_text(case), encoding="utf-8")
    again = rs.load_case(tmp_path / "case.toml")
    assert _limits(again.network) == _limits(case.network) == (-9.0, 12.5)
    assert Microgrid.build(again, "distflow").network.angle_max_degree.tolist() == [12.5]


def _limits(network: Network) -> tuple[float, float]:
    return float(network.angle_min_degree[0]), float(network.angle_max_degree[0])


def test_limits_that_forbid_an_idle_line_are_refused() -> None:
    """All at once: such a line could not be out, and most of them are slips."""
    with pytest.raises(rs.CaseError) as refused:
        pair({"angle_min_degree": 2.0, "angle_max_degree": 25.0})
    assert "1-2: 2" in str(refused.value)
    assert "angle_min_degree" in str(refused.value)
    with pytest.raises(rs.CaseError, match="angle_max_degree"):
        pair({"angle_max_degree": 15.0} | TAP)
