"""The batched simulator beside python-microgrid, which steps one microgrid at a time.

The peer needs older NumPy and pandas than ours, so it lives in a virtual environment of its own in
the user's cache, made when it is first measured; nothing of the package depends on it. Its raw
`step` is measured, without any learning environment around it: one battery, PV, load and a grid
connection. Ours steps the five storage units of ieee33 on one bus.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from bench.row import Row, skipped
from bench.simulator import Bench, one_bus, one_core, race
from resilience.case import load_case

PINS = ("python-microgrid==1.4.1", "numpy==1.26.*", "pandas<2.1", "cvxpy<1.6", "setuptools<81")
NEWEST_PYTHON = (3, 12)  # for which NumPy 1.26 has wheels
INSTALL_S, STEP_S = 600, 300
SCRIPT = Path(__file__).with_name("peer_step.py")


class MissingError(Exception):
    """Why the peer cannot be measured."""


def environment() -> Path:
    """The interpreter of the peer's environment, made if it is not there yet.

    Raises:
        MissingError: it cannot be made here.
    """
    if sys.version_info[:2] > NEWEST_PYTHON:
        raise MissingError("the peer needs NumPy 1.26, which has no wheels for this Python")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    root = cache / "resilience-bench" / "python-microgrid-1.4.1"
    python = root / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = root / "installed"
    if not done.is_file():
        called(sys.executable, "-m", "venv", "--clear", str(root), seconds=INSTALL_S)
        called(str(python), "-m", "pip", "install", "--quiet", *PINS, seconds=INSTALL_S)
        done.touch()
    return python


def called(*command: str, seconds: float) -> str:
    try:
        process = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise MissingError(f"{Path(command[0]).name}: {error}") from error
    if process.returncode:
        last = (process.stderr.strip() or "no message").splitlines()[-1]
        raise MissingError(f"exit code {process.returncode}: {last}")
    return process.stdout


def peers() -> Iterator[Row]:
    """Steps per second against python-microgrid, in one run."""
    name = "step, 5 storage units at batch 4096, over python-microgrid"
    try:
        python = environment()
        with one_core():
            theirs = float(called(str(python), str(SCRIPT), "5", "1000", seconds=STEP_S))
    except MissingError as why:
        yield skipped(name, str(why))
        return
    case = one_bus(load_case("ieee33"))
    many, alone = Bench.for_case(case, 4096), Bench.for_case(case, 1)
    with one_core():
        bare, slot, single = race(many.step, many.with_data, alone.with_data)
    yield over(name, 4096 / bare, theirs, 100.0)
    yield over("the same with data, islands and every device's power", 4096 / slot, theirs, 100.0)
    yield over("the same, a batch of 1", 1 / single, theirs, None)


def over(name: str, ours: float, theirs: float, target: float | None) -> Row:
    times, note = ours / theirs, f"{ours:.3g}/s against {theirs:.3g}/s"
    if target is None:
        return Row(name, f"{times:.2g}x", "", None, note)
    return Row(name, f"{times:,.0f}x", f">= {target:g}x", times >= target, note)
