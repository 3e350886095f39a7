"""`loss_cost_per_mwh`: where feeding in costs nothing, the objective is the losses."""

from __future__ import annotations

import math

import pytest

from resilience.case import Case
from resilience.testing import small_case
from tests.known.solving import solved

R_PU, LOAD_MW, PRICE = 0.02, 1.5, 50.0


def fed(loss_cost_per_mwh: float, import_cost_per_mwh: float = 0.0, g_us: float = 0.0) -> Case:
    """Half an hour of 1.5 MW behind a line of 0.02 pu; 1 pu at its first end."""
    case = small_case(
        slots=1,
        step_min=30.0,
        buses=2,
        lines=[(1, 2, R_PU, 0.0, {"g_us": g_us})],
        load=[{"bus": "2", "p_max_mw": LOAD_MW, "shed_cost_per_mwh": 1000.0, "power_factor": 1.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": import_cost_per_mwh, "v_pu": 1.0}],
    )
    return case.replace(loss_cost_per_mwh=loss_cost_per_mwh)


def loss_mw() -> float:
    """By hand: i is the smaller root of r i² - i + p = 0, with 1 pu in front of r."""
    current = (1.0 - math.sqrt(1.0 - 4.0 * R_PU * LOAD_MW)) / (2.0 * R_PU)
    return R_PU * current**2


@pytest.mark.parametrize("method", ["socp", "nlp", "minlp"])
def test_the_objective_is_what_is_lost(method: str) -> None:
    found = solved(fed(PRICE), method)
    assert found.objective == pytest.approx(PRICE * 0.5 * loss_mw(), rel=1e-6)
    assert found.bound == pytest.approx(found.objective, rel=1e-5)


def test_it_comes_on_top_of_what_feeding_in_costs() -> None:
    found = solved(fed(PRICE, import_cost_per_mwh=80.0), "minlp")
    energy = 0.5 * (LOAD_MW + loss_mw())
    assert found.objective == pytest.approx(80.0 * energy + PRICE * 0.5 * loss_mw(), rel=1e-6)


def test_leakage_of_a_line_is_lost_as_well() -> None:
    """What comes in less what is served, whatever becomes of it on the way."""
    found = solved(fed(PRICE, g_us=2000.0), "minlp")
    lost = float(found["grid.import"].sum()) - LOAD_MW
    assert lost > 1.05 * loss_mw()
    assert found.objective == pytest.approx(PRICE * 0.5 * lost, rel=1e-6)


def test_without_losses_there_is_nothing_to_pay() -> None:
    assert solved(fed(PRICE), "lp").objective == pytest.approx(0.0, abs=1e-9)


def test_a_copy_keeps_it_and_a_difference_is_told() -> None:
    case = fed(PRICE)
    assert case.replace(description="again").loss_cost_per_mwh == PRICE
    assert not case.equals(case.replace(loss_cost_per_mwh=0.0))
