"""ENTSO-E exports: every shape gives the same numbers, and what is missing is named."""

from __future__ import annotations

from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from resilience.case import load_case
from resilience.case.measured.entsoe_query import query_measured
from resilience.case.measured.series import read_measured, write_measured_case
from resilience.errors import UsageError
from tests.shared import shared

OLD_LOAD = """\
"Time (CET/CEST)","Day-ahead Total Load Forecast [MW] - BZN|DE-LU",\
"Actual Total Load [MW] - BZN|DE-LU"
"01.07.2022 00:00 - 01.07.2022 00:15","48080","49128"
"01.07.2022 00:15 - 01.07.2022 00:30","47793","48027"
"01.07.2022 00:30 - 01.07.2022 00:45","47153","47325"
"""
OLD_GENERATION = """\
"Area","MTU","Biomass  - Actual Aggregated [MW]","Solar  - Actual Aggregated [MW]",\
"Solar - Actual Consumption [MW]"
"BZN|DE-LU","01.07.2022 00:00 - 01.07.2022 00:15 (CET/CEST)","4010","12","n/e"
"BZN|DE-LU","01.07.2022 00:15 - 01.07.2022 00:30 (CET/CEST)","4011","17","n/e"
"BZN|DE-LU","01.07.2022 00:30 - 01.07.2022 00:45 (CET/CEST)","4012","23","n/e"
"""
NEW_LOAD = """\
"MTU (CET/CEST)","Area","Actual Total Load (MW)","Day-ahead Total Load Forecast (MW)"
"01/07/2022 00:00:00 - 01/07/2022 00:15:00","BZN|DE-LU","49128","48080"
"01/07/2022 00:15:00 - 01/07/2022 00:30:00","BZN|DE-LU","48027","47793"
"01/07/2022 00:30:00 - 01/07/2022 00:45:00","BZN|DE-LU","47325","47153"
"""
NEW_GENERATION = """\
"MTU (CET/CEST)","Area","Production Type","Generation (MW)"
"01/07/2022 00:00:00 - 01/07/2022 00:15:00","BZN|DE-LU","Biomass","4010"
"01/07/2022 00:00:00 - 01/07/2022 00:15:00","BZN|DE-LU","Solar","12"
"01/07/2022 00:15:00 - 01/07/2022 00:30:00","BZN|DE-LU","Biomass","4011"
"01/07/2022 00:15:00 - 01/07/2022 00:30:00","BZN|DE-LU","Solar","17"
"01/07/2022 00:30:00 - 01/07/2022 00:45:00","BZN|DE-LU","Biomass","4012"
"01/07/2022 00:30:00 - 01/07/2022 00:45:00","BZN|DE-LU","Solar","23"
"""
BULK_LOAD = """\
DateTime(UTC),ResolutionCode,AreaCode,AreaDisplayName,AreaTypeCode,AreaMapCode,TotalLoad[MW]
2022-06-30 22:00:00.000,PT15M,10Y1001A1001A82H,DE-LU,BZN,DE_LU,49128
2022-06-30 22:00:00.000,PT15M,10YFR-RTE------C,France,CTY,FR,41000
2022-06-30 22:15:00.000,PT15M,10Y1001A1001A82H,DE-LU,BZN,DE_LU,48027
2022-06-30 22:15:00.000,PT15M,10YFR-RTE------C,France,CTY,FR,40900
2022-06-30 22:30:00.000,PT15M,10Y1001A1001A82H,DE-LU,BZN,DE_LU,47325
2022-06-30 22:30:00.000,PT15M,10YFR-RTE------C,France,CTY,FR,40800
""".replace(",", "\t")
BULK_HEADER = (
    "DateTime(UTC),ResolutionCode,AreaDisplayName,AreaMapCode,ProductionType,"
    "ActualGenerationOutput[MW],ActualConsumption[MW]"
).replace(",", "\t")
BULK_GENERATION = (
    BULK_HEADER
    + """
2022-06-30 22:00:00.000,PT15M,DE-LU,DE_LU,Solar,12,
2022-06-30 22:15:00.000,PT15M,DE-LU,DE_LU,Solar,17,
2022-06-30 22:30:00.000,PT15M,DE-LU,DE_LU,Solar,23,
""".replace(",", "\t")
)
PLAIN = """\
# measured
time_utc,load_mw,load_dayahead_forecast_mw,solar_mw
2022-06-30T22:00Z,49128,48080,12
2022-06-30T22:15Z,48027,47793,17
2022-06-30T22:30Z,47325,47153,23
"""
SHAPES = {
    "old": (OLD_LOAD, OLD_GENERATION),
    "new": (NEW_LOAD, NEW_GENERATION),
    "bulk": (BULK_LOAD, BULK_GENERATION),
    "mixed": (OLD_LOAD, BULK_GENERATION),
    "plain": (PLAIN,),
}


