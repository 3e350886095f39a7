"""Changing a case, and writing it down."""

from datetime import datetime

import numpy as np
import pytest

from resilience.case import Outage, case_names, case_text, load_case
from resilience.errors import CaseError, UsageError


@pytest.mark.parametrize("name", case_names())
def test_a_written_case_loads_to_the_same_from_anywhere(name, tmp_path):
    case = load_case(name)
    path = tmp_path / "case.toml"
    path.write_text(case_text(case))
    assert load_case(path).equals(case)


def test_a_written_case_resolves_bases_defaults_and_files(case_file, tmp_path):
    base = case_file(name="base.toml")
    variant = load_case(
        case_file(
            text='extends = "base"\n[[ess]]\nname = "b2"\nbus = "2"\np_max_mw = 1\ne_mwh = 3\n',
            name="variant.toml",
        )
    )
    base.unlink()
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "case.toml").write_text(case_text(variant))
    assert load_case(folder / "case.toml").equals(variant)


def test_equal_means_every_number(case_file):
    case = load_case(case_file())
    assert case.equals(load_case(case_file()))
    for change in (
        ("e_mwh = 2.0", "e_mwh = 2.5"),
        ("r_ohm = 0.4", "r_ohm = 0.41"),
        ("0.3]", "0.31]"),
        ("00:45", "01:00"),
        ('"four"', '"five"'),
    ):
        assert not case.equals(load_case(case_file(change)))


def test_a_new_horizon_reads_other_rows_of_the_profiles():
    case = load_case("ieee33")
    later = case.replace(start=case.window.time(40), slots=8)
    for name, values in case.profiles.items():
        np.testing.assert_array_equal(later.profile(name), values[40:48])
    assert later.start == case.window.time(40)


def test_outages_stay_at_their_time_when_the_horizon_moves():
    case = load_case("ieee33").replace(outages="6-26@14:00-17:30")
    later = case.replace(start=case.window.time(60), slots=8)
    assert later.outages == (Outage("6-26", 0, 8),)
    assert case.replace(slots=8).outages == ()
    assert case.replace(start=case.window.time(40)).outages == (Outage("6-26", 16, 30),)


def test_inline_profiles_move_with_the_horizon(case_file):
    case = load_case(case_file())
    later = case.replace(start=datetime(2016, 7, 12, 0, 30), slots=2)
    np.testing.assert_array_equal(later.profile("homes"), [0.6, 1.0])
    with pytest.raises(CaseError, match="at least slots = 3"):
        case.replace(start=datetime(2016, 7, 12, 0, 30), slots=3)
    with pytest.raises(UsageError, match="inline profiles start"):
        case.replace(start=datetime(2016, 7, 11))


def test_outages_may_be_text_or_slots(case_file):
    case = load_case(case_file())
    assert case.replace(outages="none").outages == ()
    assert case.replace(outages="2-3@00:30-01:00").outages == (Outage("2-3", 2, 4),)
    assert case.replace(outages=[Outage("2-3", 2, 4)]).source["outages"] == ["2-3@00:30-01:00"]
    with pytest.raises(UsageError, match="2-4"):
        case.replace(outages=[Outage("2-4", 2, 4)])
    with pytest.raises(UsageError, match="0 <= first < stop <= 4"):
        case.replace(outages=[Outage("2-3", 2, 5)])


def test_devices_and_profiles_may_be_replaced_and_are_checked(case_file):
    case = load_case(case_file())
    bigger = case.ess[0].model_copy(update={"e_mwh": 3.0})
    constant = case.load[0].model_copy(update={"profile": None})
    changed = case.replace(ess=[bigger], load=[constant], terminal_value_per_mwh=7.0)
    assert changed.ess == (bigger,)
    assert changed.load == (constant,)
    assert changed.terminal_value_per_mwh == 7.0
    assert case.ess[0].e_mwh == 2.0
    doubled = case.replace(profiles={name: 0.5 * v for name, v in case.profiles.items()})
    np.testing.assert_array_equal(doubled.profile("homes"), 0.5 * case.profile("homes"))
    with pytest.raises(CaseError, match="soc_initial"):
        case.replace(ess=[bigger.model_copy(update={"soc_initial": 0.95})])
    with pytest.raises(UsageError, match="allowed: a table, or a network of pandapower"):
        case.replace(network=case.network)


def test_a_changed_case_can_be_written_too(case_file, tmp_path):
    case = load_case(case_file()).replace(outages="none", slots=3, load=[])
    path = tmp_path / "changed.toml"
    path.write_text(case_text(case))
    assert load_case(path).equals(case)


def test_one_line_changes_and_the_others_stay() -> None:
    case = load_case("ieee33")
    found = case.with_line("1-2", hardening=2.0, rating_mva=15.0).with_line("5-6", underground=True)
    assert [line.name for line in found.line] == [*(line.name for line in case.line), "5-6"]
    assert found.line[0].breakpoint
    assert found.line[0].hardening == 2.0
    assert found.network.rating_mva[found.network.line("1-2")] == 15.0
    assert found.line[1:-1] == case.line[1:]
    assert found.outages == case.outages
    with pytest.raises(UsageError, match="'5-7' is not in the network"):
        case.with_line("5-7", hardening=2.0)
    with pytest.raises(CaseError, match="hardening"):
        case.with_line("5-6", hardening=-1.0)
