"""Fuel in tanks: by hand, against a program written here, over all methods, and played again."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.case import Case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.backends.highs import Highs
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.referee import settle
from resilience.models.program.unroll import unroll
from resilience.planning.plan import Plan
from resilience.simulation.replay import replay
from resilience.testing import case_optimum, small_case
from resilience.testing.cases import MIDNIGHT

DIESEL = {"p_max_mw": 2.0, "cost_per_mwh": 10.0, "tank": "tank1", "fuel_m3_per_mwh": 0.25}
CRITICAL = {"p_max_mw": 1.0, "shed_cost_per_mwh": 150.0}
OTHER = {"p_max_mw": 1.0, "shed_cost_per_mwh": 30.0}
METHODS = ["lp", "milp", "socp", "nlp", "minlp", "exact"]


def two_loads(fuel_m3: float, **more: Any) -> Case:
    tank = {"capacity_m3": 5.0, "initial_m3": fuel_m3, **more}
    return small_case(slots=4, tanks=[tank], generator=[DIESEL], load=[CRITICAL, OTHER])


@pytest.mark.parametrize(("fuel_m3", "cost"), [(1.0, 160.0), (1.5, 120.0), (0.5, 440.0)])
def test_fuel_goes_to_the_critical_load_first(fuel_m3: float, cost: float) -> None:
    """1 m³ are 4 MWh: all of the critical load; half a m³ more, 2 of the 4 MWh of the other."""
    found = case_optimum(two_loads(fuel_m3))
    assert found.objective == pytest.approx(cost)
    critical, other = found["load.shed"].sum(axis=1)
    assert critical == pytest.approx(max(4.0 - 4.0 * fuel_m3, 0.0))
    assert other == pytest.approx(min(8.0 - 4.0 * fuel_m3, 4.0))
    assert found["tank.level"][0, -1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_and_its_replay(method: str) -> None:
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    plan = rs.solve(two_loads(1.5), method)
    assert isinstance(plan, Plan)
    assert plan.objective == pytest.approx(120.0, rel=1e-5)
    again = replay(plan)
    assert again.operating_cost == pytest.approx(plan.operating_cost, rel=1e-6)
    np.testing.assert_allclose(again.states["tank.level"], plan.tables["fuel"].values, atol=1e-6)
    burnt = 0.25 * plan.tables["power"]["generator1"].cumsum()
    np.testing.assert_allclose(plan.tables["fuel"]["tank1"], 1.5 - burnt, atol=1e-6)
    assert any(note.startswith("tank tank1: 1.500 m³ at the start, 1.5") for note in plan.notes)


def test_fuel_that_is_worth_nothing_is_not_lost() -> None:
    """More than can be burnt: no price holds the level up, and it is what was not burnt."""
    plan = rs.solve(two_loads(5.0), "socp")
    np.testing.assert_allclose(plan.tables["fuel"]["tank1"], [4.5, 4.0, 3.5, 3.0], atol=1e-5)


DELIVERIES = [
    ({"hour": 2.0}, 2),
    ({"hour": 1.25}, 2),
    ({"time": MIDNIGHT.replace(hour=1, minute=1)}, 2),
    ({"hour": 0.0}, 0),
]


@pytest.mark.parametrize(("when", "slot"), DELIVERIES)
def test_a_delivery_is_there_in_time(when: dict[str, Any], slot: int) -> None:
    """1 MWh at the start, 2 MWh more from `slot` on: the hours without are shed."""
    tank = {"capacity_m3": 1.0, "initial_m3": 0.25, "delivery": [{"amount_m3": 0.5, **when}]}
    case = small_case(slots=4, tanks=[tank], generator=[DIESEL], load=[CRITICAL])
    found = case_optimum(case)
    assert found.objective == pytest.approx(30.0 + 150.0)
    if slot:
        shed = found["load.shed"][0]
        assert shed[:slot].sum() == pytest.approx(1.0)
        assert shed[slot:].sum() == pytest.approx(0.0, abs=1e-9)


def test_what_finds_no_room_is_turned_away() -> None:
    """0.25 m³ of the delivery are burnt in its slot and 0.25 find room; they last an hour more."""
    tank = {"capacity_m3": 0.25, "delivery": [{"hour": 1.0, "amount_m3": 2.0}]}
    case = small_case(slots=4, tanks=[tank], generator=[DIESEL], load=[CRITICAL])
    plan = rs.solve(case, "lp")
    assert plan.objective == pytest.approx(3 * 10.0 + 150.0)
    np.testing.assert_allclose(plan.tables["fuel"]["tank1"], [0.0, 0.25, 0.0, 0.0], atol=1e-9)
    assert (
        "tank tank1: 0.250 m³ at the start, 2.000 delivered, 0.750 burnt, 1.500 turned away for "
        "want of room, 0.000 left"
    ) in plan.notes


def test_no_load_fuel_is_burnt_while_a_unit_is_on() -> None:
    """0.6 m³ are two hours at 0.1 + 0.2; three hours would leave 1.5 MWh to give, not 2."""
    unit = DIESEL | {"fuel_m3_per_mwh": 0.2, "fuel_no_load_m3_per_h": 0.1}
    tank = {"capacity_m3": 0.6}
    case = small_case(slots=3, tanks=[tank], generator=[unit], load=[CRITICAL])
    found = case_optimum(case)
    assert found.objective == pytest.approx(20.0 + 150.0)
    assert found["generator.on"].sum() == pytest.approx(2.0)
    assert found["generator.p"].sum() == pytest.approx(2.0)


def test_units_that_share_a_tank_go_by_price_and_scarcity() -> None:
    """The thirsty unit is cheaper, the other burns half: 2 MWh of load at 150.

    With 0.8 m³ the thirsty one gives all, with 0.4 the other; between, the mix that fits, at
    (20 - 10) / (0.4 - 0.2) = 50 $ per m³.
    """
    thrifty = DIESEL | {"p_max_mw": 1.0, "cost_per_mwh": 20.0, "fuel_m3_per_mwh": 0.2}
    thirsty = DIESEL | {"p_max_mw": 1.0, "fuel_m3_per_mwh": 0.4}
    cost = {}
    for fuel_m3 in (0.3, 0.4, 0.6, 0.62, 0.8, 1.0):
        tank = {"capacity_m3": 1.0, "initial_m3": fuel_m3}
        case = small_case(slots=2, tanks=[tank], generator=[thrifty, thirsty], load=[CRITICAL])
        cost[fuel_m3] = case_optimum(case).objective
    assert cost[1.0] == pytest.approx(20.0)
    assert cost[0.8] == pytest.approx(20.0)
    assert cost[0.6] == pytest.approx(30.0)
    assert cost[0.6] - cost[0.62] == pytest.approx(0.02 * 50.0)
    assert cost[0.4] == pytest.approx(40.0)
    assert cost[0.3] == pytest.approx(1.5 * 20.0 + 0.5 * 150.0)


def test_a_convex_curve_is_run_where_it_is_flat() -> None:
    """The second MW burns twice as much: 0.8 m³ are 1 MW for two hours, and 1 MWh of the rest."""
    unit = DIESEL | {"fuel_m3_per_mwh": None, "fuel_curve": [[0, 0], [1, 0.2], [2, 0.6]]}
    unit = {key: value for key, value in unit.items() if value is not None}
    load = CRITICAL | {"p_max_mw": 2.0}
    case = small_case(slots=2, tanks=[{"capacity_m3": 0.8}], generator=[unit], load=[load])
    found = case_optimum(case)
    assert found.objective == pytest.approx(3.0 * 10.0 + 150.0)
    np.testing.assert_allclose(found["tank.burn"].sum(), 0.8, atol=1e-9)


def random_case(rng: np.random.Generator) -> Case:
    """Two tanks, four generators, two with a curve, two loads, a storage, twelve hours."""
    points = np.array([[0.0, 0.0], [0.7, 0.15], [1.2, 0.3], [2.0, 0.7]])
    units = []
    for k in range(4):
        unit: dict[str, Any] = {"p_max_mw": 2.0, "cost_per_mwh": float(rng.uniform(5, 20))}
        unit["tank"] = f"tank{1 + k % 2}"
        if k < 2:
            scaled = points * [1.0, rng.uniform(0.8, 1.4)]
            unit["fuel_curve"] = scaled.tolist()
        else:
            unit["fuel_m3_per_mwh"] = float(rng.uniform(0.2, 0.4))
        units.append(unit)
    tanks = [
        {
            "capacity_m3": float(rng.uniform(1, 3)),
            "initial_m3": float(rng.uniform(0, 1)),
            "delivery": [
                {"hour": float(hour), "amount_m3": float(rng.uniform(0.5, 2))}
                for hour in rng.integers(0, 11, 2)
            ],
        }
        for _ in range(2)
    ]
    demand = rng.uniform(0.3, 1.0, 12).tolist()
    loads = [
        {"p_max_mw": 2.0, "profile": "demand", "shed_cost_per_mwh": 150.0},
        {"p_max_mw": 3.0, "profile": "demand", "shed_cost_per_mwh": 30.0},
    ]
    store = {"p_max_mw": 1.0, "e_mwh": 2.0, "soc_initial": 0.5}
    return small_case(
        slots=12,
        profiles={"demand": demand},
        tanks=tanks,
        generator=units,
        load=loads,
        ess=[store],
    )


def optimum_written_here(case: Case) -> float:
    """The same case as one program for scipy: per slot power and fuel of every unit, what is shed,
    what storage does, levels, and what is turned away.
    """
    t, units, tanks, loads = case.slots, case.generator, case.tank, case.load
    g, k, m = len(units), len(tanks), len(loads)
    per = 2 * g + m + 3 + 2 * k  # p, fuel, shed, charge, discharge, stored, level, turned away
    p, fuel, shed, store, level, away = np.cumsum([0, g, g, m, 3, k])
    cost, bounds = np.zeros(per * t), []
    equal, right, less, most = [], [], [], []
    for s in range(t):
        at = s * per
        for i, unit in enumerate(units):
            cost[at + p + i] = unit.cost_per_mwh
        demand = [load.p_max_mw * case.profiles["demand"][s] for load in loads]
        cost[at + shed : at + shed + m] = [load.shed_cost_per_mwh for load in loads]
        bounds += [(0, unit.p_max_mw) for unit in units] + [(0, None)] * g
        bounds += [(0, d) for d in demand] + [(0, 1.0), (0, 1.0), (0, 2.0)]
        bounds += [(0, tank.capacity_m3) for tank in tanks] + [(0, None)] * k
        row = np.zeros(per * t)  # power
        row[at + p : at + p + g] = row[at + shed : at + shed + m] = 1.0
        row[at + store], row[at + store + 1] = -1.0, 1.0
        equal.append(row), right.append(sum(demand))
        row = np.zeros(per * t)  # stored energy
        row[at + store + 2], row[at + store], row[at + store + 1] = 1.0, -1.0, 1.0
        if s:
            row[at + store + 2 - per] = -1.0
        equal.append(row), right.append(0.0 if s else 1.0)
        for j, tank in enumerate(tanks):
            row = np.zeros(per * t)
            row[at + level + j] = row[at + away + j] = 1.0
            for i, unit in enumerate(units):
                row[at + fuel + i] = float(unit.tank == tank.name)
            if s:
                row[at + level + j - per] = -1.0
            comes = sum(d.amount_m3 for d in tank.delivery if d.hour == s)
            equal.append(row), right.append(comes + (0.0 if s else tank.initial_m3 or 0.0))
        for i, unit in enumerate(units):
            points = unit.fuel_curve or ((0.0, 0.0), (2.0, 2.0 * (unit.fuel_m3_per_mwh or 0.0)))
            for (x1, y1), (x2, y2) in pairwise(points):
                row = np.zeros(per * t)
                row[at + p + i], row[at + fuel + i] = (y2 - y1) / (x2 - x1), -1.0
                less.append(row), most.append((y2 - y1) / (x2 - x1) * x1 - y1)
    answer = linprog(cost, np.array(less), most, np.array(equal), right, bounds, method="highs")
    assert answer.success
    return float(answer.fun)


@pytest.mark.parametrize("seed", range(8))
def test_against_a_program_written_here(seed: int) -> None:
    case = random_case(np.random.default_rng(seed))
    plan = rs.solve(case, "lp", physics="copperplate")
    assert plan.objective == pytest.approx(optimum_written_here(case), rel=1e-7)
    assert plan.objective > 1.05 * sum(unit.cost_per_mwh for unit in case.generator)
    assert not plan.relaxed
    again = replay(plan)
    assert again.audit.maximum < 1e-6
    np.testing.assert_allclose(again.states["tank.level"], plan.tables["fuel"].values, atol=1e-6)


def test_reasons_for_shedding_tell_an_empty_tank_from_a_saved_one() -> None:
    """Half a MWh of the other load is shed, then fuel ends with the critical one still unserved."""
    plan = rs.solve(two_loads(0.75), "lp")
    assert plan.shed_by_load["load1"].keys() <= {"fuel", "fuel saved"}
    assert sum(plan.shed_by_load["load1"].values()) == pytest.approx(1.0)
    assert sum(plan.shed_by_load["load2"].values()) == pytest.approx(4.0)
    assert "fuel saved" in plan.shed_by_load["load2"]


def test_plans_over_scenarios_share_fuel_until_they_part() -> None:
    """The extensive form and the L-shaped method agree, and neither beats foresight."""
    rng = np.random.default_rng(5)
    case = small_case(
        slots=10,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={"demand": rng.uniform(0.5, 1.0, 10).tolist()},
        tanks=[{"capacity_m3": 2.0, "initial_m3": 0.8}],
        generator=[DIESEL | {"bus": "2"}],
        load=[CRITICAL | {"bus": "2", "profile": "demand"}, OTHER | {"bus": "2"}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.0, "soc_initial": 1.0}],
        grid=[{"import_max_mw": 1.5, "import_cost_per_mwh": 1.0}],
    )
    down = np.zeros((1, 10, 3), bool)
    for k, (first, stop) in enumerate([(2, 4), (2, 7), (4, 10)]):
        down[0, first:stop, k] = True
    storms = Scenarios(("1-2",), down, np.array([0.5, 0.3, 0.2]), None)
    plans = [
        rs.solve(case, "stochastic", scenarios=storms, algorithm=algorithm)
        for algorithm in ("extensive", "lshaped")
    ]
    assert plans[0].objective == pytest.approx(plans[1].objective, rel=1e-6)
    alone = []
    for first, stop in [(2, 4), (2, 7), (4, 10)]:
        outage = f"1-2@{first:02d}:00-{stop:02d}:00"
        known = case.replace(outages=[outage])
        alone.append(rs.solve(known, "lp", physics="copperplate").objective)
    assert plans[0].objective >= np.array([0.5, 0.3, 0.2]) @ alone - 1e-9
    assert plans[0].tables["fuel"].values.min() >= -1e-9


def comb_written_here(demand: list[float], stays: list[float], fuel: float, stored: float) -> float:
    """One program for scipy: cost of hour h weighs as its chance, decisions know h alone."""
    h = len(demand)
    cost, bounds, equal, right = np.zeros(6 * h), [], [], []
    for t in range(h):  # power, shed critical, shed other, discharge, level, energy
        cost[6 * t : 6 * t + 3] = stays[t] * np.array([10.0, 150.0, 30.0])
        bounds += [(0, 2), (0, demand[t]), (0, demand[t]), (0, 0.5), (0, 5), (0, 2)]
        row = np.zeros(6 * h)
        row[6 * t : 6 * t + 4] = 1.0
        equal.append(row), right.append(2 * demand[t])
        for place, used, size, start in ((4, 0, 0.25, fuel), (5, 3, 1.0, stored)):
            row = np.zeros(6 * h)
            row[6 * t + place], row[6 * t + used] = 1.0, size
            if t:
                row[6 * (t - 1) + place] = -1.0
            equal.append(row), right.append(0.0 if t else start)
    answer = linprog(cost, A_eq=np.array(equal), b_eq=right, bounds=bounds, method="highs")
    assert answer.success
    return float(answer.fun)


def test_an_outage_of_unknown_length_is_a_comb() -> None:
    """An island that may be joined again after any hour: a tree of one stem and its ends."""
    rng = np.random.default_rng(3)
    h, demand = 9, rng.uniform(0.4, 1.0, 9).tolist()
    stays = np.array([1.0, *np.sort(rng.uniform(0.05, 0.95, h - 1))[::-1]])
    load = {"profile": "demand", "p_max_mw": 1.0}
    case = small_case(
        slots=h,
        profiles={"demand": demand},
        tanks=[{"capacity_m3": 5.0, "initial_m3": 1.0}],
        generator=[DIESEL],
        load=[CRITICAL | load, OTHER | load],
        ess=[{"p_max_mw": 0.5, "e_mwh": 2.0, "soc_initial": 1.0}],
    )
    grid = Microgrid.build(case, "copperplate")
    # Hour by hour the stem, each with an end behind it; in the ends nothing is asked for.
    order = np.array([0, *(k for t in range(1, h) for k in (t, -1))])
    chance = np.array([1.0, *(c for t in range(1, h) for c in (stays[t], stays[t - 1] - stays[t]))])
    parent = np.array([-1, *np.repeat([0, *range(1, 2 * h - 3, 2)], 2)])
    tree = Tree(parent, chance, np.zeros(len(parent), np.intp), tuple(map(str, range(len(parent)))))
    profile = np.where(order < 0, 0.0, np.array(demand)[order])
    situation = grid.situation(
        np.ones((0, len(parent)), bool), lambda name: profile if name else np.ones(len(parent))
    )
    program = unroll([grid.stage(1.0)], tree)
    solver = Highs(program)
    solver.update(program.vectors(grid.data(situation), grid.start()))
    found = solver.solve()
    expected = comb_written_here(demand, stays.tolist(), 1.0, 2.0)
    assert found.objective == pytest.approx(expected, rel=1e-8)
    level = settle(program, found.point, program.vectors(grid.data(situation), grid.start()))
    assert level[program.columns("tank.level")].min() >= -1e-9
