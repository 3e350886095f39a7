"""The training ground as Gymnasium and PettingZoo expect it, by their own checks."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

import resilience as rs
from resilience.case import load_case
from resilience.inputs import case_folder
from tests.unit.rl.small import few_storms, small_storm_case

gym = pytest.importorskip("gymnasium", reason="gymnasium is not installed here: resilience[gym]")
pytest.importorskip("pettingzoo", reason="pettingzoo is not installed here: resilience[gym]")

from resilience.rl.adapters.checks import check_environments  # noqa: E402
from resilience.rl.adapters.make import make_env, make_parallel, make_vec  # noqa: E402
from resilience.rl.adapters.play import Play  # noqa: E402

SHIPPED = sorted(path.stem for path in case_folder().glob("*.toml"))
OPTIONAL = {"stable_baselines3"}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    few_storms(monkeypatch)


@pytest.fixture(scope="module")
def case() -> rs.Case:
    return small_storm_case()


def assert_passed(case: rs.Case, cycles: int) -> None:
    for check in check_environments(case, cycles):
        package = check.name.partition(":")[0]
        missing = package in OPTIONAL and find_spec(package) is None
        assert check.verdict == ("skipped" if missing else "passed"), check


def test_the_official_checks_pass(case: rs.Case) -> None:
    assert_passed(case, cycles=30)


def test_the_official_checks_pass_on_a_shipped_case() -> None:
    assert_passed(load_case("ieee33-tou"), cycles=5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SHIPPED)
def test_the_official_checks_pass_on_every_shipped_case_that_can_be_played(name: str) -> None:
    case = load_case(name)
    if not case.network.breakpoint.any() and case.storm is None:
        with pytest.raises(rs.UsageError, match="has no breakpoint"):
            make_env(case)
        return
    try:
        Play(case)
    except rs.UsageError as error:
        pytest.skip(f"no simulator holds it: {error.message}")
    assert_passed(case, cycles=200)


def test_a_check_that_fails_says_why(case: rs.Case, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = Play.reset
    counter = iter(range(10**6))

    def restless(self: Play, rng: np.random.Generator) -> np.ndarray:
        return honest(self, np.random.default_rng(next(counter)))

    monkeypatch.setattr(Play, "reset", restless)
    verdicts = {check.name: check for check in check_environments(case, 5)}
    assert verdicts["gymnasium: check_env"].verdict == "failed"
    assert "AssertionError" in verdicts["gymnasium: check_env"].reason
    assert verdicts["pettingzoo: parallel_seed_test"].verdict == "failed"


def test_rewards_add_up_to_what_the_day_costs_less_what_is_left(case: rs.Case) -> None:
    env = make_vec(case, 3)
    env.reset(seed=11)
    play = env.play
    rewards, costs = np.zeros(3), np.zeros(3)
    rng = np.random.default_rng(12)
    for t in range(play.slots):
        before = play.energy
        _, reward, _, truncated, info = env.step(rng.uniform(-1, 1, (3, 2)).astype(np.float32))
        facts = info["final_info"] if t == play.slots - 1 else info
        rewards, costs = rewards + reward, costs + facts["cost_usd"]
        terms = [v for k, v in facts.items() if k.startswith("cost_") and k != "cost_usd"]
        np.testing.assert_allclose(sum(terms), facts["cost_usd"], atol=1e-9)
        assert facts["done_mw"].shape == facts["asked_mw"].shape == (3, 2)
        if t < play.slots - 1:
            change = play.energy - before
            charged, given = np.maximum(facts["done_mw"].T, 0), np.maximum(-facts["done_mw"].T, 0)
            expected = play.simulator.gain * charged - play.simulator.drain * given
            np.testing.assert_allclose(change, expected, atol=1e-9)
        else:
            assert truncated.all()
            left = facts["credit_usd"] / case.terminal_value_per_mwh
    np.testing.assert_allclose(rewards, left * case.terminal_value_per_mwh - costs, atol=1e-9)
    assert (left > 0).all()


def test_the_rule_itself_earns_nothing_over_the_rule(case: rs.Case) -> None:
    """With anchors, 0 is the rule's action."""
    env = make_vec(case, 5, baseline="rule")
    env.reset(seed=13)
    total = np.zeros(5)
    for _ in range(env.play.slots):
        total += abs(env.step(np.zeros((5, 2), np.float32))[1])
    np.testing.assert_allclose(total, 0.0, atol=1e-9)


