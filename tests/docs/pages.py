"""Runs what the pages of the documentation tell a reader to run.

A page is a list of fenced blocks. A `toml` or `json` block with a title is a file to write, the
lines of a `bash` block that begin with `resilience` are commands, a `python` block is a program
that goes on where the last one stopped; a `text` block right behind a command or program is what it
prints. A line `...` in it stands for lines left out. The files of the guide are at hand on every
page.

    python tests/docs/pages.py docs/guide/first-feeder.md    pastes what is printed today
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "guide" / "first-feeder.md"
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TITLE = re.compile(r'title="([^"]+)"')
PROGRESS = re.compile(r"^ *\d+\.\d s  .*$")  # what a slow machine says on stderr


@dataclass
class Block:
    """One fenced block, and where its body stands in the page."""

    kind: str
    title: str
    body: str
    span: tuple[int, int]


@dataclass
class Step:
    """A command or program of a page, what the page says it prints, and what it did print."""

    source: str
    pasted: Block | None
    printed: str
    code: int = 0


@dataclass
class Run:
    """The state of a page: its folder, and the names its programs have defined."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "page"})

    def command(self, line: str) -> tuple[str, int]:
        """Return what a command prints (errors where it fails) and its exit code."""
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=self.folder,
            env=os.environ | with_command() | {"COLUMNS": "80", "NO_COLOR": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        return tidy(done.stderr if done.returncode else done.stdout), done.returncode

    def program(self, source: str) -> str:
        """Return what a program prints."""
        out = io.StringIO()
        with patch.dict(os.environ, with_command()), chdir(self.folder), redirect_stdout(out):
            exec(compile(source, "page", "exec"), self.names)
        return tidy(out.getvalue())


def with_command() -> dict[str, str]:
    """Return the search path that finds `resilience` of this environment, active or not."""
    return {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}


def tidy(text: str) -> str:
    """Return text without trailing blanks, progress lines, and empty lines at its ends."""
    lines = [line.rstrip() for line in text.splitlines() if not PROGRESS.match(line)]
    return "\n".join(lines).strip("\n") + "\n"


def blocks(text: str) -> list[Block]:
    """Return the fenced blocks of a page."""
    found = []
    for match in FENCE.finditer(text):
        title = TITLE.search(match[2])
        found.append(Block(match[1], title[1] if title else "", match[3], match.span(3)))
    return found


def run(page: Path, folder: Path) -> list[Step]:
    """Do everything a page says, in `folder`."""
    text = page.read_text(encoding="utf-8")
    found, state, steps = blocks(text), Run(folder), []
    if page != GUIDE and "storm.toml" in text:
        prepare(state)
    for block, after in zip(found, [*found[1:], None], strict=True):
        if block.kind in ("toml", "json") and block.title:
            (folder / block.title).write_text(block.body, encoding="utf-8")
        if block.kind not in ("bash", "python"):
            continue
        follows = after is not None and text[block.span[1] : after.span[0]].count("\n") <= 3
        pasted = after if follows and after is not None and after.kind == "text" else None
        if block.kind == "python":
            steps.append(Step(block.body, pasted, state.program(block.body)))
            continue
        lines = [line for line in block.body.splitlines() if line.startswith("resilience ")]
        for k, line in enumerate(lines):
            printed, code = state.command(line)
            steps.append(Step(line, pasted if k + 1 == len(lines) else None, printed, code))
    return steps


def prepare(state: Run) -> None:
    """Write the files that the guide writes."""
    state.command("resilience case new case33bw --out feeder.toml")
    for block in blocks(GUIDE.read_text(encoding="utf-8")):
        if block.kind == "toml" and block.title:
            (state.folder / block.title).write_text(block.body, encoding="utf-8")


def shortened(printed: str, pasted: str) -> str:
    """Return what was printed with as many lines left out as the page leaves out."""
    lines, old = printed.splitlines(), pasted.splitlines()
    if "..." not in old:
        return printed
    head = old.index("...")
    tail = len(old) - 1 - head
    kept = [*lines[:head], "...", *lines[len(lines) - tail :]]
    return "\n".join(kept) + "\n"


def refresh(page: Path) -> None:
    """Paste what the commands and programs of a page print today."""
    with tempfile.TemporaryDirectory() as folder:
        steps = run(page, Path(folder))
    text = page.read_text(encoding="utf-8")
    for step in reversed(steps):
        if step.pasted is not None:
            start, stop = step.pasted.span
            text = text[:start] + shortened(step.printed, step.pasted.body) + text[stop:]
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        refresh(Path(name).resolve())
