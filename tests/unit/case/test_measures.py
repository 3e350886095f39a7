"""Numbers and names that nothing on a feeder has are refused, in every table."""

from __future__ import annotations

import pytest

from resilience.case import load_case
from resilience.errors import CaseError
from tests.unit.case.conftest import CaseFile


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("slots = 4", f"slots = {10**30}", "1e\\+06 or less"),
        ("slots = 4", "slots = 10_000_000", "1e\\+06 or less"),
        ("step_min = 15", "step_min = 1e300", "10080 or less"),
        ("step_min = 15", "step_min = 1e-300", "0.0166667 or more"),
        ("2016-07-12T00:00:00", "9999-12-31T00:00:00", "a horizon in 1700 to 2200"),
        ("2016-07-12T00:00:00", "0001-01-01T00:00:00", "a horizon in 1700 to 2200"),
        ("slots = 4\nstep_min = 15", "slots = 500_000\nstep_min = 1440", "a horizon in 1700"),
        ("r_ohm = 0.4", "r_ohm = 1e-300", "1e-12 to 1e\\+12"),
        ("e_mwh = 2.0", "e_mwh = 1e300", "1e-12 to 1e\\+12"),
        ("[0.2, 60.0]", "[0.2, 1e300]", r"cost_curve\[2\]\[2\]"),
        ("priority = 10.0", "priority = 1e10", "1e\\+06 or less"),
        ("v_max_pu = 1.05", "v_max_pu = 1e-200", "1e-12"),
        ('name = "four"', 'name = " "', "without blanks"),
        ('name = "four"', 'name = ""', "not empty"),
        ('name = "village"', 'name = "village\\n"', "without blanks"),
        ('name = "village"', 'name = "vil\\u0007lage"', "control characters"),
        ('name = "village"', f'name = "{"v" * 300}"', "200 characters"),
        ("[network]", '[network]\npandapower = "../../x"', "letters, digits"),
        ("shed_cost_per_mwh = 1000.0", "shed_cost_per_mwh = 1000.0\nx = {a = 1}", "unknown"),
    ],
)
def test_what_is_beyond_measure_is_refused(
    case_file: CaseFile, old: str, new: str, words: str
) -> None:
    with pytest.raises(CaseError, match=words):
        load_case(case_file((old, new)))


@pytest.mark.parametrize("name", ["Stürmische Bucht 台风", "[/x]", "$x$", "a:x:b", "l'été"])
def test_names_of_every_script_are_read(case_file: CaseFile, name: str) -> None:
    case = load_case(case_file(('name = "village"', f'name = "{name}"')))
    assert case.load[0].name == name


TABLES = {
    "storm": "[storm]", "storm.repair": "[storm.repair]", "storm.forecast": "[storm.forecast]",
    "storm.cloud": "[storm.cloud]\nfactor = 0.4\nradius_km = 90.0", "geography": "[geography]",
    "outage": "[outage]", "defaults": "[defaults]", "defaults.ess": "[defaults.ess]",
    "storm.curves.mine": "[storm.curves.mine]\naveraging_s = 3.0\nmedian_mps = 50.0\nbeta = 0.3",
}  # fmt: skip


@pytest.mark.parametrize("beside", TABLES)
@pytest.mark.parametrize("table", TABLES)
def test_an_unknown_key_beside_every_table_is_refused(
    case_file: CaseFile, table: str, beside: str
) -> None:
    """A table that is unsound leaves its sub-tables and its neighbours what they are."""
    tables = {table: TABLES[table] + "\nhardning = 1.8", **{beside: TABLES[beside]}}
    tables[table] = TABLES[table] + "\nhardning = 1.8"
    ordered = "\n".join(tables[name] for name in TABLES if name in tables)
    with pytest.raises(CaseError) as caught:
        load_case(case_file(("[defaults.load]", f"{ordered}\n[defaults.load]")))
    assert "hardning" in str(caught.value)
    assert "unknown key" in str(caught.value)


@pytest.mark.parametrize("value", ["5", '"x"', "true", "[]", "[[5]]", "{ grid = 5 }", "inf"])
@pytest.mark.parametrize("table", ["defaults", "storm", "geography", "outage", "profiles", "line"])
def test_anything_in_place_of_a_table_is_refused(
    case_file: CaseFile, table: str, value: str
) -> None:
    text = case_file().read_text()
    heads = ("[[line]]", "[profiles.columns]", "[defaults.load]")
    if table in ("line", "profiles", "defaults"):
        head = {"line": heads[0], "profiles": heads[1], "defaults": heads[2]}[table]
        following = {"line": "[time]", "profiles": heads[2], "defaults": "[[load]]"}[table]
        start = text.index(head)
        text = text[:start] + text[text.index(following, start) :]
    path = case_file(text=f"{table} = {value}\n{text}")
    if (table, value) == ("line", "[]"):
        load_case(path)
        return
    with pytest.raises(CaseError, match=table):
        load_case(path)
