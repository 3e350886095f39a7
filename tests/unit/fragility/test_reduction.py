"""Scenario reduction against brute force."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.cli import main
from resilience.errors import UsageError
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.outages.reduction import (
    fast_forward,
    load_behind_mw,
    outage_distance,
    reduced,
)
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.transport import (
    in_units_of_spread,
    least_transport,
    with_means_in_reach,
)
from resilience.fragility.storm_means import (
    ANY_LINE,
    AT_RISK,
    GRID_LOST,
    expected_moments,
    moments,
)
from resilience.testing import small_case


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


def test_all_are_remembered() -> None:
    some = drawn(30, 4)
    few = reduced(some, 5)
    assert few.represents is some
    assert few.chosen([0, 1]).represents is None


def simplex(steps: int, n: int) -> np.ndarray:
    """All weights of n scenarios in steps of 1 / steps."""
    cuts = np.array(list(combinations(range(steps + n - 1), n - 1)))
    ends = np.hstack([np.full((len(cuts), 1), -1), cuts, np.full((len(cuts), 1), steps + n - 1)])
    return (np.diff(ends, axis=1) - 1) / steps


@pytest.mark.parametrize("seed", range(4))
def test_the_least_transport_is_that_of_all_weights_on_a_grid(seed: int) -> None:
    """Three kept of six, one mean that a grid of weights can have: every weight, tried in turn."""
    rng = np.random.default_rng(seed)
    distance, p = rng.uniform(0, 5, (6, 3)), np.full(6, 1 / 6)
    distance[[0, 1, 2], [0, 1, 2]] = 0.0
    values = np.array([[0.0, 1.0, 3.0, 0.0, 1.0, 1.0]])  # of mean 1
    apart = in_units_of_spread(values, p)
    found = least_transport(distance, p, apart[:, :3])
    assert found is not None
    assert found.weight @ values[0, :3] == pytest.approx(1.0, abs=1e-12)
    best = np.inf
    for weight in simplex(60, 3):
        if abs(weight @ values[0, :3] - 1.0) > 1e-12:
            continue
        rows = np.vstack([np.kron(np.eye(6), np.ones(3)), np.kron(np.ones(6), np.eye(3))])
        plan = linprog(distance.ravel(), A_eq=rows, b_eq=np.concatenate([p, weight]))
        best = min(best, plan.fun)
    # The grid is coarse: its best is no lower, and within its step.
    assert found.distance <= best + 1e-9
    assert best - found.distance < 5.0 / 60


@pytest.mark.parametrize("seed", range(4))
def test_multipliers_prove_the_least_transport(seed: int) -> None:
    """Any prices u of the means bound it from below: the mean of min_i (d_ji + u m_i). The best do
    so exactly, found by SciPy's own search over u.
    """
    from scipy.optimize import minimize

    some = drawn(40, seed)
    p = some.probability
    distance = outage_distance(some, np.ones(3)).astype(float)
    values = np.array([some.down.sum((0, 1)), some.down.any((0, 1)), some.down[0].any(0)], float)
    apart = in_units_of_spread(values, p)
    kept = with_means_in_reach(fast_forward(distance, p, 8)[0], apart)
    found = least_transport(distance[:, kept], p, apart[:, kept])
    assert found is not None

    def lower(u: np.ndarray) -> float:
        return -float(p @ (distance[:, kept] + u @ apart[:, kept]).min(axis=1))

    starts = [np.zeros(3)]
    for _ in range(4):
        starts.append(
            minimize(lower, starts[-1], method="Nelder-Mead", options={"maxiter": 4000}).x
        )
    assert -lower(starts[0]) <= found.distance + 1e-9
    assert -lower(starts[-1]) == pytest.approx(found.distance, rel=2e-3)
    assert -lower(starts[-1]) <= found.distance + 1e-9
    assert found.weight @ apart[:, kept].T == pytest.approx(np.zeros(3), abs=1e-12)


def test_means_out_of_reach_take_more_scenarios_and_no_more_than_they_need() -> None:
    """One scenario cannot have three means; Caratheodory: four of all always can."""
    some = drawn(50, 5)
    p = some.probability
    values = np.array([some.down.sum((0, 1)), some.down.any((0, 1)), some.down[1].sum(0)], float)
    apart = in_units_of_spread(values, p)
    first = np.array([int(np.argmax(values[0]))])
    assert least_transport(np.ones((50, 1)), p, apart[:, first]) is None
    kept = with_means_in_reach(first, apart)
    assert kept[0] == first[0]
    assert 2 <= len(kept) <= 5
    assert len(set(kept.tolist())) == len(kept)


def test_a_mean_that_never_varies_is_no_condition() -> None:
    p = np.full(4, 0.25)
    apart = in_units_of_spread(np.array([[2.0, 2.0, 2.0, 2.0], [1.0, 2.0, 3.0, 4.0]]), p)
    assert (apart[0] == 0.0).all()
    assert apart[1] @ p == pytest.approx(0.0)
    assert apart[1] ** 2 @ p == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["ieee33_rammasun", "ieee33_koinu"])
@pytest.mark.parametrize("k", [4, 20])
def test_means_of_the_storm_cases_hold(name: str, k: int) -> None:
    """Load at risk, any line, the grid, and the hours of each critical load, to 1e-9; nearest
    weights miss some of them by a fifth.
    """
    case = rs.load_case(name)
    storms = sample_case(case, 150, 2)
    load, of_all = load_behind_mw(case, storms.lines), moments(case, storms)
    wanted = expected_moments(of_all, storms.probability)
    few = reduced(storms, k, load_mw=load, means=of_all)
    held = expected_moments(moments(case, few), few.probability)
    assert held == pytest.approx(wanted, abs=1e-9, rel=1e-9)
    assert (few.probability > 0).all()
    assert few.n <= k + len(wanted) + 1
    nearest = reduced(storms, k, load_mw=load)
    off = expected_moments(moments(case, nearest), nearest.probability)
    assert off[AT_RISK] < 0.9 * wanted[AT_RISK]


def test_moments_by_hand() -> None:
    """Grid at 1, loads of 2 MW at 2 and 1 MW, critical, at 3; half-hour slots.

    Storm 0: line 1-2 down for two slots: both loads off the grid, 3 MW behind it for an hour.
    Storm 1: line 2-3 down for one slot: the critical load off, 1 MW for half an hour; load 2 stays.
    Storm 2: nothing.
    """
    case = small_case(
        slots=4,
        step_min=30.0,
        buses=3,
        lines=[(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}, {"name": "2-3", "breakpoint": True}],
        grid=[{"bus": "1", "import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        load=[
            {"name": "town", "bus": "2", "p_max_mw": 2.0, "shed_cost_per_mwh": 50.0},
            {
                "name": "clinic", "bus": "3", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0,
                "critical": True,
            },
        ],
    )  # fmt: skip
    down = np.zeros((2, 4, 3), bool)
    down[0, 1:3, 0] = True
    down[1, 0:1, 1] = True
    found = moments(case, Scenarios(("1-2", "2-3"), down, np.array([0.5, 0.3, 0.2])))
    by_hand = {
        AT_RISK: [3.0, 0.5, 0.0],
        ANY_LINE: [1.0, 1.0, 0.0],
        GRID_LOST: [1.0, 0.0, 0.0],
        "clinic off the grid, h": [1.0, 0.5, 0.0],
    }
    assert {name: values.tolist() for name, values in found.items()} == by_hand


def test_what_few_stand_for_is_kept_in_the_file(tmp_path: Path) -> None:
    case = rs.load_case("ieee33")
    storms = sample_case(case, 40, 3)
    few = reduced(storms, 6, means=moments(case, storms))
    few.save(tmp_path / "few.npz")
    again = load_scenarios(tmp_path / "few.npz", case)
    assert again.represents is not None
    np.testing.assert_array_equal(again.down, few.down)
    np.testing.assert_array_equal(again.represents.down, storms.down)
    np.testing.assert_array_equal(again.represents.probability, storms.probability)
    assert (again.represents.process, again.process) == (storms.process, few.process)
    assert again.represents.centre is not None
    again.represents.save(tmp_path / "all.npz")
    assert load_scenarios(tmp_path / "all.npz", case).represents is None


def test_the_command_prints_means_before_and_after(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["scenarios", "ieee33_rammasun", "-n", "60", "--reduce", "8", "--json"]
    with pytest.raises(SystemExit):
        main(words)
    means = json.loads(capsys.readouterr().out)["means"]
    assert means["kept"] == pytest.approx(means["all"], rel=1e-9)
    assert len(means["all"]) == 7
    with pytest.raises(SystemExit):
        main(words[:-1])
    printed = capsys.readouterr().out
    assert "all 60" in printed
    for name in means["all"]:
        assert name in printed
