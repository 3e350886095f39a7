"""`resilience survive`: how long loads last without the main grid."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resilience.cli import options, pages, terminal
from resilience.dispatch.registry import REFERENCE

if TYPE_CHECKING:
    from resilience.evaluation.survival import Survival

USUAL = "6,12,24,48,72,96,120,168"


def survive(
    case: options.CaseName,
    durations: Annotated[
        str | None,
        typer.Option(
            help=f"Hours without the main grid, with commas; those of {USUAL} that the profiles "
            "have, if omitted.",
            metavar="HOURS",
        ),
    ] = None,
    method: Annotated[
        str, typer.Option(help="Who dispatches: a name that `compare` knows.")
    ] = REFERENCE,
    every_h: Annotated[
        float, typer.Option("--every-h", help="Hours from one start to the next.")
    ] = 1.0,
    seed: Annotated[int, typer.Option(help="Of the failures of units.", min=0)] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for tables, summary.json and the case.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture: .png, .pdf or .svg.")] = None,
    html: options.Page = None,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """How likely loads are served through a loss of the main grid, by its duration."""
    import resilience as rs
    from resilience.files import check_picture
    from resilience.results import SURVIVAL, check_replaceable

    if plot is not None:
        check_picture(plot)
    pages.check(html)
    if out is not None:
        check_replaceable(out, SURVIVAL)
    with terminal.progress(verbose):
        hours = None if durations is None else _hours(durations)
        survival = rs.survive(case, hours, method=method, every_h=every_h, seed=seed)
    terminal.show(partial(_print, survival, as_json))
    terminal.write(
        terminal.Output("tables", out, survival.save),
        terminal.Output("picture", plot, partial(rs.plot_survival, survival)),
        terminal.Output("page", html, partial(pages.write, survival)),
        quiet=as_json,
    )


def _hours(text: str) -> list[float]:
    """Durations from the command line.

    Raises:
        UsageError: a word that is no number.
    """
    from resilience.errors import UsageError
    from resilience.inputs import to_number

    words = [word.strip() for word in text.split(",") if word.strip()]
    numbers = [to_number(word) for word in words]
    if wrong := [word for word, number in zip(words, numbers, strict=True) if number is None]:
        raise UsageError(
            f"durations {', '.join(map(repr, wrong))}; allowed: hours, with commas",
            hint=f"{USUAL} is usual",
        )
    return [number for number in numbers if number is not None]


def _print(survival: Survival, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(survival.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.survival import print_survival

    print_survival(survival, plain_console())
