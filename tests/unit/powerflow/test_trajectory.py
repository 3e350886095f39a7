"""Trajectories of dispatchers on the wires: AC power flow of all slots and scenarios in batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import held_out
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.rules import Idle
from resilience.evaluation import ac_check as certify
from resilience.evaluation.ac_check import ac_check_trajectory
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.models.ac_check import connected, roots
from resilience.models.microgrid import Microgrid
from resilience.simulation.powers import demand
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.unit.powerflow.oracle import oracle

ONE = np.ones(1)


@pytest.fixture(scope="module")
def world() -> World:
    case = held_out(rs.load_case("ieee33-tou"), 1)
    return World.build(Microgrid.build(case, "copperplate"), sample_bell(case, Bell(), 3, 5))


def test_slots_of_a_trajectory_equal_pandapower(world: World) -> None:
    """Calm slots and islanded ones, injections put together anew from the case's tables."""
    case, network = world.microgrid.case, world.microgrid.case.network
    run = simulate(world, DISPATCHERS["rule"](world.setting))
    found = ac_check_trajectory(world, run)
    served = demand(world) - run.flow("load.shed")
    outages = (~world.line_up).sum(0)
    often = np.unravel_index(np.argsort(outages, axis=None)[-3:], outages.shape)
    slots = [(0, 0), (50, 1), *zip(*often, strict=True)]
    assert outages.max() >= 3
    for t, k in slots:
        p, q = np.zeros((2, len(network.bus_names)))
        for i, load in enumerate(case.load):
            p[network.bus(load.bus)] -= served[i, t, k]
            q[network.bus(load.bus)] -= served[i, t, k] * np.tan(np.arccos(load.power_factor))
        for i, unit in enumerate(case.ess):
            p[network.bus(unit.bus)] += run.storage[i, t, k]
        sources = (
            ("pv.p", case.pv, 1),
            ("generator.p", case.generator, 1),
            ("grid.import", case.grid, 1),
            ("grid.export", case.grid, -1),
        )
        for kind, tables, sign in sources:
            for i, device in enumerate(tables):
                p[network.bus(device.bus)] += sign * run.flow(kind)[i, t, k]
        up = world.line_up[:, t, k] & network.in_service
        root = roots(case, connected(case, up[:, None]))[:, 0]
        v, loss, _, fed = oracle(network, p, q, up, root, np.ones(len(p)))
        assert found.values("v_min_pu")[t, k] == pytest.approx(np.nanmin(v), abs=1e-6)
        assert found.values("v_max_pu")[t, k] == pytest.approx(np.nanmax(v), abs=1e-6)
        assert found.values("loss_mw")[t, k] == pytest.approx(loss, abs=1e-6)
        assert fed.sum() == pytest.approx(loss, abs=1e-6)
    assert found.unfunded_mwh(world.scenarios.probability) == pytest.approx(
        found.loss_mwh(world.scenarios.probability)
    )


def test_pieces_of_the_batch_change_nothing(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    run = simulate(world, DISPATCHERS["rule"](world.setting))
    whole = ac_check_trajectory(world, run)
    monkeypatch.setattr(certify, "MEMBERS", 40)
    small_pieces = ac_check_trajectory(world, run)
    for name in vars(whole.members):
        np.testing.assert_allclose(whole.values(name), small_pieces.values(name), atol=1e-9)


def line(r: float, angle_max_degree: float | None = None, **more: Any) -> World:
    """1 MW behind a line of 10 kV; the line is out in slot 1 of the second scenario.

    With a limit of its angle `r` is its reactance.
    """
    limited = {"angle_max_degree": angle_max_degree}
    case = small_case(
        buses=2,
        lines=[(1, 2, r, 0.0) if angle_max_degree is None else (1, 2, 0.0, r, limited)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0}],
        grid=[{"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}],
        generator=[{"bus": "2", "p_max_mw": 1.0, "cost_per_mwh": 5.0}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.0, "soc_initial": 0.5}],
        **more,
    )
    down = np.zeros((1, 2, 2), bool)
    down[0, 1, 1] = True
    return World.build(
        Microgrid.build(case, "copperplate"), rs.Scenarios(("1-2",), down, np.array([0.5, 0.5]))
    )


def test_the_grid_gives_the_losses_and_exceeds_its_limit_by_them() -> None:
    """1 MW over r = 0.05 pu from 1 pu: v² - v + 0.05 = 0, losses 1/v - 1; alone there are none."""
    world = line(0.05)
    found = ac_check_trajectory(world, simulate(world, Idle(world.setting)))
    v = (1 + np.sqrt(1 - 4 * 0.05)) / 2
    assert found.values("v_min_pu") == pytest.approx(np.array([[v, v], [v, 1.0]]), abs=1e-8)
    loss = 1 / v - 1
    assert found.values("loss_mw") == pytest.approx(np.array([[loss, loss], [loss, 0.0]]), abs=1e-8)
    assert found.values("root_excess_mw") == pytest.approx(found.values("loss_mw"), abs=1e-7)
    likely = world.scenarios.probability
    assert found.loss_mwh(likely) == pytest.approx(1.5 * loss, abs=1e-8)
    assert found.excess_mwh(likely) == pytest.approx(1.5 * loss, abs=1e-7)
    assert found.outside_share(likely) == 0.75
    assert found.worst_root_excess_mw == pytest.approx(loss, abs=1e-7)
    assert np.isnan(found.worst_overload_mva)
    assert found.worst().overload_mva is None
    worst = found.worst().undervoltage_pu
    assert worst is not None
    assert worst.value == pytest.approx(v)


def test_an_angle_beyond_its_limit_is_outside() -> None:
    """1 MW without Mvar over x = 0.2 pu, sin(2 theta) = 2 x P: 11.8 degrees, of which 10 may be.

    In the island, where the line is out, there is no angle between its ends.
    """
    world = line(0.2, 10.0)
    found = ac_check_trajectory(world, simulate(world, Idle(world.setting)))
    beyond = 0.5 * np.degrees(np.arcsin(0.4)) - 10.0
    excess = np.array([[beyond, beyond], [beyond, 0.0]])
    assert found.values("angle_excess_degree") == pytest.approx(excess, abs=1e-6)
    assert found.outside.tolist() == [[True, True], [True, False]]


def test_members_without_solution_are_masked_and_counted() -> None:
    """1 MW over 0.3 pu is more than the line can carry; the island beside it has a voltage."""
    world = line(0.3)
    likely = world.scenarios.probability
    found = ac_check_trajectory(world, simulate(world, Idle(world.setting)))
    assert found.converged.tolist() == [[False, False], [False, True]]
    assert found.not_converged_share(likely) == 0.75
    assert found.worst().not_converged == 3
    assert np.isnan(found.values("loss_mw")[~found.converged]).all()
    assert found.lowest_pu == found.highest_pu == pytest.approx(1.0)
    assert found.loss_mwh(likely) == pytest.approx(0.0, abs=1e-9)
    assert found.outside_share(likely) == 0.0
