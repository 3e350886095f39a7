"""What a solver's library raises reaches nobody: a `SolverError` names the solver."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import casadi
import clarabel
import highspy
import numpy as np
import pytest
import scipy.sparse as sp
from pyomo.contrib.appsi import solvers as appsi
from pyomo.contrib.solver.common import factory
from pyomo.contrib.solver.common.results import TerminationCondition

from resilience.errors import SolverError
from resilience.models.backends.base import NOTHING, Solution, of_solver
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
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
    "Clarabel": (clarabel, "DefaultSolver", Conic),
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


@pytest.fixture
def _ctrl_c_raises() -> Iterator[None]:
    """As in a terminal, also where the tests run in the background, which ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_ctrl_c_raises")
@pytest.mark.parametrize("name", CASES)
def test_ctrl_c_ends_the_program_where_a_library_makes_an_error_of_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    went_on = []

    def deaf(*_: Any, **__: Any) -> None:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
            went_on.append("as if nothing had been")
        raise RuntimeError("an evaluation failed")

    library, attribute, backend = CASES[name]
    tiny = next(iter(TINY.values()))()
    solver = backend(tiny.standard)
    if not isinstance(solver, Plain):
        solver.update(tiny.vectors)
    monkeypatch.setattr(library, attribute, deaf)
    with pytest.raises(KeyboardInterrupt):
        solver.solve()
    assert not went_on
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("name", ["highs", "scip"])
def test_a_solver_behind_pyomo_that_stops_without_a_point_gives_nothing(
    name: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = SimpleNamespace(
        termination_condition=TerminationCondition.maxTimeLimit,
        incumbent_objective=None,
        best_feasible_objective=None,
    )
    tiny = next(iter(TINY.values()))()
    direct = SimpleNamespace(solve=lambda *_, **__: stopped)
    monkeypatch.setattr(appsi.Highs, "solve", lambda *_: stopped)
    solver = Pyomo(tiny.standard, solver=name)
    solver.update(tiny.vectors)
    if name == "scip":
        monkeypatch.setattr(factory, "SolverFactory", lambda _: direct)
    assert solver.solve() is NOTHING


def test_ctrl_c_ends_the_program_where_scip_stops_by_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stopped = SimpleNamespace(termination_condition=TerminationCondition.interrupted)
    direct = SimpleNamespace(solve=lambda *_, **__: stopped)
    monkeypatch.setattr(factory, "SolverFactory", lambda _: direct)
    tiny = next(iter(TINY.values()))()
    solver = Pyomo(tiny.standard, solver="scip")
    solver.update(tiny.vectors)
    with pytest.raises(KeyboardInterrupt):
        solver.solve()


@pytest.mark.parametrize(
    ("z", "value", "bound", "sound"),
    [
        ([3.0, np.nan], 7.5, 2.5, False),
        ([3.0, np.inf], 7.5, 2.5, False),
        ([3.0, 4.0], np.nan, 2.5, False),
        ([3.0, 4.0], 7.5, np.nan, False),
        (None, np.inf, np.nan, False),
        (None, np.inf, -np.inf, True),
        ([3.0, 4.0], 7.5, -np.inf, True),
    ],
)
def test_an_answer_is_all_numbers(
    z: list[float] | None, value: float, bound: float, sound: bool
) -> None:
    answer = Solution("feasible", None if z is None else np.array(z), value, bound)
    solve = of_solver("HiGHS")(lambda _: answer)
    if sound:
        assert solve(None) is answer
        return
    with pytest.raises(SolverError, match=r"^HiGHS answered with values that are no numbers"):
        solve(None)
