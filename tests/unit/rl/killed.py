"""Trainings that are killed at chosen moments and resumed: a program, since what is killed is a
process. `python -m tests.unit.rl.killed FOLDER WHEN...` prints a line of JSON for every moment.

A moment is `never`, a number of file operations below the run's folder, or seconds with an `s`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys
import threading
from functools import partial
from pathlib import Path
from typing import Any

from resilience.rl.checkpoint import load
from resilience.rl.training import run as run_module
from resilience.rl.training.run import Run, event_writer
from resilience.rl.training.trainer import TrainingOptions
from tests.faults.killing import Killer, forked
from tests.unit.rl.small import SETTINGS, keyword_defaults, small_storm_case

OPTIONS = TrainingOptions(iterations=5, validations=2, seed=4, settings=SETTINGS)


def main(folder: Path, moments: list[str]) -> None:
    """Trains, kills, resumes, and prints what came of it."""
    keyword_defaults()["storms"] = 40
    run_module.CHECKPOINT_S = 0.0  # after every iteration
    event_writer()  # imported once, before all forks
    case = small_storm_case()
    for number, moment in enumerate(moments):
        place = folder / str(number)
        killed = forked(partial(_train, case, place, moment))
        report: dict[str, Any] = {"moment": moment, "killed": killed == signal.SIGKILL}
        report["left"] = sorted(path.name for path in place.glob("*"))
        if killed:
            began = place.is_dir() and any(place.iterdir())
            again = forked(partial(_resume, case, place, began))
            report["resumed"] = again == 0
        report["facts"] = facts(place)
        print(json.dumps(report), flush=True)
        shutil.rmtree(place)


def _train(case: Any, place: Path, moment: str) -> None:
    if moment.endswith("s"):
        seconds = float(moment[:-1])
        timer = threading.Timer(seconds, lambda: os.kill(os.getpid(), signal.SIGKILL))
        timer.daemon = True
        timer.start()
    elif moment != "never":
        sys.addaudithook(Killer(place, int(moment)))
    Run(case, OPTIONS, place).train()


def _resume(case: Any, place: Path, began: bool) -> None:
    Run(case, OPTIONS, place, resume=began).train()


def facts(place: Path) -> dict[str, str]:
    """Digests of all that a run keeps, apart from seconds and the times in events."""
    rows = [json.loads(line) for line in (place / "log.jsonl").read_text("utf-8").splitlines()]
    curve = [line.split(",") for line in (place / "curve.csv").read_text("utf-8").splitlines()]
    tensors, header = load(place / "last.safetensors")
    result = json.loads((place / "result.json").read_text("utf-8"))
    result["best"].pop("cpu_s")
    notes = header.notes | {"cpu_s": 0}
    notes["rows"] = [row | {"cpu_s": 0} for row in notes["rows"]]
    names = sorted(path.name for path in place.iterdir())
    events = sorted(path.suffix for path in (place / "events").glob("*"))
    parts: dict[str, Any] = {
        "names": names,
        "events": events,
        "log": [row | {"cpu_s": 0} for row in rows],
        "curve": [line[:1] + line[2:] for line in curve],
        "config": (place / "config.json").read_text("utf-8"),
        "result": result,
        "state": {name: value.numpy().tobytes().hex() for name, value in tensors.items()},
        "notes": notes,
        "iteration": header.iteration,
    }
    digests = {k: hashlib.sha256(repr(v).encode()).hexdigest() for k, v in parts.items()}
    policy = (place / "policy.safetensors").read_bytes()
    return digests | {"policy": hashlib.sha256(policy).hexdigest()}


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
