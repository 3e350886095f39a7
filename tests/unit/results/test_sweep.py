"""Sweeps and scenarios from Python: what loops and the command line would give."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
import resilience.fragility
import resilience.rl
from resilience.fragility import expected_moments, moments
from resilience.fragility.draw import draw
from resilience.testing import small_case

LOAD: dict[str, Any] = {"p_max_mw": 2.0, "shed_cost_per_mwh": 1000.0}
GRID: dict[str, Any] = {"import_max_mw": 1.5, "import_cost_per_mwh": 40.0}
UNIT: dict[str, Any] = {"p_max_mw": 1.0, "e_mwh": 1.0, "soc_initial": 1.0, "soc_min": 0.0}


def day() -> rs.Case:
    return small_case(slots=4, load=[LOAD], grid=[GRID], ess=[UNIT])


def test_a_sweep_has_a_row_per_combination() -> None:
    """Of 8 MWh the grid gives 1.5 or 1.75 an hour, and the battery what it holds."""
    table = rs.sweep(
        day(), {"ess.ess1.e_mwh": [0.5, 1.0], "grid.grid1.import_max_mw": [1.5, 1.75]}, "lp"
    )
    sizes, imports = [0.5, 0.5, 1.0, 1.0], [1.5, 1.75, 1.5, 1.75]
    assert table["ess.ess1.e_mwh"].tolist() == sizes
    assert table["grid.grid1.import_max_mw"].tolist() == imports
    lacks = 8.0 - 4.0 * np.array(imports) - sizes
    np.testing.assert_allclose(table["shed_mwh"], np.maximum(lacks, 0.0), atol=1e-9)
    assert (table["status"] == "optimal").all()


def test_workers_change_nothing() -> None:
    values: dict[str, Any] = {"ess.ess1.e_mwh": [0.5, 1.0, 2.0], "slots": [2]}
    alone, together = (rs.sweep(day(), values, "lp", workers=n) for n in (1, 2))
    pd.testing.assert_frame_equal(alone.drop(columns="seconds"), together.drop(columns="seconds"))


def test_lines_tanks_and_outages_are_swept() -> None:
    case = small_case(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        tanks=[{"capacity_m3": 1.0, "initial_m3": 0.0}],
        grid=[GRID | {"import_max_mw": 9.0}],
        generator=[
            {"bus": "2", "p_max_mw": 3.0, "cost_per_mwh": 9.0, "tank": "tank1"}
            | {"fuel_m3_per_mwh": 0.25}
        ],
        load=[LOAD | {"bus": "2"}],
    )
    rated = rs.sweep(case, {"line.1-2.rating_mva": [1.0, 9.0]}, "lp", physics="copperplate")
    np.testing.assert_allclose(rated["shed_mwh"], [2.0, 0.0], atol=1e-6)
    values: dict[str, Any] = {
        "tank.tank1.initial_m3": [0.25, 1.0],
        "outages": [["1-2@00:00-01:00"], "none"],
    }
    fuel = rs.sweep(case, values, "lp", physics="copperplate")
    np.testing.assert_allclose(fuel["shed_mwh"], [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    assert fuel["outages"].tolist() == [["1-2@00:00-01:00"], "none"] * 2


def test_where_there_is_no_plan_the_row_says_so() -> None:
    unit = UNIT | {"soc_final_min": 1.0, "soc_initial": 0.5}
    case = small_case(slots=1, load=[LOAD | {"p_max_mw": 0.1}], grid=[GRID], ess=[unit])
    table = rs.sweep(case, {"ess.ess1.e_mwh": [1.0, 9.0]}, "lp")
    assert table["status"].tolist() == ["optimal", "infeasible"]
    assert table["objective"].isna().tolist() == [False, True]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"ess.ess2.e_mwh": [1.0]}, "no .*ess2"),
        ({"ess.ess1.e_mhw": [1.0]}, "e_mwh"),
        ({"battery.ess1.e_mwh": [1.0]}, "KIND.NAME.KEY"),
        ({"ess.e_mwh": [1.0]}, "KIND.NAME.KEY"),
        ({"ess.ess1.e_mwh": 3.0}, "allowed: a list"),
        ({"ess.ess1.e_mwh": "3"}, "allowed: a list"),
        ({"ess.ess1.e_mwh": []}, "one or more"),
        ({"ess.ess1.e_mwh": [1.0, -2.0]}, "greater than 0"),
        ({"weather": [1]}, "cannot be replaced"),
    ],
)
def test_wrong_keys_are_refused_before_anything_is_solved(
    values: dict[str, Any], message: str
) -> None:
    with pytest.raises(rs.ResilienceError, match=message):
        rs.sweep(day(), values, "no such method")


def test_scenarios_are_those_of_the_command_line() -> None:
    case = rs.load_case("ieee33")
    ours = rs.scenarios("ieee33", 7, seed=3)
    known = draw(case, 7, 3)
    np.testing.assert_array_equal(ours.down, known.down)
    assert ours.lines == known.lines


def test_few_scenarios_carry_the_means_of_many() -> None:
    case = rs.load_case("ieee33")
    many, few = (rs.scenarios(case, 60, seed=1, reduce=reduce) for reduce in (None, 12))
    assert few.down.shape[-1] < many.down.shape[-1]
    assert few.probability.sum() == pytest.approx(1.0)
    means = [expected_moments(moments(case, s), s.probability) for s in (many, few)]
    assert means[1] == pytest.approx(means[0], rel=1e-6)


@pytest.mark.parametrize("package", [rs, rs.fragility, rs.rl])
def test_tab_completes_every_public_name(package: ModuleType) -> None:
    assert set(package.__all__) <= set(dir(package))
    assert all(hasattr(package, name) for name in package.__all__)
