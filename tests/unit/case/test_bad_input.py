"""Every mistake in a case file is found, all at once, with where it is and how to mend it."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from resilience.case import load_case
from resilience.errors import CaseError, Mistake


@dataclass(frozen=True)
class Spoiled:
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
    Spoiled(
        "unknown key",
        "e_mwh = 2.0",
        "e_mwh = 2.0\nsoc_start = 0.5",
        ESS,
        "soc_start",
        hint="did you mean soc_max",
    ),
    Spoiled("unknown table", "[time]", "[storage]\n[time]", "", "storage", "unknown"),
    Spoiled(
        "unknown default",
        'profile = "homes"',
        'profile = "homes"\nprofle = "a"',
        "[defaults.load]",
        "profle",
        hint="did you mean profile?",
    ),
    Spoiled("missing key", "e_mwh = 2.0\n", "", ESS, "e_mwh", "nothing", hint="add e_mwh"),
    Spoiled(
        "text for a number",
        "e_mwh = 2.0",
        'e_mwh = "2.0"',
        ESS,
        "e_mwh",
        '"2.0"',
        "a number",
        "remove the quotes",
    ),
    Spoiled("infinite number", "e_mwh = 2.0", "e_mwh = inf", ESS, "e_mwh", "inf", "finite"),
    Spoiled(
        "negative capacity", "e_mwh = 2.0", "e_mwh = -2.0", ESS, "e_mwh", "-2", "greater than 0"
    ),
    Spoiled(
        "negative power",
        "p_max_mw = 0.8",
        "p_max_mw = -0.8",
        VILLAGE,
        "p_max_mw",
        "-0.8",
        "0 or more",
    ),
    Spoiled(
        "percent",
        "e_mwh = 2.0",
        "e_mwh = 2.0\nefficiency_charge = 95",
        ESS,
        "efficiency_charge",
        "95",
        "1 or less",
        "percent",
    ),
    Spoiled(
        "soc limits swapped",
        "soc_min = 0.1\nsoc_max = 0.9",
        "soc_min = 0.9\nsoc_max = 0.1",
        ESS,
        "soc_min",
        "0.9",
        "at most soc_max = 0.1",
        "swap",
    ),
    Spoiled(
        "soc outside its band",
        "soc_min = 0.1",
        "soc_min = 0.6",
        ESS,
        "soc_initial",
        "0.5",
        "soc_min = 0.6 to soc_max = 0.9",
    ),
    Spoiled(
        "power limits swapped",
        "p_min_mw = 0.1",
        "p_min_mw = 0.5",
        GENERATOR,
        "p_min_mw",
        "0.5",
        "at most p_max_mw = 0.4",
    ),
    Spoiled(
        "curve that turns back",
        "[0.2, 60.0]",
        "[0.5, 60.0]",
        GENERATOR,
        "cost_curve",
        "0, 0.5, 0.4",
        "rising",
    ),
    Spoiled(
        "curve too short",
        "[0.4, 140.0]]",
        "[0.3, 140.0]]",
        GENERATOR,
        "cost_curve",
        "0, 0.2, 0.3",
        "at least 0.4",
    ),
    Spoiled("curve point without cost", "[0.2, 60.0]", "[0.2]", GENERATOR, "cost_curve[2][2]"),
    Spoiled(
        "output while off",
        "ramp_up",
        "p_initial_mw = 0.2\nramp_up",
        GENERATOR,
        "p_initial_mw",
        "0.2",
        "initial_on = false",
    ),
    Spoiled(
        "ramp from below the minimum",
        "ramp_up",
        "initial_on = true\nramp_up",
        GENERATOR,
        "p_initial_mw",
        "0",
        "p_min_mw = 0.1",
    ),
    Spoiled(
        "unknown bus",
        'bus = "2"',
        'bus = "22"',
        VILLAGE,
        "bus",
        '"22"',
        "a bus of the network",
        "did you mean 2",
    ),
    Spoiled(
        "line to an unknown bus",
        'from = "3"\nto = "4"',
        'from = "3"\nto = "5"',
        "[[network.line]] 3-5",
        "to",
        '"5"',
    ),
    Spoiled(
        "line from a bus to itself",
        'from = "3"\nto = "4"',
        'from = "3"\nto = "3"',
        "[[network.line]] 3-3",
        "to",
    ),
    Spoiled(
        "volts for kilovolts",
        'name = "4"\nvn_kv = 12.66',
        'name = "4"\nvn_kv = 12660',
        "[[network.bus]] 4",
        "vn_kv",
        "12660",
        "1000 or less",
        "V given as kV",
    ),
    Spoiled(
        "disconnected",
        'name = "4"\nvn_kv = 12.66\n',
        'name = "4"\nvn_kv = 12.66\n[[network.bus]]\nname = "far"\nvn_kv = 12.66\n',
        "[network]",
        "",
        "1 of 5 buses cut off: far",
    ),
    Spoiled(
        "duplicate bus",
        'name = "4"\nvn_kv = 12.66\n',
        'name = "4"\nvn_kv = 12.66\n[[network.bus]]\nname = "4"\nvn_kv = 12.66\n',
        "[[network.bus]] 4",
        "name",
        '"4"',
    ),
    Spoiled(
        "duplicate name across kinds",
        'name = "roof"',
        'name = "battery"',
        ESS,
        "name",
        "[[pv]] battery and [[ess]] battery",
    ),
    Spoiled(
        "unknown line",
        'name = "4-1"',
        'name = "1-4"',
        "[[line]] 1-4",
        "name",
        '"1-4"',
        hint="did you mean 4-1?",
    ),
    Spoiled("two tables for a line", 'name = "4-1"', 'name = "1-2"', "[[line]] 1-2", "name"),
    Spoiled(
        "milliohms",
        "r_ohm = 0.6",
        "r_ohm = 60000",
        "[[network.line]] 3-4",
        "r_ohm",
        "60000",
        hint="mOhm",
    ),
    Spoiled(
        "voltage limits swapped",
        "v_max_pu = 1.05",
        "v_max_pu = 0.9",
        "[network]",
        "v_min_pu",
        "0.95 at bus 3",
        "at most v_max_pu = 0.9",
    ),
    Spoiled(
        "grid voltage outside the limits",
        "import_max_mw = 2.0",
        "import_max_mw = 2.0\nv_pu = 0.9",
        "[[grid]] grid",
        "v_pu",
        "0.9",
        "0.95 to 1.1",
    ),
    Spoiled(
        "two sources of a network",
        "[network]",
        '[network]\npandapower = "case33bw"',
        "[network]",
        "",
        "pandapower and bus",
        "exactly one",
    ),
    Spoiled(
        "kilowatts",
        "p_max_mw = 0.8",
        "p_max_mw = 800",
        VILLAGE,
        "p_max_mw",
        "36.5 kA",
        "10 kA at 12.66 kV",
        "kW given as MW",
    ),
    Spoiled("kilowatt-hours", "e_mwh = 2.0", "e_mwh = 2000", ESS, "e_mwh", "2000", "200 h", "kWh"),
    Spoiled(
        "price per kilowatt-year",
        "shed_cost_per_mwh = 1000.0",
        "shed_cost_per_mwh = 2e6",
        "[defaults.load]",
        "shed_cost_per_mwh",
        "2e+06",
        "1,000,000",
    ),
    Spoiled(
        "nothing forms the grid", "[[generator]]", "grid_forming = false\n[[generator]]", "", ""
    ),
    Spoiled("horizon without slots", "slots = 4", "slots = 0", "[time]", "slots", "0"),
    Spoiled("horizon with a time zone", "00:00:00\n", "00:00:00Z\n", "[time]", "start"),
    Spoiled(
        "missing profile",
        'profile = "sun"',
        'profile = "son"',
        "[[pv]] roof",
        "profile",
        '"son"',
        "a column",
        "did you mean sun?",
    ),
    Spoiled(
        "missing default profile",
        'profile = "homes"',
        'profile = "home"',
        "[defaults.load]",
        "profile",
        '"home"',
        hint="did you mean homes?",
    ),
    Spoiled(
        "short profile",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, 0.1, 0.2]",
        "[profiles]",
        "sun",
        "3 values",
        "at least slots = 4",
    ),
    Spoiled(
        "NaN",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, nan, 0.2, nan]",
        "[profiles]",
        "sun",
        "2 of 4 values NaN or infinite, the first at 2016-07-12 00:15",
    ),
    Spoiled(
        "negative profile",
        "[0.0, 0.1, 0.2, 0.3]",
        "[0.0, -0.1, 0.2, 0.3]",
        "[profiles]",
        "sun",
        "1 of 4 values negative",
    ),
    Spoiled(
        "profile in kW",
        "[0.4, 0.5, 0.6, 1.0]",
        "[400, 500, 600, 1000]",
        "[profiles]",
        "homes",
        "4 of 4 values above 2",
        hint="p_max_mw",
    ),
    Spoiled(
        "profile with text",
        "[0.0, 0.1, 0.2, 0.3]",
        '[0.0, "x", 0.2, 0.3]',
        "[profiles]",
        "columns.sun[2]",
        '"x"',
        "a number",
    ),
    Spoiled(
        "outage of an unknown line",
        "1-2@00:15-00:45",
        "1-3@00:15-00:45",
        "outages #1",
        "line",
        "'1-3'",
        hint="did you mean",
    ),
    Spoiled(
        "outage that ends before it starts",
        "1-2@00:15-00:45",
        "1-2@00:45-00:15",
        "outages #1",
        "",
        "00:45-00:15",
        "an end after the start",
    ),
    Spoiled(
        "outage outside the horizon",
        "1-2@00:15-00:45",
        "1-2@14:15-14:45",
        "outages #1",
        "",
        "14:15",
        "2016-07-12 00:00 to 2016-07-12 01:00",
    ),
    Spoiled(
        "outage without times",
        "1-2@00:15-00:45",
        "1-2 at noon",
        "outages",
        "#1",
        "'1-2 at noon'",
        "LINE@START-STOP",
    ),
    Spoiled("one bracket too few", "[[pv]]", "[pv]", "[pv]", "", allowed="[[pv]]"),
]


def mistakes_of(path: Path) -> list[Mistake]:
    with pytest.raises(CaseError) as caught:
        load_case(path)
    return list(caught.value.mistakes)


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
        mistake = Spoiled("", "", "", "", "grid_forming", "false for all 3 units", "at least one")
    path = case_file(*changes)
    [problem] = mistakes_of(path)
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
    found = {(p.table, p.key) for p in mistakes_of(path)}
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


TABLES = ["[network]", "[time]", "[outage]", "[[load]]", "[profiles]"]


def with_key(case_file, table, key):
    """The valid case with one key more in a table, its first one; at the head if it is empty."""
    entry = f'"{key}" = "1"\n'
    path = case_file()
    text = path.read_text(encoding="utf-8")
    if not table:
        text = entry + text
    elif f"{table}\n" in text:
        text = text.replace(f"{table}\n", f"{table}\n{entry}", 1)
    else:
        text += f"\n{table}\n{entry}"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError) as caught:
        load_case(path)
    return caught.value


@pytest.mark.parametrize("table", ["", *TABLES])
def test_an_unknown_key_without_end_is_shortened(case_file, table):
    assert len(str(with_key(case_file, table, "x" * 300_000))) < 6_000


@pytest.mark.parametrize("key", ["__class__", "model_fields", "__dict__", "copy"])
@pytest.mark.parametrize("table", TABLES)
def test_names_of_python_are_unknown_keys(case_file, table, key):
    error = with_key(case_file, table, key)
    assert any(key == mistake.key for mistake in error.mistakes)


@pytest.mark.parametrize("price", ["1e308", "-1e7"])
def test_a_profile_of_prices_has_the_size_of_prices(case_file, price):
    path = case_file(("price = [1, 1, 2, -1]", f"price = [1, 1, {price}, -1]"))
    with pytest.raises(CaseError, match="1 of 4 values beyond 1,000,000"):
        load_case(path)
