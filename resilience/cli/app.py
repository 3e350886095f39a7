"""The command line: every command parses, calls the API, and prints.

Data goes to stdout, progress and errors to stderr. The exit code is 0 only when a valid answer was
given: 1 for mistakes in a case or a call, 2 for a command line that cannot be read.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resilience.cli import options as given
from resilience.cli.case import case_app
from resilience.cli.storms import hazard, scenarios
from resilience.cli.terminal import progress as _progress
from resilience.cli.terminal import written

if TYPE_CHECKING:
    from resilience.planning.plan import Plan
    from resilience.planning.scenario_plan import ScenarioPlan

app = typer.Typer(
    name="resilience",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Dispatch of a microgrid in a storm: plans with a proven bound, from one case file.",
)
app.add_typer(case_app, name="case")


@app.command()
def solve(
    case: given.CaseName,
    method: given.Method = "minlp",
    physics: given.Physics = None,
    outages: given.Outages = None,
    seed: given.BellSeed = None,
    scenarios: given.Scenarios = None,
    risk: given.Risk = None,
    common_slots: given.CommonSlots = None,
    algorithm: given.Algorithm = None,
    time_limit: given.TimeLimit = 60.0,
    gap: given.Gap = None,
    out: given.Folder = None,
    plot: given.Picture = None,
    export: given.Export = None,
    as_json: given.AsJson = False,
    verbose: given.Verbose = False,
) -> None:
    """Find the best plan for a case, with a proven bound and an audit."""
    from resilience import solve as find
    from resilience.planning.solve import export_model
    from resilience.plots.saved import draw_plan
    from resilience.plots.style import check_suffix

    if plot is not None:
        check_suffix(plot)
    with _progress(verbose):
        plan = find(  # type: ignore[misc]  # more unions than overloads are tried for
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
        if export is not None:
            export_model(plan, export)
    if out is not None:
        plan.save(out)
    if plot is not None:
        draw_plan(plan, plot)
    if as_json:
        typer.echo(json.dumps(plan.summary(), indent=2, allow_nan=False))
        return
    _print(plan)
    written(("tables", out), ("picture", plot), ("model", export))


def _print(plan: Plan | ScenarioPlan) -> None:
    from rich.console import Console

    from resilience.planning.scenario_plan import ScenarioPlan
    from resilience.text.plan import print_plan
    from resilience.text.scenario_plan import print_scenario_plan

    if isinstance(plan, ScenarioPlan):
        print_scenario_plan(plan, Console())
    else:
        print_plan(plan, Console())


@app.command()
def compare(
    case: given.CaseName,
    methods: given.Methods = "rule,mpc-blind,mpc,stochastic",
    days: given.Days = None,
    draws: given.Draws = 8,
    seed: given.Seed = 0,
    scenarios: given.ScenarioFile = None,
    physics: given.OnePhysics = "copperplate",
    end_value: given.EndValue = None,
    forecast_error: given.ForecastErrors = "none",
    unknown_centre: given.UnknownCentre = False,
    reset_daily: given.ResetDaily = False,
    ac: given.AC = False,
    workers: given.Workers = 1,
    engine: given.EngineName = "local",
    out: given.ReportFolder = None,
    plot: given.ReportPicture = None,
    as_json: given.AsJson = False,
    verbose: given.Verbose = False,
) -> None:
    """Judge dispatchers on the same storms, against the clairvoyant optimum."""
    from resilience import compare as judge
    from resilience import plot_report
    from resilience.plots.style import check_suffix

    if plot is not None:
        check_suffix(plot)
    names = [name.strip() for name in methods.split(",") if name.strip()]
    with _progress(verbose):
        report = judge(
            case,
            names,
            days=days,
            draws=draws,
            seed=seed,
            scenarios=scenarios,
            physics=physics,  # type: ignore[arg-type]
            end_value_per_mwh=end_value,
            forecast_error=forecast_error,
            known_centre=not unknown_centre,
            reset_daily=reset_daily,
            workers=workers,
            engine=engine,  # type: ignore[arg-type]
            ac=ac,
            out=out,
        )
    if plot is not None:
        plot_report(report, plot)
    if as_json:
        for line in report.warnings:
            print(f"warning: {line}", file=sys.stderr)
        typer.echo(json.dumps(report.summary(), indent=2, allow_nan=False))
        return
    from rich.console import Console

    from resilience.text.comparison import print_report

    print_report(report, Console())
    written(("report", out), ("picture", plot))


@app.command()
def plot(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A folder written by --out.")],
    method: given.DrawnMethods = None,
    episode: given.DrawnEpisode = None,
    day: given.DrawnDay = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Picture file; in RUN, named after what it shows, if omitted."),
    ] = None,
) -> None:
    """Draw a saved plan, a saved comparison, or with --method one of its storms."""
    from resilience.plots.saved import draw_run

    target, hint = draw_run(run, out, method=method, episode=episode, day=day)
    typer.echo(str(target))
    if hint:
        typer.echo(f"one storm: {hint}", err=True)


for _command in (scenarios, hazard):
    app.command()(_command)


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
