"""Ctrl-C ends a run of the tests, whatever a test makes of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"
BEGIN = "\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""What runs in the background ignores Ctrl-C, unless it is told not to."""
TESTS = """
import signal
from contextlib import suppress


def test_that_takes_it_for_its_own():
    with suppress(KeyboardInterrupt):
        SENT


def test_that_comes_later():
    print("it went on")
"""


@pytest.mark.parametrize(
    ("sent", "code", "went_on"),
    [
        ("signal.raise_signal(signal.SIGINT)", pytest.ExitCode.INTERRUPTED, False),
        ("pass", pytest.ExitCode.OK, True),
    ],
)
def test_a_test_that_swallows_ctrl_c_is_the_last(
    tmp_path: Path, sent: str, code: pytest.ExitCode, went_on: bool
) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST.read_text(encoding="utf-8") + BEGIN)
    (tmp_path / "test_two.py").write_text(TESTS.replace("SENT", sent))
    command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == code
    assert ("it went on" in done.stdout) == went_on
