"""From outputs to MW: within limits in any state, and the anchors by hand."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import Simulator
from resilience.rl.ground.bands import band
from tests.stepping import Scene, scene


@cache
def simulator(case: str = "ieee33-tou") -> Simulator:
    return Simulator(Microgrid.build(rs.load_case(case), "copperplate"), 0.25)


def at_the_edges(observed: Scene, plant: Simulator, rng: np.random.Generator) -> Scene:
    """A third of the units full or empty, or all but."""
    is_low = rng.random(observed.energy.shape) < 0.5
    chosen = np.where(is_low, plant.low, plant.high)
    chosen += rng.choice([0.0, 1e-13, -1e-13], observed.energy.shape)
    on_edge = rng.random(observed.energy.shape) < 0.33
    observed.energy[on_edge] = np.clip(chosen, plant.low, plant.high)[on_edge]
    return observed


@pytest.mark.parametrize("name", ["affine", "anchors"])
@pytest.mark.parametrize("case", ["ieee33-tou", "ieee33-grid"])
def test_no_output_leaves_the_limits_in_fifty_thousand_states(name: str, case: str) -> None:
    plant, rng = simulator(case), np.random.default_rng(12)
    made, size, n = band(name, plant), plant.high - plant.low, 2500
    for _ in range(20):
        observed = at_the_edges(scene(plant, n, rng), plant, rng)
        output = rng.choice([-1.0, 0.0, 1.0, 0.5], observed.energy.shape)
        output = np.where(rng.random(output.shape) < 0.5, output, rng.uniform(-1, 1, output.shape))
        power = made.power(output, observed.energy, made.slot(observed.data, observed.island))
        low, high = plant.limits(observed.energy, observed.data)
        assert (power >= low - 1e-12).all()
        assert (power <= high + 1e-12).all()
        after = observed.energy + np.where(power > 0.0, plant.gain, plant.drain) * power
        assert (after >= plant.low - 1e-12 * size).all()
        assert (after <= plant.high + 1e-12 * size).all()


def test_affine_is_the_papers_mask_with_efficiencies() -> None:
    """Its eq. (18): 0.25 h, room for 0.07 MWh at 0.999 and 0.04 MWh above the least."""
    plant = simulator()
    rng = np.random.default_rng(2)
    observed = scene(plant, 1, rng)
    size = np.array([[6.0], [4.0], [6.0], [3.0], [3.0]])
    energy = 0.9 * size - 0.07
    energy[2:] = 0.1 * size[2:] + 0.04
    top = np.array([0.07 / (0.25 * 0.999)] * 2 + [2.0, 1.0, 1.0])
    bottom = np.array([-2.0, -1.5] + [-0.04 * 0.999000999000999 / 0.25] * 3)
    for output in (-1.0, -0.3, 0.0, 0.7, 1.0):
        affine = band("affine", plant)
        slot = affine.slot(observed.data, observed.island)
        power = affine.power(np.full((5, 1), output), energy, slot)
        expected = bottom + (top - bottom) * (output + 1.0) / 2.0
        np.testing.assert_allclose(power[:, 0], expected, rtol=0.0, atol=1e-9)


def by_hand(plant: Simulator, observed: Scene, k: int) -> dict[str, Floats]:
    """What greedy, rule 0.9 and full charge ask of member k, device by device, in plain loops."""
    microgrid = plant.microgrid
    case, dt, island = microgrid.case, 0.25, observed.island[:, k]

    def of(table) -> int:
        return int(island[microgrid.bus_index([table])[0]])

    number = range(len(plant.units))
    demand, sun, able = np.zeros((3, plant.n_buses))
    for row, load in enumerate(case.load):
        demand[of(load)] += observed.named["load.demand"][row, k]
        demand[of(load)] -= np.broadcast_to(
            observed.named["load.shed_min"], observed.named["load.demand"].shape
        )[row, k]
    for row, plant_pv in enumerate(case.pv):
        sun[of(plant_pv)] += observed.named["pv.available"][row, k]
    for generator in case.generator:
        able[of(generator)] += generator.p_max_mw
    grids = {of(grid) for grid in case.grid}
    energy = observed.energy[:, k]
    top, bottom, hold = np.zeros((3, len(plant.units)))
    for u, unit in enumerate(case.ess):
        room = unit.soc_max * unit.e_mwh - energy[u]
        stock = energy[u] - unit.soc_min * unit.e_mwh
        top[u] = max(min(unit.p_max_mw, room / unit.efficiency_charge / dt), 0.0)
        bottom[u] = max(min(-unit.p_min_mw, stock * unit.efficiency_discharge / dt), 0.0)
        away = 0.9 * unit.e_mwh - energy[u]
        per = unit.efficiency_charge if away > 0 else 1.0 / unit.efficiency_discharge
        hold[u] = np.clip(away / per / dt, -bottom[u], top[u])
    greedy, rule = np.zeros((2, len(plant.units)))
    for u, unit in enumerate(case.ess):
        here = of(unit)
        mates = [v for v in number if of(case.ess[v]) == here]
        take, give = sum(top[v] for v in mates), sum(bottom[v] for v in mates)
        net = demand[here] - sun[here]
        left = max(net, 0.0) - able[here]
        charge = top[u] * min(max(-net, 0.0) / take, 1.0) if take > 0 else 0.0
        greedy[u] = charge - (bottom[u] * min(max(net, 0.0) / give, 1.0) if give > 0 else 0.0)
        spare = charge - (bottom[u] * min(max(left, 0.0) / give, 1.0) if give > 0 else 0.0)
        rule[u] = hold[u] if here in grids else spare
    return {"greedy": greedy, "rule": rule, "full": top}


@pytest.mark.parametrize("case", ["ieee33-tou", "ieee33-grid"])
def test_the_anchors_are_greedy_rule_and_full_charge(case: str) -> None:
    plant, rng = simulator(case), np.random.default_rng(21)
    anchors, n, kinds = band("anchors", plant), 40, set()
    for _ in range(12):
        observed = at_the_edges(scene(plant, n, rng), plant, rng)
        power = {
            name: anchors.power(np.full(observed.energy.shape, output), *state)
            for state in [(observed.energy, anchors.slot(observed.data, observed.island))]
            for name, output in (("greedy", -1.0), ("rule", 0.0), ("full", 1.0))
        }
        for k in range(n):
            for name, expected in by_hand(plant, observed, k).items():
                np.testing.assert_allclose(power[name][:, k], expected, rtol=0.0, atol=1e-9)
            kinds.add(len(set(observed.island[:, k])))
    assert len(kinds) > 1
