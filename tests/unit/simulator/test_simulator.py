"""The simulator against the optimiser: the same physics, stepped."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import horizon, status
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.unroll import unroll
from resilience.models.simulator import NetworkSimulator, Simulator
from resilience.testing import small_case
from tests.stepping import Scene, assert_sound, scene


@pytest.fixture(scope="module")
def microgrid() -> Microgrid:
    return Microgrid.build(rs.load_case("ieee33"), "copperplate")


@pytest.fixture(scope="module")
def simulator(microgrid: Microgrid) -> Simulator:
    return Simulator(microgrid, 0.25)


@pytest.mark.parametrize("seed", range(6))
def test_recourse_is_the_one_slot_linear_program(
    microgrid: Microgrid, simulator: Simulator, seed: int
) -> None:
    """With storage as the step left it, no dispatch of the other devices is cheaper."""
    seen = scene(simulator, 25, np.random.default_rng(seed))
    step = simulator.step(*seen.all)
    assert simulator.heuristic == ()
    assert step.spill.max() < 1e-9
    problem = unroll([microgrid.stage(0.25)], Tree.chain(["now"]))
    solver = Highs(lower(problem, modes={}))
    for k in range(seen.energy.shape[1]):
        one = {name: values[:, [k]] for name, values in seen.named.items()}
        vectors = problem.vectors(one, {"ess.energy": seen.energy[:, k]})
        for name, power in (("ess.charge", step.charge), ("ess.discharge", step.discharge)):
            vectors = vectors.fixed(problem.columns(name)[:, 0], power[:, k])
        solver.update(vectors)
        found = solver.solve()
        assert found.status == "optimal"
        assert step.cost[k] == pytest.approx(found.objective, abs=1e-9)
        after = found.point[problem.columns("ess.energy")[:, 0]]
        np.testing.assert_allclose(step.energy[:, k], after, atol=1e-9)


@pytest.mark.parametrize("recourse", ["economic", "paper"])
def test_a_hundred_thousand_steps_violate_no_bound_and_conserve_energy(
    microgrid: Microgrid, recourse: Any
) -> None:
    simulator = Simulator(microgrid, 0.25, recourse)
    rng, members = np.random.default_rng(7), 20_000
    for _ in range(5):
        seen = scene(simulator, members, rng, reach=3.0)
        assert_sound(simulator, seen, simulator.step(*seen.all))


def test_a_long_walk_stays_in_the_band(simulator: Simulator) -> None:
    """Rounding does not add up: the state is masked anew in every step."""
    rng = np.random.default_rng(3)
    seen = scene(simulator, 500, rng)
    energy = seen.energy
    for _ in range(200):
        action = rng.uniform(-3.0, 3.0, energy.shape)
        energy = simulator.step(energy, action, seen.data, seen.island).energy
        assert (energy >= simulator.low - 1e-12).all()
        assert (energy <= simulator.high + 1e-12).all()


def test_batch_equals_loop(simulator: Simulator) -> None:
    seen = scene(simulator, 40, np.random.default_rng(3))
    whole = simulator.step(*seen.all)
    for k in range(40):
        one = simulator.step(*seen.of(k))
        np.testing.assert_allclose(whole.cost[[k]], one.cost, rtol=1e-12)
        np.testing.assert_allclose(whole.flows[:, [k]], one.flows, atol=1e-12)


def test_data_of_one_column_serve_the_whole_batch(simulator: Simulator) -> None:
    seen = scene(simulator, 1, np.random.default_rng(5))
    energy = np.random.default_rng(0).uniform(simulator.low, simulator.high, (5, 7))
    island, action = np.repeat(seen.island, 7, axis=1), np.repeat(seen.action, 7, axis=1)
    once = simulator.step(energy, action, seen.data, island)
    each = simulator.step(energy, action, np.repeat(seen.data, 7, axis=1), island)
    np.testing.assert_array_equal(once.cost, each.cost)
    np.testing.assert_array_equal(once.flows, each.flows)


@pytest.mark.parametrize("kind", [Simulator, NetworkSimulator])
def test_a_copy_sent_to_another_process_steps_alike(microgrid: Microgrid, kind: Any) -> None:
    simulator = kind(microgrid, 0.25)
    seen = scene(simulator, 3, np.random.default_rng(1))
    ours = simulator.step(*seen.all)
    theirs = pickle.loads(pickle.dumps(simulator)).step(*seen.all)
    np.testing.assert_allclose(ours.cost, theirs.cost, atol=1e-9)
    np.testing.assert_allclose(ours.energy, theirs.energy, atol=1e-9)


def with_prices(simulator: Any, seen: Scene, rng: np.random.Generator) -> Scene:
    """Members that pay three import prices: two that order sources alike, one above generators."""
    block = next(b for b in simulator.form.stage.datums if b.name == "grid.import_price")
    seen.data[block.start] = rng.choice([0.31, 0.43, 7.0], seen.data.shape[1])
    return seen


@pytest.mark.parametrize("recourse", ["economic", "paper"])
def test_members_of_different_prices_do_as_if_they_were_alone(
    microgrid: Microgrid, recourse: Any
) -> None:
    simulator, rng = Simulator(microgrid, 0.25, recourse), np.random.default_rng(5)
    seen = with_prices(simulator, scene(simulator, 60, rng), rng)
    groups = simulator.priced(seen.data).groups
    assert len(groups) == (2 if recourse == "economic" else 3)
    whole = simulator.step(*seen.all)
    again = simulator.step_ready(*seen.all[:2], simulator.ready(*seen.all[2:]))
    for k in range(60):
        one = simulator.step(*seen.of(k))
        for step in (whole, again):
            np.testing.assert_array_equal(step.cost[[k]], one.cost)
            for name in ("energy", "charge", "discharge", "spill", "flows"):
                np.testing.assert_array_equal(getattr(step, name)[:, [k]], getattr(one, name))


def test_members_of_different_prices_have_networks_of_their_own(microgrid: Microgrid) -> None:
    simulator, rng = NetworkSimulator(microgrid, 0.25), np.random.default_rng(6)
    seen = with_prices(simulator, scene(simulator, 12, rng), rng)
    whole = simulator.step(*seen.all)
    for k in range(12):
        one = simulator.step(*seen.of(k))
        np.testing.assert_allclose(whole.cost[[k]], one.cost, atol=1e-9)
        np.testing.assert_allclose(whole.energy[:, [k]], one.energy, atol=1e-9)


@pytest.mark.parametrize("recourse", ["economic", "paper"])
def test_numpy_equals_torch_and_its_gradient_is_the_finite_difference(
    microgrid: Microgrid, recourse: Any
) -> None:
    torch = pytest.importorskip("torch", reason="the extra `learn` is not installed")
    simulator = Simulator(microgrid, 0.25, recourse)
    seen = scene(simulator, 64, np.random.default_rng(11))
    plain = simulator.step(*seen.all)

    def total(asked: Any) -> Any:
        tensors = [torch.as_tensor(x) for x in (seen.energy, seen.data, seen.island)]
        step = simulator.step(tensors[0], asked, tensors[1], tensors[2])
        return (step.cost + 0.3 * step.energy.sum(0)).sum(), step

    asked = torch.as_tensor(seen.action).requires_grad_()
    value, step = total(asked)
    np.testing.assert_allclose(step.cost.detach(), plain.cost, atol=1e-12)
    np.testing.assert_allclose(step.energy.detach(), plain.energy, atol=1e-12)
    np.testing.assert_allclose(step.flows.detach(), plain.flows, atol=1e-12)
    value.backward()
    rng = np.random.default_rng(0)
    for _ in range(40):
        i, k = rng.integers(seen.action.shape[0]), rng.integers(64)
        moved = np.zeros_like(seen.action)
        moved[i, k] = 1e-6
        ends = [float(total(torch.as_tensor(seen.action + s * moved))[0]) for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / 2e-6
        assert float(asked.grad[i, k]) == pytest.approx(slope, abs=1e-5)


def test_single_precision_is_kept_by_numpy_and_torch(simulator: Simulator) -> None:
    torch = pytest.importorskip("torch", reason="the extra `learn` is not installed")
    seen = scene(simulator, 500, np.random.default_rng(2))
    whole = simulator.step(*seen.all)
    single = [x.astype(np.float32) for x in (seen.energy, seen.action, seen.data)]
    ours = simulator.step(single[0], single[1], single[2], seen.island)
    tensors = [torch.as_tensor(x) for x in (*single, seen.island)]
    theirs = simulator.step(*tensors)
    for name in ("energy", "cost", "charge", "discharge", "spill", "flows"):
        found, other = getattr(ours, name), getattr(theirs, name)
        assert found.dtype == np.float32
        assert other.dtype == torch.float32
        np.testing.assert_allclose(found, getattr(whole, name), atol=2e-5)
        np.testing.assert_allclose(other.numpy(), getattr(whole, name), atol=2e-5)


def test_a_plan_stepped_has_its_cost_and_its_states(microgrid: Microgrid) -> None:
    """At copperplate the optimum's storage decisions alone, stepped, cost what the plan says."""
    case = microgrid.case
    problem = horizon(case, "copperplate")
    plan = rs.solve(case, "lp", physics="copperplate")
    simulator = Simulator(problem.microgrid, case.step_h)
    situation = problem.microgrid.situation(status(case))
    data = simulator.stacked(problem.microgrid.data(situation))
    energy = problem.x0["ess.energy"][:, None]
    spent = 0.0
    for t in range(case.slots):
        action = np.array([[-plan.tables["power"][unit][t]] for unit in simulator.units])
        step = simulator.step(energy, action, data[:, [t]], situation.island[:, [t]])
        spent, energy = spent + float(step.cost[0]), step.energy
        np.testing.assert_allclose(energy[:, 0], plan.tables["energy"].values[:, t], atol=1e-6)
    assert spent == pytest.approx(plan.operating_cost, rel=1e-6)


