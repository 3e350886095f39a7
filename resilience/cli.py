"""The command line: every command parses, calls the API, and prints.

Data goes to stdout, progress and errors to stderr. The exit code is 0 only when a valid answer was
given: 1 for mistakes in a case or a call, 2 for a command line that cannot be read.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.status import Status

app = typer.Typer(
    name="resilience",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Dispatch of a microgrid in a storm: plans with a proven bound, from one case file.",
)
case_app = typer.Typer(no_args_is_help=True, help="Make, check and look at case files.")
app.add_typer(case_app, name="case")

CaseArgument = Annotated[
    str, typer.Argument(metavar="CASE", help="A case file, or the name of an installed case.")
]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print every phase to stderr.")]


QUIET_S = 2.0  # shorter work needs no progress lines where there is no terminal


class _Ticker(logging.Handler):
    """Shows the phase at work on stderr: a spinner on a terminal, a line each elsewhere."""

    def __init__(self, status: Status | None, quiet_s: float) -> None:
        super().__init__()
        self.status, self.quiet_s = status, quiet_s
        self.began = time.perf_counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Shows one message; lines only once the work has lasted `quiet_s` seconds."""
        seconds = time.perf_counter() - self.began
        text = f"{seconds:6.1f} s  {record.getMessage()}"
        if self.status is not None:
            self.status.update(text)
        elif seconds >= self.quiet_s:
            print(text, file=sys.stderr, flush=True)


@contextmanager
def _progress(verbose: bool) -> Iterator[None]:
    from rich.console import Console

    log = logging.getLogger("resilience")
    log.setLevel(logging.INFO)
    console = Console(stderr=True)
    status = console.status("starting") if console.is_terminal and not verbose else None
    ticker = _Ticker(status, 0.0 if verbose else QUIET_S)
    log.addHandler(ticker)
    try:
        with status or nullcontext():
            yield
    finally:
        log.removeHandler(ticker)


@app.command()
def solve(
    case: CaseArgument,
    method: Annotated[
        str, typer.Option(help="lp, milp, socp, nlp, minlp or exact.", metavar="METHOD")
    ] = "minlp",
    physics: Annotated[
        str | None,
        typer.Option(help="copperplate, lindistflow or distflow; the method's own if omitted."),
    ] = None,
    outages: Annotated[
        str | None,
        typer.Option(
            help='"6-26@14:00-17:30, ...", a CSV file, or none; the case\'s own if omitted.'
        ),
    ] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds for the search.", min=0.0)] = 60.0,
    gap: Annotated[float, typer.Option(help="Relative gap to stop at.", min=0.0)] = 1e-3,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for tables, summary.json and the case as solved."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Picture of the plan: a .png, .pdf or .svg file."),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(help="Also write the model: a .lp, .mps or .nl file."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    verbose: Verbose = False,
) -> None:
    """Find the best plan for a case, with a proven bound and an audit."""
    from resilience import plot_plan
    from resilience import solve as find
    from resilience.plot import check_suffix

    if plot is not None:
        check_suffix(plot)
    with _progress(verbose):
        plan = find(
            case,
            method,
            physics=physics,  # type: ignore[arg-type]
            outages=outages,
            time_limit=time_limit,
            relative_gap=gap,
        )
        if export is not None:
            from resilience.dispatch.plan import export_model

            export_model(plan, export)
    if out is not None:
        plan.save(out)
    if plot is not None:
        plot_plan(plan, plot)
    if as_json:
        typer.echo(json.dumps(plan.summary(), indent=2, allow_nan=False))
        return
    from rich.console import Console

    from resilience.report import print_plan

    print_plan(plan, Console())
    for what, where in (("tables", out), ("picture", plot), ("model", export)):
        if where is not None:
            typer.echo(f"{what}: {where}")


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder written by --out.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Picture file; RUN/plan.png if omitted."),
    ] = None,
) -> None:
    """Draw a saved plan on one page."""
    from resilience import load_plan, plot_plan

    target = out or run / "plan.png"
    plot_plan(load_plan(run), target)
    typer.echo(str(target))


@case_app.command()
def new(
    network: Annotated[
        str,
        typer.Argument(
            metavar="NETWORK", help="A pandapower network's name, or its JSON or .m file."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; stdout if omitted. An existing file is kept."),
    ] = None,
) -> None:
    """Write a starter case for a network: its loads and sources, and examples to fill in."""
    from resilience.case import new_case_text
    from resilience.errors import UsageError
    from resilience.results import replacing_file

    if out is not None and out.exists():
        raise UsageError(f"{out} exists", hint="name a new file")
    text = new_case_text(network)
    if out is None:
        typer.echo(text, nl=False)
        return
    with replacing_file(out) as fresh:
        fresh.write_text(text, encoding="utf-8")
    typer.echo(f"{out}: resilience solve {out}")


@case_app.command()
def check(case: CaseArgument) -> None:
    """Read a case and report every mistake in it at once."""
    from resilience import load_case

    found = load_case(case)
    typer.echo(f"{case}: {found.name} is a valid case")


@case_app.command()
def show(case: CaseArgument) -> None:
    """Print what a case holds: network, devices, horizon, outages, islands."""
    from rich.console import Console

    from resilience import load_case
    from resilience.report import print_case

    print_case(load_case(case), Console())


@case_app.command("list")
def list_cases() -> None:
    """Print the names of the installed cases."""
    from resilience import case_names

    for name in case_names():
        typer.echo(name)


@case_app.command()
def schema() -> None:
    """Print the JSON Schema of case files."""
    from resilience.case import case_schema

    typer.echo(json.dumps(case_schema(), indent=2))


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(version("resilience"))
        raise typer.Exit


@app.callback()
def _main(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


def main(arguments: list[str] | None = None) -> Any:
    """Runs the command line; errors of the package are printed, not raised."""
    from resilience.errors import ResilienceError

    try:
        app(args=arguments)
    except ResilienceError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
