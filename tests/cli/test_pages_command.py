"""`--html`, `report` and `diff` as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from resilience.cli import main

CASE = "analytic/two-islands"


def test_a_page_is_written_beside_the_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "plan.html"
    with pytest.raises(SystemExit) as ended:
        main(["solve", CASE, "--method", "lp", "--html", str(page)])
    assert ended.value.code == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"page: {page}"
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_page_that_cannot_be_written_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["solve", CASE, "--method", "lp", "--html", str(tmp_path / "plan.htmx")])
    assert ended.value.code == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert "allowed suffixes: .html, .htm" in said.err


def test_runs_are_reported_and_held_against_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [tmp_path / "a", tmp_path / "b"]
    for run, outages in zip(runs, ("none", "grid-east@14:00-16:00"), strict=True):
        with pytest.raises(SystemExit):
            main(["solve", CASE, "--method", "lp", "--outages", outages, "--out", str(run)])
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["report", str(runs[0])])
    assert capsys.readouterr().out == f"{runs[0] / 'report.html'}\n"
    with pytest.raises(SystemExit) as ended:
        main(["diff", *map(str, runs), "--json"])
    assert ended.value.code == 0
    difference = json.loads(capsys.readouterr().out)
    assert [change["key"] for change in difference["case"]] == ["outages"]
    shed = next(figure for figure in difference["figures"] if figure["name"] == "shed")
    assert shed["change"] == pytest.approx(0.4)