def test_a_seed_is_a_seed_and_nothing_else_is(case: rs.Case) -> None:
    np.random.seed(1)  # noqa: NPY002 the global generator has no part in it
    first, second = make_env(case), make_env(case)
    observed = first.reset(seed=21)[0]
    np.random.seed(2)  # noqa: NPY002
    np.testing.assert_array_equal(observed, second.reset(seed=21)[0])
    np.testing.assert_array_equal(first.reset()[0], second.reset()[0])
    free = make_env(case, random_start=True)
    assert (free.reset(seed=22)[0] != free.reset(seed=21)[0]).any()
    many = make_vec(case, 2, random_start=True)
    lists = [many.reset(seed=[3, 4])[0], many.reset(seed=[3, 5])[0], many.reset(seed=[3, 4])[0]]
    np.testing.assert_array_equal(lists[0], lists[2])
    assert (lists[0] != lists[1]).any()


def test_agents_see_the_same_each_with_its_own_mark(case: rs.Case) -> None:
    env = make_parallel(case)
    observed, _ = env.reset(seed=31)
    assert env.agents == ["ess1", "ess2"]
    np.testing.assert_array_equal(observed["ess1"][:-2], env.state())
    np.testing.assert_array_equal(observed["ess1"][-2:], [1, 0])
    np.testing.assert_array_equal(observed["ess2"][-2:], [0, 1])
    _, reward, _, _, info = env.step({"ess1": np.array([0.5]), "ess2": np.array([-0.25])})
    assert reward["ess1"] == reward["ess2"]
    assert info["ess1"]["asked_mw"] != info["ess2"]["asked_mw"]


def test_what_is_seen_is_what_a_policy_sees(case: rs.Case) -> None:
    """The numbers of an episode are those of the torch environment, to the bit."""
    pytest.importorskip("torch", reason="torch is not installed here")
    from resilience.rl.ground.env import BatchEnv

    play = Play(case, 4)
    observed = play.reset(np.random.default_rng(41))
    env = BatchEnv(play.sampler)
    tape = env.tape(play.episodes)
    energy = env.start(4)
    for t in range(play.slots - 1):
        np.testing.assert_array_equal(observed[:, 2:], tape.observed[t].numpy())
        action = np.full((4, 2), 0.3 - 0.05 * t)
        step = env.step(tape, t, energy, env.tensor(action))
        observed, _, _, info = play.step(action)
        np.testing.assert_allclose(info["cost_usd"], step.cost.numpy(), atol=1e-5)
        energy = step.energy
        np.testing.assert_allclose(play.energy, energy.numpy(), atol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band_name": "wide"}, "band 'wide' is unknown"),
        ({"baseline": "best"}, "baseline 'best' is unknown"),
        ({"days": 9}, "episodes of 9 days"),
    ],
)
def test_what_there_is_not_is_refused(
    case: rs.Case, options: dict[str, object], message: str
) -> None:
    with pytest.raises(rs.UsageError, match=message):
        make_env(case, **options)


def test_a_wrong_action_is_refused(case: rs.Case) -> None:
    env = make_env(case)
    with pytest.raises(rs.UsageError, match="call reset"):
        env.step(np.zeros(2))
    env.reset(seed=1)
    with pytest.raises(rs.UsageError, match="allowed: numbers of"):
        env.step(np.zeros(3))
    with pytest.raises(rs.UsageError, match="not finite"):
        env.step(np.array([0.0, np.nan]))


def test_stable_baselines_trains_on_it(case: rs.Case) -> None:
    pytest.importorskip("torch", reason="torch is not installed here")
    library = pytest.importorskip(
        "stable_baselines3", reason="stable-baselines3 is not installed here"
    )
    env = make_env(case, baseline="rule", random_start=True)
    model = library.PPO("MlpPolicy", env, n_steps=48, batch_size=24, n_epochs=2, seed=5)
    before = [value.detach().clone() for value in model.policy.parameters()]
    model.learn(96)
    moved = [bool((a != b).any()) for a, b in zip(before, model.policy.parameters(), strict=True)]
    assert any(moved)
    action, _ = model.predict(env.reset(seed=6)[0])
    assert action in env.action_space
