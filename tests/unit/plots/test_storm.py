"""One storm: what is drawn is what was done, and names that do not exist are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import held_out
from resilience.evaluation.comparison import Comparison
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import case_bell
from resilience.fragility.outages.scenarios import Scenarios
from resilience.plots.panels import GRID, band_colours
from resilience.plots.storm_choice import storm
from resilience.plots.storm_data import OTHERS, feeder, load_groups, zone_names
from resilience.testing import small_case
from tests.unit.plots.stormy import chain, compared, cut

METHODS = ["idle", "rule", "rule-0.9"]
PANELS = 5  # of every method


@pytest.fixture(scope="module")
def tiny() -> Comparison:
    case = chain()
    return compared(case, cut(case), METHODS)


@pytest.fixture(scope="module")
def days() -> Comparison:
    case = chain(slots=48)
    return compared(case, cut(case), METHODS)


@pytest.fixture(scope="module")
def ieee33() -> Comparison:
    case = held_out(rs.load_case("ieee33-tou"), 1)
    return compared(case, sample_bell(case, case_bell(case), 2, 1), METHODS)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("which", ["tiny", "ieee33"])
def test_sources_add_up_to_the_demand_served(
    which: str, name: str, request: pytest.FixtureRequest
) -> None:
    shown: Comparison = request.getfixturevalue(which)
    case = shown.case
    demand = sum(t.p_max_mw * case.profile(t.profile) for t in case.load)
    for episode in (1, 2):
        one = storm(shown, name, episode, 1).methods[name]
        fed, taken = sum(one.fed.values()), sum(one.intake.values())
        np.testing.assert_allclose(one.demand, demand, atol=1e-9)
        np.testing.assert_allclose(fed - taken, demand - one.shed.sum(0), atol=1e-9)
        assert min(v.min() for v in (*one.fed.values(), *one.intake.values(), one.shed)) >= -1e-12


def test_days_are_parts_of_the_episode(days: Comparison) -> None:
    run = days.trajectories["rule"]
    parts = [storm(days, "rule", 1, day).methods["rule"] for day in (1, 2)]
    whole = storm(days, "rule", 1, "all").methods["rule"]
    assert sum(part.cost for part in parts) == pytest.approx(run.cost[:, 0].sum())
    np.testing.assert_array_equal(np.hstack([p.shed for p in parts]), whole.shed)
    np.testing.assert_array_equal(whole.soc, run.energy[:, :, 0] / 4.0)
    assert parts[0].soc[0, -1] == parts[1].soc[0, 0]


def test_sun_that_nobody_takes_is_curtailed(tiny: Comparison) -> None:
    """Idle storage, the grid gone: 2 MW of sun for 1.5 MW of load, and 1 MW once bus 3 is away."""
    one = storm(tiny, "idle", 1, 1).methods["idle"]
    np.testing.assert_allclose(one.curtailed[4:8], [0.5, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(one.fed["grid"], 0.0, atol=1e-12)
    np.testing.assert_allclose(one.shed[1, 6:10], 0.5)
    assert one.shed.sum() == pytest.approx(2.0)


def test_islands_are_those_of_the_lines(tiny: Comparison) -> None:
    shown = feeder(tiny.case, tiny.scenarios, 0, slice(0, 24))
    assert shown.zones == ("1", "2", "3")
    assert shown.lines == ("1-2", "2-3")
    assert shown.on_grid.tolist() == [True, False, False]
    first = shown.island
    assert len(set(first[:, 0])) == 1
    assert first[1, 5] == first[2, 5] != first[0, 5]
    assert len(set(first[:2, 7])) == 2
    assert (first[2, 6:10] == 0).all()
    assert shown.centre_h == (6.0,)


def test_zones_of_ieee33_are_the_hub_and_its_laterals(ieee33: Comparison) -> None:
    shown = feeder(ieee33.case, ieee33.scenarios, 0, slice(0, 96))
    assert shown.zones == ("1", "2–18", "19–22", "23–25", "26–33")


def test_zone_names_are_short() -> None:
    names = ["bus a", "bus b", "3", "5"]
    network = replace(chain().network, bus_names=tuple(names))
    assert zone_names(network, np.array([0, 0, 1, 1])) == ("bus a, bus b", "3, 5")
    numbered = replace(network, bus_names=("²", "7", "9", "8"))
    assert zone_names(numbered, np.array([0, 0, 1, 1])) == ("², 7", "8–9")
    assert zone_names(network, np.zeros(4, int)) == ("bus a, bus b, ...",)


def test_loads_shed_are_grouped_where_they_are_many(ieee33: Comparison) -> None:
    shared = feeder(ieee33.case, ieee33.scenarios, 0, slice(0, 96))
    shed = np.zeros((20, 96))
    shed[[4, 7], 3] = 1.0, 2.0
    assert [name for name, _ in load_groups(ieee33.case, shared, [shed])] == ["load8", "load5"]
    shed += 0.1
    groups = load_groups(ieee33.case, shared, [shed])
    assert sorted(np.concatenate([at for _, at in groups]).tolist()) == list(range(20))
    assert {name for name, _ in groups} == {
        "11 loads, buses 2–18", "3 loads, buses 19–22", "3 loads, buses 23–25",
        "3 loads, buses 26–33",
    }  # fmt: skip


def test_what_is_beyond_six_groups_is_one_more() -> None:
    lines = [(1, k, 0.01, 0.01) for k in range(2, 10)]
    case = small_case(
        buses=9,
        lines=lines,
        line_tables=[{"name": f"1-{k}", "breakpoint": True} for k in range(2, 10)],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        load=[{"bus": str(k), "p_max_mw": 1.0, "shed_cost_per_mwh": 5.0} for k in range(2, 10)],
    )
    calm = Scenarios((), np.zeros((0, 2, 1), bool), np.ones(1))
    shared = feeder(case, calm, 0, slice(0, 2))
    groups = load_groups(case, shared, [np.ones((8, 2))])
    assert [len(at) for _, at in groups] == [1] * 6 + [2]
    assert groups[-1][0] == OTHERS


def test_an_island_keeps_its_colour_and_none_beside_it_has_it() -> None:
    number = np.array([[1, 1, 1, 1], [1, 2, 2, 1], [1, 2, 3, 1], [1, 2, 3, 0]])
    shown = band_colours(number, np.array([True, False, False, False]))
    assert (shown[:, 0] == GRID).all()
    assert shown[1, 1] == shown[2, 1]
    assert shown[2, 2] == shown[2, 1], "the larger part inherits the colour"
    assert shown[1, 2] not in (shown[2, 2], GRID)
    assert shown[:, 3].tolist() == [GRID, GRID, GRID, 0]


def test_the_storm_chosen_is_the_one_that_sheds_most(days: Comparison) -> None:
    chosen = storm(days, METHODS)
    assert chosen.which == "day 1 of 2, episode 1 of 2"
    assert storm(days, "idle", 2).which.endswith("episode 2 of 2")
    assert storm(days, "idle", day=2).which.startswith("day 2 of 2")


@pytest.mark.parametrize(
    ("which", "names"), [("tiny", ["rule"]), ("days", METHODS[:2]), ("ieee33", METHODS)]
)
def test_a_storm_is_drawn(
    which: str, names: list[str], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    shown: Comparison = request.getfixturevalue(which)
    figure = rs.plot_storm(shown, names, path=tmp_path / "storm.png")
    assert (tmp_path / "storm.png").stat().st_size > 20_000
    assert len(figure.axes) == PANELS * len(names)
    demand = next(line for line in figure.axes[0].lines if line.get_label() == "demand")
    arrays = storm(shown, names).methods[names[0]]
    np.testing.assert_array_equal(np.asarray(demand.get_ydata())[:-1], arrays.demand)
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert [title.partition(":")[0] for title in titles if title] == names


def test_a_case_without_storage_and_without_storms_is_drawn() -> None:
    case = small_case(
        slots=24,
        load=[{"p_max_mw": 0.8, "shed_cost_per_mwh": 5.0}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
    )
    calm = Scenarios((), np.zeros((0, 24, 1), bool), np.ones(1))
    figure = rs.plot_storm(compared(case, calm, ["idle"]), "idle")
    figure.draw_without_rendering()
    assert len(figure.axes) == PANELS
    demand = next(line for line in figure.axes[0].lines if line.get_label() == "demand")
    assert np.asarray(demand.get_ydata()).tolist() == [0.8] * 25


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("magic",), "method 'magic' was not compared; allowed: idle, rule, rule-0.9"),
        ((["idle", "mgc", "x"],), "method 'mgc', 'x' was not compared"),
        (([],), "0 methods; allowed: 1 to 6"),
        (("idle", 3), "episode 3; allowed: 1 to 2"),
        (("idle", 0), "episode 0; allowed: 1 to 2"),
        (("idle", "all"), "episode all; allowed: 1 to 2"),
        (("idle", 1, 2), "day 2; allowed: 1 to 1, or all"),
        (("idle", 1, "x"), "day x; allowed: 1 to 1, or all"),
        (("idle", 1, 1, "storm.gif"), "allowed suffixes: .png, .pdf, .svg"),
    ],
)
def test_what_does_not_exist_is_refused(
    tiny: Comparison, arguments: tuple[Any, ...], message: str
) -> None:
    with pytest.raises(rs.UsageError, match="hint:") as caught:
        rs.plot_storm(tiny, *arguments)
    assert message in str(caught.value)
