"""Outages as text and as slots."""

from dataclasses import dataclass
from datetime import datetime
from itertools import product

import pytest

from resilience.case import Network, Outage, load_case, parse_outages
from resilience.case.outages import outage_texts
from resilience.case.window import Window
from resilience.errors import CaseError, UsageError


@dataclass(frozen=True)
class Horizon:
    network: Network
    window: Window
    units: tuple[str, ...] = ()


def horizon(
    start: datetime = datetime(2016, 7, 12), slots: int = 96, step_min: float = 15
) -> Horizon:
    return Horizon(load_case("ieee33").network, Window(start, slots, step_min))


@pytest.mark.parametrize(
    ("text", "first", "stop"),
    [
        ("6-26@14:00-17:30", 56, 70),
        ("6-26@14:05-14:10", 56, 57),
        ("6-26@14:14-14:16", 56, 58),
        ("6-26@14:14:59-14:15:00", 56, 57),
        ("6-26@14:00-14:15:01", 56, 58),
        ("6-26@00:00-24:00", 0, 96),
        ("6-26@22:00-00:00", 88, 96),
        (" 6-26 @ 14:00 - 14:15 ", 56, 57),
        ("6-26@2016-07-12T14:00-2016-07-12T14:15", 56, 57),
        ("6-26@2016-07-11T14:00-2016-07-12T01:00", 0, 4),
        ("6-26@23:00-d2 03:00", 92, 96),
    ],
)
def test_every_slot_that_an_outage_touches_is_down(text, first, stop):
    assert parse_outages(text, horizon()) == (Outage("6-26", first, stop),)


@pytest.mark.parametrize("time", ["14:30:60", "14:60", "14:60:00", "24:00:01", "24:01", "25:00"])
def test_a_time_that_no_clock_shows_is_refused(time):
    for text in (f"6-26@{time}-d2 03:00", f"6-26@02:00-{time}"):
        with pytest.raises(CaseError) as caught:
            parse_outages(text, horizon())
        [mistake] = caught.value.mistakes
        assert mistake.allowed == f"times as HH:MM, not {time!r}"
        assert mistake.hint == "hours run to 24, minutes to 59"


def test_a_time_of_day_is_its_first_occurrence_in_the_horizon():
    evening = horizon(datetime(2016, 7, 12, 18))
    assert parse_outages("6-26@22:00-02:00", evening) == (Outage("6-26", 16, 32),)
    assert parse_outages("6-26@17:00-18:00", evening) == (Outage("6-26", 92, 96),)


def test_beyond_a_day_times_may_name_their_day():
    week = horizon(slots=7 * 96)
    assert parse_outages("6-26@d2 14:00-17:30", week) == (Outage("6-26", 152, 166),)
    assert parse_outages("6-26@d2 14:00-d3 01:00", week) == (Outage("6-26", 152, 196),)
    assert parse_outages("6-26@14:00-17:30", week) == (Outage("6-26", 56, 70),)


def test_midnight_is_24_00_of_the_day_that_ends():
    week = horizon(slots=7 * 96).window
    texts = outage_texts([Outage("6-26", 150, 192), Outage("1-2", 190, 193)], week)
    assert texts == ["6-26@d2 13:30-d2 24:00", "1-2@d2 23:30-d3 00:15"]


def test_several_outages_in_one_text():
    expected = (Outage("6-26", 56, 70), Outage("1-2", 0, 1))
    assert parse_outages("6-26@14:00-17:30, 1-2@00:00-00:15", horizon()) == expected
    assert parse_outages("6-26@14:00-17:30;1-2@00:00-00:15", horizon()) == expected


def test_none_is_no_outage():
    assert parse_outages("none", horizon()) == ()
    assert parse_outages("", horizon()) == ()


def test_outages_from_a_file(tmp_path):
    path = tmp_path / "outages.csv"
    path.write_text("line,start,stop\n6-26,14:00,17:30\n1-2,2016-07-12 00:00,2016-07-12 00:15\n")
    expected = (Outage("6-26", 56, 70), Outage("1-2", 0, 1))
    assert parse_outages(path, horizon()) == expected
    assert parse_outages(str(path), horizon()) == expected


def test_mistakes_in_a_file_are_all_reported_with_their_rows(tmp_path):
    path = tmp_path / "outages.csv"
    path.write_text("line,start,stop\n6-27,14:00,17:30\n1-2,25:00,26:00\n1-2,,\n")
    with pytest.raises(CaseError) as caught:
        parse_outages(path, horizon())
    assert [p.table for p in caught.value.mistakes] == ["row 2", "row 3", "row 4"]
    path.write_text("branch,from,to\n6-26,14:00,17:30\n")
    with pytest.raises(CaseError, match="line, start, stop"):
        parse_outages(path, horizon())
    with pytest.raises(UsageError, match="does not exist"):
        parse_outages("elsewhere.csv", horizon())


def test_an_unknown_line_is_refused_with_a_hint():
    with pytest.raises(CaseError, match=r"did you mean 6-26\?"):
        parse_outages("26-6@14:00-17:30", horizon())


@pytest.mark.parametrize("start", [datetime(2016, 7, 12), datetime(2016, 7, 12, 18, 30)])
@pytest.mark.parametrize(("slots", "step_min"), [(96, 15), (200, 15), (24, 60), (30, 0.5)])
def test_outages_read_back_as_they_were_written(start, slots, step_min):
    case = horizon(start, slots, step_min)
    ends = sorted({0, 1, slots // 2, slots - 1, slots})
    for first, stop in product(ends, ends):
        if first < stop:
            outages = (Outage("6-26", first, stop),)
            assert parse_outages(",".join(outage_texts(outages, case.window)), case) == outages
