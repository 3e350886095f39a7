"""`resilience hazard`: what it prints, writes and draws."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

import resilience as rs
from resilience import fragility
from resilience.cli import main
from resilience.fragility import chain
from resilience.fragility.feeder_hazard import Hazard, hazard
from resilience.fragility.outages.files import load_scenarios
from resilience.plots.hazard import plot_hazard
from resilience.text.hazard import print_hazard

TRACK = """time,lat,lon,pressure_hpa,vmax_mps,averaging_s
2023-10-04T00:00,22.2,123.5,945,47.8,120
2023-10-04T12:00,22.0,122.0,930,54.5,120
2023-10-05T00:00,21.9,120.9,945,47.8,120
2023-10-05T12:00,22.0,119.1,970,37.6,120
2023-10-06T12:00,21.4,116.3,950,47.8,120
"""


@pytest.fixture(scope="module")
def found() -> Hazard:
    return hazard("ieee33_koinu", n=200, seed=1)


def test_the_summary_is_the_tables_and_names_what_is_made_up(found: Hazard, tmp_path: Path) -> None:
    folder = found.save(tmp_path / "out")
    summary = json.loads((folder / "hazard.json").read_text())
    assert summary["synthetic"] is True
    assert summary["filled"]["rmw_km"]
    assert summary["closest_km"] < 20.0
    failed = {row["line"]: row["failure_probability"] for row in summary["lines"]}
    assert summary["expected_lines_down"] == pytest.approx(sum(failed.values()))
    with (folder / "hazard.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == found.storm.case.slots
    stands = np.prod([1.0 - float(row["16-17"]) for row in rows])
    assert 1.0 - stands == pytest.approx(failed["16-17"], abs=1e-6)
    assert rs.load_case("ieee33_koinu").slots == len(rows)
    assert {path.name for path in folder.iterdir()} == {
        "hazard.json", "hazard.csv", "failed_by.csv", "wind.csv",
        "lines.csv", "loads.csv", "outages.npz", "README.md",
    }  # fmt: skip


def test_the_likeliest_slot_is_that_in_which_most_failures_begin(
    found: Hazard, tmp_path: Path
) -> None:
    """From the hazard of every slot: the chance to fail in it times that to stand until then."""
    folder = found.save(tmp_path / "out")
    with (folder / "hazard.csv").open() as file:
        rows = list(csv.DictReader(file))
    case = found.storm.case
    for line in found.lines:
        hazard_of = np.array([float(row[line["line"]]) for row in rows])
        begins = hazard_of * np.append(1.0, np.cumprod(1.0 - hazard_of)[:-1])
        assert begins.max() > 0.0
        assert line["likeliest"] == case.slot_label(int(begins.argmax()))


def test_buses_farther_out_are_cut_off_more_often(found: Hazard) -> None:
    """On a radial feeder a bus is apart whenever the one before it is."""
    network = found.storm.case.network
    apart = found.likely.apart
    for i, j, up in zip(network.from_bus, network.to_bus, network.in_service, strict=True):
        if up:
            assert apart[j] >= apart[i] - 1e-12


def test_loads_without_a_source_are_those_that_simulated_islands_leave(found: Hazard) -> None:
    """Of every storm and slot, by networkx: parts without grid, storage or generator are dark."""
    case, drawn = found.storm.case, found.scenarios
    network = case.network
    sources = {network.bus(d.bus) for d in (*case.grid, *case.ess, *case.generator)}
    step, dark = 16, np.zeros((len(network.bus_names), len(range(0, case.slots, 16))))
    for number, t in enumerate(range(0, case.slots, step)):
        for k in range(drawn.n):
            out = {
                line for line, down in zip(drawn.lines, drawn.down[:, t, k], strict=True) if down
            }
            graph = nx.Graph()
            graph.add_nodes_from(range(len(network.bus_names)))
            for name, i, j, up in zip(
                network.line_names,
                network.from_bus,
                network.to_bus,
                network.in_service,
                strict=True,
            ):
                if up and name not in out:
                    graph.add_edge(int(i), int(j))
            for part in nx.connected_components(graph):
                if not part & sources:
                    dark[list(part), number] += drawn.probability[k]
    np.testing.assert_allclose(found.likely.dark_by_slot[:, ::step], dark, atol=1e-12)
    row = next(one for one in found.loads if one["load"] == "load20")
    at = network.bus("32")
    assert row["dark_hours"] == pytest.approx(0.25 * found.likely.dark_by_slot[at].sum())
    mw = 0.46 * case.profile(next(one.profile for one in case.load if one.name == "load20"))
    assert row["dark_mwh"] == pytest.approx(0.25 * (found.likely.dark_by_slot[at] * mw).sum())


def test_the_course_of_the_storm_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["hazard", "ieee33_koinu", "-n", "50"])
    assert done.value.code == 0
    said = capsys.readouterr().out
    rows = [
        line.split() for line in said.splitlines() if line.strip().startswith(("d1", "d2", "d3"))
    ]
    failed = [float(row[3]) for row in rows]
    assert failed == sorted(failed)
    assert rows[-1][:2] == ["d3", "12:00"]
    assert f"lines    {failed[-1]:.1f} of 32 expected to fail" in said
    assert "lines down at once:" in said


def test_the_picture_shows_what_it_is(found: Hazard, tmp_path: Path) -> None:
    figure = plot_hazard(found, tmp_path / "storm.png")
    assert (tmp_path / "storm.png").stat().st_size > 20_000
    heading = figure.get_suptitle()
    assert "Koinu" in heading
    assert "synthetic geography" in heading
    with pytest.raises(rs.UsageError, match="allowed suffixes"):
        plot_hazard(found, tmp_path / "storm.gif")


def test_the_command_reads_a_track_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "koinu.csv"
    path.write_text(TRACK, encoding="utf-8")
    with pytest.raises(SystemExit) as done:
        main(["hazard", "ieee33_koinu", "--track", str(path), "-n", "50", "--json"])
    assert done.value.code == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["storm"] == "koinu"
    assert len(answer["hazard"]["1-2"]) == 192
    with pytest.raises(SystemExit):
        main(["scenarios", "ieee33_koinu", "--track", str(path), "-n", "20", "--json"])
    drawn = json.loads(capsys.readouterr().out)
    assert drawn["scenarios"] == 20
    assert "storm, 1 course of winds" in drawn["process"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["hazard", "ieee33"], "33 of 33 buses without coordinates"),
        (["hazard", "ieee33"], "points, or a track file"),
        (["hazard", "ieee33_koinu", "--storm", "KOINU"], "add --track FILE"),
        (["hazard", "ieee33_koinu", "--track", "nowhere.csv"], "does not exist"),
        (["scenarios", "ieee33_koinu", "--days", "2"], "a storm comes once"),
        (["solve", "ieee33", "--outages", "storm"], "buses without coordinates"),
        (["compare", "ieee33_koinu", "--days", "2"], "its outages come once"),
    ],
)
def test_what_cannot_be_is_refused(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        main(words)
    assert done.value.code == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("lon", [179.9, 180.0, -179.9])
def test_a_feeder_astride_the_dateline_is_where_it_is(lon: float) -> None:
    """The same storm over the same feeder, moved round the earth."""
    case = rs.load_case("ieee33_koinu")
    assert case.storm is not None
    assert case.geography is not None
    assert case.geography.anchor_lon_deg is not None
    by = lon - case.geography.anchor_lon_deg
    points = tuple(
        (p[0], p[1], (p[2] + by + 180.0) % 360.0 - 180.0, *p[3:]) for p in case.storm.points
    )
    moved = case.replace(
        geography=case.geography.model_copy(update={"anchor_lon_deg": lon}),
        storm=case.storm.model_copy(update={"points": points}),
    )
    here, there = hazard(case, n=5), hazard(moved, n=5)
    assert here.closest is not None
    assert there.closest is not None
    assert there.closest[0] == pytest.approx(here.closest[0], abs=0.01)
    np.testing.assert_allclose(there.storm.failed_by, here.storm.failed_by, atol=1e-6)
    for one, other in zip(there.storm.geography.bus_km, here.storm.geography.bus_km, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


def test_mistakes_of_the_feeder_and_of_the_track_come_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "track.csv"
    path.write_text(TRACK.replace("22.0,122.0", "122.0,22.0"), encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["hazard", "ieee33", "--track", str(path)])
    said = capsys.readouterr().err
    assert "33 of 33 buses without coordinates" in said
    assert "latitude" in said or "lat" in said
    assert "track.csv" in said


def test_rare_storms_are_drawn_often_and_few_stand_for_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "few.npz"
    words = ["scenarios", "ieee33_koinu", "-n", "400", "--shift", "-1", "--reduce", "40"]
    with pytest.raises(SystemExit) as done:
        main([*words, "--out", str(path)])
    assert done.value.code == 0
    assert "out at once in" in capsys.readouterr().out
    few = load_scenarios(path, rs.load_case("ieee33_koinu"))
    assert 30 <= few.n <= 40  # some get no weight
    assert few.probability.sum() == pytest.approx(1.0)
    assert few.probability.max() > 2.0 * few.probability.min()
    with pytest.raises(SystemExit):
        main(["scenarios", "ieee33", "--shift", "-1"])
    assert "of a storm only" in capsys.readouterr().err


def test_a_track_without_its_averaging_time_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "track.csv"
    path.write_text("\n".join(line.rpartition(",")[0] for line in TRACK.splitlines()))
    with pytest.raises(SystemExit):
        main(["hazard", "ieee33_koinu", "--track", str(path)])
    assert "averaging_s" in capsys.readouterr().err
    with pytest.raises(SystemExit) as done:
        main(["hazard", "ieee33_koinu", "--track", str(path), "--averaging-s", "120", "-n", "5"])
    assert done.value.code == 0


def test_no_public_name_is_hidden_by_a_module() -> None:
    """`from resilience.fragility import x` must not depend on what was imported before."""
    folder = Path(fragility.__file__).parent
    modules = {path.stem for path in folder.iterdir()}
    assert not modules.intersection(fragility.__all__)


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as done:
        main(list(words))
    assert done.value.code == 0
    return " ".join(capsys.readouterr().out.split())  # lines are broken where a terminal ends


def test_an_answer_says_what_it_rests_on(found: Hazard, capsys: pytest.CaptureFixture[str]) -> None:
    """Koinu's case as it stands in its file; Harper's and Knaff's factors; CMA's practice."""
    said = found.summary()
    assert (said["field"], said["takes"], said["asymmetry"]) == (
        "holland2008", "pressure", "climada",
    )  # fmt: skip
    assert said["points_without_pressure"] == 0
    assert (said["agency"], said["averaging_s"], said["agency_factor"]) == ("cma", 120.0, 0.871)
    assert [factor["value"] for factor in said["factors"]] == pytest.approx([1.49, 0.8])
    assert said["factors"][1]["source"] == "knaff2011: water to land"
    assert (said["pole"], said["hardening"], said["correlation"]) == ("pole", 1.8, 0.3)
    assert said["curves"]["pole"]["median_mps"] == 58.2
    assert said["curves"]["pole"]["of"] == "3 s mean at 10 m over land"
    assert said["exceptions"]["1-2"]["pole"] == "substation"
    assert said["repair"]["crews"] == 3
    assert (said["members"], said["forecast"], said["cables"]) == (1, None, 0)
    assert said["expected_lines_down_standard_error"] == 0.0
    text = printed(capsys, "hazard", "ieee33_koinu", "-n", "5")
    assert "field holland2008, from the pressure of the track; asymmetry climada" in text
    assert "1.15 from 120 s to one minute, as cma; 1.49 Harper 2010, in-land; 0.8 knaff" in text
    assert "curve pole, 1.8 times as strong, correlation 0.3; 1 line otherwise" in text
    assert "±" not in text


def test_every_choice_of_a_case_is_in_its_answer() -> None:
    """What is not the default, and why an answer is another."""
    case = rs.load_case("ieee33_koinu")
    assert case.storm is not None
    changed = {
        "wind": "willoughby2006", "asymmetry": "none", "inflow": "hubbert1991", "hardening": 1.3,
        "roughness": "tchazards", "inland_km": 0.7, "conductor": "pole",
    }  # fmt: skip
    storm = case.storm.model_copy(update=changed)
    said = hazard(case.replace(storm=storm), n=2).summary()
    for key in ("asymmetry", "inflow", "hardening", "conductor"):
        assert said[key] == changed[key]
    assert said["field"] == "willoughby2006"
    assert said["takes"] == "wind"
    assert said["factors"][-1]["value"] == pytest.approx(0.66 + 0.34 * np.exp(-0.7 / 0.4))


def test_sampled_members_carry_their_noise(capsys: pytest.CaptureFixture[str]) -> None:
    """The standard deviation of single members' answers, over the root of how many there are."""
    case = rs.load_case("ieee33_koinu")
    assert case.storm is not None
    errors = case.storm.forecast.model_copy(update={"members": 7, "cross_km_per_day": 90.0})
    forecast = case.replace(storm=case.storm.model_copy(update={"forecast": errors}))
    answer = hazard(forecast, n=3)
    alone = [chain.storm(case, member, every_line=True) for member in answer.storm.members]
    failed = np.array([one.failed_by[:, -1] for one in alone])
    said = answer.summary()
    assert said["forecast"]["members"] == 7
    assert said["expected_lines_down"] == pytest.approx(failed.sum(axis=1).mean())
    spread = np.std(failed.sum(axis=1), ddof=1) / np.sqrt(7)
    assert spread > 0.1
    assert said["expected_lines_down_standard_error"] == pytest.approx(spread)
    for k, row in enumerate(said["lines"]):
        assert row["standard_error"] == pytest.approx(np.std(failed[:, k], ddof=1) / np.sqrt(7))
    from rich.console import Console

    print_hazard(answer, Console(width=200))
    text = capsys.readouterr().out
    assert f"{failed.sum(axis=1).mean():.1f} ± {spread:.1f} of 32 expected to fail" in text
    assert "one standard error of 7 tracks drawn with seed 0" in text


