"""The unrolled matrix against Kronecker products: own parts per node, states from the parent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.unroll import unroll
from tests.property.random_cases import quick

STATES, OTHERS, ROWS = 2, 3, 4


def random_stage(rng: np.random.Generator) -> tuple[Stage, np.ndarray, np.ndarray]:
    """A stage with random rows, and their coefficients of states now and of its own columns."""
    stage = Stage(1.0)
    first = stage.var("first", ["a"], 0.0, 1.0)
    now, after = stage.state("state", ["a", "b"], -1.0, 1.0, unit="1")
    rest = stage.var("rest", ["a", "b"], 0.0, 1.0)
    before = rng.integers(-2, 3, (ROWS, STATES)).astype(float)
    own = rng.integers(-2, 3, (ROWS, OTHERS + STATES)).astype(float)
    demand = stage.data("demand", ["a"])
    rows = now.mapped(before) + first.mapped(own[:, :1]) + after.mapped(own[:, 1:3])
    rows = rows + rest.mapped(own[:, 3:])
    stage.eq("equal", rows[:2], demand)
    stage.le("below", rows[2:], 1.0)
    return stage, before, own


@st.composite
def trees(draw: st.DrawFn) -> Tree:
    """Random parents; probabilities shared evenly among children."""
    n = draw(st.integers(1, 6))
    parent = np.array([draw(st.integers(-1, k - 1)) for k in range(n)])
    probability = np.empty(n)
    for k in range(n):
        siblings = (parent == parent[k]).sum()
        probability[k] = (probability[parent[k]] if parent[k] >= 0 else 1.0) / siblings
    stage = np.array([draw(st.integers(0, 1)) for _ in range(n)])
    return Tree(parent, probability, stage, tuple(f"n{k}" for k in range(n)))


@quick
@given(trees(), st.integers(0, 99))
def test_the_matrix_is_a_sum_of_kronecker_products(tree: Tree, seed: int) -> None:
    rng = np.random.default_rng(seed)
    made = [random_stage(rng) for _ in range(2)]
    problem = unroll([stage for stage, _, _ in made], tree)
    carry = np.zeros((STATES, OTHERS + STATES))
    carry[:, 1:3] = np.eye(STATES)  # where a node keeps the states it hands on
    expected = np.zeros((tree.n * ROWS, problem.n_columns))
    head = STATES + len(tree.leaves)
    for k, (_, before, own) in enumerate(made):
        of_k = np.diag((tree.stage == k).astype(float))
        descends = of_k @ np.array([[float(p == j) for j in range(tree.n)] for p in tree.parent])
        root = of_k @ (tree.parent == -1).astype(float)[:, None]
        expected[:, :STATES] += np.kron(root, before)
        expected[:, head:] += np.kron(of_k, own) + np.kron(descends, before @ carry)
    assert problem.a.toarray() == pytest.approx(expected)
    demand = np.arange(tree.n, dtype=float) + 1.0
    vectors = problem.vectors({"demand": demand[None]}, {"state": [0.5, -0.5]})
    equal = np.tile([True, True, False, False], tree.n)
    assert vectors.row_upper == pytest.approx(np.where(equal, np.repeat(demand, ROWS), 1.0))
    assert vectors.row_lower == pytest.approx(np.where(equal, vectors.row_upper, -np.inf))
    assert vectors.lower[:STATES].tolist() == vectors.upper[:STATES].tolist() == [0.5, -0.5]


@quick
@given(trees())
def test_costs_are_weighted_by_probability_and_add_up(tree: Tree) -> None:
    # Prices that are numbers and prices that are data, of columns, constants and data.
    stage = Stage(1.0)
    x = stage.var("x", ["a", "b"], 1.0, 1.0)
    fee, levy = stage.data("fee", ["a", "b"]), stage.data("levy", ["a"])
    stage.cost("x", x + 0.5, [3.0, 4.0])
    stage.cost("fee", x * 2.0 + [1.0, 0.0], fee + 1.0)
    stage.cost("levy", levy * 2.0)
    problem = unroll([stage, stage], tree)
    prices = np.stack([np.arange(tree.n), 2.0 * np.arange(tree.n)])
    data = {"fee": prices, "levy": prices[:1] + 7.0}
    vectors = problem.vectors(data, {})
    z = vectors.lower
    expected = {
        "x": np.full(tree.n, 1.5 * 7.0),
        "fee": 3.0 * (prices[0] + 1.0) + 2.0 * (prices[1] + 1.0),
        "levy": 2.0 * (prices[0] + 7.0),
    }
    assert vectors.cost @ z + vectors.offset == pytest.approx(
        tree.probability @ sum(expected.values())
    )
    terms = problem.cost_terms(z, data)
    assert terms.keys() == expected.keys()
    for name, spent in expected.items():
        assert terms[name] == pytest.approx(spent)
