"""Profiles are cut exactly to the horizon, or refused."""

import gzip
from datetime import datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import resilience as rs
from resilience.case import load_case
from resilience.case.days import held_out, training
from resilience.dispatch.sddp.days import past_days
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


def test_a_horizon_may_end_with_the_file(case_file):
    path = case_file(("slots = 8", "slots = 72"), text=CASE)
    (path.parent / "profiles.csv").write_text(csv_text())
    np.testing.assert_array_equal(load_case(path).profile("homes"), VALUES[24:])


def test_a_horizon_that_begins_between_two_rows_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("2016-07-12T06:00", "2016-07-12T06:07"))
    assert problem.value == "rows from 2016-07-12 00:00:00 to 2016-07-12 23:45:00"
    assert problem.allowed == "a row at 2016-07-12 06:07:00"


def test_a_horizon_before_the_file_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("2016-07-12T06", "2016-07-11T06"))
    assert problem.value == "rows from 2016-07-12 00:00:00 to 2016-07-12 23:45:00"


def test_a_start_between_two_rows_is_refused(case_file):
    problem = problem_of(case_file, csv_text(), ("T06:00", "T06:05"))
    assert problem.allowed == "a row at 2016-07-12 06:05:00"


@pytest.mark.parametrize("step_min", ["10", "20", "5"])
def test_another_time_step_is_refused(case_file, step_min):
    problem = problem_of(case_file, csv_text(), ("step_min = 15", f"step_min = {step_min}"))
    assert problem.value == "a time step of 15 min"
    assert problem.allowed == f"step_min = {step_min}, or a step that divides it"


def test_a_longer_slot_has_the_mean_of_its_rows():
    quarters = rs.load_case("ieee33")
    hours = quarters.replace(step_min=60, slots=24)
    for name, values in quarters.profiles.items():
        assert hours.profile(name) == pytest.approx(values.reshape(24, 4).mean(axis=1), abs=1e-15)
    assert training(hours).slots * 4 == training(quarters).slots
    assert held_out(hours, 3).start == held_out(quarters, 3).start
    assert len(past_days(hours).values) == len(past_days(quarters).values)


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
        (csv_text().replace("0.25,0.5", "0,25,0.5"), "file", "4 cells in row 26"),
        (csv_text(values=[*VALUES[:30], "x", *VALUES[31:]]), "homes", "'x' in row 32"),
        (csv_text([*STAMPS[:30], "noon", *STAMPS[31:]]), "time", "'noon' in row 32"),
        (csv_text([f"{t}+00:00" for t in STAMPS]), "time", "+00:00' in row 2"),
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


def named(case_file, name, content):
    """What is wrong with a profile file of another kind."""
    path = case_file(("profiles.csv", name), text=CASE)
    if content is not None:
        (path.parent / name).write_bytes(content)
    with pytest.raises(CaseError) as caught:
        load_case(path)
    [problem] = caught.value.mistakes
    assert problem.table == "[profiles]"
    return problem


WHOLE = gzip.compress(csv_text().encode())


@pytest.mark.parametrize(
    ("name", "content", "allowed", "hint"),
    [
        ("none.csv", None, "a file that exists", "paths start at the case file's folder"),
        ("p.xlsx", b"PK", "a .csv, .csv.gz or .parquet file", "convert the file"),
        ("p.csv", csv_text(head="time,hömes,sun").encode("latin-1"), "UTF-8 text", "damaged"),
        ("p.csv.gz", WHOLE[:-20], "a whole file", "damaged"),
        ("p.csv.gz", csv_text().encode(), "a whole file", "damaged"),
        ("p.csv.gz", b"", "`time` as the first column", "name the column"),
        ("p.parquet", csv_text().encode(), "a Parquet file", "damaged"),
        ("p.parquet", b"", "a Parquet file", "damaged"),
    ],
)
def test_a_missing_or_damaged_file_is_refused(case_file, name, content, allowed, hint):
    problem = named(case_file, name, content)
    assert problem.key == "file"
    assert problem.allowed == allowed
    assert hint in problem.hint


def as_parquet(folder, **columns):
    pq.write_table(pa.table(columns), folder / "made.parquet")
    return (folder / "made.parquet").read_bytes()


def test_a_parquet_file_needs_a_column_of_times(case_file, tmp_path):
    problem = named(case_file, "p.parquet", as_parquet(tmp_path, date=STAMPS, homes=VALUES))
    assert (problem.key, problem.value) == ("file", "date, homes")
    assert problem.allowed == "a column `time`"


def test_times_of_a_parquet_file_may_be_text_but_have_no_zone(case_file, tmp_path):
    path = case_file(("profiles.csv", "p.parquet"), text=CASE)
    content = as_parquet(tmp_path, time=[str(stamp) for stamp in STAMPS], homes=VALUES)
    (path.parent / "p.parquet").write_bytes(content)
    np.testing.assert_array_equal(load_case(path).profile("homes"), VALUES[24:32])
    zoned = pa.array(STAMPS, pa.timestamp("s", tz="UTC"))
    problem = named(case_file, "p.parquet", as_parquet(tmp_path, time=zoned, homes=VALUES))
    assert (problem.key, problem.value) == ("time", "'2016-07-12 00:00:00+00:00' in data row 1")
    words = [*map(str, STAMPS[:11]), "noon", *map(str, STAMPS[12:])]
    problem = named(case_file, "p.parquet", as_parquet(tmp_path, time=words, homes=VALUES))
    assert (problem.key, problem.value) == ("time", "'noon' in data row 12")


def test_an_empty_cell_of_a_parquet_file_is_nan(case_file, tmp_path):
    gap = [*VALUES[:29], None, *VALUES[30:]]
    problem = named_column(case_file, as_parquet(tmp_path, time=STAMPS, homes=gap))
    assert "1 of 8 values NaN" in problem.value
    assert "2016-07-12 07:15" in problem.value


def named_column(case_file, content):
    path = case_file(("profiles.csv", "p.parquet"), text=CASE)
    (path.parent / "p.parquet").write_bytes(content)
    with pytest.raises(CaseError) as caught:
        load_case(path)
    [problem] = caught.value.mistakes
    assert problem.key == "homes"
    return problem
