"""The command `resilience reproduce`."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resilience.cli import options, terminal

if TYPE_CHECKING:
    from resilience.rl.reproduce.run import Reproduction


def reproduce(
    case: Annotated[
        str, typer.Argument(metavar="CASE", help="Case file, or name of an installed case.")
    ] = "ieee33",
    quick: Annotated[
        bool, typer.Option("--quick", help="Few days, storms and trainings: minutes, not hours.")
    ] = False,
    profiles: Annotated[
        list[Path] | None,
        typer.Option(
            help="Load and solar power exported from ENTSO-E, in place of the case's profiles; "
            "twice for a file of each.",
            metavar="FILE",
        ),
    ] = None,
    area: Annotated[
        str | None, typer.Option(help="Where the files have several areas, as DE_LU.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for figures, trainings and pictures.")] = Path(
        "reproduction"
    ),
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """Run the source paper's experiments and print them beside its figures; once run, only read."""
    from resilience.plots.reproduction import plot_reproduction
    from resilience.results import SUMMARY_FILE
    from resilience.rl.reproduce.run import TABLE_FILE
    from resilience.rl.reproduce.run import reproduce as run_experiments

    with terminal.progress(verbose):
        result = run_experiments(
            case, quick=quick, profiles=profiles or (), area=area, out=out, save=False
        )
    terminal.show(partial(_print, result, as_json))

    def write_all(_: Path) -> None:
        files = [("table", out / TABLE_FILE), ("all figures", out / SUMMARY_FILE)]
        result.save()
        for picture in plot_reproduction(result):
            files.insert(-2, ("picture", picture))
        if not as_json:
            terminal.print_written(*files)

    terminal.write(terminal.Output("", out, write_all), quiet=True)


def _print(result: Reproduction, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(result.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.reproduction import print_reproduction

    print_reproduction(result, plain_console())
    typer.echo("")
