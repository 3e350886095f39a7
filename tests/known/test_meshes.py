"""Closed loops: every plan is the power flow, the relaxation says what it leaves open."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.models.case_program import horizon
from resilience.models.methods.conic import relaxation
from resilience.planning.ac_check import ac_check_plan
from resilience.simulation.replay import replay
from tests.known.solving import solved
from tests.known.test_branches import feeder, truth
from tests.known.ybus import Pi, power_flow

Mesh = tuple[list[Pi], dict[int, complex], dict[int, complex]]
RING = [Pi(1, 2, 0.02, 0.03), Pi(2, 3, 0.02, 0.02, b=0.05), Pi(1, 3, 0.03, 0.02)]
LOADS = {2: 0.5 + 0.2j, 3: 0.6 + 0.3j}
MESHES: dict[str, Mesh] = {
    "a ring": (RING, LOADS, {}),
    "a tap and a shift in a ring": (
        [Pi(1, 2, 0.02, 0.05, tap=0.98), RING[1], Pi(1, 3, 0.03, 0.06, shift_deg=1.0)],
        LOADS,
        {3: 0.1j},
    ),
    "two loops that share a line": (
        [*RING, Pi(3, 4, 0.02, 0.02), Pi(2, 4, 0.02, 0.05)],
        LOADS | {4: 0.4 + 0.2j},
        {},
    ),
    "one vector group at both ends of a loop": (
        [Pi(1, 2, 0.02, 0.05, shift_deg=150.0), RING[1], Pi(1, 3, 0.03, 0.06, shift_deg=150.0)],
        LOADS,
        {},
    ),
    "parallel transformers of two taps in a ring": (
        [Pi(1, 2, 0.01, 0.06, tap=0.98), Pi(1, 2, 0.012, 0.05, tap=0.99), *RING[1:]],
        LOADS,
        {},
    ),
    "a ring and a branch": ([*RING, Pi(3, 4, 0.02, 0.02, tap=1.02)], LOADS | {4: 0.2 + 0.1j}, {}),
}


@pytest.mark.parametrize("method", ["nlp", "minlp"])
@pytest.mark.parametrize("name", MESHES)
def test_an_ac_plan_of_a_mesh_is_the_power_flow(name: str, method: str) -> None:
    branches, loads, shunts = MESHES[name]
    known = truth(branches, loads, shunts)
    plan = rs.solve(feeder(branches, loads, shunts), method=method)
    assert isinstance(plan, rs.Plan)
    assert plan.gap is not None
    np.testing.assert_allclose(plan.tables["voltage"].values[:, 0], np.abs(known.volts), atol=1e-7)
    assert plan.energy_mwh["losses"] == pytest.approx(known.loss_mw, abs=1e-7)
    assert plan.relaxed == []
    assert plan.gap < 4e-3
    assert replay(plan).audit.maximum < 1e-6
    check = ac_check_plan(plan)
    assert check.ok
    assert check.unfunded_mwh == pytest.approx(0.0, abs=1e-7)


def test_scip_proves_a_ring() -> None:
    plan = rs.solve(feeder(RING, LOADS), method="exact")
    assert plan.gap is not None
    known = truth(RING, LOADS, {})
    assert plan.energy_mwh["losses"] == pytest.approx(known.loss_mw, abs=1e-6)
    assert plan.gap < 1e-5


def test_the_relaxation_says_which_angles_are_open() -> None:
    """Without angles the loop is free in one direction: losses are least, and too small. Rows on
    the clique of the loop take nearly all of that freedom away.
    """
    known = truth(RING, LOADS, {})
    program = horizon(feeder(RING, LOADS), "distflow")
    free = relaxation(program, program.vectors).point[program.standard.columns("line.l")[:, 0]]
    assert free @ [branch.r for branch in RING] < known.loss_mw - 1e-4
    plan = rs.solve(feeder(RING, LOADS), method="socp")
    assert plan.relaxed[0].startswith("line.loop: 3 of 3 angles open")
    assert plan.energy_mwh["losses"] == pytest.approx(known.loss_mw, abs=1e-6)


@pytest.mark.parametrize("name", MESHES)
def test_without_losses_flows_of_a_mesh_are_near(name: str) -> None:
    """At a hundredth of the loads only what ratios drive round has losses to speak of."""
    branches, loads, shunts = MESHES[name]
    loads, shunts = ({bus: 0.01 * s for bus, s in table.items()} for table in (loads, shunts))
    known = truth(branches, loads, shunts)
    found = solved(feeder(branches, loads, shunts), "lp")
    volts = np.sqrt(found["bus.v_sq"][:, 0])
    np.testing.assert_allclose(volts, np.abs(known.volts), atol=3e-3)
    if name in ("a ring", "two loops that share a line"):
        charging = [0.5j * branch.b for branch in branches]
        sent = (
            known.ends[:, 0]
            + np.array(charging) * np.abs(known.volts[[b.i - 1 for b in branches]]) ** 2
        )
        ours = found["line.p"][:, 0] + 1j * found["line.q"][:, 0]
        np.testing.assert_allclose(ours, sent, atol=3e-5)


def test_an_outage_opens_a_loop_and_an_island_keeps_one() -> None:
    """Slot 2: the ring is a line. Slot 3: buses 4 to 6, a ring of their own, have a generator."""
    far = [Pi(4, 5, 0.02, 0.03), Pi(5, 6, 0.02, 0.02), Pi(4, 6, 0.03, 0.02)]
    branches = [*RING, Pi(3, 4, 0.01, 0.01), *far]
    loads = LOADS | {5: 0.2 + 0.1j, 6: 0.3 + 0.1j}
    unit = {
        "bus": "4",
        "p_max_mw": 2.0,
        "q_min_mvar": -1.0,
        "q_max_mvar": 1.0,
        "cost_per_mwh": 90.0,
    }
    lines = [{"name": name, "breakpoint": True} for name in ("2-3", "3-4")]
    case = feeder(
        branches,
        loads,
        slots=3,
        line_tables=lines,
        outages=["2-3@01:00-02:00", "3-4@02:00-03:00"],
        generator=[unit],
    )
    plan = rs.solve(case, method="minlp")
    volts = plan.tables["voltage"].values
    fed = plan.tables["power"]["generator1"] + 1j * plan.tables["reactive"]["generator1"]
    opened = [branch for branch in branches if branch != RING[1]]
    for slot, there in enumerate((branches, opened)):
        known = truth(there, loads | {4: -fed[slot]}, {})
        np.testing.assert_allclose(volts[:, slot], np.abs(known.volts), atol=1e-6)
    near = truth(RING, LOADS, {})
    np.testing.assert_allclose(volts[:3, 2], np.abs(near.volts), atol=1e-6)
    renamed = [Pi(b.i - 3, b.j - 3, b.r, b.x) for b in far]
    island = power_flow(renamed, [0.0, -loads[5], -loads[6]], v_slack=float(volts[3, 2]))
    np.testing.assert_allclose(volts[3:, 2], np.abs(island.volts), atol=1e-6)
    assert ac_check_plan(plan).unfunded_mwh == pytest.approx(0.0, abs=1e-6)


def test_loops_that_cannot_open_beside_switches_are_refused_by_name() -> None:
    branches = [*RING, Pi(3, 4, 0.02, 0.02), Pi(2, 4, 0.02, 0.02)]
    case = feeder(branches, LOADS, line_tables=[{"name": "2-4", "switchable": True}])
    with pytest.raises(rs.UsageError, match=r"form a cycle: (1-2|2-3|1-3), "):
        rs.solve(case, method="minlp")
