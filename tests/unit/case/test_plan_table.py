"""`[plan]` and `[[line]] harden`: what may be built, and what is wrong with how it is said."""

from __future__ import annotations

import copy
from typing import Any

import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.case.write import case_text
from resilience.errors import CaseError, UsageError
from resilience.planning.hardening.options import options_of, strengths
from resilience.planning.hardening.sites import ties_of, units_of, with_built
from tests.fuzz.full_case import stormy_case

FALLIBLE = ("1-2", "2-3", "3-4")


def case_with(plan: dict[str, Any], **line: Any) -> Case:
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
    options = strengths(options_of(case, [named, "3-4"]))
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


SITE = {"name": "depot", "kind": "ess", "units": 2, "cost": 5.0,
        "unit": {"bus": "2", "p_max_mw": 0.1, "e_mwh": 0.2}}  # fmt: skip


def test_sites_offer_units_after_lines(tmp_path: Any) -> None:
    roof = {"name": "barn", "kind": "pv", "cost": 3.0, "life_years": 20.0,
            "unit": {"bus": "3", "p_max_mw": 0.1, "profile": "sun"}}  # fmt: skip
    case = case_with({"life_years": 15.0, "site": [SITE, roof]})
    units = units_of(case)
    assert [o.label for o in options_of(case, FALLIBLE, factor=2.0, lines=["3-4"])] == [
        "3-4 x2", "depot 1", "depot 2", "barn",
    ]  # fmt: skip
    assert [(o.place, o.cost, o.life_years) for o in units] == [
        ("ess at 2", 5.0, 15.0), ("ess at 2", 5.0, 15.0), ("pv at 3", 3.0, 20.0),
    ]  # fmt: skip
    built = with_built(case, units)
    assert [unit.name for unit in built.ess[-2:]] == ["depot 1", "depot 2"]
    # The storm's cloud is over a plant that is built as over those that stand.
    assert {plant.profile for plant in case.pv if plant.profile} >= {built.pv[-1].profile}
    path = tmp_path / "written.toml"
    path.write_text(case_text(case), "utf-8")
    assert rs.load_case(path).equals(case)


WRONG_SITES: dict[str, tuple[dict[str, Any], str]] = {
    "nowhere": ({"bus": "nowhere"}, "a bus of the network"),
    "no bus": ({"bus": None}, "bus"),
    "named twice": ({"name": "x"}, "the site has the name"),
    "kilowatts": ({"e_mwh": 2000.0}, "kWh or kW"),
    "fails": ({"mttf_h": 100.0}, "can_fail"),
    "final": ({"soc_final_min": 0.1}, "soc_final_min"),
    "unknown": ({"size": 0.1}, "size"),
}


@pytest.mark.parametrize("name", WRONG_SITES)
def test_what_is_wrong_with_a_site_is_said(name: str) -> None:
    changes, words = WRONG_SITES[name]
    unit = {k: v for k, v in (SITE["unit"] | changes).items() if v is not None}  # type: ignore[operator]
    with pytest.raises(CaseError, match="depot") as caught:
        case_with({"site": [SITE | {"unit": unit}]})
    assert words in str(caught.value)


def test_a_site_has_a_name_of_its_own_and_a_kind_that_can_be_built() -> None:
    with pytest.raises(CaseError, match="a name used once"):
        case_with({"site": [SITE, SITE]})
    with pytest.raises(CaseError, match="kind"):
        case_with({"site": [SITE | {"kind": "load"}]})
    unit = {"bus": "2", "p_max_mw": 0.4, "p_min_mw": 0.1}
    with pytest.raises(CaseError, match="needs_commitment"):
        case_with({"site": [SITE | {"kind": "generator", "unit": unit}]})


def test_a_tie_is_an_open_line_without_a_switch() -> None:
    tie = {"from": "2", "to": "4", "r_ohm": 0.8, "x_ohm": 0.5, "in_service": False}
    data = copy.deepcopy(stormy_case())
    data["network"]["line"].append(tie)
    data["line"].append({"name": "2-4", "tie_cost": 3.0})
    case = build_case(Document(None, data))
    (option,) = ties_of(case)
    assert (option.label, option.cost, option.life_years) == ("tie 2-4", 3.0, 40.0)
    built = with_built(case, [option]).network
    assert built.switchable[built.line("2-4")]
    assert not built.in_service[built.line("2-4")]
    for name in ("1-2", "4-1"):
        with pytest.raises(CaseError, match="open line without switch"):
            case.with_line(name, tie_cost=3.0)
