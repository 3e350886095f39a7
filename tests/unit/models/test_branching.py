"""Branching on a warm basis: the optimum of mixed-integer programs that others solve, too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from resilience.errors import SolverError
from resilience.models.backends import branching
from resilience.models.backends.branching import Branching
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll
from resilience.models.structures.base import Mode


def unrolled(stage: Stage) -> Standard:
    return unroll([stage], Tree.chain(["now"]))


def branched(standard: Standard) -> Branching:
    solver = Highs(lower(standard, integer="none", modes={}), duals=False)
    modes = list(standard.structures_of(Mode).values())
    return Branching(solver, np.flatnonzero(standard.integer), modes)


def knapsack(rng: np.random.Generator) -> Stage:
    """Twelve binaries and three continuous columns under five dense rows."""
    stage = Stage(1.0)
    items = tuple(f"i{k}" for k in range(12))
    binary, x = stage.binary("pick", items), stage.var("x", ("a", "b", "c"), 0.0, 2.0)
    for row in range(5):
        weight, rate = rng.uniform(0.2, 1.0, 12), rng.uniform(-0.5, 0.5, 3)
        stage.le(f"row{row}", (binary * weight).sum() + (x * rate).sum(), weight.sum() * 0.4)
    stage.cost("worth", binary, -rng.uniform(0.5, 1.5, 12))
    stage.cost("x", x, rng.uniform(-1.0, 1.0, 3))
    return stage


@pytest.mark.parametrize("seed", range(8))
def test_random_integer_programs_have_the_optimum_of_scipy(seed: int) -> None:
    standard = unrolled(knapsack(np.random.default_rng(seed)))
    v = standard.vectors({}, {})
    solution = branched(standard).solve(v)
    reference = milp(
        v.cost,
        integrality=standard.integer.astype(int),
        bounds=Bounds(v.lower, v.upper),
        constraints=LinearConstraint(standard.a, v.row_lower, v.row_upper),
        options={"mip_rel_gap": 0.0},
    )
    assert solution.objective == pytest.approx(reference.fun, abs=1e-7)
    assert solution.bound == pytest.approx(solution.objective, rel=1e-8)
    picked = solution.point[standard.integer]
    np.testing.assert_allclose(picked, np.round(picked), atol=2e-6)


@pytest.mark.parametrize("seed", range(8))
def test_modes_and_bent_curves_have_the_optimum_of_their_binaries(seed: int) -> None:
    """Paid for both ways at once, and curves that bend down: nothing that a relaxation holds."""
    rng = np.random.default_rng(100 + seed)
    stage = Stage(1.0)
    names = ("a", "b", "c")
    pos, neg = stage.split("way", names, (2.0, 2.0), (2.0, 2.0))
    x = stage.var("x", names, 0.0, 3.0)
    points = np.cumsum(rng.uniform(0.2, 1.0, (3, 4)), axis=1) - 0.2
    points[:, 0], points[:, -1] = 0.0, 3.0
    y = stage.piecewise("curve", x, points, rng.uniform(0.0, 4.0, (3, 4)), "$/h")
    stage.eq("balance", (pos * 0.8 - neg).sum() + x.sum(), rng.uniform(-1.0, 4.0))
    stage.cost("earn", pos + neg, -rng.uniform(0.1, 1.0, 3))
    stage.cost("curve", y)
    standard = unrolled(stage)
    exact = Highs(standard, gap=0.0)
    vectors = standard.vectors({}, {})
    exact.update(vectors)
    solution = branched(standard).solve(vectors)
    assert solution.objective == pytest.approx(exact.solve().objective, abs=1e-6)
    for mode in standard.structures_of(Mode).values():
        assert mode.violation(solution.point).max() < 1e-6


def test_any_mode_survives_one_of_two_branches_and_the_point_none() -> None:
    stage = Stage(1.0)
    x = stage.var("x", ("a",), 0.0, 3.0)
    stage.piecewise("curve", x, np.array([[0.0, 1.0, 2.0, 3.0]]), np.zeros((1, 4)), "$/h")
    stage.split("way", ("a",), (2.0, 2.0), (2.0, 2.0))
    curve, way = unrolled(stage).structures_of(Mode).values()
    columns, weights = curve.columns[:, 0], np.array([0.5, 0.0, 0.0, 0.5])
    sides = curve.structure.sides(columns, weights)
    for k in range(3):
        neighbours = columns[k : k + 2]
        assert any(not np.isin(neighbours, side).any() for side in sides)
    for side in sides:
        assert weights[np.isin(columns, side)].sum() > 0.0
    smaller, larger = way.structure.sides(way.columns[:, 0], np.array([0.3, 0.2]))
    assert [*smaller, *larger] == [way.columns[1, 0], way.columns[0, 0]]


def test_no_point_is_no_point_and_a_search_without_end_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    standard = unrolled(knapsack(np.random.default_rng(0)))
    v = standard.vectors({}, {})
    search = branched(standard)
    impossible = Vectors(v.cost, v.offset, v.lower, v.upper, v.row_lower, v.row_upper - 100.0)
    assert search.solve(impossible).z is None
    monkeypatch.setattr(branching, "MAX_NODES", 1)
    with pytest.raises(SolverError, match="12 integers did not end within 1 nodes"):
        search.solve(v)
