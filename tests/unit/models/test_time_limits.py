"""Time is a promise: after the limit nothing is begun that only improves, and soon nothing at all.

No second passes here: a watch is read that each solve turns on by as much as the test says.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.errors import SolverError
from resilience.models.backends import conic
from resilience.models.backends.base import NOTHING
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import horizon
from resilience.models.methods import METHODS, MethodOptions, linear
from resilience.models.methods.answer import GRACE_S, OUT_OF_TIME, Deadline
from resilience.testing import small_case

BEGAN = 17.0


@dataclass
class Watch:
    """What each solver was given, and when.

    Attributes:
        now: what the watch shows, s.
        pace: what one solve takes, s.
        calls: (seconds since the start, time limit) of every solve.
    """

    pace: float
    now: float = BEGAN
    calls: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self) -> float:
        return self.now

    def watch(self, monkeypatch: pytest.MonkeyPatch, backend: type[Any]) -> None:
        solve = backend.solve

        def timed(solver: Any) -> Any:
            self.calls.append((self.now - BEGAN, solver.time_limit))
            try:
                return solve(solver)
            finally:
                self.now += self.pace

        monkeypatch.setattr(backend, "solve", timed)


@pytest.fixture
def case() -> Case:
    """Two units that run or do not, a store, and an inverter whose rating binds."""
    unit = {"bus": "2", "p_min_mw": 0.5, "p_max_mw": 1.5, "cost_per_mwh": 0.8, "start_cost": 0.7,
            "no_load_cost_per_h": 0.3, "q_min_mvar": -0.5, "q_max_mvar": 0.6}  # fmt: skip
    return small_case(
        buses=3,
        lines=[(1, 2, 0.03, 0.02), (2, 3, 0.02, 0.04)],
        slots=4,
        profiles={"load": [0.5, 0.9, 0.3, 0.8], "sun": [0.2, 0.5, 0.9, 0.6]},
        generator=[unit, unit | {"bus": "3", "cost_per_mwh": 0.6, "p_min_mw": 0.3}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.3, "soc_initial": 0.2, "s_mva": 0.6,
              "degradation_cost_per_mwh": 0.2, "efficiency_charge": 0.95}],
        pv=[{"bus": "3", "p_max_mw": 0.7, "s_mva": 0.45, "profile": "sun"}],
        load=[{"bus": "3", "p_max_mw": 2.2, "profile": "load", "power_factor": 0.9,
               "shed_cost_per_mwh": 1.5}],
    )  # fmt: skip


@pytest.fixture
def watches(monkeypatch: pytest.MonkeyPatch) -> Watch:
    watch = Watch(pace=3.0)
    for backend in (Highs, Conic, NLP, Pyomo):
        watch.watch(monkeypatch, backend)
    return watch


@pytest.mark.parametrize("limit", [0.0, 2.0, 5.5, 8.0, 40.0])
@pytest.mark.parametrize("method", METHODS)
def test_every_solver_gets_what_is_left(
    method: str, limit: float, case: Case, watches: Watch
) -> None:
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="SCIP is an extra")
    solve, physics = METHODS[method]
    message, hint = "", ""
    try:
        found = solve(horizon(case, physics), MethodOptions(limit, 1e-7, watches))
        assert found.status == "optimal" or found.notes
    except SolverError as error:
        message, hint = error.message, error.hint
    assert not message or f"found no plan within {limit:g} s" in message
    assert f"--method {method}" not in hint
    assert watches.calls
    for start, given in watches.calls:
        assert start < limit + GRACE_S
        assert 0.0 < given <= limit + GRACE_S - start
    # What begins after the limit is for having anything at all: at most one solve of three seconds.
    assert sum(start >= limit for start, _ in watches.calls) <= 1


def test_a_deadline_reads_its_own_clock() -> None:
    watch = Watch(pace=2.5)
    deadline = Deadline(4.0, watch)
    watch.now += 1.5
    assert (deadline.spent_s, deadline.remaining_s, deadline.late) == (1.5, 2.5, False)
    watch.now += 2.5
    assert (deadline.remaining_s, deadline.final_s, deadline.late) == (0.0, GRACE_S, True)
    watch.now += 7.0
    assert (deadline.remaining_s, deadline.final_s) == (0.0, 0.0)


@pytest.mark.parametrize("backend", [Conic, NLP])
def test_building_counts(backend: Any, case: Case) -> None:
    """A limit that building alone exceeds leaves nothing to solve with."""
    program = horizon(case, "distflow")
    solver = backend(program.standard, time_limit=1e-9)
    solver.update(program.vectors)
    assert solver.solve().z is None


def test_clarabel_stopped_early_still_proves_a_bound(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its point holds nothing yet and is not shown; its multipliers are as good as any others."""
    program = horizon(case, "distflow")
    solver = Conic(program.standard)
    solver.update(program.vectors)
    optimum = solver.solve().objective

    monkeypatch.setattr(conic, "TOLERANCES", conic.TOLERANCES | {"max_iter": 7})
    early = solver.solve()
    assert (early.status, early.z) == ("none", None)
    assert np.isfinite(early.bound)
    assert early.bound < optimum


def test_a_relaxed_answer_says_what_ended_the_search(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is the optimum of what it relaxes, so its gap is none: the limit is named all the same."""
    watch = Watch(pace=5.0)
    watch.watch(monkeypatch, Highs)
    monkeypatch.setattr(linear, "_any_plan", lambda search: NOTHING)
    monkeypatch.setattr(linear, "_plan", lambda search, relaxed, broken: NOTHING)
    found = linear.lp(horizon(case, "lindistflow"), MethodOptions(3.0, clock=watch))
    assert found.status == "optimal"
    assert found.relaxed
    assert found.notes[-1] == OUT_OF_TIME
