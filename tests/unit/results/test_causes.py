"""Why load was shed, by name and number; every number is from the head."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.testing import small_case

LOAD: dict[str, Any] = {"bus": "2", "p_max_mw": 2.0, "shed_cost_per_mwh": 1000.0}
GRID: dict[str, Any] = {"import_max_mw": 10.0, "q_max_mvar": 10.0, "import_cost_per_mwh": 1.0}
LINE = (1, 2, 0.001, 0.001)


def causes(method: str = "lp", **keys: Any) -> dict[str, dict[str, str]]:
    """Causes of a case of two buses; the line between them is out from 01:00 to 03:00."""
    known: dict[str, Any] = {
        "slots": 4,
        "buses": 2,
        "lines": [LINE],
        "grid": [GRID],
        "load": [LOAD],
    }
    case = small_case(**(known | {"outages": ["1-2@01:00-03:00"]} | keys))
    plan = rs.solve(case, method)
    assert isinstance(plan, rs.Plan)
    assert {load: set(why) for load, why in plan.shed_by_load.items()} == {
        load: set(why) for load, why in plan.shed_causes.items()
    }
    return plan.shed_causes


def test_an_island_without_a_source_is_named() -> None:
    dark = "no grid-forming unit stands or runs in its island, bus 2"
    assert causes() == {"load1": {"no source": dark}}


def test_sources_at_their_limits_are_named_with_what_is_short() -> None:
    units = [{"bus": "2", "p_max_mw": mw, "cost_per_mwh": 2.0} for mw in (0.5, 0.25)]
    words = "sources of its island are at their limits: generator1, generator2, 1.25 MW short"
    assert causes(generator=units) == {"load1": {"power": words}}


def test_many_names_are_counted_and_those_of_other_islands_are_not_there() -> None:
    units = [{"bus": "2", "p_max_mw": 0.1, "cost_per_mwh": 2.0}] * 6
    elsewhere = {"bus": "1", "p_max_mw": 0.1, "cost_per_mwh": 0.5}
    words = causes(generator=[elsewhere, *units])["load1"]["power"]
    assert "generator2, generator3, generator4, generator5 and 2 more, 1.4 MW short" in words


def test_an_empty_storage_says_what_lacks_and_until_when() -> None:
    """1.2 of 4 MWh are there; with 1.2 MW at the most the first hour cannot have them all."""
    unit = {"bus": "2", "p_max_mw": 2.0, "e_mwh": 1.2, "soc_initial": 1.0, "soc_min": 0.0}
    generator = {"bus": "2", "p_max_mw": 0.3, "cost_per_mwh": 2.0}
    why = causes(ess=[unit], generator=[generator])["load1"]
    lacks = "its island lacks 2.2 MWh until 03:00"  # 4 - 0.6 - 1.2
    assert why["energy"] == f"storage ess1 is empty; {lacks}"


def test_what_is_saved_for_dearer_hours_is_one_lack_with_what_is_empty_after_them() -> None:
    """The clinic asks for 0.15 and 1.5 MW, the town for 2 and nothing: 1.65 MWh of 3.65 lack."""
    clinic = {"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 9000.0, "profile": "clinic"}
    unit = {"bus": "2", "p_max_mw": 2.0, "e_mwh": 2.0, "soc_initial": 1.0, "soc_min": 0.0}
    why = causes(
        load=[LOAD | {"profile": "town"}, clinic],
        ess=[unit],
        profiles={"clinic": [0.0, 0.1, 1.0, 0.0], "town": [0.0, 1.0, 0.0, 0.0]},
    )
    words = "storage ess1 saves what it has for later; its island lacks 1.65 MWh until 02:00"
    assert why == {"load1": {"saved": words}}


def test_fuel_is_that_of_the_tank() -> None:
    """0.5 m³ are 2 MWh of the 4."""
    unit = {"bus": "2", "p_max_mw": 3.0, "cost_per_mwh": 9.0, "tank": "tank1"}
    why = causes(
        generator=[unit | {"fuel_m3_per_mwh": 0.25}],
        tanks=[{"capacity_m3": 1.0, "initial_m3": 0.5}],
    )["load1"]
    assert why.keys() in ({"fuel"}, {"fuel saved"})  # the hour that goes without may be either
    hour = "02:00" if "fuel saved" in why else "03:00"
    assert f"; its island lacks 2 MWh until {hour}" in next(iter(why.values()))
    assert "tank tank1 is " in next(iter(why.values()))


def test_a_line_at_its_rating_is_named_with_what_it_is_over() -> None:
    """Of 2 MW behind a line of 1.25 MVA 0.75 are shed; before it nothing is, whatever its price."""
    line = (1, 2, 0.001, 0.001, {"rating_mva": 1.25})
    before = {"bus": "1", "p_max_mw": 0.3, "shed_cost_per_mwh": 0.5}
    why = causes(outages=[], lines=[line], load=[LOAD, before])
    over = "line 1-2 is at its rating of 1.25 MVA, 0.75 MW over if nothing behind it were shed"
    assert why["load1"] == {"rating": over}
    assert why["load2"].keys() == {"price"}
    assert "0.5 $/MWh" in why["load2"]["price"]


@pytest.mark.parametrize("limit", ["angle_max_degree", "angle_min_degree"])
def test_a_line_at_the_limit_of_its_angle_is_named_with_what_it_is_over(limit: str) -> None:
    """Of 2 MW 0.02 rad over 0.016 pu let 1.25 through, whichever end the line begins at."""
    ends, sign = ((1, 2), 1.0) if limit == "angle_max_degree" else ((2, 1), -1.0)
    line = (*ends, 0.0, 0.016, {limit: sign * float(np.degrees(0.02))})
    why = causes("lp", outages=[], lines=[line])
    degrees = f"{sign * np.degrees(0.02):g}"
    over = f"at its limit of {degrees} degrees between its ends, 0.75 MW over if nothing behind it"
    assert why["load1"].keys() == {"angle"}
    assert over in why["load1"]["angle"]


def test_in_a_loop_every_line_at_its_rating_is_named() -> None:
    lines = [(1, 2, 0.01, 0.01, {"rating_mva": 0.5}), (1, 3, 0.01, 0.01), (3, 2, 0.01, 0.01)]
    why = causes(outages=[], buses=3, lines=lines)
    assert why["load1"]["rating"].startswith("line 1-2 is at its rating of 0.5 MVA, ")


def test_reactive_power_names_the_unit() -> None:
    unit = {"bus": "2", "p_max_mw": 3.0, "cost_per_mwh": 2.0, "q_max_mvar": 0.5}
    why = causes("socp", generator=[unit], load=[LOAD | {"q_mvar": 1.0}])
    words = "reactive power of generator1 is at its limit (s_mva, q_max_mvar)"
    assert why == {"load1": {"reactive": words}}


def test_a_load_served_whole_says_how_much_that_is() -> None:
    unit = {"bus": "2", "p_max_mw": 0.5, "cost_per_mwh": 2.0}
    words = "the load can only be served whole: 2 MW at once"
    why = causes("milp", load=[LOAD | {"block": True}], generator=[unit])
    assert why == {"load1": {"block": words}}


def test_voltages_at_both_ends_are_named() -> None:
    """2 MW over 0.1 pu of resistance ask for more than there is between 0.99 and the grid's 1."""
    line = (1, 2, 0.1, 0.001)
    why = causes(outages=[], lines=[line], voltage_band_pu=(0.99, 1.01))
    words = "bus 2 is at 0.99 pu, the least allowed, and bus 1 at 1 pu, the most"
    assert why == {"load1": {"voltage": words}}


def test_causes_are_saved_and_plans_without_them_load(tmp_path: Any) -> None:
    case = small_case(
        slots=2, buses=2, lines=[LINE], grid=[GRID], load=[LOAD], outages=["1-2@00:00-01:00"]
    )
    plan = rs.solve(case, "lp")
    plan.save(tmp_path / "run")
    assert rs.load_plan(tmp_path / "run").shed_causes == plan.shed_causes
    assert plan.shed_causes["load1"].keys() == {"no source"}
