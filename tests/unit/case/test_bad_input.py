"""Every mistake in a case file is found, all at once, with where it is and how to mend it."""

from dataclasses import dataclass

import pytest

from resilience.case import load_case
from resilience.errors import CaseError, Problem


@dataclass(frozen=True)
class Mistake:
    """A change that spoils the valid case, and what the one problem about it must say."""

    id: str
    old: str
    new: str
    table: str
    key: str
    value: str = ""
    allowed: str = ""
    hint: str = ""


ESS, GENERATOR, VILLAGE = "[[ess]] battery", "[[generator]] diesel", "[[load]] village"

MISTAKES = [
    Mistake(
        "unknown key",
        "e_mwh = 2.0",
        "e_mwh = 2.0\nsoc_start = 0.5",
        ESS,
        "soc_start",
        hint="did you mean soc_max",
    ),
    Mistake("unknown table", "[time]", "[storage]\n[time]", "", "storage", "unknown"),
    Mistake(
        "unknown default",
        'profile = "homes"',
        'profile = "homes"\nprofle = "a"',
        "[defaults.load]",
        "profle",
        hint="did you mean profile?",
    ),
    Mistake("missing key", "e_mwh = 2.0\n", "", ESS, "e_mwh", "nothing", hint="add e_mwh"),
    Mistake(
        "text for a number",
        "e_mwh = 2.0",
        'e_mwh = "2.0"',
        ESS,
        "e_mwh",
        '"2.0"',
        "a number",
        "remove the quotes",
    ),
    Mistake("infinite number", "e_mwh = 2.0", "e_mwh = inf", ESS, "e_mwh", "inf", "finite"),
    Mistake(
        "negative capacity", "e_mwh = 2.0", "e_mwh = -2.0", ESS, "e_mwh", "-2", "greater than 0"
    ),
    Mistake(
        "negative power",
        "p_max_mw = 0.8",
        "p_max_mw = -0.8",
        VILLAGE,
        "p_max_mw",
        "-0.8",
        "0 or more",
    ),
    Mistake(
        "percent",
        "e_mwh = 2.0",
        "e_mwh = 2.0\nefficiency_charge = 95",
        ESS,
        "efficiency_charge",
        "95",
        "1 or less",
        "percent",
    ),
    Mistake(
        "soc limits swapped",
        "soc_min = 0.1\nsoc_max = 0.9",
        "soc_min = 0.9\nsoc_max = 0.1",
        ESS,
        "soc_min",
        "0.9",
        "at most soc_max = 0.1",
        "swap",
    ),
    Mistake(
        "soc outside its band",
        "soc_min = 0.1",
        "soc_min = 0.6",
        ESS,
        "soc_initial",
        "0.5",
        "soc_min = 0.6 to soc_max = 0.9",
    ),
    Mistake(
        "power limits swapped",
        "p_min_mw = 0.1",
        "p_min_mw = 0.5",
        GENERATOR,
        "p_min_mw",
        "0.5",
        "at most p_max_mw = 0.4",
    ),
    Mistake(
        "curve that turns back",
        "[0.2, 60.0]",
        "[0.5, 60.0]",
        GENERATOR,
        "cost_curve",
        "0, 0.5, 0.4",
        "rising",
    ),
    Mistake(
        "curve too short",
        "[0.4, 140.0]]",
        "[0.3, 140.0]]",
        GENERATOR,
        "cost_curve",
        "0, 0.2, 0.3",
        "at least 0.4",
    ),
    Mistake("curve point without cost", "[0.2, 60.0]", "[0.2]", GENERATOR, "cost_curve[2][2]"),
    Mistake(
        "output while off",
        "ramp_up",
        "p_initial_mw = 0.2\nramp_up",
        GENERATOR,
        "p_initial_mw",
        "0.2",
        "initial_on = false",
    ),
    Mistake(
        "ramp from below the minimum",
        "ramp_up",
        "initial_on = true\nramp_up",
        GENERATOR,
        "p_initial_mw",
        "0",
        "p_min_mw = 0.1",
    ),
    Mistake(
        "unknown bus",
        'bus = "2"',
        'bus = "22"',
        VILLAGE,
        "bus",
        '"22"',
        "a bus of the network",
        "did you mean 2",
    ),
    Mistake(
        "line to an unknown bus",
        'from = "3"\nto = "4"',
        'from = "3"\nto = "5"',
        "[[network.line]] 3-5",
        "to",
        '"5"',
    ),
    Mistake(
        "line from a bus to itself",
        'from = "3"\nto = "4"',
        'from = "3"\nto = "3"',
        "[[network.line]] 3-3",
        "to",
    ),
    Mistake(
        "volts for kilovolts",
        'name = "4"\nvn_kv = 12.66',
        'name = "4"\nvn_kv = 12660',
        "[[network.bus]] 4",
        "vn_kv",
        "12660",
        "1000 or less",
        "V given as kV",
    ),
    Mistake(
        "disconnected",
        'name = "4"\nvn_kv = 12.66\n',
        'name = "4"\nvn_kv = 12.66\n[[network.bus]]\nname = "far"\nvn_kv = 12.66\n',
        "[network]",
        "",
        "1 of 5 buses cut off: far",
    ),
    Mistake(
        "duplicate bus",
        'name = "4"\nvn_kv = 12.66\n',
        'name = "4"\nvn_kv = 12.66\n[[network.bus]]\nname = "4"\nvn_kv = 12.66\n',
        "[[network.bus]] 4",
        "name",
        '"4"',
    ),
    Mistake(
        "duplicate name across kinds",
        'name = "roof"',
        'name = "battery"',
        ESS,
        "name",
        "[[pv]] battery and [[ess]] battery",
    ),
    Mistake(
        "unknown line",
        'name = "4-1"',
        'name = "1-4"',
        "[[line]] 1-4",
        "name",
        '"1-4"',
        hint="did you mean 4-1?",
    ),
    Mistake("two tables for a line", 'name = "4-1"', 'name = "1-2"', "[[line]] 1-2", "name"),
    Mistake(
        "milliohms",
        "r_ohm = 0.6",
        "r_ohm = 60000",
        "[[network.line]] 3-4",
        "r_ohm",
        "60000",
        hint="mOhm",
    ),
    Mistake(
        "voltage limits swapped",
        "v_max_pu = 1.05",
        "v_max_pu = 0.9",
        "[network]",
        "v_min_pu",
        "0.95 at bus 3",
        "at most v_max_pu = 0.9",
    ),
    Mistake(
        "grid voltage outside the limits",
        "import_max_mw = 2.0",
        "import_max_mw = 2.0\nv_pu = 0.9",
        "[[grid]] grid",
        "v_pu",
        "0.9",
        "0.95 to 1.1",
    ),
    Mistake(
        "two sources of a network",
        "[network]",
        '[network]\npandapower = "case33bw"',
        "[network]",
        "",
        "pandapower and bus",
        "exactly one",
    ),
    Mistake(
        "kilowatts",
        "p_max_mw = 0.8",
        "p_max_mw = 800",
        VILLAGE,
        "p_max_mw",
        "36.5 kA",
        "10 kA at 12.66 kV",
        "kW given as MW",
    ),
    Mistake("kilowatt-hours", "e_mwh = 2.0", "e_mwh = 2000", ESS, "e_mwh", "2000", "200 h", "kWh"),
    Mistake(
        "price per kilowatt-year",
        "shed_cost_per_mwh = 1000.0",
        "shed_cost_per_mwh = 2e6",
        "[defaults.load]",
        "shed_cost_per_mwh",
        "2e+06",
        "1,000,000",
    ),
    Mistake(
        "nothing forms the grid", "[[generator]]", "grid_forming = false\n[[generator]]", "", ""
    ),
    Mistake("horizon without slots", "slots = 4", "slots = 0", "[time]", "slots", "0"),
    Mistake("horizon with a time zone", "00:00:00\n", "00:00:00Z\n", "[time]", "start"),
    Mistake(
        "missing profile",
        'profile = "sun"',
        'profile = "son"',
        "[[pv]] roof",
        "profile",
        '"son"',
        "a column",
        "did you mean sun?",
    ),
    Mistake(
        "missing default profile",
        'profile = "homes"',
        'profile = "home"',
        "[defaults.load]",
        "profile",
        '"home"',
        hint="did you mean homes?",
    ),
    Mistake(
        "short profile",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, 0.1, 0.2]",
        "[profiles]",
        "sun",
        "3 values",
        "at least slots = 4",
    ),
    Mistake(
        "NaN",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, nan, 0.2, nan]",
        "[profiles]",
        "sun",
        "2 of 4 values NaN or infinite, the first at 2016-07-12 00:15",
    ),
    Mistake(
        "negative profile",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, -0.1, 0.2, 0.3]",
        "[profiles]",
        "sun",
        "1 of 4 values negative",
    ),
    Mistake(
        "profile in kW",
        "[0.4, 0.5, 0.6, 1.0]",
        "[400, 500, 600, 1000]",
        "[profiles]",
        "homes",
        "4 of 4 values above 2",
        hint="p_max_mw",
    ),
    Mistake(
        "profile with text",
        "[0.0, 0.1, 0.2, 0.3]",
        '[0.0, "x", 0.2, 0.3]',
        "[profiles]",
        "columns.sun[2]",
        '"x"',
        "a number",
    ),
    Mistake(
        "outage of an unknown line",
        "1-2@00:15-00:45",
        "1-3@00:15-00:45",
        "outages #1",
        "line",
        "'1-3'",
        hint="did you mean",
    ),
    Mistake(
        "outage that ends before it starts",
        "1-2@00:15-00:45",
        "1-2@00:45-00:15",
        "outages #1",
        "",
        "00:45-00:15",
        "an end after the start",
    ),
    Mistake(
        "outage outside the horizon",
        "1-2@00:15-00:45",
        "1-2@14:15-14:45",
        "outages #1",
        "",
        "14:15",
        "2016-07-12 00:00 to 2016-07-12 01:00",
    ),
    Mistake(
        "outage without times",
        "1-2@00:15-00:45",
        "1-2 at noon",
        "outages",
        "#1",
        "'1-2 at noon'",
        "LINE@START-STOP",
    ),
    Mistake("one bracket too few", "[[pv]]", "[pv]", "[pv]", "", allowed="[[pv]]"),
]


