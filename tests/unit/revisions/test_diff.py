"""A difference says what was changed in a case, and nothing that was not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import resilience as rs
from resilience.revisions.cases import case_changes
from resilience.text.console import plain_console
from resilience.text.revision import print_diff
from tests.unit.pages.results import data_of, two_islands
from tests.unit.plots.stormy import chain, cut


@pytest.fixture(scope="module")
def larger() -> rs.Plan:
    """Storage of 1.25 MW charges 2 MWh, so that nothing is shed any more."""
    case = rs.load_case("analytic/two-islands")
    return rs.solve(case.with_ess("ess", p_max_mw=1.25, p_min_mw=-1.25), "lp")


@pytest.fixture(scope="module")
def difference(larger: rs.Plan) -> rs.RunDiff:
    return rs.diff(two_islands(), larger)


def test_keys_that_were_changed_are_named_and_no_others(difference: rs.RunDiff) -> None:
    changed = {change.key: (change.before, change.after) for change in difference.case}
    assert changed == {
        "ess ess p_max_mw": ("1.0", "1.25"),
        "ess ess p_min_mw": ("-1.0", "-1.25"),
    }


def test_figures_are_those_on_paper(difference: rs.RunDiff) -> None:
    """0.5 MWh more from the grid at 0.3, 0.4 more through storage at 0.2, 0.4 less shed at 1.5."""
    figures = {figure.name: figure for figure in difference.figures}
    assert figures["shed"].before == pytest.approx(0.4)
    assert figures["shed"].after == pytest.approx(0.0, abs=1e-6)
    change = figures["objective"].change
    assert change == pytest.approx(0.3 * 0.5 + 0.2 * 0.4 - 1.5 * 0.4)
    by_load = {figure.name: figure.change for figure in difference.shed_by_load}
    assert by_load == {"homes": pytest.approx(-0.4)}


def test_actions_differ_where_a_unit_does_something_else(difference: rs.RunDiff) -> None:
    actions = {(action.do, action.unit): action for action in difference.actions}
    assert set(actions) == {("charge", "ess"), ("discharge", "ess"), ("shed", "homes")}
    assert actions["charge", "ess"].before == ("12:00–14:00 1 MW",)
    assert actions["charge", "ess"].after == ("12:00–14:00 1.25 MW",)
    assert actions["shed", "homes"].after == ()


def test_a_result_differs_from_itself_in_nothing(tmp_path: Path) -> None:
    two_islands().save(tmp_path / "run")
    same = rs.diff(two_islands(), tmp_path / "run")
    assert same.case == ()
    assert same.actions == ()
    assert not [figure for figure in (*same.figures, *same.shed_by_load) if figure.differs]


def test_profiles_that_differ_are_named_by_their_means() -> None:
    case = rs.load_case("ieee33")
    flat = case.with_load("load1", profile=None)
    changes = {change.key: change for change in case_changes(case, flat)}
    assert changes.keys() == {"load load1 profile", "profiles columns lv_rural1"}
    before = changes["profiles columns lv_rural1"].before
    assert before == f"96 values, mean {case.profile('lv_rural1').mean():.6g}"


def test_comparisons_are_held_against_each_other_by_method(tmp_path: Path) -> None:
    case = chain()
    rs.compare(case, ["idle", "rule"], days=1, scenarios=cut(case)).save(tmp_path / "a")
    cheaper = case.with_load(case.load[0].name, shed_cost_per_mwh=25.0)
    report = rs.compare(cheaper, ["idle"], days=1, scenarios=cut(cheaper))
    report.save(tmp_path / "b")
    difference = rs.diff(tmp_path / "a", tmp_path / "b")
    figures = {figure.name: figure for figure in difference.figures}
    assert figures["idle: cost"].after == pytest.approx(report.frame().cost_per_day["idle"])
    assert figures["rule: cost"].after is None
    assert figures["rule: cost"].change is None
    assert [change.after for change in difference.case] == ["25.0"]


def test_results_of_two_kinds_are_not_held_against_each_other(tmp_path: Path) -> None:
    case = chain()
    rs.compare(case, ["idle"], days=1, scenarios=cut(case)).save(tmp_path / "a")
    with pytest.raises(rs.UsageError, match="is a comparison, after a plan; allowed: two of one"):
        rs.diff(tmp_path / "a", two_islands())


def test_text_json_and_page_say_the_same(
    difference: rs.RunDiff, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    print_diff(difference, plain_console())
    printed = capsys.readouterr().out
    page = rs.write_page(difference, tmp_path / "diff.html").read_text(encoding="utf-8")
    summary = difference.summary()
    assert data_of(page, "summary") == json.loads(json.dumps(summary))
    for words in ("ess ess p_max_mw", "charge ess", "homes", "objective", "-0.3700"):
        assert words in printed
        assert words in page
