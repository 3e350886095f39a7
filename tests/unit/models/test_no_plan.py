"""What is said where there is no plan: who found none, what is in conflict, and what may help."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.errors import InfeasibleError, SolverError, UsageError
from resilience.models.backends import conic
from resilience.models.backends.base import NOTHING
from resilience.models.backends.conic import Conic
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import METHODS, MethodOptions, explain
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.start import any_point
from resilience.testing import small_case
from tests.known.solving import watch_that_is_late


def sunny(sun_mw: float, *, switch: bool = False, **devices: Any) -> Case:
    """Sun that must be taken at the end of a line, and in the second slot more than in the first.

    Without losses bus 2 rises by 2 * 0.03 pu * MW above 1 pu, squared, and 1.1025 is the most.
    """
    return small_case(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.03, 0.02)],
        line_tables=[{"name": "1-2", "switchable": switch}],
        voltage_band_pu=(0.9, 1.05),
        profiles={"sun": [0.3, 0.8]},
        grid=[{"import_max_mw": 7.0, "import_cost_per_mwh": 2.0, "export_max_mw": 8.0}],
        load=[{"bus": "2", "p_max_mw": 0.2, "shed_cost_per_mwh": 9.0}],
        pv=[{"bus": "2", "p_max_mw": sun_mw, "curtailable": False, "profile": "sun"}],
        **devices,
    )


def test_eight_groups_of_rows_are_named_and_the_others_counted() -> None:
    program = horizon(sunny(2.0), "lindistflow")
    rows = [f"row{k}[bus, 01:00]" for k in range(1, 12)]
    most, all_of_them = infeasible(program, rows), infeasible(program, rows[:8])
    assert most.message.endswith("row7[bus, 01:00], row8[bus, 01:00] and 3 more")
    assert all_of_them.message.endswith("row7[bus, 01:00], row8[bus, 01:00]")
    assert most.message.startswith("no plan satisfies the lindistflow model; in conflict: row1[")
    assert "make PV curtailable" in most.hint


def test_rows_that_differ_in_their_label_or_slot_are_named_together() -> None:
    """Two labels by name, more by the first and the last; slots by the first and the last."""
    slots = ["01:00", "02:00", "03:00"]
    rows = [f"line.voltage[{line}, {slot}]" for line in ("2-3", "4-5") for slot in slots]
    rows += [f"balance.p[{bus}, 02:00]" for bus in (7, 8, 9)]
    assert explain.grouped([*rows, "bounds of pv.p[roof, 04:00]"]) == [
        "bounds of pv.p[roof, 04:00]",
        "line.voltage[2-3, 4-5, 01:00 .. 03:00]",
        "balance.p[7 .. 9 (3), 02:00]",
    ]


def test_where_no_conflict_is_found_it_says_so() -> None:
    found = infeasible(horizon(sunny(2.0), "lindistflow"))
    assert found.message.endswith("in conflict: no small set of rows could be named")


@pytest.mark.parametrize(
    ("physics", "hint"),
    [
        ("lindistflow", "raise --time-limit"),
        ("distflow", "raise --time-limit or use --method lp"),
    ],
)
def test_out_of_time_nothing_is_explained(physics: Any, hint: str) -> None:
    error = no_plan(horizon(sunny(9.0), physics), "HiGHS", MethodOptions(2.5), late=True)
    assert isinstance(error, SolverError)
    assert (error.message, error.hint) == ("HiGHS found no plan within 2.5 s", hint)


def test_what_is_infeasible_without_cones_is_no_fault_of_the_solver() -> None:
    error = no_plan(horizon(sunny(5.0), "lindistflow"), "HiGHS", MethodOptions(), late=False)
    assert isinstance(error, InfeasibleError)
    assert "line.voltage[1-2, 01:00]" in error.message
    assert "00:00" not in error.message


def test_losses_may_save_a_plan_that_nobody_found() -> None:
    """2.3 * 0.8 - 0.2 = 1.64 MW are carried, 1.708 may be; with 2.5 it is 1.8 MW."""
    said = "Ipopt found no plan, though the cone relaxation has one"
    lossless, lossy = (
        no_plan(horizon(sunny(sun), "distflow"), "Ipopt", MethodOptions(), late=False)
        for sun in (2.3, 2.5)
    )
    assert isinstance(lossless, SolverError)
    assert lossless.message == said
    assert isinstance(lossy, SolverError)
    assert lossy.message.startswith(f"{said}; without losses there is none, in conflict: ")
    assert "01:00]" in lossy.message
    assert "00:00" not in lossy.message
    assert "make PV curtailable" in lossy.hint


def test_an_explanation_takes_no_longer_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither search for a conflict is begun when no second of its own is there."""
    monkeypatch.setattr(explain, "EXPLANATION_S", 0.0)
    found = infeasible(horizon(sunny(5.0), "distflow"))
    assert found.message.endswith("in conflict: no small set of rows could be named")


