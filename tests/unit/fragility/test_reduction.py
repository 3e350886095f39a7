"""Scenario reduction against brute force."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.errors import UsageError
from resilience.fragility.outages.reduction import (
    fast_forward,
    load_behind_mw,
    outage_distance,
    reduced,
)
from resilience.fragility.outages.scenarios import Scenarios


def drawn(n: int, seed: int = 0, lines: int = 3, slots: int = 12) -> Scenarios:
    rng = np.random.default_rng(seed)
    first, last = np.sort(rng.integers(0, slots + 1, (2, lines, n)), axis=0)
    slot = np.arange(slots)[:, None]
    weight = rng.random(n) + 0.1
    down = (slot >= first[:, None]) & (slot < last[:, None])
    names = tuple("abcdef"[:lines])
    return Scenarios(names, down, weight / weight.sum(), seed=seed, process="test")


def loss(distance: np.ndarray, probability: np.ndarray, kept: tuple[int, ...]) -> float:
    return float(distance[:, list(kept)].min(axis=1) @ probability)


def test_distance_is_the_load_weighted_time_of_difference() -> None:
    some = drawn(6)
    load = np.array([1.0, 2.0, 0.5])
    found = outage_distance(some, load)
    for i in range(6):
        for j in range(6):
            differs = (some.down[:, :, i] != some.down[:, :, j]).sum(axis=1)
            assert found[i, j] == pytest.approx(differs @ load)


@pytest.mark.parametrize("seed", range(6))
def test_every_step_is_the_best_one(seed: int) -> None:
    some = drawn(9, seed)
    distance, p = outage_distance(some, np.ones(3)), some.probability
    kept, nearest, lost = fast_forward(distance, p, 4)
    for k in range(1, 5):
        grown = [(*kept[: k - 1], i) for i in range(9)]
        best = min(loss(distance, p, choice) for choice in grown)
        assert loss(distance, p, tuple(kept[:k])) == pytest.approx(best, rel=1e-6)
    assert lost == pytest.approx(loss(distance, p, tuple(kept)))
    assert distance[np.arange(9), kept[nearest]] == pytest.approx(distance[:, kept].min(axis=1))


@pytest.mark.parametrize("seed", range(6))
def test_one_scenario_is_the_optimum_and_more_come_close(seed: int) -> None:
    some = drawn(10, seed)
    distance, p = outage_distance(some, np.ones(3)), some.probability
    for k in (1, 2, 3):
        best = min(loss(distance, p, kept) for kept in combinations(range(10), k))
        lost = fast_forward(distance, p, k)[2]
        assert best - 1e-9 <= lost <= (1.0 + 1e-9 if k == 1 else 1.25) * best


def test_what_is_lost_is_the_transport_distance() -> None:
    some = drawn(8, 3)
    distance, p = outage_distance(some, np.ones(3)), some.probability
    kept, nearest, lost = fast_forward(distance, p, 3)
    weight = np.bincount(nearest, p)
    cost = distance[:, kept].astype(float)
    rows = np.vstack([np.kron(np.eye(8), np.ones(3)), np.kron(np.ones(8), np.eye(3))])
    plan = linprog(cost.ravel(), A_eq=rows, b_eq=np.concatenate([p, weight]))
    assert plan.status == 0
    assert lost == pytest.approx(plan.fun)


def test_weights_are_kept() -> None:
    some = drawn(200, 1)
    few = reduced(some, 20, load_mw=[1.0, 3.0, 2.0])
    assert few.n == 20
    assert few.probability.sum() == pytest.approx(1.0)
    assert "20 kept of 200" in few.process
    mean = [s.down.sum(axis=1) @ s.probability for s in (some, few)]
    assert mean[1] == pytest.approx(mean[0], rel=0.25)
    index = [np.flatnonzero((some.down == few.down[:, :, [k]]).all(axis=(0, 1))) for k in range(20)]
    assert all(len(found) for found in index)


def test_nothing_is_lost_where_scenarios_repeat() -> None:
    some = drawn(5, 2)
    twice = Scenarios(
        some.lines, np.repeat(some.down, 3, axis=2), np.repeat(some.probability / 3.0, 3)
    )
    few = reduced(twice, 5)
    assert few.n == 5
    assert "distance 0 slots" in few.process
    assert sorted(few.probability) == pytest.approx(sorted(some.probability))
    assert reduced(twice, 50).n == 5


def test_scenarios_without_lines_are_one() -> None:
    none = Scenarios((), np.zeros((0, 4, 3), bool), np.full(3, 1 / 3))
    assert reduced(none, 2).n == 1


def test_no_reduction() -> None:
    with pytest.raises(UsageError, match="0 scenarios"):
        reduced(drawn(5), 0)
    with pytest.raises(UsageError, match=r"loads of shape \(2,\)"):
        reduced(drawn(5), 2, load_mw=[1.0, 2.0])
    with pytest.raises(UsageError, match="0 or more for each of 3 lines"):
        reduced(drawn(5), 2, load_mw=[1.0, 2.0, -1.0])


def test_the_load_behind_a_line_is_what_hangs_on_it() -> None:
    """The laterals of the paper's feeder as its case file sums them up, and a tie that is open."""
    case = rs.load_case("ieee33")
    found = load_behind_mw(case, ["1-2", "2-19", "3-23", "6-26", "17-18", "9-15"])
    assert found == pytest.approx([9.43, 0.97, 2.11, 2.11, 0.32, 0.0])
