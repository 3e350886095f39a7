"""The paper's experiments as data, run once: figures by hand, digests, and its own tables."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import resilience as rs
from resilience.case import case_text
from resilience.cli.app import app
from resilience.errors import UsageError
from resilience.evaluation.compare import evaluate
from resilience.evaluation.measures.intervals import MeanInterval
from resilience.fragility.draw import sample_case
from resilience.progress import NOTICE
from resilience.rl.reproduce import experiments, outage_day, outcomes, published, trained
from resilience.rl.reproduce import run as runner
from resilience.rl.reproduce.experiments import Contender, Effort, Experiment
from resilience.rl.reproduce.figures import Figures, episode_values
from resilience.rl.reproduce.outcomes import Outcome, changed
from resilience.rl.reproduce.run import Reproduction, reproduce
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.text.reproduction import print_reproduction
from tests.shared import shared
from tests.unit.rl.small import few_storms, small_storm_case

TINY = Effort(days=8, draws=3, seeds=2, variant_seeds=1, budget_s=1e-3, episodes=20)
CHOSEN = tuple(
    e
    for e in experiments.EXPERIMENTS
    if e.name in ("methods", "methods-paper", "shed-price-1.5-paper", "failed-agents", "deviation")
)


def test_the_tables_are_those_of_the_paper() -> None:
    text = shared("reference", "paper.tex").read_text(encoding="utf-8")
    rows = {
        "Rule-based": published.RULE,
        "MINLP": published.MINLP,
        "DDPG": published.DDPG,
        "MAPPO": published.MAPPO,
        "Proposed method": published.PROPOSED,
        "Without failure": published.FAILED[0],
        "1 agent failure": published.FAILED[1],
        "3 agents failure": published.FAILED[3],
    }
    for label, row in rows.items():
        line = re.search(rf"^ *{label} +&(.*)\\\\$", text, re.MULTILINE)
        assert line, label
        cells = re.sub(r"\{,\}|\\textbf|\\textasciitilde|[{}~\s]", "", line[1]).split("&")
        values = (row.average, row.highest, row.lowest, row.shed_mw, row.time_s)
        assert [float(cell) for cell in cells] == [v for v in values if v is not None]
    for price, row in published.SHED_PRICE.items():
        assert rf"\$ {price:g} & {row.shed_mw:g} \\" in text
    assert rf"\${published.DEVIATION.lowest} per day" in text
    assert f"{published.DEVIATION.shed_mw} MW per day" in text
    assert rf"\${published.MESH.highest}" in text


def test_figures_of_an_episode_are_sums_of_its_slots() -> None:
    case = small_storm_case()
    storms = sample_case(case, 3, 5)
    world = World.build(microgrid_with_fallible_lines(case, storms, "copperplate"), storms)
    report = rs.evaluate(world, ["idle"])
    values = {name: value.mean(1) for name, value in episode_values(report, "idle").items()}
    trajectory = report.trajectories["idle"]
    days = trajectory.cost.reshape(8, 12, 3).sum(1)
    np.testing.assert_allclose(values["average"], days.mean(0))
    np.testing.assert_allclose(values["highest"], days.max(0))
    np.testing.assert_allclose(values["lowest"], days.min(0))
    mw = trajectory.shed.sum(0).sum(0)
    assert mw.max() > 0.0
    np.testing.assert_allclose(values["shed_mw_slots"], mw / 8)
    np.testing.assert_allclose(values["shed_mwh"], 2.0 * mw / 8)
    left = 0.35 * trajectory.energy[:, -1].sum(0)
    np.testing.assert_allclose(values["net"], days.mean(0) - left / 8)
    gap = 100.0 * (8 * values["net"].mean() / report.bound.mean() - 1.0)
    assert values["gap_percent"].mean() == pytest.approx(gap)
    np.testing.assert_allclose(
        values["over_rule"], values["net"] - report.objective["rule-0.9"] / 8
    )


def test_a_price_that_the_case_has_changes_nothing() -> None:
    case = small_storm_case()
    same = Experiment("name", "title", (), shed_cost_per_mwh=31.0)
    assert changed(case, same) is case
    dear = changed(case, replace(same, shed_cost_per_mwh=47.0))
    assert [load.shed_cost_per_mwh for load in dear.load] == [47.0]


@pytest.fixture
def case_path(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(case_text(small_storm_case()), encoding="utf-8")
    return path


@pytest.fixture
def learning(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
    pytest.importorskip("safetensors", reason="safetensors is not installed here")
    few_storms(monkeypatch)


@pytest.fixture
def few_learners(learning: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The proposed method alone, judged against a rule."""
    small = Experiment("rules", "rules alone", (experiments.RULE, experiments.PROPOSED))
    monkeypatch.setattr(runner, "METHODS", small)
    monkeypatch.setattr(runner, "EXPERIMENTS", (small,))


def refused(*_: Any, **__: Any) -> Any:
    raise AssertionError("nothing is to be run again")


