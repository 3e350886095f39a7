"""Loads that lead, and loads of reactive power alone, against power flows by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.planning.ac_check import ac_check_plan
from resilience.testing import case_optimum, small_case

R, X = 0.013, 0.021  # pu on 1 MVA
GRID = {"import_max_mw": 9.0, "q_max_mvar": 9.0, "import_cost_per_mwh": 40.0}
WIDE = (0.5, 1.5)


def two_bus(p: float, q: float) -> tuple[float, float]:
    """Squared voltage at the end of a line from 1 pu, and its loss: the quadratic in v^2."""
    middle = 0.5 - (R * p + X * q)
    v_sq = middle + math.sqrt(middle**2 - (R**2 + X**2) * (p**2 + q**2))
    return v_sq, R * (p**2 + q**2) / v_sq


def feeder(*loads: dict[str, object], **more: Any) -> Case:
    tables = [{"bus": "2", "shed_cost_per_mwh": 700.0, **load} for load in loads]
    return small_case(
        buses=2, slots=1, lines=[(1, 2, R, X)], voltage_band_pu=WIDE, load=tables, **more
    )


def planned(case: Case, method: str) -> rs.Plan:
    plan = rs.solve(case, method=method)
    assert isinstance(plan, rs.Plan)
    return plan


METHODS = ["minlp", "socp", "nlp", "exact"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("q_mvar", [0.7, -0.6])
def test_a_load_has_the_voltage_and_loss_of_its_power(q_mvar: float, method: str) -> None:
    plan = planned(feeder({"p_max_mw": 1.9, "q_mvar": q_mvar}, grid=[GRID]), method)
    v_sq, loss = two_bus(1.9, q_mvar)
    assert plan.tables["voltage"]["2"][0] == pytest.approx(math.sqrt(v_sq), abs=1e-6)
    assert plan.energy_mwh["losses"] == pytest.approx(loss, rel=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("q_mvar", [0.8, -1.1])
def test_reactive_power_alone_is_a_load(q_mvar: float, method: str) -> None:
    """Beside a load with a power factor of 0.8, at a profile's 0.6 of the peak."""
    case = feeder(
        {"p_max_mw": 1.2, "power_factor": 0.8},
        {"p_max_mw": 0.0, "q_mvar": q_mvar, "profile": "day"},
        profiles={"day": [0.6]},
        grid=[GRID],
    )
    plan = planned(case, method)
    v_sq, loss = two_bus(1.2, 0.9 + 0.6 * q_mvar)
    assert plan.tables["voltage"]["2"][0] == pytest.approx(math.sqrt(v_sq), abs=1e-6)
    assert plan.energy_mwh["losses"] == pytest.approx(loss, rel=1e-4)
    assert plan.tables["reactive"]["load2"][0] == pytest.approx(-0.6 * q_mvar, abs=1e-6)
    check = ac_check_plan(plan)
    assert check.loss_mwh == pytest.approx(loss, rel=1e-4)


def test_power_factor_and_reactive_power_of_a_load_say_the_same() -> None:
    by_factor = feeder({"p_max_mw": 1.2, "power_factor": 0.8}, grid=[GRID])
    by_power = feeder({"p_max_mw": 1.2, "q_mvar": 0.9}, grid=[GRID])
    assert by_factor.load[0].q_peak_mvar == pytest.approx(by_power.load[0].q_peak_mvar)


def test_reactive_power_that_no_source_gives_is_shed_at_its_price() -> None:
    """A generator with 0.5 of 0.8 Mvar in an island: 0.3 Mvarh at 700, and 0.4 MWh at 90."""
    case = feeder(
        {"p_max_mw": 0.4},
        {"p_max_mw": 0.0, "q_mvar": 0.8, "priority": 2.0},
        generator=[{"bus": "2", "p_max_mw": 2.0, "q_max_mvar": 0.5, "cost_per_mwh": 90.0}],
        grid=[GRID],
        outages=["1-2@00:00-01:00"],
    )
    optimum = case_optimum(case, "lindistflow")
    assert optimum["load.q_shed"] == pytest.approx(0.3)
    assert optimum.objective == pytest.approx(2.0 * 700.0 * 0.3 + 90.0 * 0.4)


def test_reactive_power_alone_is_shed_in_a_dark_island() -> None:
    case = feeder(
        {"p_max_mw": 0.4},
        {"p_max_mw": 0.0, "q_mvar": -0.8},
        grid=[GRID],
        outages=["1-2@00:00-01:00"],
    )
    optimum = case_optimum(case, "lindistflow")
    assert optimum["load.q_shed"] == pytest.approx(0.8)
    assert optimum["load.q"] == pytest.approx(0.0, abs=1e-9)


def test_a_plant_has_its_reactive_power_in_proportion() -> None:
    """0.6 of 1.5 MW and of -0.45 Mvar, which it takes."""
    case = feeder(
        {"p_max_mw": 2.3},
        pv=[{"bus": "2", "p_max_mw": 1.5, "q_mvar": -0.45, "profile": "sun"}],
        profiles={"sun": [0.6]},
        grid=[GRID],
    )
    plan = planned(case, "minlp")
    v_sq, loss = two_bus(2.3 - 0.9, 0.27)
    assert plan.tables["voltage"]["2"][0] == pytest.approx(math.sqrt(v_sq), abs=1e-6)
    assert plan.energy_mwh["losses"] == pytest.approx(loss, rel=1e-4)


def test_dispatch_is_certified_with_the_reactive_power_of_every_load() -> None:
    """The power flow after a comparison: two loads, one of them a capacitor."""
    from resilience.models.ac_check import carry, reactive_alone
    from resilience.models.components import device_fleets

    case = feeder(
        {"p_max_mw": 1.2, "power_factor": 0.8}, {"p_max_mw": 0.0, "q_mvar": -1.1}, grid=[GRID]
    )
    alone = reactive_alone(case, device_fleets(case).values())
    np.testing.assert_allclose(alone, [[0.0], [1.1]])
    power = {"load1": np.array([-1.2]), "load2": np.zeros(1), "grid1": np.array([1.2])}
    carried = carry(case, power, np.ones((1, 1), bool), np.zeros((0, 1)), alone)
    assert carried.loss_mw[0] == pytest.approx(two_bus(1.2, 0.9 - 1.1)[1], rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "keys", "named"),
    [
        ("load", {"q_mvar": 0.4, "power_factor": 0.9}, "nothing beside power_factor = 0.9"),
        ("pv", {"q_mvar": 0.4, "s_mva": 2.0}, "nothing beside s_mva = 2"),
        ("pv", {"q_mvar": 0.4, "p_max_mw": 0.0}, "0 beside p_max_mw = 0"),
    ],
)
def test_two_statements_of_one_reactive_power_are_refused(
    kind: str, keys: dict[str, float], named: str
) -> None:
    price = {"shed_cost_per_mwh": 700.0} if kind == "load" else {}
    tables: dict[str, Any] = {kind: [{"p_max_mw": 1.7, **price, **keys}]}
    with pytest.raises(rs.CaseError, match=named):
        small_case(**tables, grid=[GRID])
