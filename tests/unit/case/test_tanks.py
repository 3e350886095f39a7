"""Tanks in case files: what may be said of fuel, what is refused, and that it comes back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.case import Case, case_text, load_case
from resilience.case.checks.remarks import remarks
from resilience.errors import CaseError, UsageError
from resilience.testing import small_case
from resilience.testing.cases import MIDNIGHT

UNIT = {"p_max_mw": 2.0, "p_min_mw": 0.5, "cost_per_mwh": 10.0}
STRAIGHT = UNIT | {"tank": "tank1", "fuel_m3_per_mwh": 0.25}
CURVE = [[0.5, 0.2], [1.0, 0.3], [2.0, 0.6]]
DELIVERY = [{"hour": 1.0, "amount_m3": 0.5}, {"time": MIDNIGHT.replace(hour=2), "amount_m3": 1.0}]


def case_with(unit: dict[str, Any] | None = None, **tank: Any) -> Case:
    return small_case(
        slots=4,
        tanks=[{"capacity_m3": 3.0, **tank}],
        generator=[unit or STRAIGHT],
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 20.0}],
    )


def mistakes(make: Callable[[], Case]) -> dict[str, str]:
    """By table and key, what was found."""
    with pytest.raises(CaseError) as caught:
        make()
    return {f"{m.table} {m.key}": m.value for m in caught.value.mistakes}


def test_a_tank_is_full_unless_said_otherwise() -> None:
    (tank,) = case_with().tank
    assert tank.initial_m3 == 3.0
    assert case_with(initial_m3=0.0).tank[0].initial_m3 == 0.0


def test_deliveries_are_rates_of_their_slots() -> None:
    """15-minute slots: 0.5 m³ within one are 2 m³/h; at 02:05 they can be used from 02:15 on."""
    late = [*DELIVERY, {"time": MIDNIGHT.replace(hour=2, minute=5), "amount_m3": 0.25}]
    case = small_case(
        slots=16,
        step_min=15.0,
        tanks=[{"capacity_m3": 3.0, "delivery": late}],
        generator=[STRAIGHT],
    )
    rate = case.profile("deliveries to tank1")
    np.testing.assert_array_equal(np.flatnonzero(rate), [4, 8, 9])
    np.testing.assert_allclose(rate[[4, 8, 9]], [2.0, 4.0, 1.0])


def test_hours_count_from_a_new_start_and_times_stay() -> None:
    moved = case_with(delivery=DELIVERY).replace(start=MIDNIGHT.replace(hour=1))
    np.testing.assert_allclose(moved.profile("deliveries to tank1"), [0.0, 1.5, 0.0, 0.0])


@pytest.mark.parametrize("unit", [STRAIGHT, UNIT | {"tank": "tank1", "fuel_curve": CURVE}])
def test_a_case_with_tanks_comes_back_from_its_text(unit: dict[str, Any], tmp_path: Path) -> None:
    case = case_with(unit, initial_m3=1.0, delivery=DELIVERY)
    path = tmp_path / "small.toml"
    path.write_text(case_text(case), encoding="utf-8")
    again = load_case(path)
    assert again.equals(case)
    assert not again.equals(case.with_tank("tank1", initial_m3=2.0))


def test_a_variant_changes_a_tank_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(case_text(case_with()), encoding="utf-8")
    text = 'extends = "base.toml"\ntank = [{ name = "tank1", initial_m3 = 0.5 }]\n'
    (tmp_path / "low.toml").write_text(text, encoding="utf-8")
    (tank,) = load_case(tmp_path / "low.toml").tank
    assert (tank.capacity_m3, tank.initial_m3) == (3.0, 0.5)


def test_with_tank_names_what_there_is() -> None:
    case = case_with()
    assert case.with_tank("tank1", capacity_m3=4.0).tank[0].capacity_m3 == 4.0
    with pytest.raises(UsageError, match="no \\[\\[tank\\]\\] 'tank2'"):
        case.with_tank("tank2", capacity_m3=4.0)
    with pytest.raises(UsageError, match="has no key 'capacity'"):
        case.with_tank("tank1", capacity=4.0)


WRONG: dict[str, tuple[dict[str, Any], str, str]] = {
    "unknown tank": (STRAIGHT | {"tank": "tonk1"}, "tank", '"tonk1"'),
    "no fuel": (UNIT | {"tank": "tank1"}, "fuel_m3_per_mwh", "nothing"),
    "no slope": (
        UNIT | {"tank": "tank1", "fuel_no_load_m3_per_h": 0.1},
        "fuel_m3_per_mwh",
        "nothing",
    ),
    "no tank": (UNIT | {"fuel_m3_per_mwh": 0.25}, "fuel_m3_per_mwh", "0.25"),
    "curve without tank": (UNIT | {"fuel_curve": CURVE}, "fuel_curve", "a curve"),
    "both": (STRAIGHT | {"fuel_curve": CURVE}, "fuel_m3_per_mwh", "0.25"),
    "bends down": (
        UNIT | {"tank": "tank1", "fuel_curve": [[0.5, 0.2], [1.0, 0.4], [2.0, 0.6]]},
        "fuel_curve",
        "0.2 m³/MWh behind point 2, 0.4 before it",
    ),
    "falls": (
        UNIT | {"tank": "tank1", "fuel_curve": [[0.5, 0.2], [1.0, 0.1], [2.0, 0.6]]},
        "fuel_curve",
        "m3_per_h = 0.2, 0.1, 0.6",
    ),
    "short": (
        UNIT | {"tank": "tank1", "fuel_curve": [[0.5, 0.2], [1.0, 0.4]]},
        "fuel_curve",
        "p_mw = 0.5, 1",
    ),
    "back": (
        UNIT | {"tank": "tank1", "fuel_curve": [[0.5, 0.2], [0.5, 0.3], [2.0, 0.4]]},
        "fuel_curve",
        "p_mw = 0.5, 0.5, 2",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_a_generator_says_of_fuel_is_checked(name: str) -> None:
    unit, key, value = WRONG[name]
    assert mistakes(lambda: case_with(unit)) == {f"[[generator]] generator1 {key}": value}


def test_all_mistakes_of_tanks_are_told_together() -> None:
    deliveries = [
        {"amount_m3": 1.0},
        {"hour": 1.0, "time": MIDNIGHT, "amount_m3": 1.0},
        {"hour": 1.0, "amount_m3": 1.0},
    ]
    unit = STRAIGHT | {"name": "tank1", "fuel_no_load_m3_per_h": -1.0}
    found = mistakes(lambda: case_with(unit, initial_m3=4.0, delivery=deliveries))
    assert found == {
        "[[generator]] tank1 fuel_no_load_m3_per_h": "-1",
        "[[tank]] tank1 name": '"tank1", used by [[generator]] tank1 and [[tank]] tank1',
        "[[tank]] tank1 initial_m3": "4",
        "[[tank]] tank1 delivery[1]": "neither time nor hour",
        "[[tank]] tank1 delivery[2]": "time and hour",
    }


@pytest.mark.parametrize("capacity_m3", [30_000.0, 0.001])
def test_litres_taken_for_cubic_metres_are_noticed(capacity_m3: float) -> None:
    found = mistakes(lambda: case_with(capacity_m3=capacity_m3))
    assert found == {"[[tank]] tank1 capacity_m3": f"{capacity_m3:g}"}


def test_remarks_on_tanks_and_deliveries_without_effect() -> None:
    assert not [text for text in remarks(case_with(delivery=DELIVERY)) if "tank" in text]
    idle = case_with(UNIT, delivery=[{"hour": 4.0, "amount_m3": 1.0}])
    unused, missed = [text for text in remarks(idle) if "tank" in text]
    assert unused.startswith("[[tank]] tank1: no generator burns from it")
    assert missed.startswith("[[tank]] tank1 delivery[1]: outside the horizon")


def test_a_remark_on_units_that_form_an_island_with_an_empty_tank() -> None:
    free = STRAIGHT | {"p_min_mw": 0.0}
    (text,) = [text for text in remarks(case_with(free)) if "tank" in text]
    assert text.startswith("[[generator]] generator1: burns nothing at no load")
    for unit in (free | {"fuel_no_load_m3_per_h": 0.01}, free | {"start_cost": 1.0}):
        assert not [text for text in remarks(case_with(unit)) if "tank" in text]
