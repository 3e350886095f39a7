"""Two results held against each other, as text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.text import Text

from resilience.text.grid import grid

if TYPE_CHECKING:
    from rich.console import Console

    from resilience.revisions.runs import FigureChange, RunDiff


def print_diff(difference: RunDiff, console: Console) -> None:
    """Prints what changed in the case, in figures, in what loads go without, and in actions."""
    head = Text.assemble((difference.before, "bold"), " against ", (difference.after, "bold"))
    console.print(head, Text(f"two of the kind {difference.kind}", "dim"), sep="\n")
    if difference.case:
        rows = [(c.key, c.before or ".", c.after or ".") for c in difference.case]
        console.print(grid("Case", rows, "key", "before", "after"))
    else:
        console.print("The cases are the same.")
    for title, figures in (
        ("Figures", difference.figures),
        ("Shed, by load", difference.shed_by_load),
    ):
        if changed := [figure for figure in figures if figure.differs]:
            console.print(
                grid(title, figure_rows(changed), "", "unit", "before", "after", "change")
            )
        elif figures:
            console.print(f"{title}: the same.")
    if difference.actions:
        rows = [
            (f"{a.do} {a.unit}", "\n".join(a.before) or ".", "\n".join(a.after) or ".")
            for a in difference.actions
        ]
        console.print(grid("To do", rows, "", "before", "after"))
    elif difference.kind.startswith("plan"):
        console.print("What is to be done is the same.")


def figure_rows(figures: Iterable[FigureChange]) -> list[tuple[str, ...]]:
    """Name, unit, before, after and change of figures; what is not there is a dot."""
    return [
        (f.name, f.unit, _number(f.before), _number(f.after), _number(f.change, "+"))
        for f in figures
    ]


def _number(value: float | None, sign: str = "") -> str:
    return "." if value is None else f"{round(value, 4) + 0.0:{sign},.4f}"
