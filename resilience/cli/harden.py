"""`resilience harden`: what to build before the storm."""

from __future__ import annotations

import json
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resilience.cli import options, terminal

if TYPE_CHECKING:
    from resilience.models.microgrid import Physics
    from resilience.planning.hardening.report import Hardening


def harden(
    case: options.CaseName,
    budget: Annotated[
        float | None,
        typer.Option(help="Most to spend, $; that of [plan] if omitted."),
    ] = None,
    storms: Annotated[int, typer.Option(help="How many are planned for.", min=1)] = 200,
    seed: Annotated[int, typer.Option(help="Of their draw.", min=0)] = 0,
    risk: Annotated[
        str | None,
        typer.Option(
            help="mean, or cvar:0.9:0.5, half the mean and half the mean of the worst 10 %; mean "
            "if omitted.",
            metavar="RISK",
        ),
    ] = None,
    factor: Annotated[
        float | None,
        typer.Option(help="One option for every line: so many times as strong."),
    ] = None,
    cost: Annotated[float, typer.Option(help="Of that option, $.", min=0.0)] = 1.0,
    lines: Annotated[
        str | None, typer.Option(help="Of lines, those alone, with commas.", metavar="LINES")
    ] = None,
    frontier: Annotated[
        str | None, typer.Option(help="Further budgets, $, with commas.", metavar="BUDGETS")
    ] = None,
    new_storms: Annotated[
        int, typer.Option("--new-storms", help="How many the plan is judged on.", min=2)
    ] = 300,
    new_seed: Annotated[
        int | None, typer.Option("--new-seed", help="Of their draw; another one if omitted.", min=0)
    ] = None,
    shift: Annotated[
        float, typer.Option(help="Of the common strength of poles; -1 draws severe storms more.")
    ] = 0.0,
    physics: options.OnePhysics = "copperplate",
    step_min: Annotated[
        float | None,
        typer.Option("--step-min", help="Steps of the storms, minutes; 60 if omitted."),
    ] = None,
    gap: Annotated[float, typer.Option(help="Relative gap to stop at.", min=0.0)] = 1e-3,
    time_limit: Annotated[
        float, typer.Option("--time-limit", help="Seconds for every budget.", min=0.0)
    ] = math.inf,
    workers: Annotated[
        int | None, typer.Option(help="Threads; numbers do not depend on it.", min=1)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for summary.json and tables; goes on with what is there."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture: .png, .pdf or .svg.")] = None,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """What to build before the storm, within a budget or as far as it pays, with a proven bound."""
    import resilience as rs
    from resilience.files import check_picture
    from resilience.results import HARDENING, check_replaceable

    if plot is not None:
        check_picture(plot)
    if out is not None:
        check_replaceable(out, HARDENING)
    physics_name: Physics = physics  # type: ignore[assignment]
    with terminal.progress(verbose):
        hardening = rs.harden(
            case, budget, storms=storms, seed=seed, risk=risk, factor=factor, cost=cost,
            lines=None if lines is None else _words(lines),
            frontier=() if frontier is None else _numbers(frontier),
            new_storms=new_storms, new_seed=new_seed, shift=shift, physics=physics_name,
            step_min=step_min, gap=gap, time_limit=time_limit, workers=workers, out=out,
        )  # fmt: skip
    terminal.show(partial(_print, hardening, as_json))
    terminal.write(
        terminal.Output("results", out, hardening.save),
        terminal.Output("picture", plot, partial(rs.plot_hardening, hardening)),
        quiet=as_json,
    )


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _numbers(text: str) -> list[float]:
    """Budgets from the command line.

    Raises:
        UsageError: a word that is no number.
    """
    from resilience.errors import UsageError
    from resilience.inputs import to_number

    numbers = [to_number(word) for word in _words(text)]
    if None in numbers:
        raise UsageError(f"budgets {text!r}; allowed: $, with commas", hint="0,1,2,5 say")
    return [number for number in numbers if number is not None]


def _print(hardening: Hardening, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(hardening.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.hardening import print_hardening

    print_hardening(hardening, plain_console())
