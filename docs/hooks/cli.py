"""MkDocs hook: `reference/cli.md`, made from the command line itself."""

from collections.abc import Iterator
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

HEAD = """\
# Command line

Data goes to stdout, progress and errors to stderr. The exit code is 0 only when a valid answer was
given, 1 for a mistake in a case or a call, 2 for a command line that cannot be read.
`NO_COLOR=1` switches colours off.

`-h` or `--help` behind any command says what it takes, `resilience --version` which version it is.
`resilience --install-completion` teaches your shell (bash, zsh, fish or PowerShell) to complete
commands and options with the tab key; `--show-completion` prints what it would add.
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page."""
    from typer.main import get_command

    from resilience.cli import app

    text = HEAD + "".join(sections(get_command(app), "resilience"))
    files.append(File.generated(config, "reference/cli.md", content=text))
    return files


def sections(command: Any, name: str) -> Iterator[str]:
    """Yield a section for a command and for every command below it."""
    inner = getattr(command, "commands", {})
    if not inner:
        yield section(command, name)
    for word, below in inner.items():
        yield from sections(below, f"{name} {word}")


def section(command: Any, name: str) -> str:
    """Return heading, usage and options of one command."""
    given = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option"]
    words = [name, *(p.metavar for p in given), *(["[OPTIONS]"] if options else [])]
    lines = ["", f"## {name}", "", command.help, "", "```text", " ".join(words), "```", ""]
    rows = [(f"`{p.metavar}`", "**required**" if p.required else default(p), p.help) for p in given]
    rows += [(spelling(p), default(p), p.help) for p in options]
    if rows:
        lines += ["| | default | |", "|---|---|---|"]
        lines += [
            "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows
        ]
    return "\n".join(lines) + "\n"


def spelling(option: Any) -> str:
    """Return how an option is written."""
    value = "" if option.is_flag else f" {option.metavar or option.name.upper()}"
    return ", ".join(f"`{word}{value}`" for word in option.opts)


def default(option: Any) -> str:
    """Return the default of an option, where it says anything."""
    if getattr(option, "is_flag", False) or option.default is None:
        return ""
    return f"`{option.default:g}`" if isinstance(option.default, float) else f"`{option.default}`"
