"""Fuel in the simulator: by hand, against a linear program per slot, and its gradients."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

import resilience as rs
from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import NetworkSimulator, Simulator, Step
from resilience.simulation.slots import stretch_data
from resilience.testing import small_case

UNIT = {"p_max_mw": 2.0, "cost_per_mwh": 10.0, "tank": "tank1", "fuel_m3_per_mwh": 0.25}
CRITICAL = {"p_max_mw": 1.0, "shed_cost_per_mwh": 150.0}
OTHER = {"p_max_mw": 2.0, "shed_cost_per_mwh": 30.0}


def one_bus(units: list[dict[str, Any]], tanks: list[dict[str, Any]], **more: Any) -> Case:
    return small_case(slots=2, tanks=tanks, generator=units, load=[CRITICAL, OTHER], **more)


def stepped(case: Case, fuel: list[list[float]], *, t: int = 0, **more: Any) -> tuple[Step, Any]:
    simulator = Simulator(Microgrid.build(case, "copperplate"), case.step_h)
    program, n = horizon(case, "copperplate"), len(fuel[0])
    data = np.repeat(simulator.data(program.situation, t), n, axis=1)
    island = np.repeat(np.asarray(program.situation.island)[:, [t]], n, axis=1)
    energy = np.repeat(simulator.low, n, axis=1)
    action = np.zeros_like(energy)
    return simulator.step(energy, action, data, island, np.array(fuel), **more), simulator


def level(step: Step) -> np.ndarray:
    assert step.fuel is not None
    return np.asarray(step.fuel)


def flow(step: Step, simulator: Simulator, name: str) -> np.ndarray:
    return np.asarray(step.flows[simulator.columns.index(name)])


def test_a_unit_gives_what_its_tank_holds() -> None:
    """2 MW take 0.5 m³ of the slot: with 1 m³ half is left, with 0.1 m³ there are 0.4 MWh."""
    case = one_bus([UNIT], [{"capacity_m3": 1.0}])
    step, simulator = stepped(case, [[1.0, 0.1, 0.0]])
    np.testing.assert_allclose(flow(step, simulator, "generator.p[generator1]"), [2.0, 0.4, 0.0])
    np.testing.assert_allclose(level(step), [[0.5, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(step.cost, [20 + 30, 4 + 0.6 * 150 + 60, 150 + 60])


def test_a_delivery_can_be_burnt_in_its_slot_and_the_rest_must_find_room() -> None:
    tank = {"capacity_m3": 0.3, "delivery": [{"hour": 1.0, "amount_m3": 1.0}]}
    step, simulator = stepped(one_bus([UNIT], [tank]), [[0.0, 0.3]], t=1)
    np.testing.assert_allclose(flow(step, simulator, "generator.p[generator1]"), [2.0, 2.0])
    np.testing.assert_allclose(level(step), [[0.3, 0.3]])


def test_units_of_a_tank_are_served_in_merit_order_and_alike_in_proportion() -> None:
    """The cheap one takes 0.25 m³ of its 1 MW first; two at 12 share the rest, 0.4 m³ per MWh."""
    small = UNIT | {"p_max_mw": 1.0}
    dear = small | {"cost_per_mwh": 12.0, "fuel_m3_per_mwh": 0.4}
    case = one_bus([dear, small, dear], [{"capacity_m3": 2.0}])
    step, simulator = stepped(case, [[0.45, 0.2, 1.05]])
    power = [flow(step, simulator, f"generator.p[generator{k}]") for k in (1, 2, 3)]
    np.testing.assert_allclose(power, [[0.25, 0.0, 1.0], [1.0, 0.8, 1.0], [0.25, 0.0, 1.0]])
    np.testing.assert_allclose(level(step), np.zeros((1, 3)), atol=1e-12)


def test_who_stands_in_may_empty_a_tank_of_its_own() -> None:
    """The first tank ends after 0.4 MWh, the second, which stands in, after 0.8."""
    units = [UNIT, UNIT | {"cost_per_mwh": 12.0, "tank": "tank2"}, UNIT | {"cost_per_mwh": 11.0}]
    case = one_bus(units, [{"capacity_m3": 1.0}, {"capacity_m3": 1.0}])
    step, simulator = stepped(case, [[0.1, 0.1], [0.2, 1.0]])
    power = [flow(step, simulator, f"generator.p[generator{k}]") for k in (1, 2, 3)]
    np.testing.assert_allclose(power, [[0.4, 0.4], [0.8, 2.0], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(level(step), [[0.0, 0.0], [0.0, 0.5]], atol=1e-12)
    np.testing.assert_allclose(step.cost, [4 + 9.6 + 60 - 0.2 * 30 + 0.0 * 150, 4 + 24 + 0.6 * 30])


def test_what_burners_may_give_is_kept_to() -> None:
    case = one_bus([UNIT], [{"capacity_m3": 1.0}])
    step, simulator = stepped(case, [[1.0, 0.1]], burner_mw=np.array([[0.5, 0.5]]))
    np.testing.assert_allclose(flow(step, simulator, "generator.p[generator1]"), [0.5, 0.4])
    np.testing.assert_allclose(level(step), [[0.875, 0.0]], atol=1e-12)


def random_case(rng: np.random.Generator, slopes: tuple[float, ...], blocks: bool) -> Case:
    """Three buses that two lines may part, a grid, a tank for each of the units or one for all."""
    units = [
        {"bus": str(1 + k % 3), "p_max_mw": float(rng.uniform(0.5, 2)), "tank": f"tank{1 + k}"}
        | {"cost_per_mwh": float(rng.uniform(5, 20)), "fuel_m3_per_mwh": slope}
        for k, slope in enumerate(slopes)
    ]
    tank = {"capacity_m3": 1.0, "delivery": [{"hour": 1.0, "amount_m3": 0.2}]}
    loads = [
        {"bus": str(1 + k % 3), "p_max_mw": float(rng.uniform(0.3, 1)), "block": blocks and k == 4}
        | {"shed_cost_per_mwh": float(rng.uniform(30, 150)), "profile": "demand"}
        for k in range(6)
    ]
    store = {"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.0}
    return small_case(
        slots=4,
        buses=3,
        lines=[(1, 2, 0.001, 0.001), (2, 3, 0.001, 0.001)],
        line_tables=[{"name": name, "breakpoint": True} for name in ("1-2", "2-3")],
        profiles={"demand": [1.0, 0.5, 0.8, 1.0]},
        tanks=[tank] * len(units),
        generator=units,
        load=loads,
        ess=[store],
        grid=[{"import_max_mw": 0.5, "import_cost_per_mwh": 12.0}],
    )


@pytest.mark.parametrize("seed", range(4))
def test_with_a_tank_each_a_step_is_the_optimum_of_its_slot(seed: int) -> None:
    """Then nothing is shared, and merit order is the optimum: HiGHS finds nothing cheaper."""
    rng = np.random.default_rng(seed)
    case = random_case(rng, (0.25, 0.3, 0.2, 0.4), blocks=False)
    grid, n = Microgrid.build(case, "copperplate"), 12
    fast, exact = Simulator(grid, 1.0), NetworkSimulator(grid, 1.0)
    up = rng.random((2, 4, n)) < 0.6
    for t in range(4):
        stacked, island = parted(fast, up, t)
        fuel = rng.uniform(0.0, 0.4, (4, n)) * (rng.random((4, n)) < 0.8)
        energy, action = rng.uniform(0.0, 1.0, (1, n)), rng.uniform(-0.5, 0.5, (1, n))
        limit = rng.uniform(0.0, 2.0, (4, n)) if t == 3 else None
        one = fast.step(energy, action, stacked, island, fuel, limit)
        other = exact.step(energy, action, stacked, island, fuel, limit)
        np.testing.assert_allclose(one.cost, other.cost, atol=1e-6)
        np.testing.assert_allclose(level(one), level(other), atol=1e-6)
        np.testing.assert_allclose(one.energy, other.energy, atol=1e-6)
        assert level(one).min() >= 0.0
        burnt = fast.fuel_per_mw @ one.flows
        assert (burnt <= fuel + fast.delivered(_ops(fuel), stacked) + 1e-12).all()
        assert t or (burnt[:, burnt.any(0)] > 0).any()


def parted(simulator: Simulator, up: np.ndarray, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Data and islands of slot t with lines (lines, slots, batch) up or down."""
    grid, n = simulator.microgrid, up.shape[2]

    def profile(name: str | None, slots: np.ndarray) -> np.ndarray:
        return np.repeat(grid.case.profile(name)[slots][:, None], n, axis=1)

    data, situation = stretch_data(grid, up, profile, np.array([t]))
    stacked = np.broadcast_to(simulator.stacked(data), (simulator.form.n_data, n))
    return stacked, np.asarray(situation.island)


