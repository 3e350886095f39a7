"""The farmer of Birge and Louveaux (Introduction to Stochastic Programming, section 1.1)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import linprog

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.risk import Risk
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import DecompositionOptions, TwoStageSolution, lshaped
from resilience.planning.two_stage.two_stage import TwoStage

Solve = Callable[[TwoStage, DecompositionOptions], TwoStageSolution]
CROPS = ("wheat", "corn", "beets")
LAND = 500.0
PLANT = np.array([150.0, 230.0, 260.0])
YIELD = np.array([2.5, 3.0, 20.0])
NEED = np.array([200.0, 240.0])
BUY = np.array([238.0, 210.0])
SELL = np.array([170.0, 150.0, 36.0, 10.0])
QUOTA = 6000.0
WEATHER = (0.8, 1.0, 1.2)
PUBLISHED = -108390.0


def spring() -> Stage:
    stage = Stage(1.0)
    now, after = stage.state("acres", CROPS, 0.0, LAND, unit="acre")
    stage.eq("fresh", now)
    stage.le("land", after.sum(), LAND)
    stage.cost("planting", after, PLANT)
    return stage


def autumn(weather: float) -> Stage:
    """Yields multiply acreage, so every scenario is a stage of its own."""
    stage = Stage(1.0)
    now, after = stage.state("acres", CROPS, 0.0, LAND, unit="acre")
    stage.eq("kept", after, now)
    harvest = now * (weather * YIELD)
    buy = stage.var("buy", CROPS[:2], 0.0, 1e4, unit="t")
    sell = stage.var("sell", (*CROPS, "surplus beets"), 0.0, [1e4, 1e4, QUOTA, 1e5], unit="t")
    stage.le("need", NEED - harvest[:2] - buy + sell[:2])
    stage.le("beets", sell[2:].sum(), harvest[2:])
    stage.cost("buying", buy, BUY)
    stage.cost("selling", sell, -SELL)
    return stage


def farm(risk: Risk | None = None, chances: tuple[float, ...] = (1 / 3, 1 / 3, 1 / 3)) -> TwoStage:
    tree = Tree(
        np.array([-1, 0, 0, 0]),
        np.array([1.0, *chances]),
        np.arange(4),
        ("spring", "dry", "fair", "wet"),
    )
    stages = [spring(), *map(autumn, WEATHER)]
    return TwoStage(stages, tree, 1, {}, {"acres": np.zeros(3)}, (), risk or Risk())


def acres(two: TwoStage, trunk: np.ndarray) -> np.ndarray:
    return trunk[two.first.columns("acres")[:, 0]]


@pytest.mark.parametrize("solve", [lshaped, extensive])
def test_the_published_optimum(solve: Solve) -> None:
    two = farm()
    found = solve(two, DecompositionOptions(gap=1e-9))
    assert found.objective == pytest.approx(PUBLISHED, abs=0.5)
    assert found.bound == pytest.approx(PUBLISHED, abs=0.5)
    assert found.bound <= found.objective
    assert acres(two, found.trunk) == pytest.approx([170.0, 80.0, 250.0], abs=1e-6)


@pytest.mark.parametrize("solve", [lshaped, extensive])
def test_risk_moves_the_published_expected_cost(solve: Solve) -> None:
    """mpi-sppy's plan with 1 on the mean and 5 on CVaR 0.95, which is the worst of three years."""
    two = farm(Risk(0.95, 5 / 6))
    found = solve(two, DecompositionOptions(gap=1e-9))
    assert found.probability @ found.cost == pytest.approx(-103313.0, abs=1.0)


@pytest.mark.parametrize("solve", [lshaped, extensive])
@pytest.mark.parametrize(
    ("risk", "chances"),
    [
        (Risk(0.5, 0.4), (0.5, 0.3, 0.2)),
        (Risk(0.8, 1.0), (0.1, 0.6, 0.3)),
        (Risk(0.0, 0.7), (0.2, 0.2, 0.6)),
    ],
)
def test_weighted_years_and_risk_agree_with_a_hand_written_program(
    solve: Solve, risk: Risk, chances: tuple[float, ...]
) -> None:
    found = solve(farm(risk, chances), DecompositionOptions(gap=1e-9))
    expected = by_hand(risk, np.array(chances))
    assert found.objective == pytest.approx(expected, rel=1e-8)
    assert found.bound == pytest.approx(expected, rel=1e-8)


def by_hand(risk: Risk, p: np.ndarray) -> float:
    """The same problem written out for scipy: acres | per year bought, sold, excess | eta."""
    n = 3 + 3 * 7 + 1
    cost, rows, right = np.zeros(n), [], []
    cost[:3], cost[-1] = (1 - risk.weight) * PLANT, risk.weight
    rows.append(np.append(np.ones(3), np.zeros(n - 3)))
    right.append(LAND)
    bounds: list[tuple[float | None, float | None]] = [(0.0, None)] * 3
    for year, weather in enumerate(WEATHER):
        at = 3 + 7 * year
        money = np.concatenate([BUY, -SELL])
        cost[at : at + 6] = (1 - risk.weight) * p[year] * money
        cost[at + 6] = risk.weight * p[year] / (1 - risk.alpha)
        for crop in range(2):
            row = np.zeros(n)
            row[[crop, at + crop, at + 2 + crop]] = -weather * YIELD[crop], -1.0, 1.0
            rows.append(row)
            right.append(-NEED[crop])
        beets = np.zeros(n)
        beets[[2, at + 4, at + 5]] = -weather * YIELD[2], 1.0, 1.0
        excess = np.zeros(n)
        excess[:3], excess[at : at + 6], excess[at + 6], excess[-1] = PLANT, money, -1.0, -1.0
        rows += [beets, excess]
        right += [0.0, 0.0]
        bounds += [(0.0, None)] * 4 + [(0.0, QUOTA), (0.0, None), (0.0, None)]
    bounds.append((None, None))
    found = linprog(cost, np.array(rows), right, bounds=bounds)
    assert found.status == 0
    return float(found.fun)
