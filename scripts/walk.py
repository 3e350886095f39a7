"""The modules that a command walks through, in the order of their first call; imports excluded.

    python scripts/walk.py solve ieee33 --method minlp
    python scripts/walk.py --paste      # that one, into docs/concepts/architecture.md

What is counted is a call of a function that is written in the module: not its import, nor what
runs while something is imported, nor methods that dataclasses make by themselves.
"""

from __future__ import annotations

import ast
import io
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from textwrap import shorten
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "resilience"
PAGE = ROOT / "docs" / "concepts" / "architecture.md"
SHOWN = ["solve", "ieee33", "--method", "minlp"]
FENCE = '```text title="the walk"\n'
"""What the listing on the page stands behind."""


def walk(arguments: list[str]) -> list[str]:
    """Names of the modules, below `resilience`, that a command line calls into.

    Args:
        arguments: of `resilience`, as `["solve", "ieee33"]`.
    """
    sys.path.insert(0, str(ROOT))
    from resilience.cli import main

    modules: dict[str, None] = {}
    imports_open = 0

    def note(frame: FrameType, event: str, _: Any) -> None:
        nonlocal imports_open
        code = frame.f_code
        if code.co_name == "<module>":
            imports_open += {"call": 1, "return": -1}.get(event, 0)
        elif event == "call" and not imports_open and code.co_filename.startswith(str(PACKAGE)):
            path = Path(code.co_filename).relative_to(PACKAGE).with_suffix("")
            if path.name not in ("__init__", "lazy"):  # which look up where a public name lives
                modules.setdefault(".".join(path.parts))

    argv, sys.argv = sys.argv, ["resilience", *arguments]
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            sys.setprofile(note)
            main()
    except SystemExit as done:
        if done.code:
            raise
    finally:
        sys.setprofile(None)
        sys.argv = argv
    return list(modules)


def listing(modules: list[str]) -> str:
    """A line per module: its place in the walk, its name, and how its docstring begins."""
    lines = []
    for place, name in enumerate(modules, 1):
        path = PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
        source = path if path.is_file() else path.with_suffix("") / "__init__.py"
        text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
        about = (
            re.sub(r"\s*\([^)]*\)", "", text.partition("\n\n")[0]).partition(". ")[0].rstrip(".")
        )
        lines.append(f"{place:2} {name:32} {shorten(about, 66, placeholder=' ...')}".rstrip())
    return "\n".join(lines) + "\n"


def main() -> None:
    """Prints the walk, or pastes it into the page that shows it."""
    if sys.argv[1:] == ["--paste"]:
        head, fence, tail = PAGE.read_text(encoding="utf-8").partition(FENCE)
        _, end, tail = tail.partition("```\n")
        PAGE.write_text(head + fence + listing(walk(SHOWN)) + end + tail, encoding="utf-8")
    else:
        print(listing(walk(sys.argv[1:])), end="")


if __name__ == "__main__":
    main()
