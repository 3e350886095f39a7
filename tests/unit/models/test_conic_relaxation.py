"""The conic relaxation in arrays against the same program as cvxpy states it."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.models.backends.conic import Conic
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import conic, large
from resilience.models.methods.cvxpy_model import stated
from resilience.models.program.dual_bound import cone_share, safe_bound
from tests.unit.models.test_large_programs import rated_feeder

cp: Any = importlib.import_module("cvxpy")


def feeder(**more: Any) -> CaseProgram:
    return horizon(rated_feeder(outages=["1-2@03:00-05:00"], **more), "distflow")


@pytest.mark.parametrize("rating_mva", [0.5, 0.72, 5.0])
def test_the_optimum_is_that_of_cvxpy(rating_mva: float) -> None:
    program = feeder(rating_mva=rating_mva)
    standard, v = program.standard, program.vectors
    problem = stated(standard, v).problem
    problem.solve(solver=cp.CLARABEL)
    solver = Conic(standard)
    solver.update(v)
    solution = solver.solve()
    assert solution.objective == pytest.approx(problem.value, rel=1e-6)
    assert solution.bound == pytest.approx(problem.value, rel=1e-6)
    assert solution.duals is not None
    slope, offset = cone_share(standard, solution.duals.cones)
    bound = safe_bound(standard.a, v, solution.duals.rows, slope, offset)
    assert bound == pytest.approx(solution.bound, rel=1e-9)


def test_what_a_point_lacks_is_least_as_in_cvxpy() -> None:
    """A load that nothing may shed and nobody can serve: rows are missed by as little as can be."""
    program = feeder()
    shed = program.standard.columns("load.shed").ravel()
    v = program.vectors.fixed(shed, np.zeros(len(shed)))
    source = program.standard.columns("grid.import").ravel()
    v = v.fixed(source, np.full(len(source), 0.1))
    solver = Conic(program.standard, elastic=1.0)
    solver.update(v)
    assert solver.solve().z is not None
    assert solver.slack is not None
    problem = stated(program.standard, v).problem
    z = problem.variables()[0]
    slack = cp.Variable(program.standard.n_rows)
    equal = np.isfinite(v.row_lower)
    rows = program.standard.a @ z + slack
    held = [rows[equal] == v.row_upper[equal], rows[~equal] <= v.row_upper[~equal]]
    held += problem.constraints[2:]
    known = cp.Problem(cp.Minimize(cp.norm1(slack)), held)
    known.solve(solver=cp.CLARABEL)
    assert known.value > 0.1
    assert np.abs(solver.slack).sum() == pytest.approx(known.value, rel=1e-5)


def test_limits_that_are_there_for_solvers_come_back_where_they_bind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A limit of flow below what the second line takes: it is left out, missed, and held."""
    program = feeder()
    columns = program.standard.columns("line.p")[1]
    upper = program.vectors.upper.copy()
    upper[columns] = 0.31
    v = replace(program.vectors, upper=upper)
    solver = Conic(program.standard)
    solver.update(v)
    known = solver.solve()
    monkeypatch.setattr(large, "LONG_COLUMNS", 0)
    boxed = large.first_bounds(program.standard)
    assert not boxed[columns].any()
    free = Conic(program.standard, boxed=boxed)
    free.update(v)
    assert free.solve().objective < known.objective - 1e-3
    assert free.is_beyond
    solution = conic.relaxation(program, v)
    assert solution.objective == pytest.approx(known.objective, rel=1e-7)
    assert solution.point[columns].max() == pytest.approx(0.31, abs=1e-6)


def test_a_case_is_extended_in_cvxpy() -> None:
    """A row of one's own, an import of 0.2 MW at most, is the limit of the grid in the case."""
    case = rated_feeder(outages=["1-2@03:00-05:00"])
    model = rs.cvxpy_model(case)
    model.problem.solve(solver=cp.CLARABEL)
    plan = rs.solve(case, "socp")
    assert isinstance(plan, rs.Plan)
    assert model.problem.value == pytest.approx(plan.bound, rel=1e-6)
    assert model["load.shed"].shape == (len(case.load), case.slots)
    limited = cp.Problem(
        model.problem.objective, [*model.problem.constraints, model["grid.import"] <= 0.2]
    )
    limited.solve(solver=cp.CLARABEL)
    weaker = rs.solve(case.with_grid(case.grid[0].name, import_max_mw=0.2), "socp")
    assert isinstance(weaker, rs.Plan)
    assert limited.value == pytest.approx(weaker.bound, rel=1e-6)
    assert limited.value > model.problem.value + 1e-3


@pytest.mark.parametrize("name", ["ieee33-commitment", "ieee33-fuel"])
def test_cvxpy_has_the_bound_of_commitment_and_of_tanks(name: str) -> None:
    """Curves, fuel and units that run by shares are rows of the program like all others."""
    case = rs.load_case(name).replace(slots=48, outages=())
    model = rs.cvxpy_model(case)
    model.problem.solve(solver=cp.CLARABEL)
    plan = rs.solve(case, "socp")
    assert isinstance(plan, rs.Plan)
    assert plan.bound == pytest.approx(model.problem.value, rel=1e-6)
