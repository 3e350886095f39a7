"""Remarks about cases that are valid and may not be meant."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import pytest

import resilience as rs
from resilience.case.checks.remarks import remarks
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.case.networks.omissions import Omission
from resilience.testing import small_case

GRID = {"import_max_mw": 2.0, "import_cost_per_mwh": 40.0}


def test_a_forming_unit_without_reactive_power_is_named() -> None:
    loads = [{"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0, "power_factor": 0.9}]
    storage = [{"p_max_mw": 1.0, "e_mwh": 2.0}, {"p_max_mw": 1.0, "e_mwh": 2.0, "s_mva": 1.2}]
    diesel = [{"p_max_mw": 1.0}, {"p_max_mw": 1.0, "grid_forming": False}]
    (words,) = remarks(small_case(load=loads, ess=storage, generator=diesel))
    assert words.startswith(
        "[[ess]] ess1, [[generator]] generator1: grid-forming without s_mva or q_max_mvar"
    )
    assert "\nhint: " in words


def test_loads_without_reactive_power_need_none() -> None:
    loads = [{"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}]
    assert remarks(small_case(load=loads, ess=[{"p_max_mw": 1.0, "e_mwh": 2.0}])) == []


def test_energy_that_is_worth_nothing_is_named_unless_that_is_said() -> None:
    """A unit that has to keep some at the end is none of it."""
    plain = {"p_max_mw": 0.7, "e_mwh": 2.5}
    case = small_case(ess=[plain, plain | {"soc_final_min": 0.3}, plain | {"e_mwh": 1.7}])
    assert remarks(case) == []  # it says terminal_value_per_mwh = 0
    silent = {k: v for k, v in case.source.items() if k != "terminal_value_per_mwh"}
    (words,) = remarks(build_case(Document(None, silent)))
    assert words.startswith("[[ess]] ess1, [[ess]] ess3: stored energy is worth nothing at the end")
    assert "\nhint: give terminal_value_per_mwh" in words
    worth = silent | {"terminal_value_per_mwh": 3.0}
    assert remarks(build_case(Document(None, worth))) == []
    kept = silent | {"ess": [{**t, "soc_final_min": 0.2} for t in silent["ess"]]}
    assert remarks(build_case(Document(None, kept))) == []


@pytest.mark.parametrize("name", ["ieee33", "ieee33-commitment", "large"])
def test_installed_cases_are_as_they_are_meant(name: str) -> None:
    assert remarks(rs.load_case(name)) == []


def test_a_sun_at_midnight_is_named_unless_it_is_day_or_has_to_be_taken() -> None:
    plant = {"p_max_mw": 0.7, "curtailable": True}
    night = small_case(slots=3, ess=[], pv=[plant, {**plant, "p_max_mw": 0.4}], grid=[GRID])
    [words] = remarks(night)
    assert words.startswith("2 plants without a profile: the sun shines at night as by day\nhint: ")
    noon = datetime(2016, 7, 12, 11)
    assert remarks(small_case(slots=3, start=noon, pv=[plant], grid=[GRID])) == []
    assert remarks(small_case(pv=[{**plant, "curtailable": False}], grid=[GRID])) == []
    sunny = {**plant, "profile": "sun"}
    profiles = {"sun": [0.2, 0.3]}
    assert remarks(small_case(pv=[sunny], profiles=profiles, grid=[GRID])) == []


def test_what_of_the_network_is_not_modelled_is_named() -> None:
    case = replace(small_case(grid=[GRID]), omissions=(Omission("tap", ("1-2", "2-3")),))
    [words] = remarks(case)
    assert words.startswith("not modelled: 2 taps (1-2, 2-3)\nhint: ")


def test_a_hundred_units_are_counted_not_listed() -> None:
    case = small_case(ess=[{"p_max_mw": 0.7, "e_mwh": 2.5 + k} for k in range(11)])
    silent = {k: v for k, v in case.source.items() if k != "terminal_value_per_mwh"}
    (words,) = remarks(build_case(Document(None, silent)))
    assert words.startswith("[[ess]] ess1, ")
    assert ", [[ess]] ess8, ... (11 in all): stored energy" in words
