"""Scenarios on the terminal: how often a line is out, for how long, and all of them at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.summary import summary
from resilience.fragility.outages.weights import worth

if TYPE_CHECKING:
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
    for line, row in numbers["lines"].items():
        table.add_row(
            line,
            f"{100 * row[f'outage_chance{per}']:.1f} %",
            f"{row[f'hours_out{per}']:.2f}",
            f"{row['hours_per_outage']:.2f}",
        )
    console.print(table)
    console.print(
        f"all {len(scenarios.lines)} out at once "
        f"{'on' if daily else 'in'} {100 * numbers[f'all_out_chance{per}']:.1f} % of "
        f"{'days' if daily else 'scenarios'}{f', {weights}' if weights else ''}",
        highlight=False,
    )
