"""The table of a comparison at any width: nothing is cut, and what is shown is what is."""

from __future__ import annotations

import io
import math
import re

import pytest
from rich.console import Console

import resilience as rs
from resilience.text.comparison import COLUMNS, Column, chosen, print_report

WIDTHS = (60, 80, 120, 160)


@pytest.fixture(scope="module")
def report() -> rs.Report:
    return rs.compare("ieee33-tou", ["idle", "rule", "mpc-blind"], days=1, draws=2)


def printed(report: rs.Report, width: int) -> str:
    out = io.StringIO()
    print_report(report, Console(file=out, width=width))
    return out.getvalue()


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_cut_and_every_line_fits(report: rs.Report, width: int) -> None:
    text = printed(report, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert "\x1b" not in text


@pytest.mark.parametrize("width", range(40, 200, 13))
def test_numbers_are_those_of_the_frame(report: rs.Report, width: int) -> None:
    frame = report.frame()
    shown = chosen(frame, width)
    table = printed(report, width).partition("───")[2].partition("clairvoyant:")[0]
    rows = {m[1]: m[0].split() for m in re.finditer(r"(?m)^(\S+) +\d.*$", table)}
    assert list(rows) == ["clairvoyant", *[n for n in frame.index if n != "clairvoyant"]]
    for name, cells in rows.items():
        assert float(cells[1]) == pytest.approx(frame.loc[name, "cost_per_day"], abs=0.05)
    assert shown[0].key == "cost_per_day"


def test_wider_is_more_and_the_important_comes_first(report: rs.Report) -> None:
    frame = report.frame()
    kept = [{column.key for column in chosen(frame, width)} for width in WIDTHS]
    assert {"cost_per_day", "shed_mwh_per_day"} <= kept[0]
    assert len(kept[0]) < len(kept[1]) < len(kept[2]) <= len(kept[3])
    assert all(set(c.keys) <= set(frame.columns) for c in chosen(frame, 160))


def test_columns_have_ranks_and_heads_of_their_own() -> None:
    assert len({column.key for column in COLUMNS}) == len(COLUMNS)
    assert len({(column.head, column.unit) for column in COLUMNS}) == len(COLUMNS)


def test_a_new_column_is_a_line(report: rs.Report, monkeypatch: pytest.MonkeyPatch) -> None:
    extra = Column("risk", "risk", "$/day", 1, 1, "made up")
    monkeypatch.setattr("resilience.text.comparison.COLUMNS", (*COLUMNS, extra))
    frame = report.frame().assign(risk=[1234.56, math.nan, 0.0, -0.04, 9.0])
    assert chosen(frame, 80)[-1] is extra
    assert extra.texts(frame) == ["1234.6", "", "0.0", "0.0", "9.0"]
    assert extra.texts(frame.assign(risk=4321.6)) == ["4322"] * 5


def test_the_head_says_what_was_compared(report: rs.Report) -> None:
    text = printed(report, 120)
    assert "ieee33-tou  2 episodes of 1 day from 2016-08-31, copperplate" in text
    assert "Best is " in text
    assert "clairvoyant: the bound" in text
