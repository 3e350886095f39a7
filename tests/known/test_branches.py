"""Branches and buses as they are: every number beside an AC power flow from admittances alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.checks.remarks import remarks
from resilience.models.methods import METHODS
from resilience.models.network.powerflow import flow
from resilience.planning.ac_check import ac_check_plan
from resilience.simulation.replay import replay
from resilience.testing import small_case
from tests.known.solving import solved
from tests.known.ybus import Flows, Pi, power_flow

GRID = {"import_max_mw": 9.0, "q_max_mvar": 9.0, "import_cost_per_mwh": 10.0, "v_pu": 1.0}
US = 1e4
"""Microsiemens of 1 pu on 1 MVA at 10 kV."""


def feeder(
    branches: list[Pi],
    loads: dict[int, complex],
    shunts: dict[int, complex] | None = None,
    *,
    slots: int = 1,
    **more: Any,
) -> Case:
    """Bus 1 has the grid; negative impedances come from `with_impedances`."""
    lines = [
        (
            branch.i,
            branch.j,
            max(branch.r, 0.0),
            max(branch.x, 0.0),
            {
                "b_us": branch.b * US,
                "g_us": branch.g * US,
                "tap_ratio": branch.tap,
                "shift_degree": branch.shift_deg,
            },
        )
        for branch in branches
    ]
    buses = max(max(branch.i, branch.j) for branch in branches)
    load = [
        {"bus": str(bus), "p_max_mw": s.real, "q_mvar": s.imag, "shed_cost_per_mwh": 1000.0}
        for bus, s in loads.items()
    ]
    tables = {
        bus: {"shunt_p_mw": y.real, "shunt_q_mvar": -y.imag} for bus, y in (shunts or {}).items()
    }
    keys: dict[str, Any] = {"grid": [GRID], "load": load} | more
    case = small_case(slots=slots, buses=buses, lines=lines, bus_tables=tables, **keys)
    return with_impedances(case, branches)


def with_impedances(case: Case, branches: list[Pi]) -> Case:
    r, x = (np.array([getattr(branch, axis) for branch in branches]) for axis in "rx")
    return replace(case, network=replace(case.network, r_pu=r, x_pu=x))


def truth(branches: list[Pi], loads: dict[int, complex], shunts: dict[int, complex]) -> Flows:
    buses = max(max(branch.i, branch.j) for branch in branches)
    return power_flow(branches, [-loads.get(bus, 0j) for bus in range(1, buses + 1)], shunts)


TRANSFORMER = Pi(1, 2, 0.01, 0.04, tap=0.95, shift_deg=150.0)
FEEDERS: dict[str, tuple[list[Pi], dict[int, complex], dict[int, complex]]] = {
    "a tap and a vector group": ([TRANSFORMER], {2: 1.2 + 0.5j}, {}),
    "a tap at the second end": ([replace(TRANSFORMER, i=2, j=1, tap=1.04)], {2: 1.2 + 0.5j}, {}),
    "charging": ([Pi(1, 2, 0.02, 0.03, b=0.8, g=0.05), Pi(2, 3, 0.02, 0.01)], {3: 0.9 + 0.3j}, {}),
    "charging behind a tap": ([replace(TRANSFORMER, b=-0.3, g=0.1)], {2: 0.8 + 0.1j}, {}),
    "a capacitor": ([Pi(1, 2, 0.03, 0.04)], {2: 1.0 + 0.8j}, {2: 0.9j}),
    "a constant impedance": ([Pi(1, 2, 0.03, 0.04)], {2: 0.5 + 0.1j}, {2: 0.7 - 0.4j}),
    "a reactor at the grid": ([Pi(1, 2, 0.03, 0.04)], {2: 0.5 + 0.1j}, {1: 0.1 - 0.6j}),
    "no resistance": ([replace(TRANSFORMER, r=0.0)], {2: 1.2 + 0.5j}, {}),
    "a negative resistance": (
        [Pi(1, 2, 0.03, 0.05), Pi(2, 3, -0.005, 0.02), Pi(2, 4, 0.01, -0.005)],
        {3: 0.8 + 0.3j, 4: 0.5 + 0.2j},
        {},
    ),
    "all of it": (
        [
            replace(TRANSFORMER, b=-0.05, g=0.02),
            Pi(2, 3, 0.02, 0.03, b=0.2),
            Pi(3, 4, 0.01, 0.02, tap=1.05, shift_deg=-30.0),
            Pi(2, 5, 0.03, 0.01, b=0.1),
        ],
        {3: 0.6 + 0.2j, 4: 0.5 + 0.3j, 5: 0.3 - 0.1j},
        {4: 0.1 + 0.3j, 5: 0.05 - 0.02j},
    ),
    "parallel transformers of two taps": (
        [Pi(1, 2, 0.01, 0.06, tap=0.96), Pi(1, 2, 0.012, 0.05, tap=0.99), Pi(2, 3, 0.02, 0.02)],
        {3: 1.2 + 0.4j},
        {},
    ),
    "parallel transformers that point at each other": (
        [Pi(1, 2, 0.01, 0.06, tap=0.96), Pi(2, 1, 0.012, 0.05, tap=1.01, b=0.1)],
        {2: 1.2 + 0.4j},
        {},
    ),
    "parallel transformers of two shifts": (
        [
            Pi(1, 2, 0.01, 0.06, shift_deg=30.0),
            Pi(1, 2, 0.012, 0.05, tap=0.99, shift_deg=31.0),
        ],
        {2: 1.2 + 0.4j},
        {},
    ),
    "parallel lines alike": (
        [Pi(1, 2, 0.02, 0.04, b=0.2), Pi(1, 2, 0.01, 0.02, b=0.4)],
        {2: 1.2 + 0.4j},
        {},
    ),
    "parallel lines of which one is charged": (
        [Pi(1, 2, 0.02, 0.04, b=0.5), Pi(1, 2, 0.01, 0.03)],
        {2: 1.2 + 0.4j},
        {},
    ),
}


@pytest.mark.parametrize("name", FEEDERS)
def test_an_ac_plan_is_the_power_flow(name: str) -> None:
    branches, loads, shunts = FEEDERS[name]
    known = truth(branches, loads, shunts)
    plan = rs.solve(feeder(branches, loads, shunts), method="minlp", relative_gap=1e-6)
    # A negative resistance gives back what a relaxed cone lets it carry: the bound is loose.
    assert plan.status == ("feasible" if name == "a negative resistance" else "optimal")
    assert plan.shed_mwh == pytest.approx(0.0, abs=1e-7)
    volts = plan.tables["voltage"].values[:, 0]
    np.testing.assert_allclose(volts, np.abs(known.volts), atol=2e-7)
    assert plan.energy_mwh["losses"] == pytest.approx(known.loss_mw, abs=5e-7)
    assert max(plan.audit.values()) < 1e-6
    again = replay(plan)
    assert again.operating_cost == pytest.approx(plan.operating_cost, rel=1e-6)
    assert again.audit.maximum < 1e-6
    check = ac_check_plan(plan)
    assert check.ok
    assert check.unfunded_mwh == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("name", FEEDERS)
def test_power_grid_models_flow_is_that_of_the_admittances(name: str) -> None:
    branches, loads, shunts = FEEDERS[name]
    known, network = truth(branches, loads, shunts), feeder(branches, loads, shunts).network
    fed = -np.array([loads.get(k + 1, 0j) for k in range(len(network.bus_names))])[:, None]
    root = np.arange(len(fed)) == 0
    solution = flow(network, fed.real, fed.imag, network.in_service, root)
    np.testing.assert_allclose(solution.v_pu[:, 0], np.abs(known.volts), atol=1e-8)
    sent = solution.p_line_mw[:, 0] + 1j * solution.q_line_mvar[:, 0]
    np.testing.assert_allclose(sent, known.ends[:, 0], atol=1e-7)
    np.testing.assert_allclose(solution.s_line_mva[:, 0], np.abs(known.ends).max(1), atol=1e-7)
    assert solution.loss_mw[0] == pytest.approx(known.loss_mw, abs=1e-8)


@pytest.mark.parametrize("name", FEEDERS)
def test_without_losses_voltages_are_near(name: str) -> None:
    """LinDistFlow leaves losses out and nothing else: at a hundredth of the currents they are gone.

    Not those of currents that different ratios drive round.
    """
    branches, loads, shunts = FEEDERS[name]
    branches = [replace(branch, b=0.01 * branch.b, g=0.01 * branch.g) for branch in branches]
    loads, shunts = ({bus: 0.01 * s for bus, s in table.items()} for table in (loads, shunts))
    known = truth(branches, loads, shunts)
    found = solved(feeder(branches, loads, shunts), "lp")
    volts = np.sqrt(found["bus.v_sq"][:, 0])
    atol = 1e-3 if name.startswith("parallel transformers") else 2e-6
    np.testing.assert_allclose(volts, np.abs(known.volts), atol=atol)


@pytest.mark.parametrize("seed", range(6))
def test_any_tree_with_any_elements_is_the_power_flow(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 9
    branches, loads, shunts = [], {}, {}
    for j in range(2, n + 1):
        near = int(rng.integers(1, j))
        ends = (near, j) if rng.random() < 0.7 else (j, near)
        more = {"tap": rng.uniform(0.97, 1.03), "shift_deg": rng.choice([0.0, 30.0, 150.0])}
        r, x, b, g = rng.uniform([0.005, 0.005, -0.05, 0.0], [0.02, 0.03, 0.2, 0.02])
        branches.append(Pi(*ends, r, x, b, g, **(more if rng.random() < 0.4 else {})))
        loads[j] = complex(*rng.uniform([0.05, -0.05], [0.3, 0.15]))
        if rng.random() < 0.3:
            shunts[j] = complex(*rng.uniform([0.0, -0.1], [0.05, 0.2]))
    known = truth(branches, loads, shunts)
    case = feeder(branches, loads, shunts)
    plan = rs.solve(case, method="minlp", relative_gap=1e-6)
    np.testing.assert_allclose(plan.tables["voltage"].values[:, 0], np.abs(known.volts), atol=1e-6)
    assert plan.energy_mwh["losses"] == pytest.approx(known.loss_mw, abs=2e-6)
    assert plan.status == "optimal"
    assert ac_check_plan(plan).unfunded_mwh == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_holds_all_elements(method: str) -> None:
    branches, loads, shunts = FEEDERS["all of it"]
    known = truth(branches, loads, shunts)
    found = solved(feeder(branches, loads, shunts), method)
    exact = method in ("socp", "nlp", "minlp", "exact")
    volts = np.sqrt(found["bus.v_sq"][:, 0])
    np.testing.assert_allclose(volts, np.abs(known.volts), atol=1e-5 if exact else 1e-2)
    assert found["load.shed"].max() < 1e-6
    assert not any(found.near_limits.values())


OUT = {"name": "2-3", "breakpoint": True}
CHARGED = [Pi(1, 2, 0.02, 0.03, b=0.1), Pi(2, 3, 0.02, 0.03, b=0.6, g=0.05)]
TWO = {2: 0.5 + 0.2j, 3: 0.3 + 0.1j}


@pytest.mark.parametrize("method", METHODS)
def test_a_line_that_is_out_takes_its_charging_with_it(method: str) -> None:
    """Bus 3 is dead then, though a capacitor stands there; without it it is lossless anyway."""
    shunts = {3: 0.1 + 0.4j}
    case = feeder(CHARGED, TWO, shunts, slots=2, line_tables=[OUT], outages=["2-3@01:00-02:00"])
    found = solved(case, method)
    up = truth(CHARGED, TWO, shunts)
    down = power_flow(CHARGED[:1], [0.0, -TWO[2]])
    exact = method in ("socp", "nlp", "minlp", "exact")
    volts = np.sqrt(np.maximum(found["bus.v_sq"], 0.0))
    atol = 1e-6 if exact else 5e-3
    np.testing.assert_allclose(volts[:, 0], np.abs(up.volts), atol=atol)
    np.testing.assert_allclose(volts[:2, 1], np.abs(down.volts), atol=atol)
    assert volts[2, 1] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(found["load.shed"][:, 1], [0.0, TWO[3].real], atol=1e-7)
    if exact:
        lost = found["grid.import"].sum(0) - [0.8, 0.5]
        np.testing.assert_allclose(lost, [up.loss_mw, down.loss_mw], atol=1e-6)


def test_an_island_keeps_its_shunts_and_not_the_charging_of_what_is_out() -> None:
    """A generator carries bus 3: what it gives is load and shunt, at the voltage that it holds."""
    unit = {
        "bus": "3",
        "p_max_mw": 2.0,
        "q_min_mvar": -1.0,
        "q_max_mvar": 1.0,
        "cost_per_mwh": 20.0,
    }
    shunts = {3: 0.2 + 0.3j}
    case = feeder(
        CHARGED,
        TWO,
        shunts,
        slots=2,
        line_tables=[OUT],
        outages=["2-3@01:00-02:00"],
        generator=[unit],
    )
    plan = rs.solve(case, method="minlp", relative_gap=1e-6)
    v_sq = plan.tables["voltage"]["3"][1] ** 2
    assert 0.81 - 1e-6 <= v_sq <= 1.21 + 1e-6
    assert plan.tables["power"]["generator1"][1] == pytest.approx(0.3 + 0.2 * v_sq, abs=1e-6)
    assert plan.tables["reactive"]["generator1"][1] == pytest.approx(0.1 - 0.3 * v_sq, abs=1e-6)
    # The cheapest voltage of a conductance is the lowest.
    assert v_sq == pytest.approx(0.81, abs=1e-4)
    assert ac_check_plan(plan).unfunded_mwh == pytest.approx(0.0, abs=1e-6)
    assert replay(plan).operating_cost == pytest.approx(plan.operating_cost, rel=1e-6)


@pytest.mark.parametrize("method", ["milp", "minlp"])
def test_a_storage_forms_an_island_at_a_whole_voltage_or_not_at_all(method: str) -> None:
    """0.4 MWh last for one hour of 0.3 MW and a conductance, whatever fraction would be cheaper.

    The first hour serves all and the second is dark: at no voltage of the band would 0.4 - 0.3 -
    0.05 v be enough.
    """
    unit = {"bus": "3", "p_max_mw": 2.0, "e_mwh": 0.4, "soc_initial": 1.0, "s_mva": 2.5}
    case = feeder(
        CHARGED,
        TWO,
        {3: 0.05 + 0.1j},
        slots=2,
        line_tables=[OUT],
        outages=["2-3@00:00-02:00"],
        ess=[unit],
    )
    found = solved(case, method)
    v_sq = found.of("bus.v_sq", "3")
    for value in v_sq:
        assert value == pytest.approx(0.0, abs=1e-6) or 0.81 - 1e-6 <= value <= 1.21 + 1e-6
    served = 0.3 - found.of("load.shed", "load2")
    np.testing.assert_allclose(served * (v_sq < 0.5), 0.0, atol=1e-6)
    given = found["ess.discharge"][0] - found["ess.charge"][0]
    np.testing.assert_allclose(given, served + 0.05 * v_sq, atol=1e-6)
    assert found.answer.status == "optimal"
    assert served.sum() == pytest.approx(0.4 - 0.05 * v_sq.sum(), abs=1e-5)


@pytest.mark.parametrize("method", ["milp", "minlp", "exact"])
def test_a_switched_line_has_its_charging_only_while_it_is_closed(method: str) -> None:
    """Two ways to bus 3, of which one is to be open: the one whose charging is no use."""
    branches = [
        Pi(1, 2, 0.02, 0.03),
        Pi(2, 3, 0.02, 0.03, b=0.5),
        Pi(1, 3, 0.02, 0.03, b=0.02, tap=1.02),
    ]
    loads = {2: 0.5 + 0.2j, 3: 0.6 + 0.7j}
    ways = [{"name": name, "switchable": True} for name in ("2-3", "1-3")]
    case = feeder(branches, loads, line_tables=ways)
    found = solved(case, method)
    closed = found["line.closed"][:, 0]
    assert closed.sum() == pytest.approx(1.0)
    there = [branches[0], branches[1] if closed[0] > 0.5 else branches[2]]
    known = truth(there, loads, {})
    exact = method != "milp"
    volts = np.sqrt(found["bus.v_sq"][:, 0])
    np.testing.assert_allclose(volts, np.abs(known.volts), atol=1e-6 if exact else 1e-2)
    if exact:
        others = truth([branches[0], branches[2 if closed[0] > 0.5 else 1]], loads, {})
        assert known.loss_mw < others.loss_mw
        assert found["grid.import"].sum() - 1.1 == pytest.approx(known.loss_mw, abs=1e-6)


@pytest.mark.parametrize("end", ["from", "to"])
def test_a_rating_counts_what_really_flows(end: str) -> None:
    """A line that takes Mvar carries most at its first end, one that gives some at its second."""
    branches, rating = [Pi(1, 2, 0.02, 0.03, b=-0.6 if end == "from" else 0.6)], 1.3
    load = 0.9 + 0.6j if end == "from" else 1.2 + 0.6j
    case = feeder(branches, {2: load}, line_tables=[{"name": "1-2", "rating_mva": rating}])
    plan = rs.solve(case, method="minlp", relative_gap=1e-7)
    served = 1.0 - plan.shed_mwh / load.real
    assert 0.1 < served < 0.99
    known = np.abs(truth(branches, {2: served * load}, {}).ends[0])
    assert known.max() == pytest.approx(rating, abs=2e-5)
    assert known[0 if end == "from" else 1] == known.max()
    assert [reasons.keys() for reasons in plan.shed_by_load.values()] == [{"rating"}]
    check = ac_check_plan(plan)
    assert check.overload is not None
    assert check.overload.excess == pytest.approx(0.0, abs=2e-5)


def test_at_copperplate_nothing_is_changed() -> None:
    branches, loads, shunts = FEEDERS["all of it"]
    bare = [Pi(branch.i, branch.j, branch.r, branch.x) for branch in branches]
    ours, plain = (
        solved(case, "lp", "copperplate")
        for case in (feeder(branches, loads, shunts), feeder(bare, loads))
    )
    assert ours.problem.standard.a.nnz == plain.problem.standard.a.nnz
    assert ours.objective == plain.objective


@pytest.mark.parametrize("out", ["1-2", "1-2#2"])
def test_one_of_two_parallel_transformers_may_fail(out: str) -> None:
    branches, loads, _ = FEEDERS["parallel transformers of two taps"]
    tables = [{"name": name, "breakpoint": True} for name in ("1-2", "1-2#2")]
    case = feeder(branches, loads, slots=2, line_tables=tables, outages=[f"{out}@01:00-02:00"])
    plan = rs.solve(case, method="minlp", relative_gap=1e-6)
    left = [branch for k, branch in enumerate(branches) if k != (out != "1-2")]
    for slot, there in enumerate((branches, left)):
        known = truth(there, loads, {})
        volts = plan.tables["voltage"].values[:, slot]
        np.testing.assert_allclose(volts, np.abs(known.volts), atol=1e-6)
    assert ac_check_plan(plan).ok


def test_tables_of_lines_have_what_leaves_the_bus() -> None:
    branches, loads, shunts = FEEDERS["all of it"]
    tables = [{"name": "2-3", "breakpoint": True}]
    plan = rs.solve(feeder(branches, loads, shunts, line_tables=tables), relative_gap=1e-6)
    sent = plan.tables["line_power"].values + 1j * plan.tables["line_reactive"].values
    np.testing.assert_allclose(sent[:, 0], truth(branches, loads, shunts).ends[:, 0], atol=2e-6)


@pytest.mark.parametrize("end", ["from", "to"])
def test_a_linear_plan_keeps_the_rating_of_both_ends(end: str) -> None:
    """Without losses the load is served until charging and it together reach 1.3 MVA."""
    b, load = (-0.6, 0.9 + 0.6j) if end == "from" else (0.6, 1.2 + 0.6j)
    case = feeder([Pi(1, 2, 0.0, 0.0001, b=b)], {2: load})
    rated = replace(case.network, rating_mva=np.array([1.3]))
    found = solved(replace(case, network=rated), "lp", gap=1e-6)
    served = (load.real - found["load.shed"][0, 0]) * load / load.real
    v_i, v_j = found["bus.v_sq"][:, 0]
    reached = served - (0.5j * b * (v_i + v_j) if end == "from" else 0.0)
    assert abs(reached) == pytest.approx(1.3, abs=1e-5)


def test_what_copperplate_leaves_out_is_named() -> None:
    case = feeder(CHARGED, TWO, {3: 0.1 + 0.4j})
    [note] = rs.solve(case, method="lp", physics="copperplate").notes
    assert note.startswith("copperplate leaves out 0.15 MW that flow to earth at 1 pu")
    assert rs.solve(case, method="lp").notes == []


def test_charging_without_a_unit_for_it_leaves_an_island_without_a_plan() -> None:
    """A remark says so beforehand, and the conflict names the balance."""
    unit = {"bus": "3", "p_max_mw": 2.0, "cost_per_mwh": 20.0}
    lines: dict[str, Any] = {
        "line_tables": [OUT],
        "outages": ["2-3@00:00-01:00"],
        "generator": [unit],
    }
    bare = [Pi(1, 2, 0.02, 0.03), Pi(2, 3, 0.02, 0.03)]
    with pytest.raises(rs.InfeasibleError, match=r"balance\.q\[3"):
        rs.solve(feeder(bare, {3: 0.3 + 0j}, {3: 0.2j}, **lines), method="lp")
    [remark] = [text for text in remarks(feeder(bare, {}, {3: 0.2j}, **lines)) if "q_max" in text]
    assert "has no plan on lindistflow and distflow" in remark
    assert not [text for text in remarks(feeder(bare, {}, {}, **lines)) if "q_max" in text]
