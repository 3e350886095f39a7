"""Risk as a number, and as the objective of a program whose prices change in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resilience.errors import UsageError
from resilience.models.backends.risk_averse import RiskAverse
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.risk import Risk, node_prices
from resilience.models.program.risk_measures import conditional_value_at_risk
from resilience.models.program.unroll import unroll


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.75, 0.95])
def test_it_is_the_mean_and_the_tail(alpha: float) -> None:
    rng = np.random.default_rng(3)
    cost, p = rng.normal(size=40), rng.random(40)
    p /= p.sum()
    tail = conditional_value_at_risk(cost, alpha, p)
    assert Risk(alpha, 0.3).value(cost, p) == pytest.approx(0.7 * (p @ cost) + 0.3 * tail)
    assert Risk(alpha, 0.0).value(cost, p) == pytest.approx(p @ cost)


def test_words_for_it() -> None:
    assert Risk.parse("cvar:0.9:0.25") == Risk(0.9, 0.25)
    assert Risk.parse("mean") == Risk()
    wrong_words = ("cvar", "cvar:0.9", "cvar:a:b", "var:0.9:0.1", "cvar:1:0.5", "cvar:0.5:2")
    for wrong in (*wrong_words, "cvar:0.9:0.0_5", "cvar:0.9:0.5:0.5"):
        with pytest.raises(UsageError, match="hint"):
            Risk.parse(wrong)


def fan() -> tuple[Stage, Tree]:
    """Order now, at a price; after it what is missing is bought, at another."""
    stage = Stage(1.0)
    now, after = stage.state("stock", ["a"], 0.0, 4.0, unit="1")
    price, need = stage.data("price", ["a"]), stage.data("need", ["a"])
    buy = stage.var("buy", ["a"], 0.0, 9.0)
    stage.eq("stock", after, now + buy - need)
    stage.cost("buying", buy, price)
    tree = Tree(
        np.array([-1, 0, 0]), np.array([1.0, 0.25, 0.75]), np.zeros(3, int), ("now", "dear", "fair")
    )
    return stage, tree


def test_new_prices_need_no_new_model() -> None:
    """Need 1 later: bought now for 2, it costs 2 in both scenarios; bought later, 6 or 1."""
    stage, tree = fan()
    problem = unroll([stage], tree)
    solver = RiskAverse(problem, Risk(0.5, 0.5))
    need = np.array([[0.0, 1.0, 1.0]])
    # Later: mean 2.25, CVaR 0.5 is (6 + 1) / 2 = 3.5. At 9 and 0.5: 2.625 and 4.75. At 2 and 1:
    # 1.25 and 1.5, less than buying now.
    for prices, expected in (([2, 6, 1], 2.0), ([3, 9, 0.5], 3.0), ([2, 2, 1], 1.375)):
        data = {"price": np.array([prices], float), "need": need}
        solver.price(data)
        solver.update(problem.vectors(data, {"stock": np.zeros(1)}))
        found = solver.solve()
        assert found.objective == pytest.approx(expected)
        assert solver.certified_bound(found) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("prices", "optimum", "stocks"),
    [([2, 6, 1], 2.0, (3.0, 2.0, 1.0)), ([2, 2, 1], 1.375, (1.605, 1.21, 0.395))],
)
@pytest.mark.parametrize(
    "weights", [(7.0, 8.0), (-7.0, -8.0), (0.2, 8.0), (0.1, 0.2), (0.25, 0.01), (0.48, 0.02)]
)
def test_a_bound_holds_whatever_the_multipliers(
    prices: list[float],
    optimum: float,
    stocks: tuple[float, ...],
    weights: tuple[float, float],
) -> None:
    """Weights that the risk allows are at most 0.25 and 0.75 and add up to 0.5, each for itself.

    Whatever the solver says they are, no bound lies above the optimum. With 0.25 and 0.75 a MWh
    now would cost 2 (0.5 + 1) = 3, and later no less: 6 (0.125 + 0.25) and 0.375 + 0.75. With 0.48
    and 0.02 it would cost 2 (0.125 + 0.48) + 0.375 + 0.02 = 1.605 later, where 1.375 is right.
    """
    stage, tree = fan()
    problem = unroll([stage], tree)
    solver = RiskAverse(problem, Risk(0.5, 0.5))
    data = {"price": np.array([prices], float), "need": np.array([[0.0, 1.0, 1.0]])}
    solver.price(data)
    solver.update(problem.vectors(data, {"stock": np.zeros(1)}))
    found = solver.solve()
    assert found.duals is not None
    for rows in (found.duals.rows[:3], stocks):
        duals = replace(found.duals, rows=np.append(rows, weights))
        bound = solver.certified_bound(replace(found, duals=duals))
        assert -50.0 < bound <= optimum + 1e-9


def test_without_multipliers_the_bound_of_a_risk_is_the_solvers_own() -> None:
    stage, tree = fan()
    problem = unroll([stage], tree)
    solver = RiskAverse(problem, Risk(0.5, 0.5), duals=False)
    data = {"price": np.array([[2.0, 6.0, 1.0]]), "need": np.array([[0.0, 1.0, 1.0]])}
    solver.price(data)
    solver.update(problem.vectors(data, {"stock": np.zeros(1)}))
    assert solver.certified_bound(replace(solver.solve(), bound=1.25)) == 1.25


def test_weights_that_are_too_small_rise_no_further_than_each_may() -> None:
    """Bought later: 2 (0.125 + 0.25) and 0.375 + 0.25 are 1.375. Of 0.24 and 0.02 the first has
    room for 0.01 only; with 0.3 and 0.2 it would be 0.85 + 0.575.
    """
    stage, tree = fan()
    problem = unroll([stage], tree)
    solver = RiskAverse(problem, Risk(0.5, 0.5))
    data = {"price": np.array([[2.0, 2.0, 1.0]]), "need": np.array([[0.0, 1.0, 1.0]])}
    solver.price(data)
    solver.update(problem.vectors(data, {"stock": np.zeros(1)}))
    found = solver.solve()
    assert found.duals is not None
    assert np.abs(found.duals.rows[1:3]) == pytest.approx([0.75, 0.625])
    way = np.sign(found.duals.rows[1])
    for stocks in ((1.425, 0.85, 0.575), (1.36, 0.73, 0.63)):
        rows = np.append(way * np.array(stocks), (0.24, 0.02))
        bound = solver.certified_bound(replace(found, duals=replace(found.duals, rows=rows)))
        assert -50.0 < bound <= 1.375 + 1e-9
    assert bound > 1.35


def test_prices_of_nodes_add_up_to_the_cost_vector() -> None:
    stage, tree = fan()
    problem = unroll([stage], tree)
    data = {"price": np.array([[2.0, 6.0, 1.0]]), "need": np.ones((1, 3))}
    prices, offset = node_prices(problem, data)
    vectors = problem.vectors(data, {"stock": np.zeros(1)})
    assert tree.probability @ prices == pytest.approx(vectors.cost)
    assert tree.probability @ offset == pytest.approx(vectors.offset)
