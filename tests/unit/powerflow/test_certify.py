"""A certificate says of a plan what the wires make of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.errors import UsageError
from resilience.models.ac_check import carry, connected, forming_units, roots
from resilience.models.case_program import status
from resilience.models.components import device_fleets
from resilience.models.microgrid import Microgrid
from resilience.planning.ac_check import ac_check_plan
from resilience.planning.plan import Plan, load_plan
from resilience.planning.solve import solve
from resilience.planning.tables import SlotTable, balance
from resilience.testing import small_case


@pytest.fixture(scope="module")
def ac() -> Plan:
    return solve("ieee33", "minlp")


def test_a_distflow_plan_is_its_own_power_flow(ac: Plan) -> None:
    found = ac_check_plan(ac)
    planned = ac.tables["voltage"].values
    live = ac.tables["island"].values > 0
    assert found.slots == 96
    assert found.ok
    assert found.flow.v_pu[live] == pytest.approx(planned[live], abs=1e-4)
    assert np.isnan(found.flow.v_pu[~live]).all()
    assert found.loss_mwh == pytest.approx(ac.energy_mwh["losses"], rel=1e-3)
    assert found.plan_loss_mwh == pytest.approx(ac.energy_mwh["losses"], rel=1e-9)
    assert found.unfunded_mwh == pytest.approx(0.0, abs=1e-4)
    assert np.abs(found.flow.p_root_mw).max() < 1e-4


def test_a_saved_plan_has_the_same_certificate(ac: Plan, tmp_path: Path) -> None:
    again = ac_check_plan(load_plan(ac.save(tmp_path / "plan")))
    assert again == ac_check_plan(ac)


@pytest.mark.parametrize("physics", ["lindistflow", "copperplate"])
def test_losses_that_a_plan_neglects_are_unfunded(physics: Any) -> None:
    plan = solve("ieee33", "lp", physics=physics)
    found = ac_check_plan(plan)
    assert not found.not_converged
    assert found.plan_loss_mwh == pytest.approx(0.0, abs=1e-9)
    assert found.unfunded_mwh == pytest.approx(found.loss_mwh) != 0.0
    assert found.unfunded_mwh > 1.0
    assert found.root is not None
    assert found.root.excess > 0.1  # the grid gives its 12 MW already
    assert not found.ok
    step = plan.step_min / 60.0
    assert np.nansum(found.flow.p_root_mw) * step == pytest.approx(found.unfunded_mwh)


def feeder(**more: float) -> Case:
    """1 MW at the end of two lines, from the grid; the first line out in the second slot."""
    unit = {"bus": "3", "p_max_mw": 0.8, "cost_per_mwh": 5.0}
    return small_case(
        slots=2,
        buses=3,
        lines=[(1, 2, 0.05, 0.02), (2, 3, 0.05, 0.02)],
        line_tables=[{"name": "2-3", "rating_mva": 1.01}],
        outages=["1-2@01:00-02:00"],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0, "v_pu": 0.97}],
        generator=[unit | more],
        load=[{"bus": "3", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
    )


def test_worst_values_have_their_place_and_time() -> None:
    found = ac_check_plan(solve(feeder(), "lp", physics="copperplate"))
    under, over, load = found.undervoltage, found.overvoltage, found.overload
    assert under is not None
    assert (under.name, under.time, under.limit) == ("3", "00:00", 0.9)
    assert under.excess == pytest.approx(0.9 - under.value)
    # 1 MW over z = 0.1 + 0.04j pu from V = 0.97: v⁴ + (2 r P - V²) v² + |z|² P² = 0
    assert under.value**2 == pytest.approx(max(np.roots([1.0, 0.2 - 0.97**2, 0.1**2 + 0.04**2])))
    assert over is not None
    assert over.time == "01:00"
    assert over.value == pytest.approx(1.0)
    assert over.excess == pytest.approx(-0.1)
    assert load is not None
    assert (load.name, load.time, load.limit) == ("2-3", "00:00", 1.01)
    assert load.excess == pytest.approx(found.flow.overload_mva.max())
    assert load.excess > 0
    assert found.flow.v_pu[0, 0] == pytest.approx(0.97)  # the grid's own voltage
    assert found.flow.v_pu[0, 1] == pytest.approx(0.97)  # alone, and alive


def test_the_root_is_the_grid_or_else_the_largest_forming_unit() -> None:
    case = load_case("ieee33")
    situation = connected(case, status(case) & case.network.in_service[:, None])
    found = roots(case, situation)

    def names(slot: int) -> list[str]:
        return [case.network.bus_names[k] for k in np.flatnonzero(found[:, slot])]

    assert names(0) == ["1"]
    assert names(54) == ["1", "24"]  # 13:30: C alone, 1.5 MW of storage there
    assert names(60) == ["1", "3", "20", "24", "30"]  # four islands, and the grid by itself
    alone = np.array([len(set(situation.island[:, t])) for t in range(case.slots)])
    assert (found.sum(axis=0) == alone).all()


def test_of_several_grids_the_one_that_gives_most_is_the_root() -> None:
    """Two connections, which a tie joins here; then the larger store before the smaller."""
    case = small_case(
        buses=4,
        lines=[(1, 2, 0.05, 0.02), (2, 3, 0.04, 0.02), (3, 4, 0.03, 0.02)],
        line_tables=[{"name": "2-3", "switchable": True}],
        grid=[
            {"bus": "1", "import_max_mw": 2.0, "export_max_mw": 7.0, "import_cost_per_mwh": 1.0},
            {"bus": "3", "import_max_mw": 5.0, "export_max_mw": 0.5, "import_cost_per_mwh": 3.0},
        ],
        ess=[
            {"bus": "2", "p_max_mw": 8.0, "p_min_mw": -0.7, "e_mwh": 4.0},
            {"bus": "4", "p_max_mw": 0.4, "p_min_mw": -0.9, "e_mwh": 3.0},
        ],
    )
    units = forming_units(list(device_fleets(case).values()))
    assert units.names == ("grid2", "grid1", "ess2", "ess1")
    assert units.bus.tolist() == [2, 0, 3, 1]
    assert units.p_min_mw.tolist() == [-0.5, -7.0, -0.4, -8.0]
    assert units.p_max_mw.tolist() == [5.0, 2.0, 0.9, 0.7]
    up = np.array([[True, False, True], [True, True, False], [True, False, True]])
    found = roots(case, connected(case, up))
    assert [np.flatnonzero(column).tolist() for column in found.T] == [[2], [0, 2, 3], [0, 2]]


def store_behind() -> Case:
    """An island of a store and sun, which a line of 0.05 pu joins; it takes 0.4 and gives 0.7."""
    return small_case(
        slots=3,
        buses=3,
        lines=[(1, 2, 0.05, 0.02), (2, 3, 0.05, 0.02)],
        outages=["1-2@01:00-03:00"],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
        ess=[{"bus": "2", "p_max_mw": 0.4, "p_min_mw": -0.7, "e_mwh": 5.0, "soc_initial": 0.6}],
        pv=[{"bus": "3", "p_max_mw": 1.5, "profile": "sun"}],
        load=[{"bus": "3", "p_max_mw": 0.8, "shed_cost_per_mwh": 50.0, "profile": "demand"}],
        profiles={"sun": [0.2, 0.0, 0.8], "demand": [0.5, 1.0, 0.25]},
    )


@pytest.mark.parametrize(
    ("demand_mw", "sun_mw", "limit", "value"),
    [
        (0.78, 0.0, 0.7, 0.8131),  # gives the load and r i^2 = 0.05 (0.78 / v)^2 too much
        (0.1, 1.0, -0.4, -0.8628),  # takes the sun less r i^2 = 0.05 (0.9 / v)^2
    ],
)
def test_a_store_that_carries_an_island_has_a_limit_either_way(
    demand_mw: float, sun_mw: float, limit: float, value: float
) -> None:
    """A plan that was written by hand, so that the store has to give or take beyond its range.

    Bus 2 holds 1 pu; at bus 3 v^4 + (2 r P - 1) v^2 + |z|^2 P^2 = 0 for P taken there.
    """
    plan = solve(store_behind(), "lp", physics="copperplate")
    power = {name: np.zeros(3) for name in plan.tables["power"].labels}
    power["load1"][1], power["pv1"][1] = -demand_mw, sun_mw
    taken = demand_mw - sun_mw
    square = max(np.roots([1.0, 0.1 * taken - 1.0, (0.05**2 + 0.02**2) * taken**2]))
    exact = taken + 0.05 * taken**2 / square
    assert exact == pytest.approx(value, abs=1e-4)
    planned = SlotTable(tuple(power), np.array(list(power.values())))
    tables = {**plan.tables, "power": planned}
    found = ac_check_plan(replace(plan, tables=tables, energy_mwh=balance(store_behind(), tables)))
    root = found.root
    assert root is not None
    assert (root.name, root.time, root.limit) == ("ess1", "01:00", limit)
    assert root.value == pytest.approx(exact, abs=1e-6)
    assert root.excess == pytest.approx(abs(exact - limit), abs=1e-6)

    members = {name: np.array([0.0, values[1]]) for name, values in power.items()}
    up = np.array([[False, False], [True, True]])
    carried = carry(store_behind(), members, up, np.full((1, 2), 1.7))
    assert carried.root_worst_mw == pytest.approx([0.0, abs(exact - limit)], abs=1e-6)
    assert carried.root_excess_mw == pytest.approx([0.0, abs(exact - limit)], abs=1e-6)


def test_an_island_without_forming_unit_is_dead() -> None:
    plan = solve(feeder(grid_forming=False), "lp", physics="copperplate")
    found = ac_check_plan(plan)
    assert np.isnan(found.flow.v_pu[1:, 1]).all()
    assert not found.not_converged
    assert found.flow.loss_mw[1] == 0.0


def test_a_slot_without_solution_is_named_and_counts_in_nothing() -> None:
    case = feeder()
    lines = [(1, 2, 5.0, 2.0), (2, 3, 5.0, 2.0)]
    kinds = ("grid", "generator", "load")
    tables: dict[str, Any] = {k: [t.model_dump() for t in getattr(case, k)] for k in kinds}
    thin = small_case(slots=2, buses=3, lines=lines, outages=["1-2@01:00-02:00"], **tables)
    found = ac_check_plan(solve(thin, "lp", physics="copperplate"))
    assert found.not_converged == ("00:00",)
    assert not found.ok
    assert found.undervoltage is not None
    assert found.undervoltage.time == "01:00"
    assert found.summary()["not_converged"] == ["00:00"]


def test_it_needs_the_case_and_its_whole_network(ac: Plan) -> None:
    with pytest.raises(UsageError, match="without its case"):
        ac_check_plan(replace(ac, case=None))
    case = load_case("ieee33")
    merged = Microgrid.build(case, "copperplate").situation(status(case))
    with pytest.raises(UsageError, match="the situation has 5 buses, the case 33"):
        roots(case, merged)


def two_stores() -> Case:
    """An island of two stores from 01:00 on; the larger of them is empty."""
    return small_case(
        slots=3,
        buses=3,
        lines=[(1, 2, 0.05, 0.02), (2, 3, 0.05, 0.02)],
        outages=["1-2@01:00-03:00"],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 9.0}],
        ess=[
            {"bus": "2", "p_max_mw": 0.3, "p_min_mw": -1.7, "e_mwh": 5.0, "soc_initial": 0.2}
            | {"soc_min": 0.2, "degradation_cost_per_mwh": 0.4},
            {"bus": "3", "p_max_mw": 0.4, "p_min_mw": -0.7, "e_mwh": 3.0, "soc_initial": 0.6}
            | {"degradation_cost_per_mwh": 0.3},
        ],
        load=[{"bus": "3", "p_max_mw": 0.35, "shed_cost_per_mwh": 50.0}],
    )


def test_an_empty_store_carries_nothing_in_a_plan_or_a_trajectory() -> None:
    """By size it would be the first; the other one forms the island, and so holds its voltage."""
    case = two_stores()
    plan = solve(case, "lp", physics="copperplate")
    assert plan.tables["energy"]["ess1"] == pytest.approx([1.0, 1.0, 1.0])
    found = ac_check_plan(plan)
    assert found.ok
    assert found.flow.v_pu[2, 1:] == pytest.approx([1.0, 1.0])
    assert found.loss_mwh == pytest.approx(found.flow.loss_mw[0])  # the load is at the root's bus

    power = {name: plan.tables["power"][name][1:] for name in plan.tables["power"].labels}
    power["ess2"] = np.zeros(2)  # what the root gives then
    up, stored = np.array([[False, False], [True, True]]), np.array([[1.0, 1.5], [1.4, 1.4]])
    root = roots(case, connected(case, up), stored)
    assert root[1:].tolist() == [[False, True], [True, False]]
    lost = carry(case, power, up, stored).loss_mw
    assert lost[0] == pytest.approx(0.0, abs=1e-9)
    assert lost[1] == pytest.approx(0.05 * 0.35**2, rel=0.05)


def test_a_generator_that_stands_carries_nothing() -> None:
    """The diesel at bus 2 is off, since the store at bus 3 has what the load needs."""
    diesel = {"bus": "2", "p_max_mw": 1.9, "p_min_mw": 0.2, "cost_per_mwh": 7.0}
    case = small_case(
        slots=3,
        buses=3,
        lines=[(1, 2, 0.05, 0.02), (2, 3, 0.05, 0.02)],
        outages=["1-2@01:00-03:00"],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 9.0}],
        generator=[diesel | {"no_load_cost_per_h": 60.0}],
        ess=[{"bus": "3", "p_max_mw": 0.4, "p_min_mw": -0.7, "e_mwh": 3.0, "soc_initial": 0.6}],
        load=[{"bus": "3", "p_max_mw": 0.35, "shed_cost_per_mwh": 500.0}],
    )
    plan = solve(case, "milp", physics="copperplate")
    assert plan.tables["on"]["generator1"].max() == 0.0
    found = ac_check_plan(plan)
    assert found.flow.loss_mw[1:] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.abs(found.flow.p_root_mw[1, 1:]).max() == pytest.approx(0.0, abs=1e-9)
