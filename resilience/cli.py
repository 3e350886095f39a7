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

from resilience import options as given
from resilience.fragility import options as bell_options

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
    case: given.CaseName,
    method: given.Method = "minlp",
    physics: given.Physics = None,
    outages: given.Outages = None,
    seed: given.BellSeed = None,
    time_limit: given.TimeLimit = 60.0,
    gap: given.Gap = 1e-3,
    out: given.Folder = None,
    plot: given.Picture = None,
    export: given.Export = None,
    as_json: given.AsJson = False,
    verbose: given.Verbose = False,
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
            seed=seed,
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
def compare(
    case: given.CaseName,
    methods: given.Methods = "rule,mpc-blind,mpc,stochastic",
    days: given.Days = 16,
    draws: given.Draws = 8,
    seed: given.Seed = 0,
    end_value: given.EndValue = None,
    out: given.ReportFolder = None,
    as_json: given.AsJson = False,
    verbose: given.Verbose = False,
) -> None:
    """Judge dispatchers on the same storms, against the clairvoyant optimum."""
    from resilience import compare as judge

    names = [name.strip() for name in methods.split(",") if name.strip()]
    with _progress(verbose):
        report = judge(case, names, days=days, draws=draws, seed=seed, end_value_per_mwh=end_value)
    if out is not None:
        report.save(out)
    if as_json:
        typer.echo(json.dumps(report.summary(), indent=2, allow_nan=False))
        return
    from rich.console import Console

    from resilience.report import print_report

    print_report(report, Console())
    if out is not None:
        typer.echo(f"report: {out}")


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


@app.command()
def scenarios(
    case: given.CaseName,
    n: Annotated[int, typer.Option("-n", help="How many.")] = 200,
    seed: Annotated[int, typer.Option(help="The same seed draws the same scenarios.")] = 0,
    days: Annotated[
        int | None, typer.Option(help="Whole days from the start; the case's horizon if omitted.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write: .npz keeps everything, .csv the outages.")
    ] = None,
    probability: bell_options.Probability = None,
    height: bell_options.Height = None,
    sigma_slots: bell_options.SigmaSlots = None,
    duration_slots: bell_options.DurationSlots = None,
    shift_slots: bell_options.ShiftSlots = None,
    shared_shift: bell_options.SharedShift = None,
    common_draw: bell_options.CommonDraw = None,
    refail: bell_options.Refail = None,
    wrap: bell_options.Wrap = None,
    overnight: bell_options.Overnight = None,
    centre: bell_options.Centre = None,
    centre_error_slots: bell_options.CentreErrorSlots = None,
    rate: bell_options.Rate = None,
    as_json: given.AsJson = False,
) -> None:
    """Draw storms: which line is down when. What is not given here is the case's own."""
    from rich.console import Console

    from resilience import load_case
    from resilience.fragility import case_bell, print_scenarios, sample_bell, summary
    from resilience.fragility.files import check_suffix

    if out is not None:
        check_suffix(out)
    found = load_case(case)
    bell = case_bell(
        found,
        probability=probability,
        height=height,
        sigma_slots=sigma_slots,
        duration_slots=duration_slots,
        shift_slots=shift_slots,
        shared_shift=shared_shift,
        common_draw=common_draw,
        refail=refail,
        wrap=wrap,
        overnight=overnight,
        centres=tuple(centre) if centre else None,
        centre_error_slots=centre_error_slots,
        rate=rate,
    )
    drawn = sample_bell(found, bell, n, seed, days=days)
    if out is not None:
        drawn.save(out)
    if as_json:
        typer.echo(json.dumps(summary(drawn, found), indent=2, allow_nan=False))
        return
    print_scenarios(drawn, found, Console())
    if out is not None:
        typer.echo(f"scenarios: {out}")


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
def check(case: given.CaseName) -> None:
    """Read a case and report every mistake in it at once."""
    from resilience import load_case

    found = load_case(case)
    typer.echo(f"{case}: {found.name} is a valid case")


@case_app.command()
def show(case: given.CaseName) -> None:
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
