"""The commands around learning, from the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import resilience as rs
from resilience.case import case_text
from resilience.cli.app import app
from resilience.cli.train import _seconds, _seeds, _settings
from tests.unit.rl.small import few_storms, small_storm_case


@pytest.fixture
def case_path(tmp_path: Path) -> str:
    path = tmp_path / "small.toml"
    path.write_text(case_text(small_storm_case()), encoding="utf-8")
    return str(path)


def invoked(*words: str) -> str:
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_train_plot_export_and_compare(
    tmp_path: Path, case_path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
    pytest.importorskip("safetensors", reason="safetensors is not installed here")
    few_storms(monkeypatch)
    run = str(tmp_path / "run")
    words = ["train", case_path, "--iterations", "2", "--set", "batch=2", "--set", "hidden=[4]"]
    text = invoked(*words, "--out", run)
    assert "small: apg, 2 iterations, judged on 1 validation days" in text
    assert f"run: {run}" in text
    summary: list[dict[str, Any]] = json.loads(invoked(*words, "--out", run, "--resume", "--json"))
    assert summary[0]["settings"]["batch"] == 2
    assert summary[0]["ended"] == "all 2 iterations done"
    assert invoked("plot", run).strip() == f"{run}/learning.png"
    text = invoked("export", run, "--to", str(tmp_path / "policy.npz"))
    assert text.startswith(f"policy: {tmp_path / 'policy.npz'}, as the run's to ")
    with pytest.raises(rs.UsageError, match="holds a run"):
        invoked(*words, "--out", run)


def test_env_says_what_is_seen_and_checks(case_path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    few_storms(monkeypatch)
    facts = json.loads(invoked("env", case_path, "--json"))
    assert facts["agents"] == ["ess1", "ess2"]
    assert facts["numbers"] == sum(facts["observation"].values())
    assert facts["checks"] == []
    text = invoked("env", case_path)
    assert "small: episodes of 12 slots of 120 min, on 5 training days" in text
    assert "soc_of_band" in text


def test_what_an_extra_is_needed_for_is_said(
    case_path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("resilience.extras.find_spec", lambda name: None)
    for words, extra in [
        (("train", case_path), "learn"),
        (("export", "run", "--to", "policy.npz"), "learn"),
        (("env", case_path, "--check"), "gym"),
    ]:
        few_storms(monkeypatch)
        with pytest.raises(rs.UsageError, match="not installed here") as error:
            CliRunner().invoke(app, list(words), catch_exceptions=False)
        assert error.value.hint == f"pip install 'resilience[{extra}]'"


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90.0), ("90s", 90.0), ("1.5m", 90.0), ("2h", 7200.0)]
)
def test_a_budget_is_a_time(text: str, seconds: float) -> None:
    assert _seconds(text) == seconds


@pytest.mark.parametrize("text", ["", "s", "-3s", "nan", "0m", "soon"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(rs.UsageError, match="allowed: a time such as 120s"):
        _seconds(text)


@pytest.mark.parametrize("text", ["²", "1_0", "-1", "٣", "9" * 5000, "0,x"])
def test_seeds_are_whole_numbers(text: str) -> None:
    assert _seeds("0, 7,12") == [0, 7, 12]
    with pytest.raises(rs.UsageError, match="allowed: whole numbers with commas"):
        _seeds(text)


def test_what_is_no_json_is_a_text() -> None:
    digits, brackets = "9" * 5000, "[" * 50_000
    assert _settings([f"x={digits}", f"y={brackets}", "z=[1, 2]"]) == {
        "x": digits,
        "y": brackets,
        "z": (1, 2),
    }


def test_a_learner_runs_on_the_installed_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="torch is not installed here: resilience[learn]")
    pytest.importorskip("safetensors", reason="safetensors is not installed here")
    few_storms(monkeypatch)
    words = ("train", "ieee14", "--iterations", "2", "--set", "batch=2", "--set", "hidden=[4]")
    text = invoked(*words, "--out", str(tmp_path / "run"))
    assert "ieee14: apg, 2 iterations, judged on" in text
