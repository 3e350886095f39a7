"""Bounds hold for any multipliers, and cuts cut off nothing that the cone allows."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resilience.models.backends.base import Solution
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower, tangents
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Physics
from resilience.models.program.dual_bound import cone_share, safe_bound
from resilience.models.program.unroll import unroll
from resilience.models.structures import Cone, Disc
from resilience.testing import small_case
from tests.property.random_cases import quick


@cache
def feeder(physics: Physics) -> CaseProgram:
    """Three buses with a load, a battery, a plant and the grid, over two hours."""
    case = small_case(
        buses=3,
        lines=[(1, 2, 0.02, 0.01), (2, 3, 0.02, 0.02)],
        line_tables=[{"name": "2-3", "rating_mva": 0.8}],
        profiles={"price": [0.4, 1.0]},
        load=[{"bus": "3", "p_max_mw": 1.0, "power_factor": 0.9, "shed_cost_per_mwh": 9.0}],
        pv=[{"bus": "2", "p_max_mw": 0.4, "s_mva": 0.5}],
        ess=[{"bus": "3", "p_max_mw": 0.5, "e_mwh": 1.0, "degradation_cost_per_mwh": 0.1}],
        grid=[
            {"import_max_mw": 2.0, "import_cost_per_mwh": 3.0, "price_profile": "price"},
        ],
        terminal_value_per_mwh=1.0,
    )
    return horizon(case, physics)


@cache
def linear() -> tuple[CaseProgram, Highs, Solution]:
    problem = feeder("lindistflow")
    solver = Highs(lower(problem.standard, integer="none", modes={}, discs="outer"))
    solver.update(problem.vectors)
    return problem, solver, solver.solve()


@cache
def conic() -> tuple[CaseProgram, Solution]:
    problem = feeder("distflow")
    solver = Conic(problem.standard)
    solver.update(problem.vectors)
    return problem, solver.solve()


SEEDS = st.integers(0, 10_000)
WIDTHS = st.sampled_from([0.0, 1e-6, 1e-2, 1.0, 30.0])  # 0: the solver's own multipliers


@quick
@given(SEEDS, WIDTHS)
def test_any_multipliers_of_rows_give_a_bound(seed: int, width: float) -> None:
    problem, solver, found = linear()
    assert found.duals is not None
    rows = found.duals.rows
    rows = rows + width * np.random.default_rng(seed).normal(size=len(rows))
    v = solver.lowered.vectors(problem.vectors)
    bound = safe_bound(solver.lowered.a, v, rows)
    assert np.isfinite(bound)
    assert bound <= found.objective + 1e-9
    assert width > 0.0 or bound >= found.objective - 1e-6


@quick
@given(SEEDS, st.sampled_from([1e-4, 1e-2, 1.0]), st.sampled_from([-50.0, 0.3, 1000.0]))
def test_a_certified_bound_is_that_of_the_multipliers_whatever_the_solver_says(
    seed: int, width: float, claimed: float
) -> None:
    _, solver, found = linear()
    assert found.duals is not None
    rows = found.duals.rows
    off = rows + width * np.random.default_rng(seed).normal(size=len(rows))
    claim = replace(found, bound=found.objective + claimed)
    assert solver.certified_bound(claim) == pytest.approx(found.objective, abs=1e-6)
    proven = solver.certified_bound(replace(claim, duals=replace(found.duals, rows=off)))
    assert proven < found.objective - 1e-6
    assert proven != claim.bound


@quick
@given(SEEDS, WIDTHS)
def test_any_multipliers_of_cones_give_a_bound(seed: int, width: float) -> None:
    problem, found = conic()
    assert found.duals is not None
    rng, v, duals = np.random.default_rng(seed), problem.vectors, found.duals
    rows = duals.rows + width * rng.normal(size=len(duals.rows))
    cones = {k: y + width * rng.normal(size=y.shape) for k, y in duals.cones.items()}
    slope, offset = cone_share(problem.standard, cones)
    a = problem.standard.a
    bound = safe_bound(a, v, rows, slope, offset)
    assert np.isfinite(bound)
    assert bound <= found.objective + 1e-6
    assert width > 0.0 or bound == pytest.approx(found.objective, abs=1e-5)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_multipliers_outside_the_cone_are_moved_into_it(share: float) -> None:
    problem, found = conic()
    assert found.duals is not None
    v, a, duals = problem.vectors, problem.standard.a, found.duals
    short = {
        k: y * np.array([share, 1.0, 1.0, 1.0])[: len(y), None] for k, y in duals.cones.items()
    }
    slope, offset = cone_share(problem.standard, short)
    bound = safe_bound(a, v, duals.rows, slope, offset)
    assert bound <= found.objective + 1e-6


@pytest.mark.parametrize(
    ("multipliers", "slope", "offset"),
    [([7.0, 2.0, 3.0], [10.0, 4.0, 4.0], 4.0), ([2.0, 3.0, 4.0], [9.0, 1.0, 6.0], 3.0)],
)
def test_the_share_of_a_cone_by_hand(
    multipliers: list[float], slope: list[float], offset: float
) -> None:
    """Of u + v, 2 x and u - v for u = U + 0.5, x = X - 0.25: 7 is more than |(2, 3)| and stays, 2
    becomes |(3, 4)| = 5.
    """
    stage = Stage(1.0)
    u, v, x = (stage.var(name, ["a"]) for name in "uvx")
    stage.cone("flow", u + 0.5, v, x - 0.25)
    standard = unroll([stage], Tree.chain(["now"]))
    (k,) = standard.structures_of(Cone)
    found, constant = cone_share(standard, {k: np.array(multipliers)[:, None]})
    columns = [standard.columns(name)[0, 0] for name in "uvx"]
    assert found[columns].tolist() == slope
    assert constant == offset


def test_multipliers_of_the_wrong_sign_are_not_used() -> None:
    problem, solver, found = linear()
    assert found.duals is not None
    v = solver.lowered.vectors(problem.vectors)
    one_sided = np.isinf(v.row_lower)
    for rows in (found.duals.rows - 5.0 * one_sided, -found.duals.rows):
        bound = safe_bound(solver.lowered.a, v, rows)
        assert np.isfinite(bound)
        assert bound <= found.objective + 1e-9


@quick
@given(SEEDS)
def test_tangents_touch_the_cone_and_cut_off_nothing_of_it(seed: int) -> None:
    # u v >= x^2 + y^2 with shifted arguments, at and around random points of the surface.
    stage = Stage(1.0)
    u, v, x, y = (stage.var(name, ["a", "b"], -9.0, 9.0) for name in "uvxy")
    stage.cone("flow", u + 0.5, v * 2.0 + 0.75, x - 0.25, y)
    problem = unroll([stage], Tree.chain(["t0", "t1"]))
    rng = np.random.default_rng(seed)

    def on_the_cone(room: float) -> Any:
        z = np.zeros(problem.n_columns)
        left, right = rng.normal(size=4), rng.normal(size=4)
        second = rng.uniform(0.2, 2.0, 4)
        z[problem.columns("v").T.ravel()] = (second - 0.75) / 2.0
        z[problem.columns("x").T.ravel()] = left + 0.25
        z[problem.columns("y").T.ravel()] = right
        z[problem.columns("u").T.ravel()] = (left**2 + right**2) / second - 0.5 + room
        return z

    touched = on_the_cone(0.0)
    rows, sides = tangents(problem, touched)
    assert rows @ touched == pytest.approx(sides, abs=1e-9)
    assert rows.shape[0] == 4
    for _ in range(20):
        assert (rows @ on_the_cone(rng.uniform(0.0, 1.0)) <= sides + 1e-9).all()
    outside = touched.copy()
    outside[problem.columns("u").ravel()] -= 0.1
    assert (rows @ outside > sides).all()


def test_the_tangent_of_a_disc_by_hand() -> None:
    """Of radius 2 around (-1, 0.7), towards (2, 4.7), which is (3, 4) away from its centre:
    0.6 (x + 1) + 0.8 (y - 0.7) <= 2.
    """
    stage = Stage(1.0)
    x, y = (stage.var(name, ["a"], -9.0, 9.0) for name in "xy")
    stage.disc("rating", 2.0, x + 1.0, y - 0.7)
    problem = unroll([stage], Tree.chain(["now"]))
    (unrolled,) = problem.structures_of(Disc).values()
    z = np.zeros(problem.n_columns)
    columns = [problem.columns(name)[0, 0] for name in "xy"]
    z[columns] = 2.0, 4.7
    rows, sides = unrolled.structure.tangents(unrolled, z)
    assert rows.toarray()[0, columns] == pytest.approx([0.6, 0.8])
    assert sides == pytest.approx([2.0 - 0.6 + 0.56])
