"""Folders that earlier versions saved load, and are written again to the letter, with a kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
from resilience.case import case_text
from resilience.testing import small_case

PLAN: dict[str, Any] = {
    "name": "small",
    "method": "lp",
    "physics": "lindistflow",
    "status": "feasible",
    "objective": 7.5,
    "operating_cost": 8.0,
    "terminal_credit": 0.5,
    "bound": None,
    "gap": None,
    "bound_of": "lindistflow",
    "relaxed": ["ess: 1 of 2 mode elements are in two modes at once"],
    "notes": ["the time limit ended the search; this is the best plan found"],
    "not_modelled": [],
    "audit": {"balance.p": 0.0, "ess": 0.25},
    "audit_worst": "ess[ess1, 00:00]",
    "costs": {"grid.import": 8.0},
    "energy_mwh": {"demand": 4.0, "shed": 0.0, "import": 4.0, "losses": 0.0},
    "shed_mwh": 0.0,
    "shed_by_load": {"load1": {"power": 0.5}},
    "shed_causes": {},
    "outages": ["1-2@00:00-01:00"],
    "start": "2016-07-12T00:00:00",
    "step_min": 60.0,
    "seconds": 0.75,
    "seconds_by_phase": {"case": 0.25, "model": 0.5},
}
"""`summary.json` of version 0.1."""

SCENARIO_PLAN: dict[str, Any] = {
    "name": "small",
    "method": "stochastic",
    "physics": "copperplate",
    "algorithm": "extensive form",
    "status": "optimal",
    "risk": "expected cost",
    "objective": 8.0,
    "expected_cost": 8.0,
    "cvar_95_cost": 9.5,
    "worst_cost": 9.5,
    "bound": 7.75,
    "gap": 0.03125,
    "bound_of": "two-stage program on copperplate",
    "clairvoyant_cost": 7.75,
    "mean_value_cost": None,
    "value_of_stochastic_solution": None,
    "value_of_perfect_information": 0.25,
    "expected_operating_cost": 8.5,
    "expected_terminal_credit": 0.5,
    "expected_shed_mwh": 0.25,
    "shed_probability": 0.5,
    "scenarios": 2,
    "different": 2,
    "seed": None,
    "process": "",
    "common_slots": 1,
    "half_left_at": "2016-07-12T01:00:00",
    "relaxed": [],
    "notes": [],
    "not_modelled": [],
    "audit": {"balance.p": 0.0},
    "audit_worst": "balance.p[1, 00:00] in scenario 1",
    "start": "2016-07-12T00:00:00",
    "step_min": 60.0,
    "seconds": 0.75,
    "seconds_by_phase": {"case": 0.25, "model": 0.5},
}
"""The same of a plan over scenarios."""


GRID = {"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}


def written(folder: Path, summary: dict[str, Any]) -> str:
    """Writes a summary as an earlier version did, and gives it as it is today."""
    later = ("not_modelled", "shed_causes")
    earlier = {key: value for key, value in summary.items() if key not in later}
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps(earlier, indent=2) + "\n", encoding="utf-8")
    return json.dumps(summary, indent=2) + "\n"


def of_kind(kind: str, text: str) -> str:
    """A summary of an earlier version, which did not say what it is of."""
    return text.replace("{\n", f'{{\n  "kind": "{kind}",\n', 1)


def test_a_plan_of_an_earlier_version_loads(tmp_path: Path) -> None:
    text = written(tmp_path / "old", PLAN)
    plan = rs.load_plan(tmp_path / "old")
    assert list(plan.summary()) == list(PLAN)
    for key, value in PLAN.items():
        assert getattr(plan, key) == value, key
    assert plan.case is None
    plan.save(tmp_path / "new")
    assert (tmp_path / "new" / "summary.json").read_text(encoding="utf-8") == of_kind("plan", text)


def test_a_plan_over_scenarios_of_an_earlier_version_loads(tmp_path: Path) -> None:
    folder = tmp_path / "old"
    text = written(folder, SCENARIO_PLAN)
    case = small_case(buses=2, lines=[(1, 2, 0.0, 0.0)], grid=[GRID])
    (folder / "case.toml").write_text(case_text(case), encoding="utf-8")
    down = np.array([[[False, False], [True, False]]])
    rs.Scenarios(("1-2",), down, np.array([0.5, 0.5])).save(folder / "outages.npz")
    pd.DataFrame({"probability": [0.5, 0.5], "cost": [9.5, 6.5]}).to_parquet(
        folder / "scenarios.parquet"
    )
    pd.DataFrame({"grid1": [1.0, 2.0, 3.0, 4.0]}).to_parquet(folder / "recourse.parquet")
    pd.DataFrame({"probability": [1.0]}).to_parquet(folder / "staying.parquet")
    plan = rs.load_scenario_plan(folder)
    assert list(plan.summary()) == list(SCENARIO_PLAN)
    for key, value in SCENARIO_PLAN.items():
        assert getattr(plan, key) == value, key
    np.testing.assert_array_equal(plan.recourse[1], [[[1.0, 3.0], [2.0, 4.0]]])
    np.testing.assert_array_equal(plan.tables["staying"]["probability"], [1.0])
    plan.save(tmp_path / "new")
    again = (tmp_path / "new" / "summary.json").read_text(encoding="utf-8")
    assert again == of_kind("plan over scenarios", text)


def test_a_summary_with_a_key_too_many_is_none_of_a_plan(tmp_path: Path) -> None:
    written(tmp_path / "run", PLAN | {"weather": "fine"})
    with pytest.raises(rs.UsageError, match="another kind of result"):
        rs.load_plan(tmp_path / "run")


@pytest.mark.parametrize(
    "wrong",
    [
        {"seconds_by_phase": {"case": "0.25"}},
        {"audit": {"balance.p": -np.inf}},
        {"audit": {"balance.p": np.nan}},
        {"objective": np.nan},
        {"operating_cost": "8.0"},
        {"costs": {"grid.import": np.nan}},
        {"shed_by_load": {"load1": {"power": "9" * 400}}},
    ],
)
def test_a_number_of_a_summary_is_a_number(tmp_path: Path, wrong: dict[str, Any]) -> None:
    """No text that looks like one, and none that JSON cannot hold."""
    written(tmp_path / "run", PLAN | wrong)
    with pytest.raises(rs.UsageError):
        rs.load_plan(tmp_path / "run")


def test_a_plan_knows_how_long_it_took() -> None:
    plan = rs.solve(small_case(grid=[GRID]), "lp")
    assert list(plan.seconds_by_phase) == ["case", "model", "linear program", "tie-break", "audit"]
    assert plan.seconds == sum(plan.seconds_by_phase.values()) > 0.0


def test_a_folder_says_what_is_in_it(tmp_path: Path) -> None:
    """Every file is named in its README, and a unit stands beside every table."""
    plan = rs.solve("ieee33", "lp")
    assert isinstance(plan, rs.Plan)
    over = rs.solve("ieee33-tou", "stochastic", scenarios=4)
    assert isinstance(over, rs.ScenarioPlan)
    report = rs.compare("ieee33-tou", ["rule"], days=1, draws=2)
    for name, result in (("plan", plan), ("over", over), ("report", report)):
        folder = result.save(tmp_path / name)
        text = (folder / "README.md").read_text(encoding="utf-8")
        for path in folder.iterdir():
            if path.name != "README.md":
                assert path.stem in text, path.name
    text = (tmp_path / "plan" / "README.md").read_text(encoding="utf-8")
    assert "- `energy.csv, energy.parquet`: MWh stored at the end of the slot" in text
    text = (tmp_path / "report" / "README.md").read_text(encoding="utf-8")
    assert "- `asidi_h_per_day`: hours without supply of the average MW" in text
    for table in ("report", "differences", "per_episode", "per_day"):
        named = text.partition(f"Columns of `{table}`:")[2].partition("Columns of")[0]
        for column in pd.read_parquet(tmp_path / "report" / f"{table}.parquet"):
            assert f"- `{column}`: " in named, (table, column)
