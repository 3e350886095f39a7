"""The page of a plan says what the plan says, loads nothing, and shows names as they are."""

from __future__ import annotations

import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.pages.document import number, plain
from resilience.pages.plan_page import plan_page
from tests.unit.pages.results import MARKED, SCRIPT, data_of, marked_case, two_islands


@pytest.fixture(scope="module")
def page() -> str:
    return plan_page(two_islands())


def test_figures_are_those_on_paper(page: str) -> None:
    tiles = dict(re.findall(r'data-figure="([^"]+)">([^ ]+) ', page))
    assert {key: tiles[key] for key in ("objective", "proven bound", "shed")} == {
        "objective": "4.52", "proven bound": "4.52", "shed": "0.400",
    }  # fmt: skip
    assert tiles["critical loads served"] == "100.0"
    words = unescape(page)
    assert "0.400 of 10.000 MWh (4.0 %) are not served, of 1 load." in words
    assert "grid-east@14:00-16:00" in words


def test_summary_in_the_page_is_what_json_prints(page: str) -> None:
    assert data_of(page, "summary") == two_islands().summary()


def test_map_holds_what_happens_at_every_bus(page: str) -> None:
    feeder = data_of(page, "drawn")["map"]
    frames, names = feeder["frames"], [bus["name"] for bus in feeder["buses"]]
    east = names.index("east")
    assert sum(mw or 0.0 for mw in frames["shed"][east]) == pytest.approx(0.4)
    assert [k for k, row in enumerate(frames["shed"]) if row is not None] == [east]
    storage = [device["name"] for device in feeder["devices"]].index("ess")
    # 1.6 of 2 MWh are stored when the grid is lost, and all of it is used in two hours.
    assert frames["soc"][storage][1] == pytest.approx(0.8)
    assert frames["soc"][storage][3] == pytest.approx(0.0, abs=1e-9)
    assert frames["state"] == [[1, 1, 2, 2], [1, 1, 2, 2]]
    assert [names[device["bus"]] for device in feeder["devices"]] == ["grid", "west", "east"]
    apart = {frames["colour"][k][3] for k in (east, names.index("west"))}
    assert len(apart) == 2
    assert min(apart) > 1


def test_power_by_source_adds_up_to_what_is_served(page: str) -> None:
    series = data_of(page, "drawn")["charts"]["power"]["series"]
    by_mark = {mark: [s for s in series if s["mark"] == mark] for mark in ("up", "down", "hatch")}
    up, down, shed = (np.sum([s["values"] for s in rows], axis=0) for rows in by_mark.values())
    demand = next(s["values"] for s in series if s["name"] == "demand")
    np.testing.assert_allclose(up - down + shed, demand, atol=1e-4)


class Tags(HTMLParser):
    """Tags of a page and what they load."""

    def __init__(self) -> None:
        super().__init__()
        self.scripts = 0
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.loaded += [f"{k}={v}" for k, v in attrs if k in ("src", "href", "action", "srcset")]


def test_page_loads_nothing_and_runs_no_name(tmp_path: Path) -> None:
    case = marked_case(tmp_path)
    text = plan_page(rs.solve(case, "lp"))
    tags = Tags()
    tags.feed(text)
    assert tags.loaded == ["href=data:,"]
    assert tags.scripts == 3
    assert "url(" not in text.replace("url(#hatch)", "")
    assert "default-src 'none'" in unescape(text)
    assert SCRIPT not in text
    assert MARKED not in text
    assert SCRIPT in unescape(text)
    assert MARKED in [bus["name"] for bus in data_of(text, "drawn")["map"]["buses"]]


@pytest.mark.parametrize(
    ("value", "text"),
    [(1234.5, "1,234.50"), (-0.001, "0.00"), (None, "–"), (float("nan"), "–"), (-7.125, "-7.12")],
)
def test_numbers_are_written_as_they_are_read(value: float | None, text: str) -> None:
    assert number(value) == text


def test_drawn_numbers_keep_five_digits_of_the_largest() -> None:
    values = np.array([[1234.5678, 0.04321], [np.nan, -2.0]])
    assert plain(values) == [[1234.6, 0.0], [None, -2.0]]


def test_a_page_is_a_html_file(tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match=r"'plan\.pdf'; allowed suffixes: \.html, \.htm"):
        rs.write_page(two_islands(), tmp_path / "plan.pdf")
    assert rs.write_page(two_islands(), tmp_path / "plan.html").stat().st_size < 3e6
