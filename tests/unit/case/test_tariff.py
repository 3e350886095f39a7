"""Prices by time of day: from the case file to the profile and the model."""

from datetime import datetime

import numpy as np
import pytest

import resilience as rs
from resilience.case import case_text, load_case
from resilience.errors import CaseError

PRICE = "import_cost_per_mwh = 50.0\n"
TARIFF = 'tariff = [["00:00", 10], ["00:30", 30.0], ["17:00", 60]]\n'
NAME = "tariff of grid"


def mistakes_of(path):
    with pytest.raises(CaseError) as error:
        load_case(path)
    return error.value.mistakes


def with_tariff(case_file, tariff=TARIFF, *changes, profile=""):
    old = ('price_profile = "price"\n', profile)
    unused = () if profile else (("price = [1, 1, 2, -1]\n", ""),)
    return case_file((PRICE, tariff), old, *unused, *changes)


def test_a_tariff_becomes_a_profile_per_mwh(case_file):
    case = load_case(with_tariff(case_file))
    np.testing.assert_array_equal(case.profile(NAME), [10, 10, 30, 30])
    assert case.grid[0].import_price == (1.0, NAME)
    assert case.grid[0].export_price == (0.0, None)
    assert not case.profile(NAME).flags.writeable


def test_a_price_profile_multiplies_the_tariff(case_file):
    case = load_case(with_tariff(case_file, profile='price_profile = "price"\n'))
    np.testing.assert_array_equal(case.profile(NAME), [10, 10, 60, -30])


def test_a_tariff_replaces_the_price_of_a_base(case_file):
    case_file(name="base.toml")
    case = load_case(case_file(text=f'extends = "base"\n[[grid]]\n{TARIFF}'))
    assert case.grid[0].import_cost_per_mwh == 50.0
    assert case.grid[0].import_price == (1.0, NAME)


def test_exports_may_follow_the_tariff(case_file):
    case = load_case(with_tariff(case_file, TARIFF + "export_tariff_factor = -1\n"))
    assert case.grid[0].export_price == (-1.0, NAME)


def test_a_constant_tariff_costs_what_the_price_does(case_file):
    export = "export_max_mw = 5.0\n"
    flat = case_file((PRICE, f"{PRICE}export_cost_per_mwh = -50.0\n{export}"), name="flat.toml")
    tariff = 'tariff = [["00:00", 50.0]]\nexport_tariff_factor = -1.0\n'
    timed = case_file((PRICE, tariff + export), name="timed.toml")
    costs = [rs.solve(load_case(path), method="lp").objective for path in (flat, timed)]
    assert costs[0] == pytest.approx(costs[1], abs=1e-9)


def test_a_price_that_changes_within_a_slot_is_averaged(case_file):
    changes = ("slots = 4", "slots = 3"), ("step_min = 15", "step_min = 20"), ("00:45", "00:40")
    case = load_case(with_tariff(case_file, TARIFF, *changes))
    np.testing.assert_allclose(case.profile(NAME), [10, 20, 30])


def test_a_tariff_holds_on_every_day_of_a_horizon():
    case = load_case("ieee33-tou")
    moved = case.replace(start=datetime(2016, 8, 1, 16, 45), slots=3 * 96)
    prices = moved.profile(NAME)
    assert prices[:2].tolist() == [0.3, 0.6]
    np.testing.assert_array_equal(prices[:96], prices[192:])
    hours = [np.count_nonzero(prices == p) / 12 for p in (0.1, 0.3, 0.6)]
    assert hours == [8, 11, 5]


def test_a_written_case_has_the_tariff_and_not_its_profile(case_file, tmp_path):
    case = load_case(with_tariff(case_file))
    text = case_text(case)
    assert NAME not in text
    path = tmp_path / "written.toml"
    path.write_text(text)
    assert load_case(path).equals(case)


@pytest.mark.parametrize(
    ("tariff", "key", "value", "hint"),
    [
        ('[["06:00", 1.0]]', "tariff", "06:00", "begin with the price at midnight"),
        ("[]", "tariff", "no times", "begin with the price at midnight"),
        ('[["00:00", 1], ["9:00", 2]]', "tariff[2]", '"9:00"', "two digits"),
        ('[["00:00", 1], ["24:00", 2]]', "tariff[2]", '"24:00"', "two digits"),
        ('[["00:00", 1], ["17:00", 2], ["06:00", 3]]', "tariff", "00:00, 17:00, 06:00", "sort"),
        ('[["00:00", 1], ["00:00", 2]]', "tariff", "00:00, 00:00", "sort"),
        ('[["00:00", 2e6]]', "tariff[1]", "2e+06", "per MWh"),
        ('[["00:00", "1"]]', "tariff[1][2]", '"1"', "remove the quotes"),
        ("0.3", "tariff", "0.3", "time of day"),
    ],
)
def test_a_wrong_tariff_is_named(case_file, tariff, key, value, hint):
    [problem] = mistakes_of(with_tariff(case_file, f"tariff = {tariff}\n"))
    assert problem.table == "[[grid]] grid"
    assert (problem.key, problem.value) == (key, value)
    assert hint in problem.hint


def test_imports_need_a_price(case_file):
    [problem] = mistakes_of(case_file((PRICE, "")))
    assert (problem.key, problem.value) == ("import_cost_per_mwh", "nothing")
    assert "tariff" in problem.hint


def test_exports_can_only_follow_a_tariff_that_is_there(case_file):
    [problem] = mistakes_of(case_file((PRICE, PRICE + "export_tariff_factor = 1\n")))
    assert problem.key == "export_tariff_factor"
    assert "add tariff" in problem.hint


def test_a_default_tariff_serves_every_grid(case_file):
    path = case_file((PRICE, ""), ("[defaults.load]", f"[defaults.grid]\n{TARIFF}[defaults.load]"))
    np.testing.assert_array_equal(load_case(path).profile(NAME), [10, 10, 60, -30])
