"""`resilience compare`: options reach the comparison, and what they change is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from resilience.cli import main


def run(arguments: str) -> None:
    with pytest.raises(SystemExit) as done:
        main(["compare", *arguments.split()])
    assert done.value.code == 0


def test_settings_are_in_the_json(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run("ieee33-tou --methods idle --days 1 --draws 2 --seed 4 --end-value 0.2 --ac --json "
        f"--forecast-error 0.05,0.9 --unknown-centre --out {tmp_path / 'found'}")  # fmt: skip
    found = json.loads(capsys.readouterr().out)
    assert found["episodes"] == 2
    assert found["end_value_per_mwh"] == 0.2
    assert found["forecast_error"] == "sigma 0.05, correlation 0.9"
    assert found["known_centre"] is False
    assert found["warnings"] == []
    assert {row["method"] for row in found["methods"]} == {"idle", "rule-0.9", "clairvoyant"}
    assert all(row["ac_loss_mwh_per_day"] > 0 for row in found["methods"])
    saved = json.loads((tmp_path / "found" / "summary.json").read_text())
    assert saved == {"kind": "comparison", **found}


def test_a_reset_is_warned_of(capsys: pytest.CaptureFixture[str]) -> None:
    run("ieee33-tou --methods idle --days 2 --draws 1 --reset-daily --json")
    printed = capsys.readouterr()
    assert "warning: the state of charge is reset every midnight" in printed.err
    assert json.loads(printed.out)["reset_daily"] is True


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--forecast-error sometimes", "forecast error 'sometimes' cannot be read"),
        ("--engine cloud", "engine 'cloud' is unknown"),
        ("--physics copper", "physics 'copper' is unknown"),
        ("--methods oracle", "dispatcher 'oracle' is unknown"),
        ("--scenarios none.npz", "scenario file none.npz does not exist"),
    ],
)
def test_mistakes_are_told(capsys: pytest.CaptureFixture[str], arguments: str, words: str) -> None:
    with pytest.raises(SystemExit) as done:
        main(["compare", "ieee33", "--days", "1", *arguments.split()])
    assert done.value.code == 1
    printed = capsys.readouterr().err
    assert words in printed
    assert "hint:" in printed
