"""Pages of results: `--html` and `resilience report`. They are imported where one is asked for."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resilience.cli import options, terminal

if TYPE_CHECKING:
    from resilience.pages.write import Pageable
    from resilience.revisions.runs import RunDiff


def check(path: Path | None) -> None:
    """Refuses a page's file before anything is computed; None: no page is asked for."""
    if path is not None:
        from resilience.pages.document import check_page

        check_page(path)


def write(result: Pageable, path: Path) -> None:
    """Writes the page of a result."""
    from resilience.pages.write import write_page

    write_page(result, path)


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder written by --out.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Page to write, a .html file; report.html in RUN if omitted."),
    ] = None,
) -> None:
    """Write a saved plan, comparison, hazard or survival as one page to send."""
    from resilience.pages.saved import write_saved_page

    with terminal.notices():
        page = write_saved_page(run, out)
    typer.echo(str(page))


def diff(
    before: Annotated[Path, typer.Argument(metavar="RUN1", help="A folder written by --out.")],
    after: Annotated[Path, typer.Argument(metavar="RUN2", help="Another of the same kind.")],
    html: options.Page = None,
    as_json: options.AsJson = False,
) -> None:
    """Say what changed between two plans or comparisons: case, figures, shedding, actions."""
    import resilience as rs

    check(html)
    with terminal.notices():
        difference = rs.diff(before, after)
    terminal.show(partial(_print, difference, as_json))
    terminal.write(
        terminal.Output("page", html, partial(write, difference)),
        quiet=as_json,
    )


def _print(difference: RunDiff, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(difference.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.revision import print_diff

    print_diff(difference, plain_console())
