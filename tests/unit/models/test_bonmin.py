"""Bonmin, apart: the same optimum as minlp and SCIP, and a crash that stays where it happened."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import METHODS, MethodOptions
from resilience.testing import small_case
from tests.unit.models import bonmin


@pytest.fixture
def problem() -> CaseProgram:
    """Two buses and a lossy line; the cheap generator has a minimum that two slots do not need."""
    unit = {"bus": "2", "p_max_mw": 1.0, "q_max_mvar": 1.0}
    case = small_case(
        buses=2,
        lines=[(1, 2, 0.02, 0.02)],
        profiles={"day": [0.2, 1.0, 0.3]},
        slots=3,
        load=[
            {"bus": "2", "p_max_mw": 0.8, "profile": "day", "shed_cost_per_mwh": 50.0,
             "power_factor": 0.95},
        ],
        generator=[
            unit | {"p_min_mw": 0.5, "cost_per_mwh": 1.0, "no_load_cost_per_h": 0.2},
        ],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 2.0}],
    )  # fmt: skip
    return horizon(case, "distflow")


def test_bonmin_agrees_with_minlp_and_scip(problem: CaseProgram) -> None:
    found = bonmin.solve_apart(problem.standard, problem.vectors, 60.0)
    assert found.status == "optimal"
    on = found.point[problem.standard.columns("generator.on")]
    np.testing.assert_allclose(on[0], [0.0, 1.0, 0.0], atol=1e-6)
    for method in ("minlp", "exact"):
        answer = METHODS[method][0](problem, MethodOptions(60.0, 1e-6))
        assert found.objective == pytest.approx(answer.objective, rel=1e-5)


def test_a_crash_is_no_answer(problem: CaseProgram, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: Any, **__: Any) -> None:
        raise subprocess.CalledProcessError(-6, "bonmin")

    monkeypatch.setattr(subprocess, "run", crash)
    assert bonmin.solve_apart(problem.standard, problem.vectors, 1.0).status == "none"


def test_a_missing_program_or_answer_is_no_answer(
    problem: CaseProgram, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    assert bonmin.solve_apart(problem.standard, problem.vectors, 1.0).status == "none"
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: None)
    assert bonmin.solve_apart(problem.standard, problem.vectors, 1.0).status == "none"
