"""Prices of plans: closed forms, and what two more solves say of a little more demand."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.planning.tables import SlotTable
from resilience.testing import small_case

GRID: dict[str, Any] = {"import_max_mw": 10.0, "q_max_mvar": 10.0, "import_cost_per_mwh": 40.0}
STEP_MW = 1e-3
SHED: dict[str, Any] = {"shed_cost_per_mwh": 5000.0}
TARIFF: dict[str, Any] = {
    "slots": 2,
    "profiles": {"tariff": [30.0, 300.0]},
    "grid": [GRID | {"import_cost_per_mwh": 1.0, "price_profile": "tariff"}],
}


def plan_of(method: str = "lp", **keys: Any) -> rs.Plan:
    """The plan of a small case, within a millionth of the best."""
    plan = rs.solve(small_case(**keys), method, relative_gap=1e-6)
    assert isinstance(plan, rs.Plan)
    return plan


def test_stored_energy_is_worth_what_it_saves_after_its_losses() -> None:
    """It charges as fast as it can; a MWh more leaves out 0.9 MWh at 300 $ and wears it by 7 $."""
    unit = {"p_max_mw": 1.0, "p_min_mw": -4.0, "e_mwh": 5.0, "soc_min": 0.0, "soc_initial": 0.1}
    losses = {"efficiency_charge": 0.8, "efficiency_discharge": 0.9}
    store = unit | losses | {"degradation_cost_per_mwh": 7.0}
    plan = plan_of(load=[{"p_max_mw": 4.0} | SHED], ess=[store], **TARIFF)
    np.testing.assert_allclose(plan.frame("bus_price")["1"], [30.0, 300.0], rtol=1e-9)
    worth = plan.frame("storage_value")["ess1"].iloc[0]
    assert worth == pytest.approx(0.9 * (300.0 - 7.0), rel=1e-9)


def test_behind_a_line_at_its_rating_the_dear_unit_tells_the_price() -> None:
    lines = [(1, 2, 0.001, 0.001, {"rating_mva": 1.0}), (2, 3, 0.001, 0.001)]
    unit = {"bus": "2", "p_max_mw": 3.0, "cost_per_mwh": 250.0}
    plan = plan_of(
        slots=1,
        buses=3,
        lines=lines,
        grid=[GRID],
        generator=[unit],
        load=[{"bus": "3", "p_max_mw": 2.0} | SHED],
    )
    np.testing.assert_allclose(plan.frame("bus_price").iloc[0], [40.0, 250.0, 250.0], rtol=1e-6)
    loading = plan.frame("line_loading")
    assert list(loading.columns) == ["1-2"]
    assert loading["1-2"].iloc[0] == pytest.approx(100.0, abs=1e-4)


def test_fuel_that_is_short_is_worth_the_load_that_it_could_serve() -> None:
    """A m³ makes 4 MWh at 100 $ each; without it they are shed at 5000 $."""
    unit = {"p_max_mw": 3.0, "cost_per_mwh": 100.0, "tank": "tank1", "fuel_m3_per_mwh": 0.25}
    plan = plan_of(
        slots=2,
        tanks=[{"capacity_m3": 1.0, "initial_m3": 0.5}],
        generator=[unit],
        load=[{"p_max_mw": 2.0} | SHED],
    )
    np.testing.assert_allclose(plan.frame("fuel_value")["tank1"], 4.0 * 4900.0, rtol=1e-9)
    np.testing.assert_allclose(plan.frame("bus_price")["1"], 5000.0, rtol=1e-9)


def test_dead_islands_have_no_price() -> None:
    plan = plan_of(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        grid=[GRID],
        load=[{"bus": bus, "p_max_mw": 1.0} | SHED for bus in ("1", "2")],
        outages=["1-2@01:00-02:00"],
    )
    prices = plan.frame("bus_price")
    np.testing.assert_allclose(prices["1"], 40.0, rtol=1e-9)
    np.testing.assert_allclose(prices["2"], [40.0, np.nan], rtol=1e-9)


STORE = {"bus": "3", "p_max_mw": 0.4, "e_mwh": 1.0, "s_mva": 0.6, "soc_min": 0.1}
UNITS: dict[str, Any] = {
    "slots": 4,
    "step_min": 30.0,
    "buses": 4,
    "grid": [
        GRID
        | {
            "import_cost_per_mwh": 1.0,
            "price_profile": "tariff",
            "v_pu": 1.0,
            "import_max_mw": 2.0,
        }
    ],
    "ess": [STORE | {"efficiency_charge": 0.95, "efficiency_discharge": 0.92}],
    "generator": [{"bus": "4", "p_max_mw": 1.5, "cost_per_mwh": 90.0} | {"q_max_mvar": 0.8}],
    "load": [
        {"bus": "2", "p_max_mw": 1.1, "power_factor": 0.95, "profile": "day"} | SHED,
        {"bus": "4", "p_max_mw": 0.9, "power_factor": 0.9} | SHED,
    ],
    "profiles": {"tariff": [40.0, 60.0, 140.0, 75.0], "day": [0.7, 0.8, 1.0, 0.9]},
}
FEEDER = [(1, 2, 0.02, 0.03), (2, 3, 0.03, 0.02), (3, 4, 0.05, 0.04)]
RATED = [(1, 2, 0.02, 0.03, {"rating_mva": 1.7}), *FEEDER[1:]]
COMMITTED = [
    {"bus": "4", "p_max_mw": 1.5, "cost_per_mwh": 90.0, "p_min_mw": 0.3, "start_cost": 5.0}
    | {"q_max_mvar": 0.8}
]
WORLDS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "lp": ("lp", "lindistflow", {"lines": FEEDER}),
    "copperplate": ("lp", "copperplate", {"lines": FEEDER}),
    "discs": ("lp", "lindistflow", {"lines": RATED}),
    "milp": ("milp", "lindistflow", {"lines": RATED, "generator": COMMITTED}),
    "socp": ("socp", "distflow", {"lines": FEEDER}),
    "minlp": ("minlp", "distflow", {"lines": RATED, "generator": COMMITTED}),
    "loop": ("nlp", "distflow", {"lines": [*FEEDER, (2, 4, 0.03, 0.05)]}),
}


def cost_of(world: str, probe: tuple[str, int] | None, more_mw: float) -> float:
    """The least cost with a little more demand at a bus and slot, $."""
    method, physics, keys = WORLDS[world]
    extra: list[dict[str, Any]] = []
    profiles = dict(UNITS["profiles"])
    if probe is not None:
        bus, slot = probe
        profiles["probe"] = [float(t == slot) for t in range(UNITS["slots"])]
        extra = [{"bus": bus, "p_max_mw": 0.01 + more_mw, "profile": "probe"} | SHED]
    case = small_case(**(UNITS | keys | {"load": UNITS["load"] + extra, "profiles": profiles}))
    plan = rs.solve(case, method, physics=physics, relative_gap=1e-6)  # type: ignore[call-overload]
    return float(plan.objective)


@pytest.mark.parametrize("world", WORLDS)
def test_a_price_is_what_a_little_more_demand_costs(world: str) -> None:
    method, physics, keys = WORLDS[world]
    case = small_case(**(UNITS | keys))
    plan = rs.solve(case, method, physics=physics, relative_gap=1e-6)  # type: ignore[call-overload]
    prices = plan.frame("bus_price")
    assert prices.notna().all().all()
    for bus, slot in (("4", 2), ("3", 0)):
        more, less = (cost_of(world, (bus, slot), sign * STEP_MW) for sign in (1.0, -1.0))
        slope = (more - less) / (2.0 * STEP_MW * case.step_h)
        assert prices[bus].iloc[slot] == pytest.approx(slope, rel=2e-3), (bus, slot)


def test_losses_make_far_buses_dearer() -> None:
    plan = plan_of("minlp", **(UNITS | {"lines": FEEDER, "generator": [], "ess": []}))
    prices = plan.frame("bus_price").to_numpy()
    np.testing.assert_allclose(prices[:, 0], UNITS["profiles"]["tariff"], rtol=1e-5)
    assert (np.diff(prices, axis=1)[:, [0, 1, 2]] > 0.0).all()


def test_prices_do_not_depend_on_the_unit_of_power() -> None:
    """A farm of a few kW has the prices of a town."""
    town: dict[str, Any] = {
        "slots": 1,
        "grid": [GRID | {"import_max_mw": 1.0}],
        "load": [{"p_max_mw": 2.0} | SHED],
    }
    unit = {"p_max_mw": 0.5, "cost_per_mwh": 30.0}
    farm: dict[str, Any] = {
        "slots": 1,
        "grid": [GRID | {"import_max_mw": 1e-6}],
        "load": [{"p_max_mw": 2e-6} | SHED],
    }
    for keys, size in ((town, 1.0), (farm, 1e-6)):
        plan = plan_of(**keys, generator=[unit | {"p_max_mw": 0.5 * size}])
        np.testing.assert_allclose(plan.frame("bus_price")["1"], 5000.0, rtol=1e-6)
        served = plan_of(**(keys | {"grid": [GRID]}))
        np.testing.assert_allclose(served.frame("bus_price")["1"], 40.0, rtol=1e-6)


def test_prices_are_saved_with_the_plan_and_made_for_one_that_is_read(tmp_path: Path) -> None:
    load = [{"p_max_mw": 4.0} | SHED]
    plan = plan_of(load=load, **TARIFF)
    assert "bus_price" not in plan.tables
    priced = plan.with_prices()
    priced.save(tmp_path / "with")
    plan.save(tmp_path / "without")
    saved = rs.load_plan(tmp_path / "with")
    np.testing.assert_array_equal(saved.tables["bus_price"]["1"], [30.0, 300.0])
    made = rs.load_plan(tmp_path / "without").frame("bus_price")
    np.testing.assert_allclose(made["1"], [30.0, 300.0], rtol=1e-9)
    assert "storage_value" not in priced.tables
    with pytest.raises(rs.UsageError, match="no table 'storage_value'"):
        plan.frame("storage_value")


STUB: dict[str, Any] = {
    "slots": 2,
    "buses": 4,
    "lines": [(1, 2, 0.02, 0.03), (2, 3, 0.03, 0.02), (2, 4, 0.04, 0.03)],
    "line_tables": [{"name": "2-4", "breakpoint": True}],
    "grid": [GRID | {"v_pu": 1.0}],
    "load": [{"bus": "2", "p_max_mw": 2.0} | SHED],
    "pv": [{"bus": "4", "p_max_mw": 0.7, "profile": "sun"}],
    "profiles": {"sun": [0.0, 0.8]},
}


@pytest.mark.parametrize(
    ("method", "physics"),
    [("lp", "lindistflow"), ("lp", "copperplate"), ("socp", "distflow"), ("minlp", "distflow")],
)
def test_where_nothing_can_be_taken_a_mwh_more_costs_what_it_does_beside(
    method: str, physics: str
) -> None:
    """At the end of a feeder and behind PV at night no line carries anything, but it could."""
    plan = rs.solve(small_case(**STUB), method, physics=physics, relative_gap=1e-6)  # type: ignore[call-overload]
    prices = plan.frame("bus_price")
    np.testing.assert_allclose(prices["3"], prices["2"], rtol=1e-5)
    assert prices["4"].iloc[0] == pytest.approx(prices["2"].iloc[0], rel=1e-5)
    assert (prices["2"] >= 40.0 * (1.0 - 1e-6)).all()


def test_prices_in_short_are_those_of_the_table() -> None:
    """Half hours make rows of an hour: means over slots, then over the buses that are alive."""
    profiles = {"tariff": [30.0, 50.0, 230.0, 246.0]}
    plan = plan_of(
        slots=4,
        step_min=30.0,
        buses=3,
        lines=[(1, 2, 0.001, 0.001, {"rating_mva": 1.0}), (2, 3, 0.001, 0.001)],
        profiles=profiles,
        grid=[GRID | {"import_cost_per_mwh": 1.0, "price_profile": "tariff"}],
        generator=[{"bus": "2", "p_max_mw": 3.0, "cost_per_mwh": 250.0}],
        load=[{"bus": "2", "p_max_mw": 2.0} | SHED],
        outages=["2-3@01:00-02:00"],
    )
    first, second = plan.price_rows()
    assert (first.begins, first.ends, second.begins, second.ends) == (0, 2, 2, 4)
    prices = np.array([(row.lowest, row.mean, row.highest) for row in (first, second)], float)
    by_hand = np.array([[40.0, 180.0, 250.0], [238.0, 244.0, 250.0]])
    np.testing.assert_allclose(prices, by_hand, rtol=1e-6)
    assert [(row.lowest_at, row.highest_at) for row in (first, second)] == [("1", "2")] * 2
    printed = StringIO()
    plan.print(file=printed, width=80, with_prices=True)
    rows = [line.split() for line in printed.getvalue().splitlines() if "-0" in line]
    assert rows[-2:] == [
        ["00:00-01:00", "40", "1", "180", "250", "2"],
        ["01:00-02:00", "238", "1", "244", "250", "2"],
    ]
    assert first.storage_low is None
    assert first.fuel_high is None


def test_an_hour_without_any_bus_alive_has_no_price() -> None:
    unit = {"p_max_mw": 3.0, "cost_per_mwh": 100.0}
    plan = plan_of(slots=2, generator=[unit], load=[{"p_max_mw": 2.0} | SHED])
    dark = replace(
        plan, tables={**plan.tables, "bus_price": SlotTable(("1",), np.array([[np.nan, 100.0]]))}
    )
    first, second = dark.price_rows()
    assert (first.lowest, first.lowest_at, first.mean) == (None, "", None)
    assert (second.lowest, second.mean, second.highest_at) == (100.0, 100.0, "1")
