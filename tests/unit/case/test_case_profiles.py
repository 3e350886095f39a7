"""Profiles are cut exactly to the horizon, or refused."""

import gzip
from datetime import datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from resilience.case import load_case
from resilience.errors import CaseError

CASE = """\
[network]
pandapower = "case33bw"
[time]
start = 2016-07-12T06:00:00
slots = 8
step_min = 15
[profiles]
file = "profiles.csv"
[[load]]
name = "load1"
bus = "18"
p_max_mw = 0.5
profile = "homes"
shed_cost_per_mwh = 1000.0
[[grid]]
bus = "1"
import_max_mw = 5.0
import_cost_per_mwh = 1.0
"""
STAMPS = [datetime(2016, 7, 12) + timedelta(minutes=15 * k) for k in range(96)]
VALUES = [round(k / 96, 4) for k in range(96)]


def csv_text(stamps=STAMPS, values=VALUES, head="time,homes,sun") -> str:
    return "\n".join([head, *(f"{t},{v},0.5" for t, v in zip(stamps, values, strict=True))])


def problem_of(case_file, text: str, *changes):
    path = case_file(*changes, text=CASE)
    (path.parent / "profiles.csv").write_text(text)
    with pytest.raises(CaseError) as caught:
        load_case(path)
    [problem] = caught.value.mistakes
    return problem


def test_all_file_types_hold_the_same(case_file):
    path = case_file(text=CASE)
    folder = path.parent
    (folder / "profiles.csv").write_text("# a comment\n" + csv_text())
    (folder / "profiles.csv.gz").write_bytes(gzip.compress(csv_text().encode()))
    stamps = pa.array(STAMPS, pa.timestamp("ns"))
    pq.write_table(pa.table({"time": stamps, "homes": VALUES}), folder / "profiles.parquet")
    for name in ("profiles.csv", "profiles.csv.gz", "profiles.parquet"):
        case = load_case(case_file(("profiles.csv", name), text=CASE))
        np.testing.assert_array_equal(case.profile("homes"), VALUES[24:32])
        assert list(case.profiles) == ["homes"]


def test_a_file_is_read_again_when_it_has_changed(case_file):
    path = case_file(text=CASE)
    (path.parent / "profiles.csv").write_text(csv_text())
    first = load_case(path).profile("homes")
    (path.parent / "profiles.csv").write_text(csv_text(values=[0.125] * 96))
    assert not np.array_equal(first, load_case(path).profile("homes"))


def test_a_horizon_beyond_the_file_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("slots = 8", "slots = 80"))
    assert problem.value == "72 rows from 2016-07-12 06:00:00 to 2016-07-12 23:45:00"
    assert problem.allowed == "at least slots = 80"


def test_a_horizon_before_the_file_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("2016-07-12T06", "2016-07-11T06"))
    assert problem.value == "rows from 2016-07-12 00:00:00 to 2016-07-12 23:45:00"


def test_a_start_between_two_rows_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("T06:00", "T06:05"))
    assert problem.allowed == "a row at 2016-07-12 06:05:00"


def test_another_time_step_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("step_min = 15", "step_min = 60"))
    assert problem.value == "a time step of 15 min"
    assert problem.allowed == "step_min = 60"


def test_a_gap_in_the_rows_is_refused(case_file):
    text = csv_text(STAMPS[:26] + STAMPS[27:], VALUES[:26] + VALUES[27:])
    assert "2016-07-12 06:45:00 after 2016-07-12 06:15:00" in problem_of(case_file, text).value


def test_an_empty_cell_is_nan_and_named_with_its_time(case_file):
    problem = problem_of(case_file, csv_text(values=[*VALUES[:27], "", *VALUES[28:]]))
    assert problem.key == "homes"
    assert "1 of 8 values NaN" in problem.value
    assert "2016-07-12 06:45" in problem.value


def test_gaps_outside_the_horizon_or_in_other_columns_do_not_matter(case_file):
    path = case_file(text=CASE)
    text = csv_text(values=["", *VALUES[1:]]).replace(",0.5", ",")
    (path.parent / "profiles.csv").write_text(text)
    assert load_case(path).profile("homes")[0] == VALUES[24]


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        (csv_text(head="date,homes,sun"), "file", "'date'"),
        (csv_text().replace("0.25,0.5", "0,25,0.5"), "file", "4 cells in data row 25"),
        (csv_text(values=[*VALUES[:30], "x", *VALUES[31:]]), "homes", "'x' in data row 31"),
        (csv_text([*STAMPS[:30], "noon", *STAMPS[31:]]), "time", "'noon' in data row 31"),
        (csv_text([f"{t}+00:00" for t in STAMPS]), "time", "+00:00' in data row 1"),
        ("time,homes", "file", "0 rows"),
        ("", "file", "an empty file"),
    ],
)
def test_a_file_in_another_form_is_refused(case_file, text, key, value):
    problem = problem_of(case_file, text)
    assert problem.table == "[profiles]"
    assert problem.key == key
    assert value in problem.value


def test_a_column_that_is_missing_is_named_with_the_nearest(case_file):
    problem = problem_of(case_file, csv_text(), ('profile = "homes"', 'profile = "home"'))
    assert problem.table == "[[load]] load1"
    assert problem.hint == "did you mean homes?"
