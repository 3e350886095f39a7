"""Units that are out: by hand, against a program written here, over methods, and simulated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.case import Case
from resilience.dispatch.registry import factory_of
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.planning.ac_check import ac_check_plan
from resilience.planning.plan import Plan
from resilience.simulation.replay import replay
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import case_optimum, small_case

LOAD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}
DIESEL = {"p_max_mw": 2.0, "cost_per_mwh": 10.0}
STORE = {"p_max_mw": 1.0, "e_mwh": 2.0, "soc_initial": 0.5, "efficiency_charge": 0.9}
METHODS = ["lp", "milp", "socp", "nlp", "minlp"]


def one_bus(*outages: str, **devices: Any) -> Case:
    devices = {"load": [LOAD], "generator": [DIESEL], "ess": [STORE]} | devices
    return small_case(slots=6, outages=outages, **devices)


def own_program(generator_up: list[int], store_up: list[int]) -> float:
    """Least cost of `one_bus`, its rows written here: variables g, charge, discharge, shed."""
    slots, gain = 6, 0.9
    cost = np.concatenate([np.full(slots, 10.0), np.zeros(2 * slots), np.full(slots, 50.0)])
    unit, none = np.eye(slots), np.zeros((slots, slots))
    balance = np.hstack([unit, -unit, unit, unit])
    stored = np.tri(slots)
    level = np.hstack([none, gain * stored, -stored, none])
    up = np.array(store_up, float)
    limits = np.concatenate([2.0 * np.array(generator_up), up, up, np.ones(slots)])
    found = linprog(
        cost,
        A_eq=balance,
        b_eq=np.ones(slots),
        A_ub=np.vstack([level, -level]),
        b_ub=np.concatenate([np.full(slots, 1.0), np.full(slots, 1.0)]),
        bounds=list(zip(np.zeros(4 * slots), limits, strict=True)),
    )
    assert found.status == 0
    return float(found.fun)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("outages", "generator_up", "store_up"),
    [
        (("generator1@02:00-05:00",), [1, 1, 0, 0, 0, 1], [1] * 6),
        (("generator1@02:00-05:00", "ess1@03:00-04:00"), [1, 1, 0, 0, 0, 1], [1, 1, 1, 0, 1, 1]),
        (("ess1@00:00-06:00", "generator1@05:00-06:00"), [1, 1, 1, 1, 1, 0], [0] * 6),
    ],
)
def test_plans_cost_what_a_program_of_ours_does(
    method: str, outages: tuple[str, ...], generator_up: list[int], store_up: list[int]
) -> None:
    plan = rs.solve(one_bus(*outages), method)
    assert isinstance(plan, Plan)
    assert plan.objective == pytest.approx(own_program(generator_up, store_up), rel=1e-5)
    assert replay(plan).operating_cost == pytest.approx(plan.operating_cost, rel=1e-6)
    # A store that is out keeps its energy.
    energy = np.concatenate([[1.0], plan.tables["energy"]["ess1"]])
    np.testing.assert_allclose(np.diff(energy)[np.array(store_up) == 0], 0.0, atol=1e-7)


def test_an_island_without_its_forming_unit_is_dead() -> None:
    """Only the store forms; while it is out nobody may use the diesel set, or the sun."""
    devices = {
        "generator": [DIESEL | {"grid_forming": False}],
        "pv": [{"p_max_mw": 0.4, "curtailable": False}],
    }
    found = case_optimum(one_bus("ess1@02:00-04:00", **devices))
    np.testing.assert_allclose(found["load.shed"][0], [0, 0, 1, 1, 0, 0], atol=1e-9)
    assert found["generator.p"][0, 2:4].max() == 0.0


def test_a_set_that_forms_while_it_is_in_order_beside_a_store_that_is_empty() -> None:
    """The set forms its island whatever is decided, but for the hours in which it is out; then the
    store, empty from the start, would have to.
    """
    empty = STORE | {"soc_initial": 0.0}
    sun = {"p_max_mw": 0.4}
    found = case_optimum(one_bus("generator1@00:00-02:00", ess=[empty], pv=[sun]))
    np.testing.assert_allclose(found["load.shed"][0], [1, 1, 0, 0, 0, 0], atol=1e-9)
    alone = case_optimum(one_bus("generator1@00:00-06:00", ess=[empty], pv=[sun]))
    np.testing.assert_allclose(alone["load.shed"][0], 1.0)
    full = case_optimum(one_bus("generator1@00:00-02:00", pv=[sun]))
    assert full["load.shed"][0, :2].sum() == pytest.approx(2.0 - 0.8 - 1.0)


def test_a_unit_that_runs_trips_and_a_plant_whose_power_must_be_taken_is_gone() -> None:
    """Neither minimum up time, minimum power nor ramp keep the unit on; it waits its time off."""
    unit = DIESEL | {
        "p_min_mw": 0.5, "min_up_h": 6.0, "min_down_h": 2.0, "ramp_down_mw_per_h": 0.1,
        "ramp_up_mw_per_h": 2.0, "start_cost": 1.0,
    }  # fmt: skip
    plant = {"p_max_mw": 0.2, "curtailable": False}
    case = one_bus("generator1@02:00-03:00", "pv1@04:00-06:00", generator=[unit], pv=[plant],
                   ess=[], grid=[{"import_max_mw": 0.3, "import_cost_per_mwh": 20.0}])  # fmt: skip
    found = case_optimum(case)
    np.testing.assert_array_equal(found["generator.on"][0], [1, 1, 0, 0, 1, 1])
    np.testing.assert_allclose(found["pv.p"][0], [0.2] * 4 + [0.0] * 2, atol=1e-9)
    np.testing.assert_allclose(found["load.shed"][0, 2:4], 0.5, atol=1e-9)


def test_a_grid_connection_may_be_out_as_a_line_may() -> None:
    grid = {"bus": "1", "import_max_mw": 3.0, "import_cost_per_mwh": 1.0}
    keys: dict[str, Any] = {"slots": 6, "buses": 2, "lines": [(1, 2, 0.001, 0.001)], "grid": [grid]}
    devices: dict[str, Any] = {"load": [LOAD | {"bus": "2"}], "ess": [STORE | {"bus": "2"}]}
    by_line, by_grid = (
        case_optimum(small_case(outages=[f"{name}@02:00-05:00"], **keys, **devices))
        for name in ("1-2", "grid1")
    )
    assert by_grid.objective == pytest.approx(by_line.objective)


def two_islands() -> Case:
    """A set and a store behind a line; the set forms, the store does, too."""
    return small_case(
        slots=12,
        buses=3,
        lines=[(1, 2, 0.001, 0.001), (2, 3, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}, {"name": "2-3", "breakpoint": True}],
        profiles={"demand": (0.8 + 0.2 * np.sin(np.arange(12.0))).tolist()},
        load=[LOAD | {"bus": str(bus), "profile": "demand"} for bus in (2, 3)],
        generator=[DIESEL | {"bus": "2", "p_max_mw": 1.5, "mttf_h": 5.0, "mttr_h": 2.0,
                             "start_failure": 0.3}],
        ess=[STORE | {"bus": "3", "e_mwh": 6.0, "mttf_h": 6.0, "mttr_h": 2.0}],
        pv=[{"bus": "3", "p_max_mw": 0.3, "curtailable": False, "mttf_h": 6.0, "mttr_h": 2.0}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 5.0}],
        terminal_value_per_mwh=6.0,
    )  # fmt: skip


def storms(n: int = 6) -> Scenarios:
    rng = np.random.default_rng(5)
    names = ("1-2", "2-3", "pv1", "ess1", "generator1")
    down = np.zeros((5, 12, n), bool)
    for element in range(5):
        for k in range(n):
            first = int(rng.integers(0, 9))
            down[element, first : first + int(rng.integers(1, 6)), k] = True
    return Scenarios(names, down, np.full(n, 1.0 / n))


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
@pytest.mark.parametrize("method", ["rule", "greedy", "mpc", "stochastic"])
def test_trajectories_stand_before_the_referee_and_above_the_bound(
    method: str, physics: Physics
) -> None:
    case, drawn = two_islands(), storms()
    world = World.build(microgrid_with_fallible_lines(case, drawn, physics), drawn)
    run = simulate(world, factory_of(method)(world.setting))
    bound = clairvoyant(world).objective
    value = world.end_value_per_mwh
    assert (run.objective(value) >= bound - 1e-6).all()
    # What is out gives nothing, and keeps what it has.
    down = dict(zip(drawn.lines, drawn.down, strict=True))
    assert np.abs(run.storage[0][down["ess1"]]).max() == 0.0
    assert run.flow("generator.p")[0][down["generator1"]].max() == 0.0
    assert run.flow("pv.p")[0][down["pv1"]].max() == 0.0
    np.testing.assert_allclose(np.diff(run.energy[0], axis=0)[down["ess1"]], 0.0, atol=1e-12)


def test_each_scenario_costs_as_the_plan_that_knows_its_outages() -> None:
    case, drawn = two_islands(), storms()
    world = World.build(microgrid_with_fallible_lines(case, drawn, "copperplate"), drawn)
    bound = clairvoyant(world).objective
    for k in range(drawn.n):
        events = [rs.Outage(*event[1:]) for event in drawn.chosen([k]).events()]
        plan = rs.solve(case.replace(outages=events), "milp", physics="copperplate")
        assert plan.objective >= bound[k] - 1e-6
        assert plan.objective == pytest.approx(bound[k], rel=1e-4)


def test_plans_over_scenarios_know_units() -> None:
    """Two equally likely hours in which the set is out, seen as they begin: the mean of both."""
    case = one_bus(ess=[], load=[LOAD])
    down = np.zeros((1, 6, 2), bool)
    down[0, 2:4, 0] = True
    both = Scenarios(("generator1",), down, np.array([0.25, 0.75]))
    plan = rs.solve(case, "stochastic", scenarios=both)
    assert plan.objective == pytest.approx(0.25 * (4 * 10.0 + 2 * 50.0) + 0.75 * 60.0)


def test_ac_power_flow_hangs_islands_on_units_in_order() -> None:
    """Cut off for good. The set would carry the island, but is out from 03:00 to 06:00: the store
    gives the losses then, within its limits, and the set nothing.
    """
    case = two_islands().replace(outages="1-2@00:00-12:00, generator1@03:00-06:00")
    plan = rs.solve(case, "milp")
    assert isinstance(plan, Plan)
    checked = ac_check_plan(plan)
    assert not checked.not_converged
    root_mw = checked.flow.p_root_mw
    set_bus, store_bus = (case.network.bus(bus) for bus in ("2", "3"))
    out = np.arange(12)[3:6]
    lost = checked.flow.loss_mw
    np.testing.assert_allclose(root_mw[store_bus][out], lost[out], atol=1e-6)
    assert lost[out].min() > 0.0
    np.testing.assert_allclose(root_mw[set_bus][out], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.delete(root_mw[set_bus] - lost, out), 0.0, atol=1e-6)
