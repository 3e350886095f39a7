"""`resilience operate`: a call per slot, each a process of its own as far as memory goes."""

from __future__ import annotations

import io
import json
import threading
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case.write import case_text
from resilience.cli import main
from resilience.dispatch.registry import DISPATCHERS
from tests.unit.operation.plant import Plant, simulated, storm_case, storm_world

CASE = storm_case(slots=12, step_min=60.0)
WORLD = storm_world(CASE)
LOG = "operate.jsonl"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(case_text(CASE), encoding="utf-8")
    return tmp_path


def call(arguments: str, code: int = 0) -> None:
    with pytest.raises(SystemExit) as done:
        main(["operate", "case.toml", *arguments.split()])
    assert done.value.code == code


def test_calls_cost_what_the_simulator_says(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected, plant = simulated(WORLD, "mpc"), Plant(WORLD)
    for t in range(CASE.slots):
        text = json.dumps(plant.state(t))
        if t % 2:
            Path("state.json").write_text(text)
            call("--method mpc --json --state state.json")
        else:
            monkeypatch.setattr("sys.stdin", io.StringIO(text))
            call("--method mpc --json")
        answer: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert answer["plan"]["steps"][0]["energy_mwh"] == pytest.approx(answer["energy_mwh"])
        plant.act(t, answer["power_mw"])
    assert plant.cost == pytest.approx(expected.cost.sum(), abs=1e-6)
    call(f"--method mpc --replay {LOG}")
    assert capsys.readouterr().out == (
        f"12 decisions by mpc, 0 of them by the rule: all come out as in {LOG}\n"
    )


def test_another_method_comes_out_otherwise(capsys: pytest.CaptureFixture[str]) -> None:
    Path("state.json").write_text(json.dumps(Plant(WORLD).state(3)))
    call("--method rule-0.9 --state state.json")
    printed = capsys.readouterr().out
    assert printed.startswith("rule-0.9  2016-07-12 03:00 to 04:00\n")
    assert "- nothing is out\n" in printed
    call("--method rule-0.9 --state state.json")
    assert "03:00 to 04:00, as decided before\n" in capsys.readouterr().out
    call(f"--method idle --replay {LOG}", code=1)
    said = capsys.readouterr()
    assert said.err == f"note: {LOG} is the log of another method\n"
    assert said.out == (
        "1 decisions by rule-0.9, 0 of them by the rule: 1 come out otherwise than in "
        f"{LOG}, at 03:00\n"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "stdin holds 'nothing'; allowed: a state in JSON"),
        ("{", "stdin holds '{'; allowed: a state in JSON"),
        ("[]", "1 mistake in the state"),
        ("{}", "4 mistakes in the state"),
    ],
)
def test_what_is_no_state_is_refused(
    text: str,
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    call("--method rule-0.9", code=1)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"error: {words}")


def test_a_log_that_is_none_is_not_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    Path("empty.jsonl").touch()
    call("--method rule-0.9 --replay empty.jsonl", code=1)
    assert capsys.readouterr().err.startswith("error: empty.jsonl is empty; allowed: a log")
    call("--method rule-0.9 --replay none.jsonl", code=1)
    assert capsys.readouterr().err.startswith("error: none.jsonl: does not exist")


class Stuck:
    """Decides nothing until it is let go."""

    name = "stuck"
    go = threading.Event()

    def __init__(self, setting: rs.Setting) -> None:
        self.units = len(setting.simulator.units)

    def act(self, observation: rs.Observation) -> np.ndarray:
        self.go.wait()
        return np.zeros((self.units, observation.energy.shape[1]))


def test_a_method_still_at_work_does_not_hold_up_or_abort_the_process(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A solver that is torn down at work aborts the process, though the answer was given."""
    leaving, codes = list[partial[None]](), list[int]()
    monkeypatch.setattr("atexit.register", lambda call, *a: leaving.append(partial(call, *a)))
    monkeypatch.setattr("os._exit", codes.append)
    monkeypatch.setitem(DISPATCHERS, "stuck", Stuck)
    Path("state.json").write_text(json.dumps(Plant(WORLD).state(3)))
    call("--method stuck --late 0.1 --state state.json --json")
    assert json.loads(capsys.readouterr().out)["fallback"]["kind"] == "late"
    leave = next(call for call in leaving if call.func.__name__ == "_leave")
    leave()
    assert codes == [0]
    Stuck.go.set()
    thread = next((t for t in threading.enumerate() if t.name == "dispatcher"), None)
    if thread is not None:
        thread.join(10.0)
    leave()
    assert codes == [0]
