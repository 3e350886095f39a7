"""An outage may stop a generator that its limits would keep running."""

from __future__ import annotations

from typing import Any

import pytest

from resilience import solve
from resilience.case import Case
from resilience.models.microgrid import Physics
from resilience.testing import small_case
from tests.known.solving import solved

UNIT = {"bus": "2", "p_max_mw": 2.2, "cost_per_mwh": 7.0, "initial_on": True, "p_initial_mw": 1.6}
GRID = {"import_max_mw": 5.0, "import_cost_per_mwh": 20.0}


def carried(unit: dict[str, Any], left: dict[str, Any]) -> Case:
    """1.6 MW of load at bus 1 and `left` at bus 2 with the unit; the line is out from 02:00."""
    return small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.003, 0.004)],
        outages=["1-2@02:00-04:00"],
        grid=[GRID],
        load=[
            {"p_max_mw": 1.6, "shed_cost_per_mwh": 900.0},
            {"bus": "2", "shed_cost_per_mwh": 300.0} | left,
        ],
        generator=[UNIT | unit],
    )


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
@pytest.mark.parametrize(
    "unit",
    [
        {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0},
        {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0, "ramp_down_mw_per_h": 0.3},
    ],
)
def test_a_unit_too_large_for_its_island_trips(physics: Physics, unit: dict[str, Any]) -> None:
    """0.3 MW are left, less than 0.5: the unit goes off, and 2 h of 0.3 MW are shed."""
    found = solved(carried(unit, {"p_max_mw": 0.3}), "milp", physics)
    assert found["generator.on"][0] == pytest.approx([1, 1, 0, 0])
    assert found.objective == pytest.approx(2 * 1.9 * 7.0 + 2 * 1.6 * 20.0 + 2 * 0.3 * 300.0)


def test_a_trip_is_reported() -> None:
    unit = {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0}
    plan = solve(carried(unit, {"p_max_mw": 0.3}), method="milp")
    assert plan.tables["trip"]["generator1"].tolist() == [0.0, 0.0, 1.0, 0.0]
    assert "generator1 trips at 02:00, as an outage begins in its island" in plan.notes


def test_a_ramp_does_not_keep_power_up_that_nobody_takes() -> None:
    """From 1.9 to 0.3 MW at once, without commitment, though the ramp allows 0.4 MW per hour."""
    unit = {"ramp_down_mw_per_h": 0.4}
    found = solved(carried(unit, {"p_max_mw": 0.3}), "lp", "copperplate")
    assert found["generator.p"][0] == pytest.approx([1.9, 1.9, 0.3, 0.3])


def test_limits_hold_again_once_the_outage_has_begun() -> None:
    """The demand at bus 2 falls from 0.9 to 0.2 MW an hour later; the unit must stop at 02:00."""
    unit = {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0}
    case = small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.003, 0.004)],
        outages=["1-2@02:00-04:00"],
        profiles={"falling": [1.1, 1.2, 1.3, 0.2]},
        grid=[GRID],
        load=[
            {"p_max_mw": 1.6, "shed_cost_per_mwh": 900.0},
            {"bus": "2", "p_max_mw": 0.9, "shed_cost_per_mwh": 300.0, "profile": "falling"},
        ],
        generator=[UNIT | unit],
    )
    found = solved(case, "milp", "copperplate")
    assert found["generator.on"][0] == pytest.approx([1, 1, 0, 0])
    assert found["load.shed"][1, 2:] == pytest.approx([0.9 * 1.3, 0.9 * 0.2])


def test_without_an_outage_the_unit_may_not_stop() -> None:
    """Its limits hold, so it burns 0.5 MWh an hour at 70 $ that the grid would sell for 20 $."""
    unit = {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0, "cost_per_mwh": 70.0}
    case = carried(unit, {"p_max_mw": 0.3}).replace(outages="")
    found = solved(case, "milp", "copperplate")
    assert found["generator.on"][0] == pytest.approx([1, 1, 1, 1])
    assert found.objective == pytest.approx(4 * (0.5 * 70.0 + 1.4 * 20.0))


def test_what_waits_after_a_trip_is_the_time_to_stand_still() -> None:
    """Back on the grid at 03:00, a unit with 3 h to stand still is missed for 1 h at 20 $/MWh."""
    unit = {"p_min_mw": 0.5, "min_up_h": 7.0, "initial_hours": 2.0, "min_down_h": 3.0}
    case = carried(unit, {"p_max_mw": 0.3}).replace(outages="1-2@02:00-03:00")
    found = solved(case, "milp", "copperplate")
    assert found["generator.on"][0] == pytest.approx([1, 1, 0, 0])
