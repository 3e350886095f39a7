"""Pages in a browser: nothing fails, the slider moves, figures are those of the result."""

from __future__ import annotations

from pathlib import Path

import pytest

import resilience as rs
from tests.browser.pages import Browser
from tests.unit.pages.results import SCRIPT, marked_case, two_islands
from tests.unit.plots.stormy import chain, cut

PAGES = ["plan", "feeder", "scenarios", "comparison", "hazard", "survival", "diff"]
VIEWS = [(1280, False), (390, False), (1280, True), (390, True)]
MOVE = """
const slider = document.getElementById("slider");
slider.value = arguments[0];
slider.dispatchEvent(new Event("input"));
const panel = document.getElementById("readout");
const rows = [...panel.querySelectorAll("tr")];
const cells = rows.map(row => [...row.cells].map(cell => cell.textContent));
return [document.getElementById("moment").textContent, cells, panel.textContent];
"""


def larger_store() -> rs.Plan:
    """The two islands with storage of 1.25 MW in place of 1."""
    case = rs.load_case("analytic/two-islands")
    return rs.solve(case.with_ess("ess", p_max_mw=1.25, p_min_mw=-1.25), "lp")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A page of every kind by its name."""
    folder = tmp_path_factory.mktemp("pages")
    case = chain()
    results = {
        "plan": two_islands(),
        "feeder": rs.solve("ieee33", "lp"),
        "scenarios": rs.solve("ieee33", "stochastic", scenarios=20),
        "comparison": rs.compare(case, ["idle", "rule"], days=1, scenarios=cut(case)),
        "hazard": rs.hazard("ieee33_rammasun", n=40),
        "survival": rs.survive(chain(), [6, 12]),
        "diff": rs.diff(two_islands(), larger_store()),
    }
    return {name: rs.write_page(r, folder / f"{name}.html") for name, r in results.items()}


@pytest.mark.parametrize(("width", "dark"), VIEWS)
@pytest.mark.parametrize("name", PAGES)
def test_pages_open_without_complaint_and_nothing_sticks_out(
    browser: Browser, pages: dict[str, Path], name: str, width: int, dark: bool
) -> None:
    browser.open(pages[name], width=width, dark=dark)
    assert browser.messages() == []
    assert browser.out_of_view() == []
    charts = browser.run("return document.querySelectorAll('figure .plot svg').length")
    assert charts == browser.run("return document.querySelectorAll('figure').length")
    assert (charts > 0) == (name != "diff")
    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") != dark


def test_slider_shows_what_the_plan_does(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["plan"])
    plan = two_islands()
    shed = plan.tables["shed"].values.sum(axis=0)
    for slot, moment in enumerate(["12:00–13:00", "13:00–14:00", "14:00–15:00", "15:00–16:00"]):
        label, cells, words = browser.run(MOVE, slot)
        rows = dict(cells)
        assert label == moment
        assert float(rows["shed"].split()[0]) == pytest.approx(shed[slot], abs=5e-4)
        held = plan.tables["soc"]["ess"][slot]
        assert rows["ess"] == f"{100.0 * held:.0f} %"
        assert ("Out: grid-east, grid-west" in words) == (slot >= 2)


def test_lines_that_are_out_are_crossed(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["plan"])
    count = "return page.map.arrows.filter(a => a.style.stroke.includes('--out')).length"
    crossed = []
    for slot in range(4):
        browser.run(MOVE, slot)
        crossed.append(browser.run(count))
    assert crossed == [0, 0, 2, 2]


def test_play_moves_through_the_slots(browser: Browser, pages: dict[str, Path]) -> None:
    browser.open(pages["plan"])
    browser.run(MOVE, 0)
    browser.run("page.timer = null; document.getElementById('play').click()")
    assert browser.run("return document.getElementById('play').textContent") == "Pause"
    browser.run("document.getElementById('play').click()")
    assert browser.run("return document.getElementById('play').textContent") == "Play"


def test_figures_in_the_page_are_those_of_the_json(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.open(pages["feeder"])
    tile = "return document.querySelector(`[data-figure='${arguments[0]}']`).innerText"
    summary = browser.run("return read('summary')")
    for head, key in (("objective", "objective"), ("proven bound", "bound"), ("shed", "shed_mwh")):
        shown = float(browser.run(tile, head).split()[0].replace(",", ""))
        assert shown == pytest.approx(summary[key], abs=5e-3)


def test_a_difference_shows_what_changed_and_nothing_else(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.open(pages["diff"], width=390)
    tables = browser.run(
        "return [...document.querySelectorAll('tbody')].map(body => "
        "[...body.rows].map(row => [...row.cells].map(cell => cell.innerText)))"
    )
    case, figures, shed, actions = tables
    assert case == [["ess ess p_max_mw", "1.0", "1.25"], ["ess ess p_min_mw", "-1.0", "-1.25"]]
    objective = next(row for row in figures if row[0].startswith("objective"))
    assert float(objective[3]) == pytest.approx(0.3 * 0.5 + 0.2 * 0.4 - 1.5 * 0.4, abs=1e-4)
    assert [row[0] for row in shed] == ["homes"]
    assert ["charge ess", "12:00–14:00 1 MW", "12:00–14:00 1.25 MW"] in actions


def test_names_are_text(browser: Browser, tmp_path: Path) -> None:
    page = rs.write_page(rs.solve(marked_case(tmp_path), "lp"), tmp_path / "marked.html")
    browser.open(page)
    assert browser.messages() == []
    assert browser.driver.title != "run"
    assert browser.run("return document.querySelector('h1').textContent") == SCRIPT
    assert browser.run("return document.querySelectorAll('main script, main b[title]').length") == 0
    assert browser.out_of_view() == []


def test_names_of_pairs_stand_in_one_line_on_a_phone(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.open(pages["comparison"], width=390)
    rows = browser.run(
        "return [...document.querySelectorAll('table.pairs tbody tr')].map(row => "
        "[...row.cells].map(cell => [cell.innerText, cell.getBoundingClientRect().height, "
        "parseFloat(getComputedStyle(cell).lineHeight)]))"
    )
    assert "idle less rule-0.9" in [row[0][0] for row in rows]
    assert all(height < 1.9 * line for row in rows for _, height, line in row)
