"""Every backend on every tiny problem: the optimum where it holds all, a bound where it relaxes."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tiny import CUTS, TINY, Tiny

from resilience.models.backends.casadi import NLP
from resilience.models.backends.cvxpy import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.referee import audit, settle
from resilience.models.standard import Standard

BACKENDS: dict[str, Callable[[Standard], Any]] = {
    "highs": lambda problem: Highs(problem, gap=0.0),
    "pyomo-highs": Pyomo,
    "pyomo-scip": lambda problem: Pyomo(problem, solver="scip"),
    "conic": Conic,
    "nlp": NLP,
}
EXACT = {
    "highs": Highs.exact,
    "pyomo-highs": Pyomo.exact - {"disc", "cone"},
    "pyomo-scip": Pyomo.exact,
    "conic": Conic.exact,
    "nlp": NLP.exact,
}
CONVEX = frozenset({"affine", "disc", "largest"})
TOLERANCE = {"pyomo-scip": 2e-6, "nlp": 1e-6}
HAS_SCIP = importlib.util.find_spec("pyscipopt") is not None


def pairs(wanted: Callable[[Tiny, str], bool]) -> Any:
    return pytest.mark.parametrize(
        ("name", "backend"),
        [
            pytest.param(
                name,
                backend,
                marks=[pytest.mark.skipif(not HAS_SCIP, reason="needs the extra `exact`")]
                if backend == "pyomo-scip"
                else [],
            )
            for name, build in TINY.items()
            for backend in BACKENDS
            if wanted(build(), backend)
        ],
    )


def solved(tiny: Tiny, backend: str) -> tuple[Any, Any]:
    solver = BACKENDS[backend](tiny.problem)
    solver.update(tiny.problem.vectors(tiny.data, tiny.x0))
    return solver, solver.solve()


@pairs(lambda tiny, backend: tiny.needs <= EXACT[backend])
def test_the_optimum_is_found_where_everything_is_held(name: str, backend: str) -> None:
    tiny = TINY[name]()
    _, found = solved(tiny, backend)
    tolerance = TOLERANCE.get(backend, 1e-7)
    assert found.status == "optimal"
    assert found.objective == pytest.approx(tiny.optimum, abs=tolerance)
    assert found.bound <= tiny.optimum + tolerance
    vectors = tiny.problem.vectors(tiny.data, tiny.x0)
    z = settle(tiny.problem, found.point, vectors)
    assert audit(tiny.problem, z, vectors).maximum <= 1e-6
    assert vectors.cost @ z + vectors.offset == pytest.approx(tiny.optimum, abs=tolerance)


@pairs(lambda tiny, backend: tiny.relaxed is not None and backend == "conic")
def test_what_is_relaxed_gives_the_optimum_of_the_relaxation(name: str, backend: str) -> None:
    tiny = TINY[name]()
    _, found = solved(tiny, backend)
    assert found.objective == pytest.approx(tiny.relaxed, abs=1e-6)
    assert tiny.relaxed - 1e-6 <= found.bound <= tiny.relaxed + 1e-9
    assert found.bound <= tiny.optimum + 1e-9
