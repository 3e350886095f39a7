"""Commands about case files: `resilience case ...`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from resilience.cli import options

case_app = typer.Typer(no_args_is_help=True, help="Make, check and look at case files.")


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
    from resilience.case.networks.omissions import omission_text
    from resilience.case.starter import starter
    from resilience.errors import UsageError
    from resilience.files import check_file, replacing_file

    if out is not None:
        check_file(out)
        if out.exists():
            raise UsageError(f"{out} exists", hint="name a new file")
    case = starter(network, None if out is None else out.parent)
    if case.omissions:
        typer.echo(f"not modelled: {omission_text(case.omissions)}", err=True)
    if out is None:
        typer.echo(case.text, nl=False)
        return
    with replacing_file(out) as fresh:
        fresh.write_text(case.text, encoding="utf-8")
    typer.echo(f"{out}: resilience solve {out}")


@case_app.command()
def check(case: options.CaseName) -> None:
    """Read a case and report every mistake in it at once, and what may not be meant."""
    import resilience as rs
    from resilience.case.checks.remarks import remarks

    loaded = rs.load_case(case)
    if loaded.storm is not None and loaded.storm.points:
        from resilience.fragility import chain

        chain.storm(loaded)
    typer.echo(f"{case}: {loaded.name} is a valid case")
    for remark in remarks(loaded):
        typer.echo(f"warning: {remark}")


@case_app.command()
def show(case: options.CaseName) -> None:
    """Print what a case holds: network, devices, horizon, outages, islands."""
    import resilience as rs
    from resilience.text.console import plain_console
    from resilience.text.plan import print_case

    print_case(rs.load_case(case), plain_console())


@case_app.command("list")
def list_cases() -> None:
    """Print the names of the installed cases."""
    import resilience as rs

    for name in rs.case_names():
        typer.echo(name)


@case_app.command()
def schema() -> None:
    """Print the JSON Schema of case files."""
    from resilience.case import case_schema

    typer.echo(json.dumps(case_schema(), indent=2))
