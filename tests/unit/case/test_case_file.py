"""What a case file means."""

import subprocess
import sys
from datetime import datetime

import numpy as np
import pytest
from pydantic import ValidationError

from resilience.case import Outage, case_names, case_schema, load_case
from resilience.errors import CaseError, UsageError


def test_every_case_of_the_package_loads():
    names = case_names()
    assert "ieee33" in names
    for name in names:
        case = load_case(name)
        assert case.slots > 0
        assert case.network.bus_names


def test_a_case_reads_as_it_is_written(case_file):
    case = load_case(case_file())
    assert case.start == datetime(2016, 7, 12)
    assert case.step_h == 0.25
    assert [load.name for load in case.load] == ["village", "clinic"]
    assert case.load[0].shed_cost_per_mwh == 1000.0
    assert case.outages == (Outage("1-2", 1, 3),)
    np.testing.assert_array_equal(case.profile("homes"), [0.4, 0.5, 0.6, 1.0])
    np.testing.assert_array_equal(case.profile(None), np.ones(4))
    with pytest.raises(UsageError, match="moon"):
        case.profile("moon")


def test_values_that_are_not_given_follow_from_others(case_file):
    case = load_case(case_file())
    assert case.ess[0].p_min_mw == -case.ess[0].p_max_mw
    assert case.grid[0].name == "grid"
    assert case.grid[0].q_max_mvar == case.grid[0].import_max_mw
    assert case.pv[0].s_mva is None
    assert case.generator[0].p_initial_mw == 0.0


def test_a_price_may_be_negative(case_file):
    assert load_case(case_file()).profile("price")[3] == -1.0


def test_names_may_be_written_as_numbers(case_file):
    assert load_case(case_file(('bus = "2"', "bus = 2"))).load[0].bus == "2"


def test_a_case_cannot_be_changed_in_place(case_file):
    case = load_case(case_file())
    with pytest.raises(AttributeError):
        case.slots = 8  # type: ignore[misc]
    with pytest.raises(ValidationError):
        case.load[0].p_max_mw = 5.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        case.network.r_pu[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        case.profile("sun")[0] = 1.0


def test_a_variant_keeps_what_it_does_not_change(case_file):
    case_file(name="base.toml")
    base = load_case(case_file())
    variant = load_case(
        case_file(
            text='extends = "base.toml"\n[network]\nimpedance_scale = 2.0\n'
            '[[ess]]\nname = "battery"\ne_mwh = 4.0\n'
            '[[load]]\nname = "farm"\nbus = "3"\np_max_mw = 0.3\n'
            "[[grid]]\nimport_max_mw = 1.0\n",
            name="variant.toml",
        )
    )
    assert variant.name == "variant"
    assert variant.ess[0].e_mwh == 4.0
    assert variant.ess[0].p_max_mw == base.ess[0].p_max_mw
    assert [load.name for load in variant.load] == ["village", "clinic", "farm"]
    assert variant.load[2].shed_cost_per_mwh == 1000.0
    assert variant.grid[0].import_max_mw == 1.0
    assert variant.grid[0].import_cost_per_mwh == 50.0
    np.testing.assert_allclose(variant.network.r_pu, 2.0 * base.network.r_pu)


def test_a_variant_may_bring_its_own_network(case_file):
    case_file(name="base.toml")
    variant = case_file(
        text='extends = "base"\nline = []\noutages = []\n[network]\npandapower = "case33bw"\n',
        name="v.toml",
    )
    with pytest.raises(CaseError) as caught:
        load_case(variant)
    [problem] = caught.value.mistakes
    assert problem.table == "[[line]] 4-1"


def test_slots_are_labelled_by_the_clock(case_file):
    day = load_case(case_file(text=LONG.format(slots=96)))
    assert day.slot_label(58) == "14:30"
    two_days = load_case(case_file(text=LONG.format(slots=192)))
    assert two_days.slot_label(58) == "d1 14:30"
    assert two_days.slot_label(96 + 58) == "d2 14:30"


LONG = """\
[network]
pandapower = "case33bw"
[time]
start = 2016-07-12T00:00:00
slots = {slots}
step_min = 15
[[grid]]
bus = "1"
import_max_mw = 5.0
import_cost_per_mwh = 1.0
"""


def test_the_schema_describes_every_key_of_a_device():
    definitions = case_schema()["$defs"]
    for table in ("LoadTable", "PVTable", "ESSTable", "GeneratorTable", "GridTable", "BranchTable"):
        for key, about in definitions[table]["properties"].items():
            assert about.get("description"), f"{table}.{key} has no description"
    assert "from" in definitions["BranchTable"]["properties"]


def test_reading_cases_does_not_load_pandas_or_pandapower(case_file):
    code = (
        "import sys, resilience.case as c; c.load_case(sys.argv[1]); c.load_case('ieee33');"
        "heavy = {'pandas', 'pandapower', 'pyomo', 'casadi', 'cvxpy', 'torch', 'matplotlib'};"
        "print(sorted(heavy & sys.modules.keys()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(case_file())], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