def _ops(array: np.ndarray) -> Any:
    from resilience.models.simulator.arrays import array_ops

    return array_ops(array)


def test_shared_tanks_are_never_overdrawn_and_never_beat_the_optimum_of_the_slot() -> None:
    rng = np.random.default_rng(9)
    case = random_case(rng, (0.25, 0.3, 0.2, 0.4), blocks=False)
    shared = [t.model_copy(update={"tank": "tank1"}) for t in case.generator[:3]]
    case = case.replace(generator=[*shared, case.generator[3]])
    grid, n = Microgrid.build(case, "copperplate"), 40
    fast, exact = Simulator(grid, 1.0), NetworkSimulator(grid, 1.0)
    data, island = parted(fast, rng.random((2, 1, n)) < 0.6, 0)
    fuel = rng.uniform(0.0, 1.0, (4, n))
    energy, action = np.full((1, n), 0.5), np.zeros((1, n))
    one = fast.step(energy, action, data, island, fuel)
    other = exact.step(energy, action, data, island, fuel)
    assert (one.cost >= other.cost - 1e-6).all()
    burnt = fast.fuel_per_mw @ one.flows
    assert (burnt <= fuel + 1e-12).all()
    short = burnt[0] > fuel[0] - 1e-9
    assert 5 < short.sum() < n - 5
    assert (one.cost > other.cost + 1e-3).any()
    np.testing.assert_allclose(level(one), fuel - burnt, atol=1e-12)


