"""The walk on the page of the architecture is the one that the command takes today."""

from __future__ import annotations

import re
import subprocess
import sys

from tests.docs.pages import ROOT

LINE = re.compile(r"(?m)^ ?\d+ ([a-z_.0-9]+)")


def test_the_walk_is_that_of_today() -> None:
    page = (ROOT / "docs" / "concepts" / "architecture.md").read_text(encoding="utf-8")
    command = re.search(r"(?m)^python (scripts/walk\.py .+)$", page)
    assert command is not None
    done = subprocess.run(
        [sys.executable, *command[1].split()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    walked = set(LINE.findall(done.stdout))
    shown = set(LINE.findall(page.partition('```text title="the walk"\n')[2].partition("```")[0]))
    assert "models.methods.minlp" in walked
    assert walked == shown, "python scripts/walk.py --paste"
