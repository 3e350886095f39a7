"""The simulator against the optimiser: the same physics, stepped."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from small import small

import resilience as rs
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.microgrid import Microgrid, microgrid
from resilience.models.problem import horizon, status
from resilience.models.simulator import Simulator
from resilience.models.tree import Tree
from resilience.models.unroll import unroll

LINES = ("1-2", "2-19", "3-23", "6-26")


@pytest.fixture(scope="module")
def grid() -> Microgrid:
    return microgrid(rs.load_case("ieee33"), "copperplate")


@pytest.fixture(scope="module")
def simulator(grid: Microgrid) -> Simulator:
    return Simulator(grid, 0.25)


def world(grid: Microgrid, simulator: Simulator, batch: int, seed: int) -> tuple[Any, ...]:
    """Random slots are one slot here: same profiles, but every member has its own outages."""
    rng = np.random.default_rng(seed)
    case = grid.case
    up = np.ones((len(case.network.line_names), batch), bool)
    for line in LINES:
        up[case.network.line(line)] = rng.random(batch) < 0.5
    slot = int(rng.integers(96))
    profile = {name: np.full(batch, values[slot]) for name, values in case.profiles.items()}
    situation = grid.situation(up, lambda name: np.ones(batch) if name is None else profile[name])
    data = simulator.stacked(grid.data(situation))
    energy = rng.uniform(simulator.low, simulator.high, (len(simulator.units), batch))
    action = rng.uniform(-2.5, 2.5, energy.shape)
    return energy, action, data, situation


@pytest.mark.parametrize("seed", range(6))
def test_recourse_is_the_one_slot_linear_program(
    grid: Microgrid, simulator: Simulator, seed: int
) -> None:
    """With storage as the step left it, no dispatch of the other devices is cheaper."""
    energy, action, data, situation = world(grid, simulator, 25, seed)
    step = simulator.step(energy, action, data, situation.island)
    assert step.spill.max() < 1e-9
    problem = unroll([grid.stage(0.25)], Tree.chain(["now"]))
    solver = Highs(lower(problem, exact={}))
    for k in range(energy.shape[1]):
        one = {name: values[:, [k]] for name, values in grid.data(situation).items()}
        vectors = problem.vectors(one, {"ess.energy": energy[:, k]})
        for name, power in (("ess.charge", step.charge), ("ess.discharge", step.discharge)):
            vectors = vectors.fixed(problem.columns(name)[:, 0], power[:, k])
        solver.update(vectors)
        found = solver.solve()
        assert found.status == "optimal"
        assert step.cost[k] == pytest.approx(found.objective, abs=1e-9)
        after = found.point[problem.columns("ess.energy")[:, 0]]
        np.testing.assert_allclose(step.energy[:, k], after, atol=1e-9)


def test_no_state_leaves_its_band_and_energy_is_conserved(
    grid: Microgrid, simulator: Simulator
) -> None:
    energy, action, data, situation = world(grid, simulator, 20_000, 7)
    for _ in range(5):
        step = simulator.step(energy, action * 3.0, data, situation.island)
        assert (step.energy >= simulator.low - 1e-12).all()
        assert (step.energy <= simulator.high + 1e-12).all()
        assert np.minimum(step.charge, step.discharge).max() == 0.0
        fed = (simulator.sign * step.flows).sum(0) + (step.discharge - step.charge).sum(0)
        demand = (simulator.demand[0] + simulator.demand[1] @ data).sum(0)
        np.testing.assert_allclose(fed, demand + step.spill.sum(0), atol=1e-9)
        energy = step.energy


def test_batch_equals_loop(grid: Microgrid, simulator: Simulator) -> None:
    energy, action, data, situation = world(grid, simulator, 40, 3)
    whole = simulator.step(energy, action, data, situation.island)
    for k in range(40):
        at = [k]
        one = simulator.step(energy[:, at], action[:, at], data[:, at], situation.island[:, at])
        np.testing.assert_allclose(whole.cost[at], one.cost, rtol=1e-12)
        np.testing.assert_allclose(whole.flows[:, at], one.flows, atol=1e-12)


def test_numpy_equals_torch_and_its_gradient_is_the_finite_difference(
    grid: Microgrid, simulator: Simulator
) -> None:
    torch = pytest.importorskip("torch", reason="the extra `learn` is not installed")
    energy, action, data, situation = world(grid, simulator, 64, 11)
    plain = simulator.step(energy, action, data, situation.island)

    def total(asked: Any) -> Any:
        tensors = [torch.as_tensor(x) for x in (energy, data, situation.island)]
        step = simulator.step(tensors[0], asked, tensors[1], tensors[2])
        return (step.cost + 0.3 * step.energy.sum(0)).sum(), step

    asked = torch.as_tensor(action).requires_grad_()
    value, step = total(asked)
    np.testing.assert_allclose(step.cost.detach(), plain.cost, atol=1e-12)
    np.testing.assert_allclose(step.energy.detach(), plain.energy, atol=1e-12)
    value.backward()
    rng = np.random.default_rng(0)
    for _ in range(20):
        i, k = rng.integers(action.shape[0]), rng.integers(64)
        moved = np.zeros_like(action)
        moved[i, k] = 1e-6
        ends = [float(total(torch.as_tensor(action + s * moved))[0]) for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / 2e-6
        assert float(asked.grad[i, k]) == pytest.approx(slope, abs=1e-5)


def test_a_plan_replayed_has_its_cost_and_its_states(grid: Microgrid) -> None:
    """Law 5 at copperplate: the optimum's storage decisions, stepped, cost what the plan says."""
    case = grid.case
    problem = horizon(case, "copperplate")
    plan = rs.solve(case, "lp", physics="copperplate")
    simulator = Simulator(problem.grid, case.step_h)
    situation = problem.grid.situation(status(case))
    data = simulator.stacked(problem.grid.data(situation))
    energy = problem.x0["ess.energy"][:, None]
    spent = 0.0
    for t in range(case.slots):
        action = np.array([[-plan.tables["power"][unit][t]] for unit in simulator.units])
        step = simulator.step(energy, action, data[:, [t]], situation.island[:, [t]])
        spent, energy = spent + float(step.cost[0]), step.energy
        np.testing.assert_allclose(energy[:, 0], plan.tables["energy"].values[:, t], atol=1e-6)
    assert spent == pytest.approx(plan.operating_cost, rel=1e-6)