def stop_after(monkeypatch: pytest.MonkeyPatch, iterations: int) -> None:
    """Clarabel ends after a few iterations, long before it has a point."""
    monkeypatch.setattr(conic, "TOLERANCES", conic.TOLERANCES | {"max_iter": iterations})


@pytest.mark.parametrize(("late", "said"), [(True, "within 0.2 s"), (False, "though the cone")])
def test_clarabel_gave_up(monkeypatch: pytest.MonkeyPatch, late: bool, said: str) -> None:
    """A solve that ends without progress is no answer, also where a conflict is sought."""
    stop_after(monkeypatch, 1)
    program = horizon(sunny(2.3), "distflow")
    options = MethodOptions(0.2)
    if late:
        options = MethodOptions(0.2, clock=watch_that_is_late(monkeypatch))
    with pytest.raises(SolverError, match=f"^the conic relaxation found no plan,? ?{said}"):
        METHODS["socp"][0](program, options)
    solver = Conic(program.standard)
    solver.update(program.vectors)
    assert solver.conflict() == []


@pytest.mark.parametrize("penalty", [0.0, 0.01])
def test_clarabel_bounds_nothing_at_another_price(
    monkeypatch: pytest.MonkeyPatch, penalty: float
) -> None:
    """A price on losses makes another program, whose bound is none of this one."""
    program = horizon(sunny(2.3), "distflow")
    solver = Conic(program.standard, penalty=penalty)
    solver.update(program.vectors)
    assert (solver.solve().bound == -np.inf) == (penalty > 0.0)
    stop_after(monkeypatch, 5)
    early = solver.solve()
    assert early.z is None
    assert (early.bound == -np.inf) == (penalty > 0.0)


def test_only_without_switches_is_a_first_point_that_is_not_there_a_proof() -> None:
    fixed, switched = (horizon(sunny(5.0, switch=s), "lindistflow") for s in (False, True))

    def found(program: CaseProgram, seconds: float) -> Any:
        return any_point(program, lower(program.standard, modes={}, discs="outer"), seconds)

    assert found(fixed, 20.0).status == "infeasible"
    assert found(switched, 20.0).status == "none"
    assert found(switched, 20.0).z is None
    assert found(fixed, 0.0) is NOTHING


def test_scip_is_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    exact, physics = METHODS["exact"]
    with pytest.raises(UsageError, match="method 'exact' needs SCIP, which is not") as error:
        exact(horizon(sunny(2.0), physics), MethodOptions())
    assert error.value.hint == 'pip install "resilience[exact]"'


def test_scip_without_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """With time to spare it says what cones have to do with it; late, after how many seconds."""
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    monkeypatch.setattr(Pyomo, "solve", lambda solver: NOTHING)
    exact, physics = METHODS["exact"]
    unit = {"p_min_mw": 0.3, "p_max_mw": 0.9, "cost_per_mwh": 5.0, "no_load_cost_per_h": 0.4}
    program = horizon(sunny(2.0, generator=[unit]), physics)
    with pytest.raises(SolverError, match="SCIP found no plan, though the cone relaxation has one"):
        exact(program, MethodOptions(7.0))
    watch = watch_that_is_late(monkeypatch)
    with pytest.raises(SolverError, match=r"SCIP found no plan within 0\.2 s"):
        exact(program, MethodOptions(0.2, clock=watch))
