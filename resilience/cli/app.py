"""The command line: every command parses, calls the API, and prints.

Data goes to stdout, progress and errors to stderr. The exit code is 0 only when a valid answer was
given: 1 for mistakes in a case or a call, 2 for a command line that cannot be read.
"""

from __future__ import annotations

import io
import json
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
import typer.core

from resilience.cli import options, pages, terminal
from resilience.cli.case import case_app
from resilience.cli.harden import harden
from resilience.cli.operate import operate, serve
from resilience.cli.reproduce import reproduce
from resilience.cli.storms import hazard, scenarios
from resilience.cli.survive import survive
from resilience.cli.train import env, export, train

if TYPE_CHECKING:
    from resilience.errors import ResilienceError
    from resilience.evaluation.compare import Report
    from resilience.planning.plan import Plan
    from resilience.planning.scenarios.plan import ScenarioPlan


class Commands(typer.core.TyperGroup):
    """The commands; one that is interrupted says what is there and how to go on."""

    def invoke(self, ctx: Any) -> Any:
        """Runs a command; on Ctrl-C the exit code is 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            note = str(stop) or "nothing was written"
            print(f"interrupted: {note}", file=sys.stderr, flush=True)
            raise typer.Exit(130) from None


app = typer.Typer(
    name="resilience",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Dispatch of a microgrid in a storm: plans with a proven bound, from one case file.",
)
app.add_typer(case_app, name="case")


@app.command()
def solve(
    case: options.CaseName,
    method: options.Method = "minlp",
    physics: options.Physics = None,
    outages: options.Outages = None,
    seed: options.BellSeed = None,
    scenarios: options.Scenarios = None,
    risk: options.Risk = None,
    common_slots: options.CommonSlots = None,
    algorithm: options.Algorithm = None,
    time_limit: options.TimeLimit = 60.0,
    gap: options.Gap = None,
    out: options.Folder = None,
    plot: options.Picture = None,
    html: options.Page = None,
    export: options.Export = None,
    schedule: options.Schedule = False,
    prices: options.Prices = False,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """Find the best plan for a case, with a proven bound and an audit."""
    import resilience as rs
    from resilience.files import check_picture
    from resilience.planning.solve import check_export, check_prices, export_model, result_kind
    from resilience.results import check_replaceable

    if plot is not None:
        check_picture(plot)
    pages.check(html)
    if export is not None:
        check_export(export, method)
    if prices:
        check_prices(method)
    if out is not None:
        check_replaceable(out, result_kind(method))
    with terminal.progress(verbose):
        plan = rs.solve(  # type: ignore[misc]  # more unions than overloads are tried for
            case,
            method,
            physics=physics,  # type: ignore[arg-type]
            outages=outages,
            seed=seed,
            time_limit=time_limit,
            relative_gap=gap,
            scenarios=scenarios,
            risk=risk,
            common_slots=common_slots,
            algorithm=algorithm,
        )
        plan, unpriced = _priced(plan) if prices else (plan, None)
    has_prices = prices and unpriced is None
    terminal.show(partial(_print, plan, as_json, with_schedule=schedule, with_prices=has_prices))
    terminal.write(
        terminal.Output("tables", out, plan.save),
        terminal.Output("picture", plot, partial(_draw, plan)),
        terminal.Output("page", html, partial(pages.write, plan)),
        terminal.Output("model", export, partial(export_model, plan)),
        quiet=as_json,
    )
    if unpriced is not None:
        raise unpriced


def _priced(plan: Plan | ScenarioPlan) -> tuple[Plan | ScenarioPlan, ResilienceError | None]:
    """The plan with its prices; where a solver finds none, without, and why."""
    from resilience.errors import SolverError
    from resilience.planning.plan import Plan

    try:
        return plan.with_prices() if isinstance(plan, Plan) else plan, None
    except SolverError as error:
        return plan, error


def _draw(plan: Plan | ScenarioPlan, path: Path) -> None:
    from resilience.plots.saved import draw_plan

    draw_plan(plan, path)


def _print(
    plan: Plan | ScenarioPlan, as_json: bool, *, with_schedule: bool, with_prices: bool
) -> None:
    from resilience.planning.plan import Plan
    from resilience.text.console import plain_console
    from resilience.text.plan import print_plan
    from resilience.text.scenario_plan import print_scenario_plan

    if as_json:
        summary = plan.summary()
        if isinstance(plan, Plan) and with_prices:
            times = [time.isoformat() for time in plan.horizon.times(len(plan.times) + 1)]
            summary["prices"] = [
                asdict(row) | {"begins": times[row.begins], "ends": times[row.ends]}
                for row in plan.price_rows()
            ]
        typer.echo(json.dumps(summary, indent=2, allow_nan=False))
    elif isinstance(plan, Plan):
        console = plain_console()
        print_plan(plan, console, with_schedule=with_schedule, with_prices=with_prices)
    else:
        print_scenario_plan(plan, plain_console(), with_schedule=with_schedule)


@app.command()
def compare(
    case: options.CaseName,
    methods: options.Methods = "rule,mpc-blind,mpc,stochastic",
    days: options.Days = None,
    draws: options.Draws = 32,
    seed: options.Seed = 0,
    scenarios: options.ScenarioFile = None,
    believe: options.Believe = None,
    physics: options.OnePhysics = "copperplate",
    end_value: options.EndValue = None,
    forecast_error: options.ForecastErrors = "none",
    unknown_centre: options.UnknownCentre = False,
    reset_daily: options.ResetDaily = False,
    ac: options.AC = False,
    check_causality: options.CheckCausality = False,
    dual_bound: options.DualBound = False,
    workers: options.Workers = 1,
    engine: options.EngineName = "local",
    out: options.ReportFolder = None,
    plot: options.ReportPicture = None,
    html: options.Page = None,
    as_json: options.AsJson = False,
    verbose: options.Verbose = False,
) -> None:
    """Judge dispatchers on the same storms, against the clairvoyant optimum."""
    import resilience as rs
    from resilience.files import check_picture

    if plot is not None:
        check_picture(plot)
    pages.check(html)
    names = [name.strip() for name in methods.split(",") if name.strip()]
    with terminal.progress(verbose):
        report = rs.compare(
            case,
            names,
            days=days,
            draws=draws,
            seed=seed,
            scenarios=scenarios,
            believe=believe,
            physics=physics,  # type: ignore[arg-type]
            end_value_per_mwh=end_value,
            forecast_error=forecast_error,
            known_centre=not unknown_centre,
            reset_daily=reset_daily,
            workers=workers,
            engine=engine,  # type: ignore[arg-type]
            ac=ac,
            causality=check_causality,
            dual_bound=dual_bound,
            out=out,
            save=False,
        )
    terminal.show(partial(_print_report, report, as_json))
    terminal.write(
        terminal.Output("report", out, report.save),
        terminal.Output("picture", plot, partial(rs.plot_report, report)),
        terminal.Output("page", html, partial(pages.write, report)),
        quiet=as_json,
    )


def _print_report(report: Report, as_json: bool) -> None:
    if as_json:
        for line in report.warnings:
            print(f"warning: {line}", file=sys.stderr)
        typer.echo(json.dumps(report.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.comparison import print_report
    from resilience.text.console import plain_console

    print_report(report, plain_console())


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder written by --out.")],
    method: options.DrawnMethods = None,
    episode: options.DrawnEpisode = None,
    day: options.DrawnDay = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Picture file; in RUN, named after what it shows, if omitted."),
    ] = None,
) -> None:
    """Draw a saved plan, a training, a saved comparison, or with --method one of its storms."""
    from resilience.plots.saved import draw_run

    with terminal.notices():
        target, hint = draw_run(run, out, method=method, episode=episode, day=day)
    typer.echo(str(target))
    if hint:
        typer.echo(f"one storm: {hint}", err=True)


for _command in (
    pages.report,
    pages.diff,
    scenarios,
    hazard,
    survive,
    harden,
    operate,
    serve,
    train,
    export,
    env,
    reproduce,
):
    app.command()(_command)


def _version(is_wanted: bool) -> None:
    if is_wanted:
        import resilience as rs

        typer.echo(rs.__version__)
        raise typer.Exit


@app.callback()
def _main(
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line; errors of the package and of the system are printed, not raised."""
    from resilience.errors import ResilienceError
    from resilience.files import file_error

    if isinstance(sys.stdout, io.TextIOWrapper):  # a pipe may know fewer letters than a case has
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            app(args=arguments)
        finally:
            sys.stdout.flush()
    except ResilienceError as error:
        _fail(str(error))
    except BrokenPipeError:  # whoever reads has enough
        terminal.silence()
        sys.exit(1)
    except OSError as error:
        _fail(str(file_error(f"cannot use {error.filename or 'a file'}", error)))
    except MemoryError:
        _fail("the memory is full\nhint: a shorter horizon, fewer scenarios or fewer workers")


def _fail(text: str) -> NoReturn:
    print(f"error: {text}", file=sys.stderr)
    sys.exit(1)
