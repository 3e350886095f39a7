"""Networks that need not be radial: the best of all switch positions, by a power flow of each."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.planning.ac_check import ac_check_plan
from resilience.simulation.replay import replay
from tests.known.solving import solved
from tests.known.test_branches import feeder, truth
from tests.known.ybus import Pi

RING = [Pi(1, 2, 0.02, 0.03), Pi(2, 3, 0.02, 0.02, b=0.05), Pi(1, 3, 0.03, 0.02)]
TIES = [Pi(3, 4, 0.02, 0.02), Pi(2, 4, 0.02, 0.05, tap=0.97), Pi(1, 4, 0.05, 0.08, shift_deg=2.0)]
LOADS = {2: 0.5 + 0.2j, 3: 0.6 + 0.3j, 4: 0.4 + 0.2j}
PRICE = 10.0  # $/MWh of what the grid feeds in


def switched(branches: list[Pi], ties: list[Pi], **more: Any) -> Case:
    tables = [{"name": f"{b.i}-{b.j}", "switchable": True} for b in ties]
    case = feeder([*branches, *ties], LOADS, line_tables=tables, **more)
    return replace(case, network=replace(case.network, radial=False))


def enumerated(branches: list[Pi], ties: list[Pi]) -> dict[tuple[int, ...], float]:
    """MW lost with every position of the switches that leaves no bus alone, or below 0.9 pu."""
    losses = {}
    for position in product((0, 1), repeat=len(ties)):
        lines = [*branches, *(b for b, closed in zip(ties, position, strict=True) if closed)]
        reached = {1}
        for _ in lines:
            for b in lines:
                if reached & {b.i, b.j}:
                    reached |= {b.i, b.j}
        if reached >= LOADS.keys():
            known = truth(lines, LOADS, {})
            if np.abs(known.volts).min() > 0.9:
                losses[position] = known.loss_mw
    return losses


NETWORKS = {
    "a ring and three ties": (RING, TIES),
    "nothing but ties": ([], [*RING, *TIES[:2]]),
    "a tie beside a line": (RING[:2], [Pi(2, 1, 0.05, 0.06), TIES[0], TIES[1]]),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_plan_is_the_best_of_all_positions(name: str) -> None:
    branches, ties = NETWORKS[name]
    losses = enumerated(branches, ties)
    best = min(losses, key=lambda position: losses[position])
    found = solved(switched(branches, ties), "minlp", gap=1e-6)
    assert tuple(np.round(found["line.closed"][:, 0]).astype(int)) == best
    demand = sum(LOADS.values()).real
    assert found.objective == pytest.approx(PRICE * (demand + losses[best]), abs=1e-5)
    assert found.bound <= found.objective + 1e-6


def test_scip_agrees() -> None:
    branches, ties = NETWORKS["a tie beside a line"]
    losses = enumerated(branches, ties)
    found = solved(switched(branches, ties), "exact")
    cost = PRICE * (sum(LOADS.values()).real + min(losses.values()))
    assert found.objective == pytest.approx(cost, rel=1e-5)
    assert found.bound > cost * (1.0 - 2e-5)


@pytest.mark.parametrize("name", NETWORKS)
def test_every_position_is_its_power_flow(name: str) -> None:
    """Held one by one: what the program says of losses is what an independent flow says."""
    branches, ties = NETWORKS[name]
    for position, loss_mw in enumerated(branches, ties).items():
        case = switched(branches, ties)
        lines = [f"{b.i}-{b.j}" for b, closed in zip(ties, position, strict=True) if not closed]
        keep = replace(
            case.network,
            in_service=~np.isin(case.network.line_names, lines),
            switchable=np.zeros(len(case.network.line_names), bool),
        )
        plan = rs.solve(replace(case, network=keep), method="nlp")
        assert isinstance(plan, rs.Plan)
        assert plan.energy_mwh["losses"] == pytest.approx(loss_mw, abs=1e-6)


def test_a_plan_with_a_closed_loop_is_certified() -> None:
    plan = rs.solve(switched(RING, TIES), method="minlp")
    assert isinstance(plan, rs.Plan)
    assert replay(plan).audit.maximum < 1e-6
    check = ac_check_plan(plan)
    assert check.ok
    assert check.unfunded_mwh == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("outages", [[], ["3-4@01:00-02:00"]], ids=["none", "3-4"])
def test_a_tie_closes_where_a_bus_would_stay_alone(outages: list[str]) -> None:
    """Closing costs more than it saves, but 3-4 is out in the second slot: then in the first too,
    as once is enough.
    """
    costs = [{"name": "2-4", "switchable": True, "switching_cost": 5.0}]
    branches = [*RING, TIES[0], TIES[1]]
    case = feeder(branches, LOADS, slots=2, line_tables=costs, outages=outages)
    closed = np.array([name != "2-4" for name in case.network.line_names])
    network = replace(case.network, radial=False, in_service=closed)
    found = solved(replace(case, network=network), "minlp")
    np.testing.assert_allclose(found["line.closed"][0], 1.0 if outages else 0.0, atol=1e-6)
    first, second = ([*branches], [*RING, TIES[1]]) if outages else ([*RING, TIES[0]],) * 2
    flows = [truth(lines, LOADS, {}) for lines in (first, second)]
    demand, action = sum(LOADS.values()).real, 5.0 if outages else 0.0
    cost = action + PRICE * sum(demand + flow.loss_mw for flow in flows)
    assert found.objective == pytest.approx(cost, abs=1e-5)


def test_without_losses_any_position_is_as_good_and_loops_close() -> None:
    found = solved(switched(RING, TIES), "milp")
    assert found.objective == pytest.approx(PRICE * sum(LOADS.values()).real, abs=1e-6)


@pytest.mark.parametrize("method", ["lp", "minlp"])
def test_the_refusal_of_a_mixture_names_the_key(method: str) -> None:
    case = switched(RING, TIES)
    radial = replace(case, network=replace(case.network, radial=True))
    with pytest.raises(rs.UsageError, match="form a cycle: ") as caught:
        rs.solve(radial, method=method)
    assert "radial = false in [network]" in caught.value.hint


def test_two_grids_in_a_network_of_loops_have_to_run_in_parallel(tmp_path: Path) -> None:
    """Nothing counts trees there, which would keep them apart."""
    text = """
time = { start = 2020-01-01T00:00:00, slots = 1, step_min = 60 }
line = [{ name = "1-2", switchable = true }]
grid = [
    { name = "a", bus = "1", import_max_mw = 1, import_cost_per_mwh = 1 },
    { name = "b", bus = "2", import_max_mw = 1, import_cost_per_mwh = 1 },
]
[network]
bus = [{ name = "1", vn_kv = 10 }, { name = "2", vn_kv = 10 }]
line = [{ from = "1", to = "2", r_ohm = 1, x_ohm = 1 }]
"""
    path = tmp_path / "two.toml"
    path.write_text(text + "radial = true\n", encoding="utf-8")
    assert rs.load_case(path).network.radial
    path.write_text(text + "radial = false\n", encoding="utf-8")
    with pytest.raises(rs.CaseError, match="one bus with a grid per tree of closed lines"):
        rs.load_case(path)
    path.write_text(text + "radial = false\nparallel_grids = true\n", encoding="utf-8")
    assert not rs.load_case(path).network.radial
