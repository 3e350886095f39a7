"""The training ground: what a slot is rewarded with."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

import resilience as rs  # noqa: E402
from resilience.rl.ground.env import BatchEnv  # noqa: E402
from resilience.rl.ground.episodes import EpisodeSampler  # noqa: E402
from resilience.rl.ground.tape import Tape  # noqa: E402


@cache
def sampler(case: str = "ieee33-tou") -> EpisodeSampler:
    return EpisodeSampler(rs.load_case(case), seed=3, storms=50)


def ground(band: str = "anchors", baseline: str = "rule") -> BatchEnv:
    torch.set_num_threads(1)
    return BatchEnv(sampler(), band, baseline, dtype=torch.float64)


def any_start(env: BatchEnv, n: int, seed: int = 4) -> Any:
    low, high = env.simulator.low, env.simulator.high
    share = np.random.default_rng(seed).random((env.units, n))
    return env.tensor(low + (high - low) * share)


def rewards(env: BatchEnv, tape: Tape, start: Any, *, agents: bool = False):
    """Rewards of every slot under outputs drawn at random, the cost of it all, and what is left."""
    rng = np.random.default_rng(11)
    baseline, energy, cost, gained = env.baseline_cost(tape, start), start, 0.0, []
    for t in range(tape.slots):
        output = env.tensor(rng.uniform(-1.0, 1.0, (tape.n, env.units)))
        step = env.step(tape, t, energy, output)
        give = env.agent_rewards if agents else env.reward
        gained.append(give(tape, t, step, baseline))
        cost, energy = cost + step.cost, step.energy
    return torch.stack(gained), cost, energy


def test_rewards_add_up_to_the_negative_objective() -> None:
    env = ground(baseline="none")
    tape, start = env.draw(5, 7), any_start(env, 5)
    gained, cost, left = rewards(env, tape, start)
    objective = cost - env.setting.end_value_per_mwh * left.sum(0)
    torch.testing.assert_close(gained.sum(0), -objective, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("baseline", ["idle", "rule"])
def test_a_baseline_moves_every_reward_by_what_no_action_changes(baseline: str) -> None:
    plain, env = ground(baseline="none"), ground(baseline=baseline)
    tape, start = env.draw(5, 7), any_start(env, 5)
    difference = rewards(env, tape, start)[0] - rewards(plain, tape, start)[0]
    torch.testing.assert_close(difference, env.baseline_cost(tape, start), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("baseline", "output"), [("rule", 0.0), ("idle", None)])
def test_whoever_acts_as_the_baseline_is_rewarded_with_nothing(
    baseline: str, output: float | None
) -> None:
    env = ground("anchors" if output is not None else "affine", baseline)
    tape, start = env.draw(6, 2), any_start(env, 6)
    costs, energy = env.baseline_cost(tape, start), start
    for t in range(tape.slots):
        asked = torch.zeros((6, env.units), dtype=torch.float64)
        if output is None:  # what the affine band makes nothing of
            low, high = env.simulator.limits(energy, tape.now(t).data)
            asked = (-2.0 * low / (high - low) - 1.0).T
        step = env.step(tape, t, energy, asked)
        reward = env.reward(tape, t, step, costs)
        torch.testing.assert_close(reward, torch.zeros_like(reward), rtol=0.0, atol=1e-9)
        energy = step.energy


def test_the_last_slot_alone_is_the_one_after_which_an_episode_is_cut_short() -> None:
    env = ground()
    tape = env.draw(2, 1)
    assert [env.is_last(tape, t) for t in range(tape.slots)] == [False] * 95 + [True]


def test_an_agent_pays_for_the_system_and_for_the_wear_of_its_own_unit() -> None:
    env = ground(baseline="none")
    tape, start = env.draw(4, 9), any_start(env, 4)
    case = env.setting.case
    wear_price = np.array([[unit.degradation_cost_per_mwh] for unit in case.ess]) * case.step_h
    zero = torch.zeros((tape.slots, 4), dtype=torch.float64)
    output = torch.full((4, env.units), -0.7, dtype=torch.float64)
    for t in (17, tape.slots - 1):
        step = env.step(tape, t, start, output)
        wear = wear_price * step.discharge.numpy()
        assert (wear > 0.0).any()
        left = env.setting.end_value_per_mwh * step.energy.numpy() * env.is_last(tape, t)
        expected = -(step.cost.numpy() - wear.sum(0) + wear - left)
        given = env.agent_rewards(tape, t, step, zero).numpy()
        np.testing.assert_allclose(given, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("band", ["anchors", "affine"])
def test_a_slot_played_without_a_gradient_is_the_same(band: str) -> None:
    """The one is in NumPy, the other in torch."""
    env, rng = ground(band), np.random.default_rng(17)
    tape, energy = env.draw(6, 3), any_start(env, 6)
    assert not tape.episodes.line_up.all()
    for t in range(tape.slots):
        output = env.tensor(rng.uniform(-1.0, 1.0, (6, env.units)))
        step = env.step(tape, t, energy, output.requires_grad_())
        assert step.cost.requires_grad
        with torch.no_grad():
            plain = env.step(tape, t, energy, output)
            asked = env.power(tape, t, energy, output)
            again = env.played(tape, t, energy, asked)
        for name in ("energy", "cost", "charge", "discharge", "spill", "flows"):
            found = getattr(step, name).detach()
            for in_numpy in (plain, again):
                torch.testing.assert_close(getattr(in_numpy, name), found, rtol=0.0, atol=1e-12)
        energy = plain.energy
