"""HiGHS has one door: a change of its interface is a change of one file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import resilience
from resilience.models.backends.highs_model import HighsModel, RunStatus
from resilience.models.program.standard import Vectors

PACKAGE = Path(resilience.__file__).parent


def test_only_one_module_imports_highspy() -> None:
    importing = re.compile(r"^\s*(import|from) highspy\b", re.MULTILINE)
    modules = [path for path in PACKAGE.rglob("*.py") if importing.search(path.read_text())]
    assert [path.relative_to(PACKAGE).as_posix() for path in modules] == [
        "models/backends/highs_model.py"
    ]


def test_nobody_else_calls_the_methods_of_highspy() -> None:
    calling = re.compile(r"model\.[a-z]+[A-Z]\w*\(")  # they alone are written likeThis
    modules = [path for path in PACKAGE.rglob("*.py") if calling.search(path.read_text())]
    assert not modules


def box() -> HighsModel:
    """min x + 2 y with x + y >= 1, x and y within [0, 1]: x = 1, y = 0."""
    model = HighsModel({})
    vectors = Vectors(
        cost=np.array([1.0, 2.0]),
        offset=0.5,
        lower=np.zeros(2),
        upper=np.ones(2),
        row_lower=np.array([1.0]),
        row_upper=np.array([np.inf]),
    )
    model.load(sp.csr_array([[1.0, 1.0]]), vectors)
    return model


def test_a_model_solves_what_it_is_given_and_what_is_changed_later() -> None:
    model = box()
    assert model.run() is RunStatus.OPTIMAL
    assert model.info.objective == pytest.approx(1.5)
    assert model.solution.values == pytest.approx([1.0, 0.0])
    model.change_bounds(np.array([0]), np.zeros(1), np.full(1, 0.25))
    model.change_offset(0.0)
    assert model.run() is RunStatus.OPTIMAL
    assert model.solution.values == pytest.approx([0.25, 0.75])
    # One more unit of demand is met by y at 2 $; the Lagrangian is c'z + y'(A z - b).
    assert model.solution.multipliers == pytest.approx([-2.0])
    assert model.info.objective == pytest.approx(1.75)
    model.add_rows(np.array([[0, 1]]), np.array([[1.0, 1.0]]), -np.inf, 0.5)
    assert model.run() in (RunStatus.INFEASIBLE, RunStatus.AMBIGUOUS)
