"""What notebooks and terminals show of results, and workbooks."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
from resilience.testing import small_case
from resilience.text.console import plain_console
from resilience.text.plan import print_plan

NASTY = "<script>alert('x')</script>"
LOAD: dict[str, Any] = {"p_max_mw": 2.0, "shed_cost_per_mwh": 1000.0}
GRID: dict[str, Any] = {"import_max_mw": 1.5, "import_cost_per_mwh": 40.0}


@pytest.fixture(scope="module")
def plan() -> rs.Plan:
    """6 of 8 MWh are imported at 40 $, 2 shed at 1000 $; the store is empty."""
    case = small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.01, 0.01, {"name": NASTY})],
        load=[LOAD | {"name": f"=SUM({NASTY})"}],
        grid=[GRID],
        outages=[f"{NASTY}@01:00-02:00"],
    )
    return rs.solve(case.replace(name=NASTY), "lp")


def results(plan: rs.Plan) -> dict[str, object]:
    drawn = rs.Scenarios((NASTY, "1-2"), np.ones((2, 4, 3), bool), np.array([0.5, 0.25, 0.25]))
    assert plan.case is not None
    return {"Plan": plan, "Case": plan.case, "Scenarios": drawn}


def test_a_plan_is_one_short_line_with_its_numbers(plan: rs.Plan) -> None:
    assert repr(plan) == (
        f"<Plan {NASTY}: method lp on lindistflow, status optimal, objective 2240.0000 $, "
        "gap 0.0000 %, shed 2 MWh>"
    )
    assert repr(plan.case) == (
        f"<Case {NASTY}: buses 2, lines 1, devices 1 load, 1 grid, "
        "slots 4 of 60 min from 2016-07-12 00:00>"
    )


@pytest.mark.parametrize("kind", ["Plan", "Case", "Scenarios"])
def test_html_escapes_every_name(plan: rs.Plan, kind: str) -> None:
    html = results(plan)[kind]._repr_html_()  # type: ignore[attr-defined]
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    assert len(html) < 6000
    assert html.count("<div>") == html.count("</div>")


def test_a_real_case_is_short() -> None:
    case = rs.load_case("ieee33")
    assert len(repr(case)) < 200
    assert "33" in repr(case)
    assert "5 ess" in case._repr_html_()


def test_scenarios_say_how_many_lines_they_take(plan: rs.Plan) -> None:
    drawn = rs.Scenarios(("a", "b"), np.zeros((2, 4, 2), bool), np.array([0.75, 0.25]))
    drawn.down[0, 1, 0] = drawn.down[1, :, 1] = drawn.down[0, 2, 1] = True
    assert (
        repr(drawn)
        == "<Scenarios outages: scenarios 2, slots 4, lines a, b, lines down 1.25 expected>"
    )


def test_print_is_what_the_command_line_prints(
    plan: rs.Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    plan.print(width=100, with_schedule=True)
    printed = capsys.readouterr().out
    known = io.StringIO()
    print_plan(plan, plain_console(file=known, width=100), with_schedule=True)
    assert printed == known.getvalue()
    assert "Shed: 2.000 MWh" in printed
    assert plan.case is not None
    plan.case.print()
    assert "2 buses, 1 closed lines" in capsys.readouterr().out
    with pytest.raises(rs.UsageError, match="a Scenarios has no report"):
        results(plan)["Scenarios"].print()  # type: ignore[attr-defined]


def test_a_notebook_is_shown_the_text_of_a_terminal_without_colours(
    plan: rs.Plan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert not plain_console().is_jupyter
    plan.print(width=100)
    printed = capsys.readouterr().out
    assert "objective 2240.0000 $" in printed
    assert "\x1b" not in printed


def test_reports_hazards_and_plans_over_scenarios_are_shown() -> None:
    case = rs.load_case("ieee33")
    report = rs.compare(case, ["rule"], days=1, draws=2)
    assert repr(report).startswith("<Report ieee33: methods ")
    assert "1 day from 2016-08-31" in repr(report)
    assert "rule" in report._repr_html_()
    plan = rs.solve(case, "stochastic", scenarios=3, relative_gap=0.1)
    assert repr(plan).startswith("<ScenarioPlan ieee33: method stochastic on copperplate, ")
    storm = rs.hazard("ieee33_rammasun", n=5)
    assert repr(storm).startswith("<Hazard ieee33_rammasun: storm Rammasun, strongest wind ")
    assert "expected" in storm._repr_html_()


def test_a_workbook_holds_what_the_plan_does(plan: rs.Plan, tmp_path: Path) -> None:
    path = plan.with_prices().to_excel(tmp_path / "plan.xlsx")
    sheets = pd.read_excel(path, sheet_name=None)
    assert list(sheets)[:3] == ["summary", "units", "actions"]
    assert {"power", "shed", "bus_price"} <= set(sheets)
    summary = dict(zip(sheets["summary"]["quantity"], sheets["summary"]["value"], strict=True))
    assert float(summary["objective"]) == pytest.approx(plan.objective)
    np.testing.assert_allclose(sheets["power"]["grid1"], plan.tables["power"]["grid1"], atol=1e-12)
    load = f"=SUM({NASTY})"
    assert load in sheets["shed"].columns  # a text, not a formula
    assert load in set(sheets["actions"]["unit"])
    assert list(sheets["units"]["sheet"]) == list(sheets)[3:]
    with pytest.raises(rs.UsageError, match=r"a name in \.xlsx"):
        plan.to_excel(tmp_path / "plan.ods")
