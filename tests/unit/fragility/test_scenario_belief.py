"""Belief in scenarios: weights by hand, paths as often as these say, and the bell's own answer."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Bools
from resilience.errors import UsageError
from resilience.evaluation.compare import compare
from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.scenario_belief import SHARPEST, ScenarioBelief, worth
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.fragility.outages.scenarios import Scenarios
from tests.histories import history

SLOTS = 8


def paths_of(*outages: tuple[int, int]) -> Bools:
    """(1, slots, scenarios) one line, down from a slot up to another in each scenario."""
    slot = np.arange(SLOTS)
    return np.array([(slot >= first) & (slot < stop) for first, stop in outages]).T[None]


def belief(down: Bools, probability: list[float] | None = None) -> ScenarioBelief:
    n = down.shape[2]
    weight = np.full(n, 1.0 / n) if probability is None else np.array(probability)
    return ScenarioBelief(Scenarios(("a",), down, weight), ("a",), step_h=0.5)


def seen(first: int, stop: int, t: int) -> LineHistory:
    return history(paths_of((first, stop))[:, :, 0], t)


def test_before_anything_is_seen_scenarios_are_as_likely_as_they_say() -> None:
    found = belief(paths_of((2, 4), (5, 8)), [0.3, 0.7])
    quiet = LineHistory.quiet(1)
    assert found.weights(quiet).tolist() == [0.3, 0.7]
    assert found.chances(quiet, SLOTS)[0].tolist() == [0, 0, 0.3, 0, 0, 0.7, 0, 0]
    assert found.paths(quiet, SLOTS, 10)[0].sum(axis=1).tolist() == [0, 0, 3, 3, 0, 7, 7, 7]


def test_what_disagrees_counts_less_and_what_is_long_past_less_of_that() -> None:
    """Nothing by slot 3: two half-hours of the first scenario differ, of which ages are 1 and 0."""
    found = belief(paths_of((2, 4), (5, 8), (6, 8)))
    hours = 0.5 * (1.0 + 2.0 ** (-0.5 / 6.0))
    weight = found.weights(seen(0, 0, 3))
    tilted = np.exp(-SHARPEST * np.array([hours, 0.0, 0.0]))
    assert worth(tilted / tilted.sum()) > np.sqrt(3.0)
    assert weight == pytest.approx(tilted / tilted.sum(), abs=1e-12)


def test_one_scenario_alone_is_never_believed_of_many() -> None:
    """One of 16 agrees: what it is worth is softened until the weights are worth four."""
    found = belief(paths_of((3, 6), *[(0, k % 4 + 1) for k in range(15)]))
    weight = found.weights(seen(3, 6, 4))
    assert worth(weight) == pytest.approx(4.0, rel=1e-4)
    assert weight.argmax() == 0


def test_what_no_scenario_foresaw_is_still_possible() -> None:
    """Down since slot 4 where the one scenario has outages of 3 slots from slot 0 on."""
    found = belief(paths_of((0, 3)))
    now = seen(4, 8, 5)
    assert found.weights(now).tolist() == [1.0]
    assert found.expected_left(now).tolist() == [1]  # of 3, of which 2 have passed
    assert found.paths(now, 2, 4)[0].T.tolist() == [[True, False]] * 4
    beyond = seen(1, 8, 7)  # longer than any
    assert found.expected_left(beyond).tolist() == [0]
    assert not found.paths(beyond, 4, 4).any()


def test_a_line_that_stands_is_up_until_the_next_outage() -> None:
    down = paths_of((2, 4))
    down[0, 6] = True
    found = belief(down)
    assert (
        found.paths(seen(0, 0, 2), 5, 3)[0].T.tolist() == [[False, False, False, True, False]] * 3
    )


def test_chances_are_the_frequencies_of_paths() -> None:
    case = rs.load_case("ieee33-tou")
    bell = Bell(centres=(40, 64))
    drawn = sample_bell(case, bell, 300, 1)
    found = ScenarioBelief(drawn, drawn.lines, case.step_h)
    now = history(drawn.down[:, :, 7], 50)
    down = found.paths(now, 40, 4000)
    begins = down & ~np.concatenate([np.repeat(now.is_down[:, None, None], 4000, 2),
                                     down[:, :-1]], axis=1)  # fmt: skip
    np.testing.assert_allclose(begins.mean(axis=2), found.chances(now, 40), atol=0.012)


def test_many_scenarios_of_a_bell_say_what_the_bell_says() -> None:
    """Chance of a failure in the rest of the day after a quiet morning, an evening, an outage."""
    case = rs.load_case("ieee33-tou")
    bell = Bell(centres=(24, 40, 56, 72))
    drawn = sample_bell(case, bell, 3000, 5)
    by_scenario = ScenarioBelief(drawn, drawn.lines, case.step_h)
    by_bell = BellBelief(bell, 96, len(drawn.lines))
    none = np.zeros((len(drawn.lines), 96), bool)
    for t in (30, 50, 60):
        now = history(none, t)
        both = [b.paths(now, 90 - t, 2000).any(axis=(0, 1)).mean() for b in (by_scenario, by_bell)]
        assert both[0] == pytest.approx(both[1], abs=0.05)
    struck = none.copy()
    struck[1, 40:] = True
    now = history(struck, 44)
    left = [b.expected_left(now)[1] for b in (by_scenario, by_bell)]
    assert abs(left[0] - left[1]) <= 1


def storms(seed: int, n: int = 6) -> Scenarios:
    """Over one test day, two islands cut off from a random slot on, for hours."""
    rng, lines = np.random.default_rng(seed), ("3-23", "6-26")
    first, length = rng.integers(36, 60, (2, n)), rng.integers(30, 60, (2, n))
    slot = np.arange(96)[:, None]
    down = np.array([(slot >= f) & (slot < f + d) for f, d in zip(first, length, strict=True)])
    return Scenarios(lines, down, np.full(n, 1.0 / n))


def test_who_plans_ahead_is_told_what_to_believe_of_given_storms() -> None:
    with pytest.raises(UsageError, match="not what operators believe"):
        compare("ieee33-tou", ["mpc"], days=1, scenarios=storms(0))
    rules = compare("ieee33-tou", ["rule"], days=1, scenarios=storms(0))
    assert rules.world.believed is None
    with pytest.raises(UsageError, match="sddp learns the case's own process"):
        compare("ieee33-tou", ["sddp"], days=1, scenarios=storms(0, 1), believe="same")


def test_a_belief_changes_what_is_done() -> None:
    """The case's bell knows nothing of outages of 7 to 15 hours from about noon."""
    costs, said = {}, {}
    for name, believe in (("case", "case"), ("other", storms(1, 30)), ("same", "same")):
        found = compare("ieee33-tou", ["mpc"], days=1, scenarios=storms(0, 2), believe=believe)
        costs[name] = float(found.objective["mpc"].mean())
        said[name] = found.summary()["belief"]
        assert f"believed: {said[name]}" in found.setting
    assert len(set(costs.values())) == 3
    assert costs["other"] < costs["case"]
    assert said == {
        "case": "the case's own process", "other": "30 other scenarios",
        "same": "the storms that come, in-sample",
    }  # fmt: skip