@pytest.mark.slow
@pytest.mark.usefixtures("learning")
def test_a_second_call_trains_and_simulates_nothing_and_says_the_same(
    tmp_path: Path, case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def called() -> Reproduction:
        return reproduce(case_path, out=tmp_path / "out", scale=TINY, experiments=CHOSEN)

    first = called()
    for module, name in (
        (trained, "_train"),
        (outcomes, "evaluate"),
        (outage_day, "evaluate"),
    ):
        monkeypatch.setattr(module, name, refused)
    second = called()
    assert second.summary() == first.summary()
    by_name = {outcome.name: outcome for outcome in first.outcomes}
    rows = {row.label: row for row in by_name["methods"].rows}
    assert {row.runs for row in rows.values()} == {1, 2}
    for label in ("MADDPG-GRU", "DDPG", "MAPPO", "apg"):
        assert rows[label].runs == TINY.seeds
        assert rows[label].training_cpu_s > 0.0
    assert rows["clairvoyant"].statistics["gap_percent"].mean == pytest.approx(0.0, abs=1e-6)
    assert all(row.statistics["gap_percent"].mean > -1e-6 for row in rows.values())
    assert all(row.v_min_pu < 1.1 and row.power_flow_ms > 0.0 for row in rows.values())
    assert "battery kept full" in by_name["methods"].telling
    failing = by_name["failed-agents"]
    assert [row.label for row in failing.rows[:2]] == ["none failed", "1 failed"]
    assert failing.notes == ("3 failed: left out, small has 2 agents",)
    assert by_name["methods-paper"].setting[-1] == "the paper's recourse"
    check_saved(first)


def test_a_call_that_goes_on_says_how_many_experiments_it_found(
    tmp_path: Path,
    case_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    chosen = [Experiment(name, "rules alone", (experiments.RULE,)) for name in ("b", "a", "c")]
    chosen[1] = replace(chosen[1], recourse="paper")
    out = tmp_path / "out"
    calls: list[str] = []

    def stopped_at_the_third(*arguments: Any, **options: Any) -> Any:
        calls.append("call")
        if len(calls) == 3:
            raise KeyboardInterrupt
        return evaluate(*arguments, **options)

    def called() -> str:
        caplog.clear()
        with pytest.raises(KeyboardInterrupt) as stop:
            reproduce(case_path, out=out, scale=TINY, experiments=chosen)
        assert str(stop.value) == f"2 of 3 experiments are in {out}; the same command goes on"
        return "\n".join(caplog.messages)

    caplog.set_level(NOTICE, "resilience")
    monkeypatch.setattr(outcomes, "evaluate", stopped_at_the_third)
    assert called() == ""
    calls[:] = ["call"] * 2
    assert called() == f"2 of 3 experiments are in {out}; the others are run"
    (damaged,) = (out / "figures").glob("a-*.json")
    damaged.write_text(damaged.read_text(encoding="utf-8").replace('"mean": ', '"mean": 1'))
    calls[:] = ["call"]
    assert called().splitlines() == [
        f"{damaged} is damaged or was changed, and is made anew",
        f"1 of 3 experiments are in {out}; the others are run",
    ]


def check_saved(result: Reproduction) -> None:
    saved = json.loads((result.folder / "summary.json").read_text(encoding="utf-8"))
    assert saved == {"kind": "reproduction", **json.loads(json.dumps(result.summary()))}
    lines = (result.folder / "statistics.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "experiment,method,runs,figure,mean,low,high,paper"
    assert len(lines) == 1 + 8 * sum(len(outcome.rows) for outcome in result.outcomes)
    assert re.search(
        r"^methods,rule 0.5,1,average,[-\d.]+,[-\d.]+,[-\d.]+,41.51$", "\n".join(lines), re.M
    )


@pytest.mark.usefixtures("learning")
def test_trainings_differ_by_price_days_and_schedule_and_by_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trained, "_train", lambda *_: None)
    proposed, apg = experiments.PROPOSED, Contender("apg", "apg")

    def folder(contender: Contender = proposed, scale: Effort = TINY, **changes: Any) -> Path:
        case = small_storm_case().replace(**changes)
        return trained.trained_runs(case, contender, scale, 1, tmp_path)[0]

    usual = folder()
    assert folder(name="other", description="words") == usual
    assert folder(scale=replace(TINY, draws=7, budget_s=9.0, seeds=3)) == usual
    dear = [load.model_copy(update={"shed_cost_per_mwh": 47.0}) for load in small_storm_case().load]
    shape = {n: 0.9 * v for n, v in small_storm_case().profiles.items()}
    others = [
        folder(load=dear),
        folder(profiles=shape),
        folder(scale=replace(TINY, episodes=40)),
        folder(apg),
        folder(apg, scale=replace(TINY, budget_s=9.0)),
    ]
    assert len({usual, *others}) == 6
    assert folder(apg, scale=replace(TINY, episodes=40)) == folder(apg)


@pytest.mark.usefixtures("learning")
def test_a_training_that_was_interrupted_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from resilience.rl.training import train as train_module

    calls: list[bool] = []

    def train(*_: Any, resume: bool, out: Path, **__: Any) -> None:
        calls.append(resume)
        out.mkdir(parents=True, exist_ok=True)
        (out / "last.safetensors").write_bytes(b"")

    monkeypatch.setattr(train_module, "train", train)
    for _ in range(2):
        trained.trained_runs(small_storm_case(), experiments.PROPOSED, TINY, 1, tmp_path)
    assert calls == [False, True]


def hourly_export(path: Path, days: int) -> Path:
    first = datetime(2022, 6, 30, 22)
    rows = [
        f"{first + timedelta(hours=k):%Y-%m-%dT%H:%MZ},{30 + k % 24},{max(k % 24 - 6, 0)}"
        for k in range(24 * days)
    ]
    path.write_text("\n".join(["time_utc,load_mw,solar_mw", *rows]), encoding="utf-8")
    return path


@pytest.mark.usefixtures("few_learners")
def test_measured_profiles_take_the_place_of_the_cases(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(case_text(small_storm_case(step_h=1)), encoding="utf-8")
    profiles = [hourly_export(tmp_path / "export.csv", 8)]
    scale = replace(TINY, days=2, seeds=1)
    out = tmp_path / "out"
    result = reproduce(path, profiles=profiles, out=out, scale=scale)
    assert result.case == "small-measured"
    assert "export.csv" in result.notes[0]
    case = rs.load_case(out / "case" / "small" / "case.toml")
    assert case.profile("load")[:2] == pytest.approx([30 / 53, 31 / 53])
    assert result.outcomes[0].setting[0] == "3 episodes of 2 days from 2022-07-07"


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(UsageError, match="is a file"):
        reproduce(out=tmp_path / "file")


def row(label: str, paper: published.Published | None = None) -> Figures:
    interval = MeanInterval(12.345, 11.26, 13.18, 0.95, 3)
    values = dict.fromkeys(
        ("average", "highest", "lowest", "shed_mwh", "shed_mw_slots", "gap_percent"), interval
    )
    return Figures(label, 3, values, 7.04, 0.456, 0.0123, 6.7, 0.912, paper)


def printed(print_to: Callable[[Console], None]) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    print_to(console)
    return console.export_text()


def test_the_papers_figures_stand_below_ours_with_their_intervals(tmp_path: Path) -> None:
    outcome = Outcome(
        "methods", "five methods", "", "small", (), (row("rule 0.5", published.RULE),), "Telling."
    )
    hour = {"time": "07:00", "load_mw": 3.2, "pv_mw": 0.4, "shed_mw": 0.3, "soc": 0.62}
    storm = outage_day.OutageDay(
        "storm", "MADDPG-GRU", 3, (hour | {"lines_out": 2, "storage_mw": 0.7},)
    )
    curve = runner.LearningSummary("DDPG", "runs/ddpg", 12.3, 0.9, 0.051, 0.06, 0.07)
    result = Reproduction("small", TINY, (outcome,), (curve,), storm, tmp_path)
    text = printed(lambda console: print_reproduction(result, console))
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "rule 0.5 12.35 12.35 12.35 12.35 12.35 12.3" in lines
    assert "95 % " + " ".join(["11.3–13.2"] * 6) in lines
    assert "paper 41.51 46.42 31.69 0.00" in lines
    assert "rule 0.5 7.0 0.46 0.012 6.7 0.912 513.7" in lines
    assert "Telling." in lines
    assert "07:00 2 3.20 0.40 +0.70 62 0.30" in lines
    assert "DDPG 12.3 90.00 5.10 6.00 7.00" in lines
    assert max(map(len, text.splitlines())) <= 80


def test_figures_come_back_from_json_as_they_were() -> None:
    alone = MeanInterval(3.4, float("nan"), float("nan"), 0.95, 1)
    figures = replace(row("rule 0.5", published.RULE), statistics={"net": alone}, v_min_pu=np.nan)
    again = Figures.of_plain(json.loads(json.dumps(figures.plain(), allow_nan=False)))
    assert repr(again) == repr(figures)


@pytest.mark.usefixtures("few_learners")
def test_the_command_prints_draws_and_writes(
    tmp_path: Path, case_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "QUICK", replace(TINY, seeds=1))
    words = ["reproduce", str(case_path), "--quick", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0
    assert "rules alone (small)" in done.stdout
    pictures = re.findall(r"picture: (\S+)", done.stdout.replace("\n", " "))
    assert len(pictures) == 2
    assert all(Path(picture).is_file() for picture in pictures)
    told = CliRunner().invoke(app, [*words, "--json"], catch_exceptions=False)
    assert json.loads(told.stdout)["experiments"][0]["name"] == "rules"
