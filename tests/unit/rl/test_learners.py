"""Learners: sizes, updates, targets, bits, and agents that fail."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

import resilience as rs  # noqa: E402
from resilience.dispatch.registry import factory_of  # noqa: E402
from resilience.errors import UsageError  # noqa: E402
from resilience.rl.algorithms.actor_critic import ActorCritic  # noqa: E402
from resilience.rl.algorithms.maddpg_paper import PaperCritics, PaperMaddpg  # noqa: E402
from resilience.rl.algorithms.registry import ALGORITHMS, algorithm  # noqa: E402
from resilience.rl.failed import with_failed  # noqa: E402
from resilience.rl.ground.env import BatchEnv  # noqa: E402
from resilience.rl.ground.episodes import EpisodeSampler  # noqa: E402
from resilience.rl.ground.observers import observer  # noqa: E402
from resilience.rl.learning.learner import Learner, Progress  # noqa: E402
from resilience.rl.learning.off_policy import updates_due  # noqa: E402
from resilience.rl.networks.actors import AgentActors, GruActors  # noqa: E402
from resilience.rl.networks.nets import network  # noqa: E402
from resilience.simulation.observation import parts_of  # noqa: E402
from tests.unit.rl.toys import arbitrage, outage  # noqa: E402

TINY = {
    "apg": {"batch": 4, "hidden": (8,)},
    "mappo": {"environments": 4, "batch": 8, "hidden": (8,)},
    "clone": {"environments": 4, "rounds": 3, "fits": 3, "batch": 8, "hidden": (8,)},
    "ddpg": {"hidden": (8,), "environments": 4, "batch": 8, "warm_up": 16, "update_every": 8},
    "paper": {"variant": "paper", "episodes": 12, "environments": 4, "warm_up": 16, "batch": 8},
}
TINY["maddpg"] = TINY["matd3"] = TINY["ddpg"] | {"head_start": 0}
TINY["ddpg"] = TINY["ddpg"] | {"head_start": 0, "replay": 2, "n_step": 2}


def fresh(name: str, seed: int = 3) -> tuple[BatchEnv, Learner]:
    """A tiny learner on the toy with an outage."""
    entry = algorithm("maddpg" if name == "paper" else name)
    settings = entry.settings_of(TINY[name])
    band, observed = entry.ground(settings)
    env = arbitrage(band, observed)
    return env, entry.make(env, settings, seed)


def bits(learner: Learner) -> list[bytes]:
    return [value.numpy().tobytes() for value in learner.state().values()]


def run(learner: Learner, first: int, last: int) -> None:
    for k in range(first, last):
        learner.iterate(Progress(k, 6))


def test_every_algorithm_is_tested() -> None:
    assert set(TINY) == {*ALGORITHMS, "paper"}


@pytest.mark.parametrize("name", TINY)
def test_same_seed_same_bits_and_another_seed_others(name: str) -> None:
    ends = []
    for seed in (3, 3, 4):
        learner = fresh(name, seed)[1]
        run(learner, 0, 3)
        ends.append(bits(learner))
    assert ends[0] == ends[1]
    assert ends[0] != ends[2]


@pytest.mark.parametrize("name", TINY)
def test_a_learner_from_its_state_goes_on_as_if_nothing_had_happened(name: str) -> None:
    whole = fresh(name)[1]
    run(whole, 0, 3)
    # As a file gives it: copies, in no particular memory.
    kept = {key: value.detach().clone() for key, value in whole.state().items()}
    run(whole, 3, 6)
    resumed = fresh(name, seed=3)[1]
    resumed.load_state(kept)
    run(resumed, 3, 6)
    assert bits(resumed) == bits(whole)


@pytest.mark.parametrize("name", TINY)
def test_what_acts_takes_one_and_many(name: str) -> None:
    env, learner = fresh(name)
    actor = network(learner.network(), env.size, env.units)
    actor.load_state_dict(learner.weights())
    observed = torch.as_tensor(np.random.default_rng(1).normal(size=(6, env.size)), dtype=env.dtype)
    together = actor(observed)
    assert together.shape == (6, env.units)
    assert (together.abs() <= 1.0).all()
    for k in range(6):
        torch.testing.assert_close(actor(observed[[k]]), together[[k]])


def test_sizes_of_the_paper() -> None:
    setting = EpisodeSampler(rs.load_case("ieee33"), storms=2).setting
    eyes = observer("paper", setting)
    assert eyes.size == 5 + 5 + 8 * 26
    generator = torch.Generator().manual_seed(0)
    actors, critics = GruActors(eyes.size, 5, generator), PaperCritics(5, generator)
    per_agent = [sum(p.numel() for p in net.parameters()) / 5 for net in (actors, critics)]
    assert per_agent == [19_761, 6_593]
    assert actors.encoder.embedding.weight.shape == (5, 26, 32)
    assert actors.encoder.last.weight.shape == (5, 32, 16)
    assert actors.body[0].weight.shape == (5, 18, 64)
    assert critics.first.weight.shape == (5, 26, 64)


@pytest.mark.parametrize("environments", [1, 8, 20, 24, 25])
def test_the_paper_updates_1267_times(environments: int) -> None:
    """One update on every multiple of 24 of the global step beyond the 8,000th, in 38,400 steps."""
    steps = [*range(0, 38_400, environments), 38_400]
    due = [updates_due(a, b, 24, 8_000) for a, b in pairwise(steps)]
    assert sum(due) == 1_267
    if environments == 1:
        falls_on = [b for b, n in zip(steps[1:], due, strict=True) if n]
        assert falls_on == list(range(8_016, 38_401, 24))


@pytest.mark.parametrize("agent", [1, 2])
def test_a_stacked_gru_is_torch_s(agent: int) -> None:
    """Two layers of `nn.GRU` with the same weights, for one agent among three."""
    generator = torch.Generator().manual_seed(2)
    actors = GruActors(2 * 3 + 8 * 7, 3, generator).double()
    for parameter in actors.parameters():
        parameter.data.uniform_(-0.5, 0.5, generator=generator)
    encoder = actors.encoder
    gru = torch.nn.GRU(32, 32, num_layers=2).double()
    with torch.no_grad():
        for k, layer in enumerate((encoder.first, encoder.second)):
            for side, part in (("ih", layer.of_input), ("hh", layer.of_hidden)):
                getattr(gru, f"weight_{side}_l{k}").copy_(part.weight[agent].T)
                getattr(gru, f"bias_{side}_l{k}").copy_(part.bias[agent, 0])
        observed = torch.randn(4, 2 * 3 + 8 * 7, generator=generator, dtype=torch.float64)
        window = observed[:, 6:].unflatten(1, (8, 7)).transpose(0, 1)
        embedded = torch.relu(
            window @ encoder.embedding.weight[agent] + encoder.embedding.bias[agent]
        )
        last = gru(embedded)[0][-1]
        expected = torch.relu(last @ encoder.last.weight[agent] + encoder.last.bias[agent])
        torch.testing.assert_close(actors.features(observed)[agent], expected)


def test_agents_see_no_storage_but_their_own() -> None:
    actors = AgentActors(9, 3, (8,), torch.Generator().manual_seed(1))
    observed = torch.zeros(1, 9)
    moved = observed.clone()
    moved[0, 1] = 0.7
    changed = (actors(observed) != actors(moved))[0].tolist()
    assert changed == [False, True, False]


def test_the_target_of_a_last_slot_is_its_reward() -> None:
    env, learner = fresh("ddpg")
    assert isinstance(learner, ActorCritic)
    run(learner, 0, 2)
    slots = 4
    last = np.arange(4) + (slots - 1) * 4
    sample = learner.replay.transitions(last, 2, learner.settings.discount)
    wanted = learner.target_value(sample, np.random.default_rng(0))
    assert torch.equal(wanted, learner.replay.state()["reward"][:, last])
    assert env.units == 1


def test_the_paper_s_target_of_a_last_slot_is_its_reward() -> None:
    _, learner = fresh("paper")
    assert isinstance(learner, PaperMaddpg)
    run(learner, 0, 1)
    last = np.arange(4) + 3 * 4
    wanted = learner.target_value(learner.replay.transitions(last, 1, 0.99))
    assert torch.equal(wanted, learner.replay.state()["reward"][:, last])


def test_unknown_settings_are_refused() -> None:
    with pytest.raises(UsageError, match="variant 'fast' of maddpg is unknown"):
        algorithm("maddpg").settings_of({"variant": "fast"})
    settings = algorithm("maddpg").settings_of({"variant": "paper", "environments": 7})
    env = arbitrage("affine", "paper")
    with pytest.raises(UsageError, match="400 episodes in 7 environments"):
        algorithm("maddpg").make(env, settings, 0)


@pytest.mark.parametrize("fallback", ["idle", "rule"])
def test_failed_units_fall_back_and_the_others_do_not(fallback: str) -> None:
    setting = EpisodeSampler(rs.load_case("ieee33-tou"), storms=5)
    episodes = setting.draw(4, 6)
    failed = [1, 2, 4]
    units = episodes.setting.simulator.units
    made = with_failed("greedy", [units[k] for k in failed], fallback)
    names = {"idle": "idle", "rule": "rule-0.9"}
    low, high = episodes.setting.simulator.low, episodes.setting.simulator.high
    energy = low + (high - low) * np.random.default_rng(2).random((5, 4))
    observed = episodes.observation(33, energy)
    power = parts_of(made(episodes.setting).act(observed)).power
    whole = parts_of(factory_of("greedy")(episodes.setting).act(observed)).power
    theirs = parts_of(factory_of(names[fallback])(episodes.setting).act(observed)).power
    assert made.batched
    np.testing.assert_array_equal(power[failed], theirs[failed])
    np.testing.assert_array_equal(power[[0, 3]], whole[[0, 3]])


def test_failed_units_that_are_none_are_refused() -> None:
    env = outage(0.3)
    with pytest.raises(UsageError, match="failed agents ess9 have no storage unit"):
        with_failed("greedy", ["ess9"])(env.setting)
    with pytest.raises(UsageError, match="fallback 'hope' is unknown; allowed: idle, rule"):
        with_failed("greedy", ["ess1"], "hope")
