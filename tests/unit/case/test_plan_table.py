"""`[plan]` and `[[line]] harden`: what may be built, and what is wrong with how it is said."""

from __future__ import annotations

from typing import Any

import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.case.write import case_text
from resilience.errors import CaseError, UsageError
from resilience.planning.hardening.options import options_of
from tests.fuzz.full_case import stormy_case

FALLIBLE = ("1-2", "2-3", "3-4")


def case_with(plan: dict[str, Any], **line: Any) -> Case:
    import copy

    data = copy.deepcopy(stormy_case())
    data["plan"] = plan
    data["line"][0].pop("harden")
    data["line"][0] |= line
    return build_case(Document(None, data))


def test_lines_say_their_options_or_take_those_of_the_plan() -> None:
    common = [{"factor": 1.5, "cost": 40.0}]
    line = [{"factor": 1.4, "cost": 30.0}, {"underground": True, "cost": 200.0}]
    case = case_with({"budget": 1000.0, "harden": common}, harden=line)
    assert case.plan is not None
    assert case.plan.budget == 1000.0
    named = next(table.name for table in case.line if table.harden)
    options = options_of(case, [named, "3-4"])
    assert [(o.line, o.label, o.cost) for o in options] == [
        (named, f"{named} x1.4", 30.0),
        (named, f"{named} underground", 200.0),
        ("3-4", "3-4 x1.5", 40.0),
    ]
    assert [o.label for o in options_of(case, FALLIBLE, factor=2.0, lines=["3-4"])] == ["3-4 x2"]


def test_a_written_case_keeps_its_plan(tmp_path: Any) -> None:
    case = case_with({"budget": 1000.0, "harden": [{"underground": True, "cost": 40.0}]})
    path = tmp_path / "written.toml"
    path.write_text(case_text(case), "utf-8")
    assert rs.load_case(path).equals(case)
    assert not case.equals(case.replace(plan={"budget": 900.0}))


WRONG = {
    "neither": ([{"cost": 1.0}], "neither of them"),
    "both": ([{"factor": 1.5, "underground": True, "cost": 1.0}], "factor and underground"),
    "twice": ([{"factor": 1.5, "cost": 1.0}, {"factor": 1.5, "cost": 2.0}], "twice"),
    "weaker": ([{"factor": 0.9, "cost": 1.0}], "greater than 1"),
    "free money": ([{"factor": 1.5, "cost": -1.0}], "0 or more"),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("place", ["plan", "line"])
def test_what_is_wrong_with_an_option_is_said(name: str, place: str) -> None:
    options, words = WRONG[name]
    plan, line = ({"harden": options}, {}) if place == "plan" else ({}, {"harden": options})
    with pytest.raises(CaseError, match="harden") as caught:
        case_with(plan, **line)
    assert words in str(caught.value)


def test_cables_and_switches_have_no_options() -> None:
    options = [{"factor": 1.5, "cost": 1.0}]
    for key in ("underground", "switchable"):
        with pytest.raises(CaseError, match="harden"):
            case_with({}, harden=options, **{key: True})


def test_nothing_to_choose_is_an_error() -> None:
    case = case_with({})
    with pytest.raises(UsageError, match="nothing to build"):
        options_of(case, FALLIBLE)
    with pytest.raises(UsageError, match="9-9 cannot be strengthened"):
        options_of(case, FALLIBLE, factor=1.5, lines=["9-9"])
    with pytest.raises(UsageError, match="factor 1"):
        options_of(case, FALLIBLE, factor=1.0)


def test_options_are_read_beside_another_mistake() -> None:
    """A wrong key of the same table leaves its options tables, and their mistakes are said, too."""
    with pytest.raises(CaseError) as caught:
        case_with({}, harden=[{"cost": 1.0}], rating_mva=-1.0)
    assert "rating_mva" in str(caught.value)
    assert "neither of them" in str(caught.value)
