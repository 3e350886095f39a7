"""Scenarios on the terminal: how often lines and units are out, how long, and all lines at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.summary import summary
from resilience.fragility.outages.weights import worth
from resilience.fragility.storm_means import CHANCES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from resilience.case import Case


def print_scenarios(scenarios: Scenarios, case: Case, console: Console) -> None:
    """Prints `summary` as a table: by day of a process that knows days, else over the horizon."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    numbers = summary(scenarios, case)
    days = "1 day" if numbers["days"] == 1 else f"{numbers['days']} days"
    seed = "" if scenarios.seed is None else f", seed {scenarios.seed}"
    title = Text.assemble((case.name, "bold"), f"  {scenarios.n} scenarios of {days}{seed}")
    console.print(title)
    weights = worth(scenarios.probability)
    if weights:
        console.print(f"weighted scenarios, {weights}: no percentage is surer than one of so many")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    daily = scenarios.centre is not None
    per, heads = ("_per_day", ("out on a day", "h out a day")) if daily else ("", ("out", "h out"))
    for head in ("line", *heads, "h per outage"):
        table.add_column(head, justify="left" if head == "line" else "right")
    units = numbers.get("units", {})
    for line, row in (numbers["lines"] | units).items():
        table.add_row(
            line,
            f"{100 * row[f'outage_chance{per}']:.1f} %",
            f"{row[f'hours_out{per}']:.2f}",
            f"{row['hours_per_outage']:.2f}",
        )
    console.print(table)
    console.print(
        f"all {len(numbers['lines'])}{' lines' if units else ''} out at once "
        f"{'on' if daily else 'in'} {100 * numbers[f'all_out_chance{per}']:.1f} % of "
        f"{'days' if daily else 'scenarios'}{f', {weights}' if weights else ''}",
        highlight=False,
    )


def print_reduction(
    few: Scenarios,
    requested: int,
    before: Mapping[str, float],
    after: Mapping[str, float],
    console: Console,
) -> None:
    """Prints what fewer scenarios keep of all: their means before and after.

    Args:
        few: those that were kept.
        requested: how many were asked for.
        before: means of all, as `expected_moments` gives.
        after: means of those kept.
        console: where to.
    """
    from rich import box
    from rich.table import Table

    n = few.n if few.represents is None else few.represents.n
    console.print()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("mean", f"all {n}", f"the {few.n} kept"):
        table.add_column(head, justify="left" if head == "mean" else "right")
    for name, value in before.items():
        form = "{:.2%}" if name in CHANCES else "{:.3f}"
        table.add_row(name, form.format(value), form.format(after[name]))
    console.print(table)
    if few.n > requested:
        console.print(f"{few.n} are kept, not {requested}: fewer do not have these means")
    console.print(
        "The weights keep these means; what else happens in fewer scenarios, costs among it, "
        "is not that of all.",
        highlight=False,
    )
