"""Whatever kills a process that writes: the earlier result is whole, or the new one is.

Every output is killed just before one of its file operations, and then read, and written again by
the same command: nothing is lost, and nothing is left. By default a sample of the operations is
tried, and all of them with RESILIENCE_EXHAUSTIVE=1.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OUTPUTS = {
    "plan", "plan over scenarios", "comparison", "part of a comparison", "hazard", "survival",
    "choice of what to build", "scenarios npz", "scenarios csv", "case", "measured case",
    "reproduction", "part of a reproduction", "picture",
}  # fmt: skip


@pytest.mark.parametrize(
    "share", [0.03, pytest.param(1.0, marks=pytest.mark.exhaustive)], ids=["some", "all"]
)
def test_a_killed_write_loses_nothing_and_leaves_nothing(tmp_path: Path, share: float) -> None:
    command = [sys.executable, "-m", "tests.faults.kills", str(tmp_path), str(share)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    reports = [json.loads(line) for line in done.stdout.splitlines()]
    assert {report["kind"] for report in reports} == OUTPUTS
    for report in reports:
        assert report["faults"] == [], report
        assert report["killed"] >= 1
        assert report["operations"] >= 8
