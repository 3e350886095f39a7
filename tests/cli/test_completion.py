"""The command line completes itself in a shell, and says which version it is."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import resilience as rs

PROGRAM = "import sys; sys.argv[0] = 'resilience'; from resilience.cli import main; main()"


def printed(arguments: list[str], **variables: str) -> str:
    """What a call prints on stdout."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | variables, check=False
    )
    return done.stdout


@pytest.mark.parametrize(
    ("line", "words"), [("resilience sol", ["solve"]), ("resilience solve --sched", ["--schedule"])]
)
def test_a_shell_completes_commands_and_options(line: str, words: list[str]) -> None:
    count = str(len(line.split()) - 1)
    out = printed([], COMP_WORDS=line, COMP_CWORD=count, _RESILIENCE_COMPLETE="complete_bash")
    assert out.split() == words


def test_short_help_and_version() -> None:
    assert printed(["--version"]).strip() == rs.__version__
    assert "Usage" in printed(["solve", "-h"])
    named = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}  # there may be no shell around
    assert "complete -o default -F" in printed(["--show-completion", "bash"], **named)
