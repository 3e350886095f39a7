"""Every algorithm learns what can be derived by hand."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

from resilience.rl.algorithms.registry import algorithm  # noqa: E402
from resilience.rl.learning.learner import Learner  # noqa: E402
from tests.unit.rl.toys import (  # noqa: E402
    BUYING_PRICE,
    SHED_PRICE,
    arbitrage,
    cost_of,
    learn,
    outage,
)

SMALL = {"hidden": (32, 32), "carried_start": 1.0}
CRITICS = SMALL | {
    "hidden": (64, 64),
    "environments": 32,
    "batch": 128,
    "warm_up": 4096,
    "update_every": 8,
    "tau": 0.05,
    "n_step": 1,
    "pull": 0.01,
    "noise": 0.5,
    "noise_correlation": 0.0,
    "discount": 1.0,
    "actor_rate": 3e-3,
    "critic_rate": 3e-3,
    "policy_delay": 1,
    "replay": 150,
}
SETTINGS = {
    "apg": (SMALL | {"batch": 32, "learning_rate": 1e-2, "average": 0.9}, 80),
    "maddpg": (CRITICS, 110),
    "matd3": (CRITICS, 110),
    "ddpg": (CRITICS, 110),
    "mappo": (
        SMALL | {"environments": 64, "batch": 128, "actor_rate": 1e-2, "critic_rate": 1e-2},
        60,
    ),
}
ON_POLICY = ("apg", "mappo")
SAMPLE = ("maddpg", 0)
OFF_POLICY = [
    pytest.param(name, seed, marks=() if (name, seed) == SAMPLE else pytest.mark.exhaustive)
    for name in ("ddpg", "matd3", "maddpg")
    for seed in range(3)
]


def learned(method: str, env, seed: int = 0) -> Learner:
    values, iterations = SETTINGS[method]
    entry = algorithm(method)
    learner = entry.make(env, entry.settings_of(values), seed)
    learn(learner, iterations)
    return learner


@pytest.mark.parametrize("method", ON_POLICY)
def test_buys_cheap_and_serves_dear(method: str) -> None:
    env = arbitrage()
    assert cost_of(env, learned(method, env)) == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(("method", "seed"), OFF_POLICY)
def test_critics_learn_it_as_well(method: str, seed: int) -> None:
    env = arbitrage()
    assert cost_of(env, learned(method, env, seed)) == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("times", [0.5, 2.0])
@pytest.mark.parametrize("method", ON_POLICY)
def test_holds_where_an_outage_is_likely_enough(method: str, times: float) -> None:
    flip = BUYING_PRICE / SHED_PRICE
    env = outage(times * flip)
    # Serving now costs the shedding, holding costs what is bought now.
    best = min(times * flip * SHED_PRICE, BUYING_PRICE)
    assert cost_of(env, learned(method, env)) == pytest.approx(best, rel=0.01)


@pytest.mark.parametrize("actor", ["mlp", "agents"])
def test_a_clone_costs_what_its_teacher_costs(actor: str) -> None:
    """The rule fills up to 0.9 of 2 MWh at 1 $ and keeps it: 1.8 + 1 + 1 + 3 + 3 $."""
    env = arbitrage()
    entry = algorithm("clone")
    values = {"hidden": (32, 32), "actor": actor, "environments": 32, "fits": 20, "average": 0.5}
    learner = entry.make(env, entry.settings_of(values), 0)
    learn(learner, 20)
    assert cost_of(env, learner) == pytest.approx(9.8, rel=0.01)
