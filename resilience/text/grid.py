"""A table of text and numbers, as all reports have it."""

from __future__ import annotations

from collections.abc import Iterable

from rich import box
from rich.table import Table


def grid(title: str, rows: Iterable[tuple[str, ...]], *heads: str) -> Table:
    """A table of text and numbers; it has no head where all heads are empty."""
    table = Table(
        title=title, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold",
        show_header=any(heads),
    )  # fmt: skip
    for k, head in enumerate(heads):
        table.add_column(head, justify="left" if k == 0 else "right", no_wrap=k == 0)
    for row in rows:
        table.add_row(*row)
    return table
