"""Gradients of a rollout against differences of its cost, at kinks and between them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="gradients need torch")

import resilience as rs  # noqa: E402
from resilience.arrays import Floats  # noqa: E402
from resilience.models.microgrid import Microgrid  # noqa: E402
from resilience.models.simulator import Simulator  # noqa: E402
from tests.stepping import Scene, scene  # noqa: E402

SLOTS, MEMBERS, WIDTH = 4, 50, 1e-5
WORTH = 0.23  # of a MWh left, $


@cache
def simulator(recourse: Any) -> Simulator:
    return Simulator(Microgrid.build(rs.load_case("ieee33-tou"), "copperplate"), 0.25, recourse)


def cost(plant: Simulator, slots: list[Scene], action: Any, energy: Any, like: Any) -> Any:
    """(members,) $ of a few slots less the worth of what is left; `like` makes their arrays."""
    total = 0.0
    for t, seen in enumerate(slots):
        step = plant.step(energy, action[t], like(seen.data), like(seen.island))
        total, energy = total + step.cost, step.energy
    return total - WORTH * energy.sum(0)


def differences(plant: Simulator, slots: list[Scene], action: Floats) -> tuple[Floats, Floats]:
    """(slots, units, members) the left and right difference quotients of every order, in NumPy."""
    start, quotients = slots[0].energy, np.empty((2, *action.shape))
    middle = cost(plant, slots, action, start, np.asarray)
    for t in range(SLOTS):
        for u in range(action.shape[1]):
            for side, width in enumerate((-WIDTH, WIDTH)):
                moved = action.copy()
                moved[t, u] += width
                quotients[side, t, u] = (
                    cost(plant, slots, moved, start, np.asarray) - middle
                ) / width
    return quotients[0], quotients[1]


def gradient(plant: Simulator, slots: list[Scene], action: Floats) -> Floats:
    """(slots, units, members) by torch."""
    torch.set_num_threads(1)
    asked = torch.tensor(action, requires_grad=True)
    cost(plant, slots, asked, torch.tensor(slots[0].energy), torch.tensor).sum().backward()
    assert asked.grad is not None
    found: Floats = asked.grad.numpy()
    return found


def drawn(plant: Simulator, seed: int) -> tuple[list[Scene], Floats]:
    rng = np.random.default_rng(seed)
    slots = [scene(plant, MEMBERS, rng, reach=0.6) for _ in range(SLOTS)]
    return slots, np.array([seen.action for seen in slots])


@pytest.mark.parametrize("recourse", ["economic", "paper"])
def test_between_kinks_the_gradient_is_the_difference(recourse: Any) -> None:
    plant = simulator(recourse)
    slots, action = drawn(plant, 31)
    left, right = differences(plant, slots, action)
    smooth = np.abs(left - right) < 1e-6
    assert smooth.mean() > 0.9
    assert np.abs(right[smooth]).max() > 1.0
    found = gradient(plant, slots, action)
    np.testing.assert_allclose(found[smooth], ((left + right) / 2.0)[smooth], rtol=0.0, atol=1e-6)


def often_idle(plant: Simulator, *, one_charges: bool) -> tuple[list[Scene], Floats]:
    """Scenes and orders, of which three in five are none; some unit of every island charges."""
    slots, action = drawn(plant, 32)
    action[np.random.default_rng(1).random(action.shape) < 0.6] = 0.0
    if one_charges:
        for orders, seen in zip(action, slots, strict=True):
            island = seen.island[plant.storage_bus]
            for u, m in np.ndindex(island.shape):
                if (orders[island[:, m] == island[u, m], m] <= 0.0).all():
                    orders[u, m] = 0.05
    return slots, action


def beyond_both_sides(plant: Simulator, *, one_charges: bool) -> Floats:
    """(orders of none) by how much a gradient lies outside its one-sided difference quotients."""
    slots, action = often_idle(plant, one_charges=one_charges)
    left, right = differences(plant, slots, action)
    low, high = np.minimum(left, right), np.maximum(left, right)
    idle = action == 0.0
    assert idle.mean() > 0.3
    assert np.median((high - low)[idle]) > 0.04  # wear of 0.2 $ per MWh and 0.25 h, at least
    found = gradient(plant, slots, action)
    return np.maximum(low - found, found - high)[idle]


# A quotient may straddle another kink, which is rare and nearly nothing: hence 1e-4.
@pytest.mark.parametrize(("recourse", "most"), [("economic", 1e-6), ("paper", 1e-4)])
def test_at_no_action_the_gradient_lies_between_both_sides(recourse: Any, most: float) -> None:
    """Charging and discharging meet there: their sum would be no gradient at all."""
    one_charges = recourse == "paper"
    assert beyond_both_sides(simulator(recourse), one_charges=one_charges).max() < most


def test_where_nothing_moves_two_kinks_may_meet() -> None:
    """Where generators run for the load alone and nothing charges in an island, its balance has its
    kink at no action, too, and one coordinate of a gradient need not lie between its own two sides.
    """
    assert (beyond_both_sides(simulator("paper"), one_charges=False) < 1e-6).mean() >= 0.98
