"""What is built is planned for the storms of many years: their draws, weights, days and errors."""

from __future__ import annotations

import csv
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.errors import CaseError, UsageError
from resilience.fragility.outages.weights import standard_error
from resilience.planning.hardening.draws import StrengthOption, draw_options, drawn_with
from resilience.planning.hardening.evaluation import StormOutcomes
from resilience.planning.hardening.harden import in_steps
from resilience.planning.hardening.season import season_of

LINES = ("12-13", "13-14", "28-29")


def base(plan: dict[str, Any] | None = None) -> Case:
    case = in_steps(rs.load_case("ieee33_rammasun"), 180.0)
    return case if plan is None else case.replace(plan=plan)


def test_a_catalogue_of_one_storm_draws_what_the_storm_draws() -> None:
    alone, one = season_of(base()), season_of(base({"storm": [{"per_year": 0.3}]}))
    plain, listed = (drawn_with(season, (), 30, 5) for season in (alone, one))
    np.testing.assert_array_equal(plain.down, listed.down)
    np.testing.assert_array_equal(plain.probability, listed.probability)


def test_every_storm_weighs_as_often_as_it_comes() -> None:
    season = season_of(base({"storm": [{"per_year": 0.3}, {"per_year": 0.9}]}))
    options = [StrengthOption("12-13", 1.5, 1.0)]
    draws = draw_options(season, options, 21, 5, shift=-0.5)
    first = season.storm_of(21) == 0
    assert season.split(21).tolist() == [11, 10]
    assert draws.scenarios.probability[first].sum() == pytest.approx(0.25)
    alone = draw_options(season_of(base()), options, 11, 5, shift=-0.5)
    np.testing.assert_array_equal(draws.scenarios.down[:, :, first], alone.scenarios.down)
    np.testing.assert_array_equal(draws.strong[:, :, first], alone.strong)
    # The same storm, but not the same draws.
    assert (draws.scenarios.down[:, :, ~first] != alone.scenarios.down[:, :, :10]).any()
    with pytest.raises(UsageError, match="one for each"):
        season.split(1)


def test_a_track_of_another_year_is_laid_on_the_day_of_the_storm(tmp_path: Path) -> None:
    """The case's own track, written 37 days and some hours later, blows as the case's own does."""
    case = base()
    assert case.storm is not None
    offset, moved = timedelta(hours=case.storm.utc_offset_h), timedelta(days=37)
    path = tmp_path / "later.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["time", "lat", "lon", "pressure_hpa", "vmax_mps"])
        for time, *numbers in case.storm.points:
            rows.writerow([(time - offset + moved).isoformat(sep=" "), *numbers])
    later = {"file": str(path), "per_year": 1.0, "averaging_s": case.storm.averaging_s or 60.0}
    season = season_of(base({"storm": [{"per_year": 1.0}, later]}))
    (own, laid), names = season.storms, season.names
    assert names[1] == "later"
    np.testing.assert_array_equal(own.track.time, laid.track.time)
    np.testing.assert_allclose(own.failed_by, laid.failed_by, atol=0.02)
    assert own.failed_by.max() > 0.1


def test_errors_are_those_of_each_storm_by_itself() -> None:
    """Storms that differ by a hundredfold come as often as they come: that is no error."""
    rng = np.random.default_rng(3)
    cost = np.concatenate([rng.normal(5.0, 1.0, 40), rng.normal(500.0, 2.0, 60)])
    weight = np.concatenate([np.full(40, 0.9 / 40), np.full(60, 0.1 / 60)])
    stratum = np.repeat([0, 1], [40, 60])
    outcomes = StormOutcomes(weight, cost, cost, cost, cost, cost, stratum)
    expected = np.hypot(
        0.9 * cost[:40].std(ddof=1) / np.sqrt(40), 0.1 * cost[40:].std(ddof=1) / np.sqrt(60)
    )
    assert outcomes.error("cost") == pytest.approx(expected)
    assert standard_error(cost, weight) > 10.0 * expected


def test_a_year_of_storms_from_a_catalogue(tmp_path: Path) -> None:
    plan = {"storm": [{"per_year": 0.5}, {"per_year": 1.5}], "interest_rate": 0.0,
            "life_years": 10.0}  # fmt: skip
    found = rs.harden(
        base(plan), storms=8, new_storms=6, factor=1.5, cost=40.0, lines=LINES, step_min=180.0
    )
    table, yearly, by_storm = found.comparison(), found.yearly(), found.by_storm()
    assert found.budget == np.inf
    assert found.chosen
    np.testing.assert_allclose(yearly["storms"], 2.0 * table["cost"])
    np.testing.assert_allclose(yearly["built"], 4.0 * table["built"])
    net = yearly["storms"]["nothing"] - yearly["storms"] - yearly["built"]
    np.testing.assert_allclose(yearly["saved"], net, atol=1e-9)
    assert by_storm["per_year"].tolist() == [0.5, 1.5]
    share = by_storm["share"].to_numpy()
    assert share @ by_storm["plan"].to_numpy() == pytest.approx(table["cost"]["plan"])
    objective = found.summary()
    assert objective["objective"] == pytest.approx(found.choice.value)
    assert objective["budget"] is None
    found.save(tmp_path)
    written = {path.name for path in tmp_path.iterdir()}
    assert {"yearly.csv", "by_storm.parquet", "README.md", "case.toml"} <= written


def test_any_budget_has_a_place_in_the_picture(tmp_path: Path) -> None:
    plan = {"storms_per_year": 2.0, "life_years": 10.0,
            "site": [{"name": "depot", "kind": "ess", "units": 2, "cost": 20.0,
                      "unit": {"bus": "14", "p_max_mw": 1.0, "e_mwh": 4.0}}]}  # fmt: skip
    found = rs.harden(
        base(plan), storms=4, new_storms=3, factor=1.5, cost=40.0, lines=LINES[:1],
        step_min=180.0, frontier=[20.0],
    )  # fmt: skip
    figure = rs.plot_hardening(found, tmp_path / "picture.png")
    left, right = figure.axes[-1].get_xlim()
    assert np.isfinite([left, right]).all()
    assert figure.axes[-1].get_ylabel() == "objective, $ a year"


def test_what_is_wrong_with_a_catalogue_is_said() -> None:
    with pytest.raises(CaseError, match="nothing beside"):
        base({"storm": [{"per_year": 1.0}], "storms_per_year": 1.0})
    with pytest.raises(CaseError, match="without a track file"):
        base({"storm": [{"per_year": 1.0, "agency": "cma"}]})
    with pytest.raises(CaseError, match="per_year"):
        base({"storm": [{}]})
    with pytest.raises(UsageError, match="track file"):
        season_of(base({"storm": [{"per_year": 1.0, "file": "nowhere.csv"}]}))


def test_a_track_file_stands_beside_the_case(tmp_path: Path) -> None:
    text = (
        'extends = "ieee33_rammasun"\nname = "years"\n[[plan.storm]]\nfile = "a.csv"\n'
        "per_year = 1.0\n"
    )
    (tmp_path / "years.toml").write_text(text, "utf-8")
    plan = rs.load_case(tmp_path / "years.toml").plan
    assert plan is not None
    assert plan.storm[0].file == str(tmp_path / "a.csv")