def test_what_a_step_cannot_hold_is_refused_all_at_once() -> None:
    with pytest.raises(rs.UsageError, match=r"generator\.on.*generator\.up_left") as refused:
        Simulator(Microgrid.build(rs.load_case("ieee33-commitment"), "copperplate"), 0.25)
    assert refused.value.hint == (
        "it steps cases without commitment, ramps, curves of cost or fuel, switchable lines and "
        "line ratings"
    )
    with pytest.raises(rs.UsageError, match="steps copperplate physics, not lindistflow"):
        Simulator(Microgrid.build(rs.load_case("ieee33"), "lindistflow"), 0.25)


@pytest.mark.parametrize(
    ("about", "generator", "named"),
    [
        ({"rating_mva": 1.0}, {}, "line ratings"),
        ({"switchable": True}, {}, r"line\.closed"),
        ({}, {"ramp_up_mw_per_h": 1.0}, r"generator\.p_before"),
        ({}, {"cost_curve": [[0.0, 0.0], [1.0, 2.0]]}, r"generator\.curve\.generator1"),
    ],
)
def test_each_thing_that_a_step_cannot_hold(
    about: dict[str, Any], generator: dict[str, Any], named: str
) -> None:
    case = small_case(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", **about}],
        generator=[{"p_max_mw": 1.0, **generator}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}],
    )
    with pytest.raises(rs.UsageError, match=named):
        Simulator(Microgrid.build(case, "copperplate"), 1.0)


def test_an_unknown_recourse_is_refused(microgrid: Microgrid) -> None:
    with pytest.raises(rs.UsageError, match="'cheap' is unknown; allowed: economic, paper"):
        Simulator(microgrid, 0.25, "cheap")  # type: ignore[arg-type]
