"""Stochastic dual dynamic programming against written-out trees, and the farmer's problem."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.dispatch.sddp.model import Cuts, Multistage, NoiseOutcomes
from resilience.dispatch.sddp.training import Begin, Engine, Settings, Trained, train
from resilience.testing.policies import simulated_costs
from tests.known.markov_tree import Written, microgrid, multistage, policy_cost
from tests.known.test_farmer import PUBLISHED, WEATHER, autumn, spring

LOW, HIGH = np.array([0.2, 0.0]), np.array([2.0, 1.0])
STARTS = [(LOW + k * (HIGH - LOW), np.array([sun])) for k in (0.23, 0.81) for sun in (0.1, 1.0)]


@pytest.fixture(scope="module")
def written() -> Written:
    return Written.out(microgrid())


@pytest.fixture(scope="module")
def trained() -> tuple[Multistage, Trained]:
    """One set of cuts for all starts and levels."""
    problem = multistage(microgrid())
    settings = Settings(iterations=220, paths=4, patience=220, tidy=1000, jump=0.0)

    def start(rng: np.random.Generator, last: Floats | None) -> Begin:
        return STARTS[rng.integers(len(STARTS))]

    return problem, train(problem, start, STARTS, settings)


@pytest.mark.parametrize("k", range(len(STARTS)))
def test_bound_policy_and_tree_agree(
    written: Written, trained: tuple[Multistage, Trained], k: int
) -> None:
    (problem, found), (energy, levels) = trained, STARTS[k]
    optimum = written.solve(energy, levels[0]).objective
    assert found.root.value(energy, levels) == pytest.approx(optimum, abs=1e-4)
    cost = policy_cost(Engine(problem, found.cuts), energy, levels[0])
    assert cost == pytest.approx(optimum, abs=1e-4)


def test_the_slope_is_the_price_of_the_states(
    written: Written, trained: tuple[Multistage, Trained]
) -> None:
    for energy, levels in STARTS:
        price = written.solve(energy, levels[0]).state_price
        assert price is not None
        np.testing.assert_allclose(trained[1].root.slope(energy, levels), price, atol=1e-3)


def anywhere(rng: np.random.Generator) -> Begin:
    return rng.uniform(LOW, HIGH), rng.uniform(0.0, 1.0, 1)


def test_every_cut_is_a_bound_everywhere(
    written: Written, trained: tuple[Multistage, Trained]
) -> None:
    root, rng = trained[1].root, np.random.default_rng(3)
    for _ in range(12):
        energy, levels = anywhere(rng)
        optimum = written.solve(energy, float(levels[0])).objective
        assert (root.constants(levels) + root.beta @ energy).max() <= optimum + 1e-7


def test_the_end_is_worth_the_same_in_every_mode(trained: tuple[Multistage, Trained]) -> None:
    problem, _ = trained
    last = Engine(problem).slots[-1].cuts
    assert len(last) == len(problem.outcomes[-1]) > 1
    state, levels = np.array([0.7, 0.3])[: problem.terminal.beta.shape[1]], np.array([0.6])
    worth = [cuts.value(state, levels) for cuts in last]
    assert worth == [problem.terminal.value(state, levels)] * len(last)


def test_simulated_costs_lie_around_the_bound(trained: tuple[Multistage, Trained]) -> None:
    problem, found = trained
    begin = STARTS[1]
    costs = simulated_costs(problem, found, begin, 300, np.random.default_rng(0))
    error = costs.std() / np.sqrt(len(costs))
    assert abs(costs.mean() - found.root.value(*begin)) < 4.0 * error


def test_bounds_rise_and_repeat_themselves() -> None:
    problem, start = multistage(microgrid()), (LOW, np.array([0.5]))
    settings = Settings(iterations=8, seed=5, tidy=3)
    first, again = (
        train(problem, lambda rng, last: anywhere(rng), [start], settings) for _ in range(2)
    )
    assert (np.diff(first.bounds) >= -1e-9).all()
    np.testing.assert_array_equal(first.bounds, again.bounds)
    for one, other in zip(first.cuts, again.cuts, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a.beta, b.beta)


def farmer() -> Multistage:
    stages = [spring(), *map(autumn, WEATHER)]
    slots = [
        [NoiseOutcomes(0, np.ones(1), {})],
        [NoiseOutcomes(k, np.ones(1), {}) for k in (1, 2, 3)],
    ]
    chances = [np.ones((1, 1)), np.full((1, 3), 1.0 / 3.0)]
    return Multistage(stages, slots, chances, Cuts.of_prices(np.zeros(3)))


def test_the_farmer_earns_108390() -> None:
    problem, nothing = farmer(), (np.zeros(3), np.empty(0))
    found = train(problem, lambda rng, last: nothing, [nothing], Settings(tolerance=1e-9))
    assert found.bound == pytest.approx(PUBLISHED, abs=1e-3)
    engine = Engine(problem, found.cuts)
    acres, spent = engine.slots[0].blocks.step(np.array([0]), np.zeros((1, 3)), np.empty((1, 0)))
    np.testing.assert_allclose(acres[0], [170.0, 80.0, 250.0], atol=1e-6)
    earned = [
        engine.slots[1].blocks.step(np.array([k]), acres, np.empty((1, 0)))[1][0] for k in range(3)
    ]
    assert spent[0] + np.mean(earned) == pytest.approx(PUBLISHED, abs=1e-3)
