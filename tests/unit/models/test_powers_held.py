"""Modes put right at the same powers: what that costs, and where it cannot be."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.models.backends.base import Solution
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import conic, large
from resilience.models.methods.powers import weighty_columns, with_powers_held
from resilience.models.program.referee import row_violations
from resilience.models.program.standard import Vectors
from resilience.planning.plan import Plan
from resilience.testing import small_case


def islanded() -> Case:
    """Two storages in an island for two of five hours, either of which could form it alone."""
    return small_case(
        slots=5,
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.02, 0.02)],
        profiles={"demand": [0.5, 0.8, 1.0, 0.9, 0.7]},
        load=[
            {"bus": "2", "p_max_mw": 0.3, "profile": "demand", "shed_cost_per_mwh": 90.0},
            {"bus": "3", "p_max_mw": 0.2, "profile": "demand", "shed_cost_per_mwh": 70.0},
        ],
        ess=[
            {"bus": "2", "p_max_mw": 0.4, "e_mwh": 0.9, "soc_initial": 0.6},
            {"bus": "3", "p_max_mw": 0.3, "e_mwh": 0.7, "soc_initial": 0.4},
        ],
        grid=[{"import_max_mw": 3.0, "import_cost_per_mwh": 10.0}],
        outages=["1-2@02:00-04:00"],
        terminal_value_per_mwh=5.0,
    )


def in_two_modes() -> tuple[CaseProgram, Solution, Vectors]:
    """A point whose storages form by halves, and bounds in which the second does not form."""
    program = horizon(islanded(), "distflow")
    solution = conic.relaxation(program, program.vectors)
    forms = program.standard.columns("ess.forms")
    return program, solution, program.vectors.fixed(forms[1], np.zeros(5))


def test_the_powers_stay_and_the_bounds_are_kept() -> None:
    program, solution, narrowed = in_two_modes()
    forms = program.standard.columns("ess.forms")[1]
    assert solution.point[forms].max() > 0.1
    plan = with_powers_held(program, solution, narrowed, 10.0)
    assert (plan.point[forms] == 0.0).all()
    assert plan.objective == pytest.approx(solution.objective, rel=1e-12)
    weighty = weighty_columns(program.standard, narrowed)
    assert {"line.l", "ess.energy", "load.shed"} <= {
        name for name in program.standard.names if weighty[program.standard.columns(name)].all()
    }
    assert plan.point[weighty] == pytest.approx(solution.point[weighty], abs=1e-12)
    assert row_violations(program.standard, plan.point, narrowed).max() <= 1e-6


def test_nothing_comes_of_powers_that_have_to_move() -> None:
    program, solution, narrowed = in_two_modes()
    shed = program.standard.columns("load.shed")[1]
    moved = narrowed.fixed(shed, solution.point[shed] + 0.01)
    assert with_powers_held(program, solution, moved, 10.0).z is None
    forms = program.standard.columns("ess.forms")
    dark = program.vectors.fixed(forms.ravel(), np.zeros(forms.size))  # the island is served
    assert with_powers_held(program, solution, dark, 10.0).z is None
    assert with_powers_held(program, solution, narrowed, 0.0).z is None


@pytest.mark.parametrize("method", ["nlp", "minlp"])
def test_large_programs_have_the_same_plan(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = rs.solve(islanded(), method)
    for module in (large, conic):
        monkeypatch.setattr(module, "LONG_COLUMNS", 0)
    after = rs.solve(islanded(), method)
    assert isinstance(before, Plan)
    assert isinstance(after, Plan)
    assert not after.relaxed
    assert after.objective == pytest.approx(before.objective, rel=1e-6)
    assert after.audit is not None
    assert max(after.audit.values()) <= 1e-6
