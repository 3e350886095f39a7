"""What a solver's library raises reaches nobody: a `SolverError` names the solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi
import cvxpy
import highspy
import numpy as np
import pytest
import scipy.sparse as sp
from pyomo.contrib.solver.common import factory

from resilience.errors import SolverError
from resilience.models.backends.casadi import NLP
from resilience.models.backends.cvxpy import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.plain import Plain
from resilience.models.backends.pyomo import Pyomo
from resilience.models.program.standard import Vectors
from resilience.testing import TINY


def plain() -> Plain:
    """min 2 z with z >= 3."""
    row = np.array([3.0])
    return Plain(
        sp.csr_array([[1.0]]),
        Vectors(np.array([2.0]), 0.5, np.array([-4.0]), np.array([9.0]), row, row + 5.0),
    )


CASES: dict[str, tuple[Any, str, Callable[[Any], Any]]] = {
    "HiGHS": (highspy.Highs, "run", Highs),
    "HiGHS, plain": (highspy.Highs, "run", lambda standard: plain()),
    "Clarabel": (cvxpy.Problem, "solve", Conic),
    "Ipopt": (casadi, "nlpsol", NLP),
    "SCIP": (factory, "SolverFactory", lambda standard: Pyomo(standard, solver="scip")),
}


@pytest.mark.parametrize("name", CASES)
def test_what_a_library_raises_is_a_solver_error(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise RuntimeError("a pivot of 1e-42")

    library, attribute, backend = CASES[name]
    tiny = next(iter(TINY.values()))()
    solver = backend(tiny.standard)
    if not isinstance(solver, Plain):
        solver.update(tiny.vectors)
    monkeypatch.setattr(library, attribute, broken)
    said = f"^{name.removesuffix(', plain')} failed: RuntimeError: a pivot of 1e-42"
    with pytest.raises(SolverError, match=said):
        solver.solve()
