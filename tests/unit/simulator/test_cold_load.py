"""Cold load stepped: recourse against what the equations leave, dispatchers, bound, referee."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.dispatch.registry import factory_of
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.simulator import MilpSimulator
from resilience.simulation.audit import check_trajectory
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import check_dispatcher, small_case

SHARE, TAU, SLOTS = 0.8, 2.0, 24
COLD = {"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0, "cold_load_share": SHARE,
        "cold_load_h": TAU}  # fmt: skip
METHODS = ["idle", "rule", "greedy", "mpc", "stochastic"]


def feeder() -> Case:
    """A load that gets cold and one that does not, a set that can serve either, and a store."""
    demand = (0.8 + 0.2 * np.sin(np.arange(SLOTS) / 3.0)).tolist()
    return small_case(
        slots=SLOTS,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={"demand": demand},
        load=[COLD | {"profile": "demand"},
              {"bus": "2", "p_max_mw": 0.5, "shed_cost_per_mwh": 20.0}],
        generator=[{"bus": "2", "p_max_mw": 0.6, "cost_per_mwh": 10.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 2.0}],
        grid=[{"import_max_mw": 2.5, "import_cost_per_mwh": 2.0}],
        terminal_value_per_mwh=3.0,
    )  # fmt: skip


def world() -> World:
    down = np.zeros((1, SLOTS, 3), bool)
    down[0, 2:9, 0] = down[0, 5:8, 1] = down[0, 12:20, 2] = True
    storms = Scenarios(("1-2",), down, np.full(3, 1.0 / 3.0))
    return World.build(microgrid_with_fallible_lines(feeder(), storms, "copperplate"), storms)


def run(method: str) -> tuple[World, Trajectory]:
    stormy = world()
    return stormy, simulate(stormy, factory_of(method)(stormy.setting))


@pytest.mark.parametrize("method", METHODS)
def test_every_dispatcher_carries_the_backlog_and_none_is_below_the_bound(method: str) -> None:
    stormy, done = run(method)
    assert isinstance(stormy.simulator, MilpSimulator)
    value = stormy.end_value_per_mwh
    assert (done.objective(value) >= clairvoyant(stormy).objective - 1e-6).all()
    shed, surplus = done.flow("load.shed")[0], done.flow("load.surplus")[0]
    keep, rho = np.exp(-1.0 / TAU), SHARE * (1.0 - np.exp(-1.0 / TAU))
    backlog = np.zeros(3)
    for t in range(SLOTS):
        least = np.maximum(rho * (backlog - TAU * shed[t]), 0.0)
        assert (surplus[t] >= least - 1e-6).all()
        assert (surplus[t] <= rho * backlog + 1e-6).all()
        backlog = keep * backlog + TAU * (1.0 - keep) * shed[t]
        np.testing.assert_allclose(done.decided("load.backlog")[0, t], backlog, atol=1e-6)
    assert surplus.max() > 0.05


def test_the_referee_wants_the_surplus_and_the_backlog() -> None:
    stormy, done = run("greedy")
    check_trajectory(stormy, done)
    row = done.columns.index("load.surplus[load1]")
    flows = done.flows.copy()
    flows[row] = 0.0
    with pytest.raises(CertificateError, match=r"surplus_least|balance"):
        check_trajectory(stormy, replace(done, flows=flows))
    assert done.decisions is not None
    decisions = done.decisions.copy()
    decisions[done.decision_columns.index("load.backlog[load1]")] *= 0.5
    with pytest.raises(CertificateError, match=r"load\.cold"):
        check_trajectory(stormy, replace(done, decisions=decisions))


def test_a_plan_is_the_clairvoyants_optimum() -> None:
    stormy = world()
    bound = clairvoyant(stormy).objective
    for k, span in enumerate(("02:00-09:00", "05:00-08:00", "12:00-20:00")):
        plan = rs.solve(feeder().replace(outages=f"1-2@{span}"), "milp", physics="copperplate")
        assert plan.objective == pytest.approx(bound[k], rel=1e-4)


def test_public_checks_pass_and_nobody_sees_the_future() -> None:
    check_dispatcher(factory_of("mpc"), world())


def test_learners_and_the_papers_recourse_refuse_it() -> None:
    with pytest.raises(UsageError):
        rs.train(feeder(), "apg", seconds=1)
    with pytest.raises(UsageError):
        World.build(world().microgrid, world().scenarios, recourse="paper")