def test_a_storm_far_away_is_remarked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "far.csv"
    rows = TRACK
    for place in ("22.2,123.5", "22.0,122.0", "21.9,120.9", "22.0,119.1", "21.4,116.3"):
        lat, lon = place.split(",")
        rows = rows.replace(place, f"{lat},{float(lon) + 40.0}")
    path.write_text(rows, encoding="utf-8")
    words = ("hazard", "ieee33_koinu", "--track", str(path), "-n", "3")
    assert "more than 1000 km: is it this feeder's storm?" in printed(capsys, *words)


def test_percentages_of_weighted_storms_say_what_they_are_worth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Kish: one over the sum of squared weights. Storms that are all alike need no word."""
    path = tmp_path / "rare.npz"
    words = ["scenarios", "ieee33_koinu", "-n", "60", "--seed", "4"]
    text = printed(capsys, *words, "--shift", "-2", "--out", str(path))
    weights = load_scenarios(path, rs.load_case("ieee33_koinu")).probability
    size = 1.0 / (weights**2).sum()
    assert size < 20.0
    assert f"worth {size:.3g} of 60 equally likely ones" in text
    assert f"% of scenarios, worth {size:.3g} of 60" in text
    said = json.loads(printed(capsys, *words, "--shift", "-2", "--json"))
    assert said["effective_scenarios"] == pytest.approx(size)
    assert "worth" not in printed(capsys, *words)
