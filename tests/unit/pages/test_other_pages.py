"""Pages of comparisons, hazards and survivals hold the figures of the result, saved or fresh."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.pages.document import number
from resilience.pages.saved import write_saved_page
from tests.unit.pages.results import data_of, two_islands
from tests.unit.plots.stormy import chain, cut


def text_of(path: Path) -> str:
    """A page without the time at which it was made."""
    return re.sub(r"Made [-0-9]+ [:0-9]+", "", path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def report() -> rs.Report:
    case = chain()
    return rs.compare(case, ["idle", "rule"], days=1, scenarios=cut(case))


@pytest.fixture(scope="module")
def hazard() -> rs.Hazard:
    return rs.hazard("ieee33_rammasun", n=40)


@pytest.fixture(scope="module")
def survival() -> rs.Survival:
    return rs.survive(chain(), [6, 12])


@pytest.mark.parametrize("kind", ["report", "hazard", "survival", "plan"])
def test_a_saved_result_has_the_page_of_the_fresh_one(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    result = two_islands() if kind == "plan" else request.getfixturevalue(kind)
    result.save(tmp_path / "run")
    page = write_saved_page(tmp_path / "run")
    assert page == tmp_path / "run" / "report.html"
    assert text_of(page) == text_of(rs.write_page(result, tmp_path / "fresh.html"))


def test_comparison_shows_every_episode_and_its_mean(report: rs.Report, tmp_path: Path) -> None:
    page = text_of(rs.write_page(report, tmp_path / "page.html"))
    charts = data_of(page, "drawn")["charts"]
    for row in charts["over"]["rows"]:
        over = report.objective[row["name"]] - report.bound
        np.testing.assert_allclose(row["dots"], over, atol=1e-4 * max(abs(over).max(), 1.0))
        assert row["mean"] == pytest.approx(float(report.scenarios.probability @ over))
    for row in charts["shed_dots"]["rows"]:
        shed = report.trajectories[row["name"]].shed_mwh
        np.testing.assert_allclose(row["dots"], shed, atol=1e-4)
    assert data_of(page, "summary") == report.summary()
    words = unescape(page)
    assert re.search(r"<dt>storms</dt>\s*<dd>2</dd>", words)
    assert all(f"<td>{name}</td>" in words for name in report.objective)


def test_methods_share_their_scales_in_one_storm(report: rs.Report, tmp_path: Path) -> None:
    page = text_of(rs.write_page(report, tmp_path / "page.html"))
    charts = data_of(page, "drawn")["charts"]
    powers = [chart for key, chart in charts.items() if key.startswith("power_")]
    assert len(powers) == 3
    assert len({(chart["bottom"], chart["top"]) for chart in powers}) == 1
    for chart in powers:
        up, shed = (
            np.sum([s["values"] for s in chart["series"] if s["mark"] == mark], axis=0)
            for mark in ("up", "hatch")
        )
        assert np.max(up + shed) <= chart["top"]


def test_hazard_colours_lines_by_their_probability(hazard: rs.Hazard, tmp_path: Path) -> None:
    page = text_of(rs.write_page(hazard, tmp_path / "page.html"))
    feeder = data_of(page, "drawn")["map"]
    chance = dict(
        zip([line["name"] for line in feeder["lines"]], feeder["frames"]["chance"], strict=False)
    )
    for row in hazard.lines:
        assert chance[row["line"]][-1] == pytest.approx(row["failure_probability"], abs=1e-4)
        ends = next(line for line in feeder["lines"] if line["name"] == row["line"])
        assert [feeder["buses"][ends[end]]["name"] for end in "ab"] == row["line"].split("-")
    east, north = hazard.storm.geography.bus_km
    width = max(np.ptp(east), np.ptp(north))
    x = np.array([bus["x"] for bus in feeder["buses"]])
    np.testing.assert_allclose(np.diff(x) * width, np.diff(east), atol=1e-3 * width)
    expected = number(hazard.storm.failed_by[:, -1].sum(), 1)
    assert f"{expected} of 32 lines are expected to fail." in page


def test_survival_steps_through_the_shares_of_its_starts(
    survival: rs.Survival, tmp_path: Path
) -> None:
    page = text_of(rs.write_page(survival, tmp_path / "page.html"))
    line = data_of(page, "drawn")["charts"]["chance"]["lines"][0]
    fits = survival.ahead_h >= 12
    for hour, share in zip(line["hours"], line["share"], strict=True):
        assert share == pytest.approx(100 * (survival.all_h[fits] >= hour).mean())
    table = survival.frame()
    for hour, share, low, high in line["points"]:
        row = 100 * table.loc[hour, ["all_served", "all_low", "all_high"]]
        assert [share, low, high] == pytest.approx(row.tolist())


def test_a_folder_without_a_result_has_no_page(tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match="holds no result"):
        write_saved_page(tmp_path)
