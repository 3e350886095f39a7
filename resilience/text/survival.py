"""Survival on the terminal: the chance that loads are served through a loss of the main grid."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from resilience.evaluation.survival import Survival

if TYPE_CHECKING:
    from rich.console import Console


def print_survival(survival: Survival, console: Console) -> None:
    """Prints a row per duration, and the hours at which the grid is best not lost."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    first, last = (f"{t.astype('datetime64[D]')}" for t in survival.start[[0, -1]])
    head = f"  {len(survival.start)} losses of the main grid, {first} to {last}, {survival.method}"
    console.print(Text.assemble((survival.case.name, "bold"), head), highlight=False)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("hours", "starts", "critical served", "95 %", "all served", "95 %"):
        table.add_column(name, justify="right")
    for hours, row in survival.frame().iterrows():
        cells = [f"{hours:g}", f"{row['starts']:g}"]
        for kind in ("critical", "all"):
            share, low, high = (float(row[f"{kind}_{x}"]) for x in ("served", "low", "high"))
            cells += ["", ""] if math.isnan(share) else [f"{share:.1%}", f"{low:.0%} to {high:.0%}"]
        table.add_row(*cells)
    console.print(table)
    for line in _notes(survival):
        console.print(line, highlight=False)


def _notes(survival: Survival) -> list[str]:
    lines = [
        "served: nothing shed until then, of the starts behind which profiles are long enough; "
        "storage and tanks as at the start of the case, lines hold.",
        "95 %: starts of one day, and outages that overlap, count as one.",
    ]
    if survival.critical_h is None:
        lines.append("No load is critical; `critical = true` or a priority above 1 says which are.")
    lasts = survival.all_h if survival.critical_h is None else survival.critical_h
    if np.isfinite(lasts).any():
        worst = int(np.argmin(lasts))
        loads = "loads" if survival.critical_h is None else "critical loads"
        when = str(survival.start[worst].astype("datetime64[m]")).replace("T", " ")
        lines.append(f"The shortest: {loads} last {lasts[worst]:g} h from {when} on.")
    return lines