def test_an_island_with_no_source_sheds_and_moves_nothing() -> None:
    case = small(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        about=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 2.0, "grid_forming": False}],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
    )
    simulator = Simulator(microgrid(case, "copperplate"), 1.0)
    situation = simulator.grid.situation(np.array([[False, True]]))
    data = simulator.stacked(simulator.grid.data(situation))
    step = simulator.step(np.ones((1, 2)), -np.ones((1, 2)), data, situation.island)
    assert step.cost == pytest.approx([5.0, 0.0])
    assert step.energy[0] == pytest.approx([1.0, 0.0])


def test_islanded_charging_and_surplus_discharge_are_cut_back() -> None:
    """A store cannot charge from nothing nor discharge into nothing, whatever is asked."""
    case = small(
        load=[{"p_max_mw": 0.4, "shed_cost_per_mwh": 5.0}],
        ess=[{"p_max_mw": 1.0, "e_mwh": 4.0}],
        pv=[{"p_max_mw": 0.6, "curtailable": False}],
    )
    simulator = Simulator(microgrid(case, "copperplate"), 1.0)
    situation = simulator.grid.situation(np.ones((0, 2), bool))
    data = simulator.stacked(simulator.grid.data(situation))
    step = simulator.step(np.full((1, 2), 2.0), np.array([[1.0, -1.0]]), data, situation.island)
    # Charging may shed the load: 0.6 of sun and 0.4 of load make 1.0 - 0.4 = 0.6 at most.
    assert step.charge[0] == pytest.approx([0.6, 0.0])
    assert step.discharge[0] == pytest.approx([0.0, 0.0])
    assert step.spill[0] == pytest.approx([0.0, 0.2])


def test_what_a_step_cannot_decide_is_refused() -> None:
    with pytest.raises(rs.UsageError, match=r"generator\.on"):
        Simulator(microgrid(rs.load_case("ieee33-commitment"), "copperplate"), 0.25)
    with pytest.raises(rs.UsageError, match="copperplate"):
        Simulator(microgrid(rs.load_case("ieee33"), "lindistflow"), 0.25)