def problems_of(path) -> list[Problem]:
    with pytest.raises(CaseError) as caught:
        load_case(path)
    return list(caught.value.problems)


def test_the_case_that_the_mistakes_spoil_is_sound(case_file):
    assert load_case(case_file()).name == "four"


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda m: m.id)
def test_one_mistake_is_one_problem(case_file, mistake):
    changes = [(mistake.old, mistake.new)]
    if mistake.id == "nothing forms the grid":
        changes += [
            ("ramp_up", "grid_forming = false\nramp_up"),
            ("import_max_mw", "grid_forming = false\nimport_max_mw"),
        ]
        mistake = Mistake("", "", "", "", "grid_forming", "false for all 3 units", "at least one")
    path = case_file(*changes)
    [problem] = problems_of(path)
    assert problem.file.endswith("case.toml")
    assert (problem.table, problem.key) == (mistake.table, mistake.key)
    assert mistake.value in problem.value
    assert mistake.allowed in problem.allowed
    assert mistake.hint in problem.hint
    assert problem.hint


def test_ten_mistakes_are_ten_problems(case_file):
    path = case_file(
        ("v_min_pu = 0.95", "v_min_pu = -0.95"),
        ("slots = 4", "slots = 4\nstep = 15"),
        ("[0.4, 0.5, 0.6, 1.0]", "[0.4, nan, 0.6, 1.0]"),
        ('bus = "2"', 'bus = "village"'),
        ("p_max_mw = 0.2", "p_max_mw = -0.2"),
        ('profile = "sun"', 'profile = "moon"'),
        ("soc_min = 0.1", "soc_min = 0.95"),
        ("e_mwh = 2.0", "e_mwh = 2000"),
        ("p_min_mw = 0.1", "p_min_mw = 1.1"),
        ('name = "4-1"', 'name = "4-2"'),
    )
    found = {(p.table, p.key) for p in problems_of(path)}
    assert found == {
        ("[network]", "v_min_pu"),
        ("[time]", "step"),
        ("[profiles]", "homes"),
        (VILLAGE, "bus"),
        ("[[load]] clinic", "p_max_mw"),
        ("[[pv]] roof", "profile"),
        (ESS, "soc_min"),
        (ESS, "e_mwh"),
        (GENERATOR, "p_min_mw"),
        ("[[line]] 4-2", "name"),
    }
