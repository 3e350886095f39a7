"""Python callers are told of the same slips as authors of case files."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case, load_case
from resilience.errors import CaseError, UsageError
from resilience.models.methods import MethodOptions
from resilience.models.program.risk import Risk
from resilience.simulation.forecast import ForecastError
from tests.unit.case.conftest import CaseFile


@pytest.fixture
def case(case_file: CaseFile) -> Case:
    return load_case(case_file())


Change = Callable[[Case], Case]
TYPOS: dict[str, tuple[Change, str]] = {
    "line": (lambda case: case.with_line("2-3", hardning=2.5), "hardening"),
    "ess": (lambda case: case.with_ess("battery", e_mhw=3.0), "e_mwh"),
    "load": (lambda case: case.with_load("clinic", prioriti=3.0), "priority"),
    "generator": (lambda case: case.with_generator("diesel", start_costs=3.0), "start_cost"),
    "pv": (lambda case: case.with_pv("roof", profle="sun"), "profile"),
    "grid": (lambda case: case.with_grid(vpu=1.02), "v_pu"),
    "kind": (lambda case: case.with_device("generatr", "diesel"), "generator"),
    "device": (lambda case: case.with_ess("batery", e_mwh=3.0), "battery"),
    "copy": (
        lambda case: case.replace(ess=[case.ess[0].model_copy(update={"e_mhw": 3.0})]),
        "e_mwh",
    ),
    "replace": (lambda case: case.replace(stat=datetime(2016, 8, 1)), "start"),
}


@pytest.mark.parametrize("name", TYPOS)
def test_a_typo_is_told_with_the_nearest(case: Case, name: str) -> None:
    change, nearest = TYPOS[name]
    with pytest.raises(UsageError, match=f"did you mean {nearest}"):
        change(case)


SLIPS: dict[str, tuple[Change, str]] = {
    "percent": (lambda case: case.with_ess("battery", efficiency_charge=93), "divide by 100"),
    "order": (lambda case: case.with_ess("battery", soc_min=0.95), "at most soc_max"),
    "text": (lambda case: case.with_load("clinic", p_max_mw="0.2"), "remove the quotes"),
    "bus": (lambda case: case.with_pv("roof", bus="99"), "a bus of the network"),
    "kW": (lambda case: case.with_generator("diesel", p_max_mw=400_000.0), "divide by 1000"),
    "volts": (lambda case: case.with_grid("grid", v_pu=12.66), "the limits of bus"),
    "price": (lambda case: case.replace(terminal_value_per_mwh=1e300), "1e\\+06 or less"),
    "slots": (lambda case: case.replace(slots=10**30), "1e\\+06 or less"),
    "zone": (lambda case: case.replace(start=datetime.now().astimezone()), "without offset"),
}


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_is_told_as_in_a_case_file(case: Case, name: str) -> None:
    change, words = SLIPS[name]
    with pytest.raises(CaseError, match=words):
        change(case)


def test_each_kind_of_device_can_be_changed(case: Case) -> None:
    changed = (
        case.with_ess("battery", e_mwh=3.25)
        .with_load("clinic", p_max_mw=0.35)
        .with_generator("diesel", start_cost=7.5)
        .with_pv("roof", p_max_mw=0.65)
        .with_grid("grid", v_pu=1.02)
    )
    assert changed.ess[0].e_mwh == 3.25
    assert [load.p_max_mw for load in changed.load] == [0.8, 0.35]
    assert changed.generator[0].start_cost == 7.5
    assert changed.pv[0].p_max_mw == 0.65
    assert changed.grid[0].v_pu == 1.02
    assert case.ess[0].e_mwh == 2.0


def test_what_the_file_leaves_to_another_key_follows_it(case: Case) -> None:
    """p_min_mw of storage is -p_max_mw, q_max_mvar of a grid import_max_mw, where none is given."""
    changed = case.with_ess("battery", p_max_mw=0.7).with_grid("grid", import_max_mw=3.5)
    assert changed.ess[0].p_min_mw == -0.7
    assert changed.grid[0].q_max_mvar == 3.5
    stated = case.with_ess("battery", p_min_mw=-0.3).with_ess("battery", p_max_mw=0.9)
    assert stated.ess[0].p_min_mw == -0.3


MISSPELT: dict[str, Any] = {"outage": "none"}
REFUSED: dict[str, tuple[Callable[[Case], Any], str]] = {
    "gap": (lambda case: rs.solve(case, "lp", relative_gap=50), "probably percent"),
    "infinite gap": (lambda case: rs.solve(case, "lp", relative_gap=float("inf")), "0 to 1"),
    "time": (lambda case: rs.solve(case, "lp", time_limit=float("nan")), "time limit nan"),
    "scenarios": (lambda case: rs.solve(case, "stochastic", relative_gap=5), "probably percent"),
    "sigma": (lambda case: rs.compare(case, ["rule"], forecast_error="2.5,0.97"), "percent"),
    "correlation": (lambda case: rs.compare(case, ["rule"], forecast_error="0.025,97"), "percent"),
    "end value": (lambda case: rs.compare(case, ["rule"], end_value_per_mwh=1e300), "end value"),
    "no end value": (
        lambda case: rs.compare(case, ["rule"], end_value_per_mwh=float("nan")),
        "end value nan",
    ),
    "no method": (lambda case: rs.compare(case, []), "no method"),
    "commas": (lambda case: rs.compare(case, "rule,mcp"), "dispatcher 'mcp' is unknown"),
    "risk": (lambda case: Risk.parse("cvar:95:0.5"), "probably percent"),
    "weight": (lambda case: Risk(0.95, 50.0), "probably percent"),
    "error": (lambda case: ForecastError(2.5), "probably percent"),
    "limits": (lambda case: MethodOptions(gap=0.5, time_limit=-1.0), "time limit -1"),
    "option": (lambda case: partial(rs.solve, case, "lp")(**MISSPELT), "did you mean outages"),
    "slots": (
        lambda case: rs.solve(
            case, "stochastic", scenarios=rs.Scenarios((), np.zeros((0, 7, 1), bool), np.ones(1))
        ),
        "scenarios of 7 slots",
    ),
    "tables": (lambda case: case.replace(ess=[5]), "with_ess"),
    "profiles": (lambda case: case.replace(profiles={"homes": ["a"]}), "a number per slot"),
    "outages": (lambda case: case.replace(outages=[5]), "texts"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_call_that_cannot_be_meant_is_refused(case: Case, name: str) -> None:
    call, words = REFUSED[name]
    with pytest.raises(UsageError, match=words):
        call(case)


@pytest.mark.parametrize("key", ["probability", "height"])
def test_percent_of_the_bell_is_told(case_file: CaseFile, key: str) -> None:
    path = case_file(("[time]", f"[outage]\n{key} = 80\n[time]"))
    with pytest.raises(CaseError, match="divide by 100"):
        load_case(path)
    from resilience.fragility.outages.bell import Bell

    with pytest.raises(UsageError, match="divide by 100"):
        Bell(**{key: 80.0})  # type: ignore[arg-type]
