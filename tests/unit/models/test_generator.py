"""Generators: hours stay hours whatever the step, and commitment is what enumeration finds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, product
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.testing import case_optimum, small_case

STEPS = [60.0, 30.0, 15.0]
SHED = 50.0


def hourly(
    demand: Sequence[float], step_min: float, generator: dict[str, Any], shed: float = SHED
) -> Case:
    """One load and one generator; `demand` in MW by the hour."""
    each = round(60 / step_min)
    peak = max(*demand, 1.0)
    return small_case(
        slots=len(demand) * each,
        step_min=step_min,
        profiles={"demand": (np.repeat(demand, each) / peak).tolist()},
        load=[{"p_max_mw": peak, "profile": "demand", "shed_cost_per_mwh": shed}],
        generator=[{"p_max_mw": 4.0, "cost_per_mwh": 1.0, **generator}],
    )


@pytest.mark.parametrize("step_min", STEPS)
def test_a_start_binds_for_the_minimum_up_time(step_min: float) -> None:
    # One hour of demand; no-load costs 1 $/h: it runs three hours, as it must.
    case = hourly([0, 1, 0, 0, 0], step_min, {"min_up_h": 3.0, "no_load_cost_per_h": 1.0})
    found = case_optimum(case)
    assert found.objective == pytest.approx(1.0 + 3.0)
    assert found["generator.on"].sum() * case.step_h == pytest.approx(3.0)


@pytest.mark.parametrize("step_min", STEPS)
@pytest.mark.parametrize(("min_down_h", "cost"), [(1.0, 18.0), (2.0, 23.0)])
def test_a_stop_binds_for_the_minimum_down_time(
    step_min: float, min_down_h: float, cost: float
) -> None:
    # No demand in the second of four hours. No-load costs 5 $/h, so that a stop of one hour pays;
    # one of two hours would shed 1 MWh at 50.
    case = hourly(
        [1, 0, 1, 1],
        step_min,
        {"min_down_h": min_down_h, "no_load_cost_per_h": 5.0, "initial_on": True},
    )
    assert case_optimum(case).objective == pytest.approx(cost)


def test_a_minimum_time_that_is_no_multiple_of_the_step_is_rounded_up() -> None:
    case = hourly([0, 1, 0, 0], 60.0, {"min_up_h": 1.5, "no_load_cost_per_h": 1.0})
    assert case_optimum(case)["generator.on"].sum() == 2.0


@pytest.mark.parametrize("step_min", STEPS)
def test_hours_before_the_horizon_count(step_min: float) -> None:
    # On for 1 of 3 hours: two to go, although nobody needs it.
    on = {"initial_on": True, "initial_hours": 1.0, "min_up_h": 3.0, "no_load_cost_per_h": 1.0}
    assert case_optimum(hourly([0, 0, 0, 0], step_min, on)).objective == pytest.approx(2.0)
    # Off for half an hour of two: the first 1.5 hours are shed.
    off = {"initial_on": False, "initial_hours": 0.5, "min_down_h": 2.0}
    expected = 1.5 * SHED + 2.5 if step_min <= 30 else 2.0 * SHED + 2.0
    assert case_optimum(hourly([1, 1, 1, 1], step_min, off)).objective == pytest.approx(expected)


@pytest.mark.parametrize("step_min", STEPS)
def test_a_ramp_up_is_per_hour(step_min: float) -> None:
    found = case_optimum(hourly([4, 4, 4, 4], step_min, {"ramp_up_mw_per_h": 1.0}))
    each = round(60 / step_min)
    assert found["generator.p"][0, each - 1 :: each] == pytest.approx([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize("step_min", STEPS)
@pytest.mark.parametrize("start_cost", [0.0, 1.0], ids=["plain", "committed"])
def test_a_ramp_down_is_per_hour(step_min: float, start_cost: float) -> None:
    # Power that nobody needs costs 1 $/MWh to get rid of. Without a minimum power a stop is no
    # faster than the ramp.
    each = round(60 / step_min)
    unit = {"p_max_mw": 4.0, "ramp_down_mw_per_h": 1.0, "initial_on": True, "p_initial_mw": 4.0}
    case = small_case(
        slots=4 * each,
        step_min=step_min,
        generator=[{**unit, "start_cost": start_cost}],
        grid=[
            {
                "import_max_mw": 0.0,
                "export_max_mw": 9.0,
                "import_cost_per_mwh": 9.0,
                "export_cost_per_mwh": 1.0,
            }
        ],
    )
    p = case_optimum(case)["generator.p"][0]
    assert p[each - 1 :: each] == pytest.approx([3.0, 2.0, 1.0, 0.0], abs=1e-9)


def test_a_start_may_reach_the_minimum_power_whatever_the_ramp() -> None:
    unit = {"p_min_mw": 2.0, "ramp_up_mw_per_h": 0.5}
    p = case_optimum(hourly([2, 2, 4, 4], 60.0, unit))["generator.p"][0]
    assert p[0] >= 2.0 - 1e-9
    assert np.diff(p).max() <= 0.5 + 1e-9


UNIT = {
    "p_min_mw": 1.0,
    "p_max_mw": 3.0,
    "cost_per_mwh": 2.0,
    "no_load_cost_per_h": 3.0,
    "start_cost": 4.0,
    "min_up_h": 2.0,
    "min_down_h": 2.0,
}


def runs_are_long_enough(on: tuple[int, ...], before: int, hours: int, unit: dict) -> bool:
    """Whether every run of on or off hours that ends within the horizon lasted long enough."""
    history = (before,) * hours + on
    runs = [(value, len(list(run))) for value, run in groupby(history)]
    least = {1: unit["min_up_h"], 0: unit["min_down_h"]}
    return all(length >= least[value] for value, length in runs[:-1])


def enumerated(demand: Sequence[float], before: int, hours: int, unit: dict, price: float) -> float:
    """The least cost over every sequence of on and off, in slots of one hour."""
    costs = []
    for on in product((0, 1), repeat=len(demand)):
        too_little = any(u and d < unit["p_min_mw"] for u, d in zip(on, demand, strict=True))
        if too_little or not runs_are_long_enough(on, before, hours, unit):
            continue
        cost = sum(max(b - a, 0) for a, b in zip((before, *on), on, strict=False))
        cost *= unit["start_cost"]
        for u, d in zip(on, demand, strict=True):
            p = min(d, unit["p_max_mw"]) * u
            cost += u * unit["no_load_cost_per_h"] + p * unit["cost_per_mwh"] + (d - p) * price
        costs.append(cost)
    return min(costs)


@pytest.mark.parametrize("seed", range(12))
def test_commitment_is_the_best_of_all_sequences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    demand = rng.choice([0.0, 0.4, 1.0, 1.5, 2.5, 3.5], size=5).tolist()
    before, hours = int(rng.integers(2)), int(rng.integers(1, 4))
    price = float(rng.choice([3.0, 6.0, 12.0]))
    unit = {**UNIT, "initial_on": bool(before), "initial_hours": float(hours)}
    case = hourly(demand, 60.0, unit, price)
    try:
        expected = enumerated(demand, before, hours, UNIT, price)
    except ValueError:  # no sequence at all: it must run on, but there is too little demand
        with pytest.raises(AssertionError, match="infeasible"):
            case_optimum(case)
        return
    assert case_optimum(case).objective == pytest.approx(expected, abs=1e-6)


def dead_island(outage: str, **unit: Any) -> Case:
    """Bus 2 has a load and a generator that cannot form a grid; bus 1 has the grid."""
    return small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        outages=[outage],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": SHED}],
        generator=[
            {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 1.0, "grid_forming": False, **unit}
        ],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 3.0}],
    )


@pytest.mark.parametrize(
    "unit",
    [
        {},
        {"p_min_mw": 0.5},
        {"ramp_down_mw_per_h": 0.1, "initial_on": True, "p_initial_mw": 1.0},
        {"min_up_h": 9.0, "initial_on": True, "initial_hours": 1.0},
    ],
    ids=["plain", "committed", "ramped", "minimum up time"],
)
def test_a_dead_island_takes_every_generator_down_and_sheds_all(unit: dict[str, Any]) -> None:
    found = case_optimum(dead_island("1-2@02:00-04:00", **unit))
    assert found["generator.p"][0] == pytest.approx([1.0, 1.0, 0.0, 0.0])
    assert found["load.shed"][0] == pytest.approx([0.0, 0.0, 1.0, 1.0])


@pytest.mark.parametrize("min_down_h", [0.0, 2.0])
def test_a_unit_that_a_dead_island_stopped_owes_no_more_up_time(min_down_h: float) -> None:
    # Dead for the second hour. It had 4 hours to run, and nothing to run for afterwards: it costs
    # no-load for the first hour alone (and could not start again for another hour).
    unit = {
        "min_up_h": 4.0,
        "initial_on": True,
        "initial_hours": 0.0,
        "no_load_cost_per_h": 10.0,
        "min_down_h": min_down_h,
    }
    found = case_optimum(dead_island("1-2@01:00-02:00", **unit))
    assert found["generator.on"][0].tolist() == [1.0, 0.0, 0.0, 0.0]