def written(folder: Path, *texts: str) -> list[Path]:
    paths = [folder / f"{k}.csv" for k in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_gives_the_same_megawatts_at_the_same_times(tmp_path: Path, shape: str) -> None:
    measured = read_measured(written(tmp_path, *SHAPES[shape]), area=areas(shape))
    assert str(measured.times[0]) == "2022-06-30 22:00:00+00:00"
    assert measured.step_min == 15
    assert measured.mw["load"].tolist() == [49128, 48027, 47325]
    assert measured.mw["solar"].tolist() == [12, 17, 23]


def areas(shape: str) -> str | None:
    return "DE_LU" if shape == "bulk" else None


def test_a_bulk_file_of_several_areas_names_them(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"areas .*DE_LU.*France"):
        read_measured(written(tmp_path, BULK_LOAD, BULK_GENERATION))


def test_an_unknown_column_is_named(tmp_path: Path) -> None:
    text = NEW_LOAD.replace("Day-ahead Total Load Forecast (MW)", "Moon (MW)")
    with pytest.raises(UsageError, match=r"unknown columns Moon \[MW\]"):
        read_measured(written(tmp_path, text, OLD_GENERATION))


def test_gigawatts_are_refused(tmp_path: Path) -> None:
    text = OLD_LOAD.replace("Actual Total Load [MW]", "Actual Total Load [GW]")
    with pytest.raises(UsageError, match=r"Actual Total Load \[GW\]"):
        read_measured(written(tmp_path, text, OLD_GENERATION))


def test_a_file_of_another_kind_is_told_all_shapes(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"the columns a, b, no shape of ENTSO-E; .*bulk"):
        read_measured(written(tmp_path, "a,b\n3,4\n"))


def test_both_series_are_needed_and_each_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no solar in"):
        read_measured(written(tmp_path, OLD_LOAD))
    with pytest.raises(UsageError, match="has load again"):
        read_measured(written(tmp_path, OLD_LOAD, NEW_LOAD, OLD_GENERATION))


def test_solar_that_is_not_there_is_told_the_types_that_are(tmp_path: Path) -> None:
    text = NEW_GENERATION.replace("Solar", "Wind Onshore")
    with pytest.raises(UsageError, match="Biomass, Wind Onshore"):
        read_measured(written(tmp_path, OLD_LOAD, text))


def test_a_gap_is_named_by_its_first_slot(tmp_path: Path) -> None:
    text = OLD_LOAD.replace("48027", "-")
    with pytest.raises(UsageError, match=r"load has a gap from 2022-06-30 22:15:00\+00:00, and 1 "):
        read_measured(written(tmp_path, text, OLD_GENERATION))
    rows = [line for line in quarters(7) if "00:30 - " not in line and "00:45 - " not in line]
    with pytest.raises(UsageError, match=r"load has a gap from 2022-06-30 22:30:00\+00:00, and 2 "):
        read_measured(written(tmp_path, "\n".join([HEADER, *rows]), OLD_GENERATION))


def test_a_row_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    text = OLD_LOAD + OLD_LOAD.splitlines()[-1] + "\n"
    with pytest.raises(UsageError, match="more than once at 2022-06-30 22:30"):
        read_measured(written(tmp_path, text, OLD_GENERATION))


def test_decimals_with_a_comma_are_refused(tmp_path: Path) -> None:
    text = OLD_LOAD.replace("48027", "48,027")
    with pytest.raises(UsageError, match="load '48,027' of 2022-06-30 22:15"):
        read_measured(written(tmp_path, text, OLD_GENERATION))


HEADER = OLD_LOAD.splitlines()[0]


def quarters(count: int, start: str = "2022-07-01 00:00", load: int = 3) -> list[str]:
    """Rows of the first shape; the k-th has a load of `load` * (k + 5)."""
    first = datetime.fromisoformat(start)
    times = [first + timedelta(minutes=15 * k) for k in range(count + 1)]
    return [
        f'"{a:%d.%m.%Y %H:%M} - {b:%d.%m.%Y %H:%M}","7","{load * (k + 5)}"'
        for k, (a, b) in enumerate(pairwise(times))
    ]


def utc_solar(count: int, start: str) -> str:
    first = datetime.fromisoformat(start)
    rows = [
        f"{first + timedelta(minutes=15 * k):%Y-%m-%d %H:%M:%S}\tPT15M\tDE\tDE\tSolar\t{k + 2}\t"
        for k in range(count)
    ]
    return "\n".join([BULK_HEADER, *rows])


def test_the_hour_that_spring_leaves_out_is_no_gap(tmp_path: Path) -> None:
    """27 March 2022, 02:00 to 03:00: the old website writes four rows without values."""
    rows = quarters(20, "2022-03-27 00:30")
    for k in range(6, 10):
        rows[k] = rows[k].rsplit(",", 2)[0] + ',"",""'
    text = "\n".join([HEADER, *rows])
    measured = read_measured(written(tmp_path, text, utc_solar(16, "2022-03-26 23:30")))
    assert len(measured.times) == 16
    assert str(measured.times[6]) == "2022-03-27 01:00:00+00:00"
    assert measured.mw["load"][5:7].tolist() == [3 * 10, 3 * 15]


def test_values_in_the_hour_that_spring_leaves_out_are_refused(tmp_path: Path) -> None:
    text = "\n".join([HEADER, *quarters(20, "2022-03-27 00:30")])
    with pytest.raises(UsageError, match=r"2022-03-27 02:00, an hour that .* leaves out"):
        read_measured(written(tmp_path, text, utc_solar(16, "2022-03-26 23:30")))


def test_the_hour_that_autumn_repeats_is_told_apart_by_its_place(tmp_path: Path) -> None:
    """30 October 2022: 02:00 to 03:00 in summer time, then once more in winter time."""
    rows = quarters(12, "2022-10-30 00:30") + quarters(8, "2022-10-30 02:00", load=5)
    rows = [*rows[:10], *rows[12:]]
    text = "\n".join([HEADER, *rows])
    measured = read_measured(written(tmp_path, text, utc_solar(18, "2022-10-29 22:30")))
    assert len(measured.times) == 18
    assert str(measured.times[10]) == "2022-10-30 01:00:00+00:00"
    assert measured.mw["load"][9:11].tolist() == [3 * 14, 5 * 5]


def test_the_hour_that_autumn_repeats_is_told_apart_by_marks(tmp_path: Path) -> None:
    marks = ("CEST", "CEST", "CET", "CET")
    starts = ("02:30:00", "02:45:00", "02:00:00", "02:15:00")
    rows = [
        f'"30/10/2022 {start} ({mark}) - 30/10/2022 {start} ({mark})","BZN|DE-LU","{k + 3}",""'
        for k, (start, mark) in enumerate(zip(starts, marks, strict=True))
    ]
    text = "\n".join([NEW_LOAD.splitlines()[0], *rows])
    measured = read_measured(written(tmp_path, text, utc_solar(4, "2022-10-30 00:30")))
    assert str(measured.times[0]) == "2022-10-30 00:30:00+00:00"
    assert measured.mw["load"].tolist() == [3, 4, 5, 6]


def test_an_hour_of_autumn_that_is_there_once_cannot_be_told_apart(tmp_path: Path) -> None:
    text = "\n".join([HEADER, *quarters(20, "2022-10-30 00:30")])
    with pytest.raises(UsageError, match="2022-10-30 02:00 is there once, an hour that"):
        read_measured(written(tmp_path, text, utc_solar(20, "2022-10-29 22:30")))


def test_another_clock_is_refused(tmp_path: Path) -> None:
    text = OLD_LOAD.replace("CET/CEST", "MSK")
    with pytest.raises(UsageError, match="clock MSK; allowed: UTC, CET/CEST"):
        read_measured(written(tmp_path, text, OLD_GENERATION))


def hourly(count: int) -> str:
    first = datetime(2022, 6, 30, 22)
    rows = [
        f"{first + timedelta(hours=k):%Y-%m-%dT%H:%MZ},{k + 3},{2 * k + 7}" for k in range(count)
    ]
    return "\n".join(["time_utc,load_mw,solar_mw", *rows])


def test_an_hour_is_divided_only_where_that_is_asked_for_and_keeps_its_energy(
    tmp_path: Path,
) -> None:
    paths = written(tmp_path, hourly(5))
    measured = read_measured(paths)
    assert measured.step_min == 60
    divided = read_measured(paths, step_min=15)
    assert divided.step_min == 15
    assert divided.mw["load"].reshape(5, 4).mean(1).tolist() == measured.mw["load"].tolist()
    assert divided.notes[0] == "load: means of 60 min, each repeated over 4 slots"
    with pytest.raises(UsageError, match="slots of 60 min, asked for are 7"):
        read_measured(paths, step_min=7)


def test_files_of_other_days_have_nothing_in_common(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no time in common: load 2022-06-30"):
        read_measured(written(tmp_path, OLD_LOAD, utc_solar(8, "2022-08-03 07:00")))


def test_a_case_follows_measured_series_in_whole_days_from_midnight(tmp_path: Path) -> None:
    """Summer time is two hours ahead: 22:00 UTC is midnight, and what is before it goes."""
    days = 6
    measured = read_measured(written(tmp_path, hourly(24 * days + 5)), step_min=15)
    path = write_measured_case("ieee33", measured, tmp_path / "case")
    case = load_case(path)
    assert case.name == "ieee33-measured"
    assert case.start == datetime(2022, 7, 1)
    longest = case.replace(slots=days * 96)
    hours = np.arange(24 * days)
    np.testing.assert_allclose(
        longest.profile("solar")[::4], (2 * hours + 7) / (2 * hours[-1] + 7), rtol=1e-12
    )
    assert {load.profile for load in case.load} == {"load"}
    assert {pv.profile for pv in case.pv} == {"solar"}
    assert case.ess == load_case("ieee33").ess
    with pytest.raises(UsageError, match="profiles of 60 min for ieee33; allowed: 15"):
        write_measured_case("ieee33", read_measured([tmp_path / "0.csv"]), tmp_path / "case")


def test_three_days_are_too_few(tmp_path: Path) -> None:
    measured = read_measured(written(tmp_path, hourly(24 * 3 + 23)), step_min=15)
    with pytest.raises(UsageError, match="3 whole days"):
        write_measured_case("ieee33", measured, tmp_path / "case")


def test_the_german_summer_of_2022_makes_62_days(tmp_path: Path) -> None:
    """Largest load 68.3 GW, mean 51.5 GW, as its source says."""
    measured = read_measured([shared("data", "profiles", "de_2022_jul_aug_15min.csv")])
    assert len(measured.times) == 62 * 96
    assert measured.mw["load"].max() == pytest.approx(68.3e3, abs=50)
    assert measured.mw["load"].mean() == pytest.approx(51.5e3, abs=50)
    case = load_case(write_measured_case("ieee33", measured, tmp_path))
    assert case.start == datetime(2022, 7, 1)
    assert case.replace(start=datetime(2022, 8, 31), slots=96).profile("load").max() <= 1.0


class Recorded:
    """Answers of the shape that entsoe-py 0.8 gives."""

    def __init__(self, consumption: bool) -> None:
        self.consumption = consumption

    def query_load(self, country_code: str, start: pd.Timestamp, end: pd.Timestamp) -> pd.DataFrame:
        index = pd.date_range(start, end, freq="15min", inclusive="left")
        return pd.DataFrame({"Actual Load": np.arange(len(index)) + 40e3}, index)

    def query_generation(
        self, country_code: str, start: pd.Timestamp, end: pd.Timestamp, psr_type: str
    ) -> pd.DataFrame:
        assert (country_code, psr_type) == ("DE_LU", "B16")
        index = pd.date_range(start, end, freq="60min", inclusive="left")
        solar = pd.DataFrame({("Solar", "Actual Aggregated"): np.arange(len(index)) + 7.0}, index)
        if self.consumption:
            solar[("Solar", "Actual Consumption")] = 3.0
            return solar
        return solar.droplevel(1, axis=1)


@pytest.mark.parametrize("consumption", [True, False])
def test_the_server_of_entsoe_is_asked_by_way_of_entsoe_py(consumption: bool) -> None:
    first, last = datetime(2022, 7, 1), datetime(2022, 7, 1, 3)
    measured = query_measured("DE_LU", first, last, step_min=15, client=Recorded(consumption))
    assert str(measured.times[0]) == "2022-06-30 22:00:00+00:00"
    assert measured.mw["load"].tolist() == [40e3 + k for k in range(12)]
    assert measured.mw["solar"].tolist() == [7.0] * 4 + [8.0] * 4 + [9.0] * 4


def test_asking_the_server_needs_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resilience.extras.find_spec", lambda name: None)
    with pytest.raises(UsageError, match=r"entsoe.*\n.*resilience\[entsoe\]"):
        query_measured("DE_LU", datetime(2022, 7, 1), datetime(2022, 7, 2), "token")
