"""The ring of what was done: what it gives back, and what it never gives."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

from resilience.rl.ground.env import BatchEnv  # noqa: E402
from resilience.rl.learning.replay import ReplayRing  # noqa: E402
from tests.unit.rl.toys import arbitrage, outage  # noqa: E402

EPISODES = 3


def filled(env: BatchEnv, rounds: int, tapes: int = 2) -> tuple[ReplayRing, list]:
    """A ring, and every (tape, t, energy, output, reward) that was put in."""
    replay, put = ReplayRing(env, tapes, EPISODES), []
    rng = np.random.default_rng(8)
    for number in range(rounds):
        tape = replay.open(number + 20)
        for t in range(tape.slots):
            energy = env.tensor(rng.uniform(0.2, 0.9, (1, EPISODES)))
            output = env.tensor(rng.uniform(-1.0, 1.0, (EPISODES, 1)))
            reward = env.tensor(rng.normal(size=(1, EPISODES)))
            replay.add(energy, output, reward)
            put.append((tape, t, energy, output, reward))
    return replay, put


def test_rows_are_what_was_seen_and_done_in_the_tapes_that_are_left() -> None:
    env = arbitrage()
    replay, put = filled(env, 3)
    assert replay.usable(1) == 2 * 4 * EPISODES
    rows = replay.rows(np.arange(replay.usable(1)), 1)
    back = replay.transitions(rows, 1, 0.9)
    for k, (tape, t, energy, output, reward) in enumerate(put[4:]):
        part = slice(k * EPISODES, (k + 1) * EPISODES)
        assert torch.equal(back.now.observed[part], env.observe(tape, t, energy))
        assert torch.equal(back.now.energy[:, part], energy)
        assert torch.equal(back.output[part], output)
        assert torch.equal(back.rewards[:, part], reward)
        power = env.power(tape, t, energy, output)
        at = back.now
        again = env.band.power(back.output.T, at.energy, at.slot)
        torch.testing.assert_close(again[:, part], power)


def test_three_steps_sum_discounted_rewards_and_stop_at_the_end() -> None:
    env = arbitrage()
    replay, put = filled(env, 1)
    rewards = [float(entry[4][0, 1]) for entry in put]
    back = replay.transitions(np.arange(4) * EPISODES + 1, 3, 0.9)
    ends = [min(t + 3, 4) for t in range(4)]
    sums = [sum(0.9**k * r for k, r in enumerate(rewards[t:end])) for t, end in enumerate(ends)]
    torch.testing.assert_close(back.rewards[0], env.tensor(np.array(sums)))
    torch.testing.assert_close(back.discount, env.tensor(np.array([0.9**3, 0.0, 0.0, 0.0])))
    assert torch.equal(back.later.energy[:, 0], put[3][2][:, 1])


def test_an_open_episode_gives_only_what_has_a_later() -> None:
    env = arbitrage()
    replay, _ = filled(env, 2)
    tape = replay.open(40)
    for played in range(1, 4):
        replay.add(env.start(EPISODES), torch.zeros(EPISODES, 1), torch.zeros(1, EPISODES))
        own = max(played - 2, 0) * EPISODES
        assert replay.usable(2) == tape.slots * EPISODES + own
        # Whatever the number, the row is neither ahead of the open episode nor of an older tape.
        rows = replay.rows(np.arange(replay.usable(2)), 2)
        of_open = rows // (4 * EPISODES) == replay.place
        assert of_open.sum() == own
        assert (rows[of_open] % (4 * EPISODES) // EPISODES < played).all()


def test_a_ring_from_its_state_samples_the_same() -> None:
    env = outage(0.3)
    replay, _ = filled(env, 3)
    other = ReplayRing(env, 2, EPISODES)
    other.load_state({name: value.clone() for name, value in replay.state().items()})
    samples = [r.sample(50, np.random.default_rng(6), 1, 0.9) for r in (replay, other)]
    for name in ("observed", "energy"):
        assert torch.equal(*(getattr(sample.now, name) for sample in samples))
    for name in ("power_limits", "island"):
        assert torch.equal(*(getattr(sample.now.slot.storage, name) for sample in samples))
    assert torch.equal(samples[0].rewards, samples[1].rewards)
