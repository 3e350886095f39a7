"""`harden` from a storm to a plan: the same storms for every choice, what it says, its errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import resilience as rs
from resilience.cli.app import app
from resilience.errors import UsageError
from resilience.parts import save_part
from resilience.planning.hardening.draws import (
    StrengthOption,
    draw_options,
    drawn_with,
    status_with,
)
from resilience.planning.hardening.evaluation import outcomes_of
from resilience.planning.hardening.harden import in_steps
from resilience.planning.hardening.options import strengths
from resilience.planning.hardening.report import Hardening
from resilience.planning.hardening.season import Season, season_of
from resilience.plots.hardening import plot_hardening
from resilience.results import PARTS_FOLDER
from resilience.text.console import plain_console
from resilience.text.hardening import print_hardening

LINES = ("1-2", "12-13", "28-29")


@pytest.fixture(scope="module")
def over() -> Season:
    return season_of(in_steps(rs.load_case("ieee33_rammasun"), 180.0))


@pytest.fixture(scope="module")
def hardening() -> Hardening:
    return rs.harden(
        "ieee33_rammasun", 2.0, storms=8, new_storms=6, factor=1.5, lines=LINES, step_min=180.0,
        frontier=[0.0, 1.0],
    )  # fmt: skip


def test_any_set_meets_the_same_storms(over: Season) -> None:
    """Drawn as a set or put together line by line; underground, nothing fails."""
    options = [
        StrengthOption("12-13", 1.2, 1.0), StrengthOption("12-13", 1.5, 2.0),
        StrengthOption("6-7", float("inf"), 5.0), StrengthOption("1-2", 1.5, 1.0),
    ]  # fmt: skip
    draws = draw_options(over, options, 60, 5)
    names = draws.scenarios.lines
    for chosen in ([0, 1, 1, 0], [1, 0, 0, 1], [0, 0, 0, 0]):
        picked = np.array(chosen, bool)
        at_once = drawn_with(
            over, [o for o, p in zip(options, chosen, strict=True) if p], 60, 5, crews=False
        )
        together = status_with(draws, options, picked)
        np.testing.assert_array_equal(at_once.down, together.down)
    assert not draws.strong[2].any()
    bare = draws.scenarios.down[names.index("12-13")].any(axis=0)
    weak, strong = draws.strong[0].any(axis=0), draws.strong[1].any(axis=0)
    assert not (strong & ~weak).any()
    assert not (weak & ~bare).any()
    assert bare.sum() > strong.sum()


def test_a_shifted_draw_keeps_its_weights(over: Season) -> None:
    options = [StrengthOption("12-13", 1.5, 1.0)]
    draws = draw_options(over, options, 40, 5, shift=-1.0)
    weight = draws.scenarios.probability
    assert weight.sum() == pytest.approx(1.0)
    assert np.ptp(weight) > 0.0
    np.testing.assert_array_equal(weight, drawn_with(over, options, 40, 5, -1.0).probability)


def test_what_is_said_is_what_the_storms_cost(over: Season, hardening: Hardening) -> None:
    """The plan's figures are those of the storms drawn anew with its lines, by the case's crews."""
    expected = outcomes_of(
        over.storms[0].case, drawn_with(over, strengths(hardening.chosen), 8, 0), "copperplate"
    )
    np.testing.assert_allclose(hardening.in_sample["plan"].cost, expected.cost)
    table = hardening.comparison()
    nothing, plan = (hardening.out_of_sample[name] for name in ("nothing", "plan"))
    saved = nothing.cost - plan.cost
    assert table["saved"]["plan"] == pytest.approx(saved.mean())
    assert table["saved_error"]["plan"] == pytest.approx(saved.std(ddof=1) / np.sqrt(6))
    assert table["cost"].loc[["all", "plan", "nothing"]].is_monotonic_increasing
    assert hardening.status == "optimal"
    values = hardening.frontier_frame()["value"].tolist()
    assert values == sorted(values, reverse=True)
    assert hardening.frontier_frame().index.tolist() == [0.0, 1.0, 2.0]


def test_the_worth_of_every_line_adds_up(hardening: Hardening) -> None:
    """With a budget for one, the best saves what it saves alone."""
    one = hardening.frontier[1]
    (k,) = np.flatnonzero(one.chosen)
    assert hardening.frontier[0].value - one.value == pytest.approx(hardening.alone[k])
    assert hardening.alone[k] == pytest.approx(hardening.alone.max())


def test_it_is_printed_saved_and_drawn(hardening: Hardening, tmp_path: Path) -> None:
    console = plain_console(width=80, record=True)
    print_hardening(hardening, console)
    text = console.export_text()
    assert "of 3 options for 2 $ of 2 $" in text
    assert "1-2 fails most often" in text
    assert "…" not in text
    hardening.save(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert summary["built"] == [option.label for option in hardening.chosen]
    assert summary["bound"] <= summary["objective"]
    figure = plot_hardening(hardening, tmp_path / "picture.svg")
    assert len(figure.axes) == 3


def test_the_command_prints_json() -> None:
    arguments = [
        "harden", "ieee33_rammasun", "--budget", "1", "--storms", "4", "--new-storms", "2",
        "--factor", "1.5", "--lines", "12-13", "--step-min", "360", "--risk", "cvar:0.5:0.5",
        "--json",
    ]  # fmt: skip
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 0, answer.output
    summary = json.loads(answer.stdout)
    assert summary["options"][0]["line"] == "12-13"
    assert summary["risk"] == "0.5 of the expected cost, 0.5 of CVaR 0.5"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "budget of nothing"),
        ({"budget": -1.0}, "budget of -1"),
        ({"budget": 1.0, "storms": 0}, "0 storms"),
        ({"budget": 1.0, "frontier": [-2.0]}, "budgets -2"),
        ({"budget": 1.0, "physics": "distflow"}, "distflow"),
        ({"budget": 1.0, "step_min": 7.0}, "steps of 7 min"),
        ({"budget": 1.0, "step_min": 0.0}, "steps of 0 min"),
        ({"budget": 1.0}, "nothing to build"),
    ],
)
def test_what_cannot_be_is_refused(keys: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        rs.harden("ieee33_rammasun", **keys)  # type: ignore[arg-type]


def test_lines_that_are_switched_want_copperplate_and_stand_beside_strong_ones() -> None:
    lines = [{"name": "21-8", "in_service": False, "tie_cost": 1.0},
             {"name": "12-22", "in_service": False, "switchable": True}]  # fmt: skip
    case = rs.load_case("ieee33_rammasun").replace(line=lines, outages=())
    common: dict[str, Any] = {"storms": 4, "new_storms": 3, "factor": 1.5, "step_min": 360.0}
    found = rs.harden(case, 2.0, lines=["12-13", "13-14"], **common)
    assert [option.label for option in found.options] == ["12-13 x1.5", "13-14 x1.5", "tie 21-8"]
    assert found.status == "optimal"
    assert any("ties" in note for note in found.notes)
    assert found.comparison()["cost"].loc[["all", "nothing"]].is_monotonic_increasing
    with pytest.raises(UsageError, match="12-22"):
        rs.harden(case, 2.0, physics="lindistflow", **common)


def test_an_interrupted_choice_goes_on_and_comes_to_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped after every part in turn, then let go: all figures are those of a run that lived."""
    whole = chosen(tmp_path / "whole")
    parts = sorted((tmp_path / "whole" / PARTS_FOLDER).iterdir())
    assert len(parts) > 6
    calls = 0

    def once(path: Path, values: object) -> None:
        nonlocal calls
        save_part(path, values)
        calls += 1
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("resilience.planning.hardening.finished.save_part", once)
        for number in range(len(parts)):
            with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
                chosen(tmp_path / "broken")
            assert calls == number + 1
    again = chosen(tmp_path / "broken")
    assert sorted(p.name for p in (tmp_path / "broken" / PARTS_FOLDER).iterdir()) == [
        part.name for part in parts
    ]
    for frame in (Hardening.frame, Hardening.comparison, Hardening.frontier_frame):
        pd.testing.assert_frame_equal(frame(again), frame(whole), rtol=1e-9)


def test_parts_of_something_else_or_damaged_ones_are_not_believed(tmp_path: Path) -> None:
    chosen(tmp_path)
    parts = tmp_path / PARTS_FOLDER
    before = {path: path.read_bytes() for path in parts.iterdir()}
    chosen(tmp_path, seed=5)
    assert len(list(parts.iterdir())) > len(before)
    assert {path: path.read_bytes() for path in before} == before
    torn = next(path for path in before if path.name.startswith("storms"))
    torn.write_bytes(before[torn].replace(b"0.", b"1.", 1))
    chosen(tmp_path)
    assert {path: path.read_bytes() for path in before} == before
    chosen(tmp_path).save(tmp_path)
    assert {path: path.read_bytes() for path in before} == before


def chosen(folder: Path, seed: int = 0) -> Hardening:
    """Which of two lines to strengthen, parts kept in a folder."""
    return rs.harden(
        "ieee33_rammasun", 1.0, storms=3, new_storms=2, factor=1.5, lines=LINES[:2],
        step_min=360.0, frontier=[0.0], seed=seed, out=folder,
    )  # fmt: skip