def test_blocks_and_fuel() -> None:
    """0.4 MWh of fuel: the block of 1 MW is shed whole, and 0.4 of the other load is served."""
    loads = [CRITICAL | {"block": True}, OTHER]
    case = small_case(
        slots=2, tanks=[{"capacity_m3": 1.0}], generator=[UNIT | {"p_max_mw": 3.0}], load=loads
    )
    step, simulator = stepped(case, [[1.0, 0.1]])
    np.testing.assert_allclose(flow(step, simulator, "load.shed[load1]"), [0.0, 1.0])
    np.testing.assert_allclose(flow(step, simulator, "load.shed[load2]"), [0.0, 1.6])
    np.testing.assert_allclose(level(step), [[0.25, 0.0]], atol=1e-12)


def rolled(simulator: Simulator, slots: Any, fuel: Any, action: Any) -> Any:
    """Cost of some slots from a level, storage doing `action` (slots, units, batch)."""
    energy, total = action[0] * 0.0 + 0.5, 0.0
    for t, (data, island) in enumerate(slots):
        step = simulator.step(energy, action[t], data, island, fuel)
        energy, fuel, total = step.energy, step.fuel, total + step.cost
    return total


@pytest.mark.parametrize("seed", range(3))
def test_gradients_through_the_levels_are_those_of_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = random_case(rng, (0.25, 0.3, 0.2), blocks=False)
    shared = [t.model_copy(update={"tank": "tank1"}) for t in case.generator[:2]]
    case = case.replace(generator=[*shared, case.generator[2]])
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    situation, n = horizon(case, "copperplate").situation, 6
    island = np.array([[0] * 3 + [0] * 3, [0] * 3 + [1] * 3, [0] * 3 + [2] * 3])
    slots = [(np.repeat(simulator.data(situation, t), n, axis=1), island) for t in range(3)]
    tensors = [(torch.as_tensor(d), torch.as_tensor(i)) for d, i in slots]
    fuel, action = rng.uniform(0.1, 0.6, (3, n)), rng.uniform(-0.15, 0.15, (3, 1, n))
    start = torch.tensor(fuel, requires_grad=True)
    power = torch.tensor(action, requires_grad=True)
    cost = rolled(simulator, tensors, start, power)
    np.testing.assert_allclose(cost.detach(), rolled(simulator, slots, fuel, action), rtol=1e-12)
    cost.sum().backward()
    assert start.grad is not None
    assert power.grad is not None
    step = 1e-6
    for gradient, values, name in ((start.grad, fuel, "fuel"), (power.grad, action, "action")):
        for k in range(values.shape[0]):
            moved = [values.copy(), values.copy()]
            for sign, array in zip((1, -1), moved, strict=True):
                array[k] += sign * step
            ends = [
                rolled(simulator, slots, *((x, action) if name == "fuel" else (fuel, x)))
                for x in moved
            ]
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(gradient[k].reshape(-1), slope, rtol=1e-5, atol=1e-5)
    assert (start.grad.abs() > 1.0).any()


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "curve": ({"fuel_curve": [[0, 0], [1, 0.2], [2, 0.6]]}, r"follow the curve 'tank\.burn'"),
    "no-load": ({"fuel_m3_per_mwh": 0.25, "fuel_no_load_m3_per_h": 0.1}, r"decide 'generator\.on'"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_fuel_that_a_step_does_not_hold_is_refused_by_name(name: str) -> None:
    fuel, words = REFUSED[name]
    unit: dict[str, Any] = {
        key: value for key, value in UNIT.items() if key != "fuel_m3_per_mwh"
    } | fuel
    grid = Microgrid.build(one_bus([unit], [{"capacity_m3": 1.0}]), "copperplate")
    for stepper in (Simulator, NetworkSimulator):
        with pytest.raises(rs.UsageError, match=words):
            stepper(grid, 1.0)


def test_the_level_must_be_told_and_the_paper_knows_none() -> None:
    case = one_bus([UNIT], [{"capacity_m3": 1.0}])
    grid = Microgrid.build(case, "copperplate")
    simulator = Simulator(grid, 1.0)
    data = simulator.data(horizon(case, "copperplate").situation, 0)
    nothing, island = np.empty((0, 1)), np.zeros((1, 1), int)
    with pytest.raises(ValueError, match="no fuel of the tanks tank1"):
        simulator.step(nothing, nothing, data, island)
    with pytest.raises(rs.UsageError, match="knows no tanks, but there is tank1"):
        Simulator(grid, 1.0, "paper")
