"""A table of text and numbers, as all reports have it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich import box
from rich.table import Table

PADDING, EDGES = 3, 5
"""Letters that a table takes beside those of its columns, for each of them and in all."""
Column = tuple[str, Sequence[str]]
"""Head and cells."""


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


def pages(title: str, first: Column, columns: Iterable[Column], width: int) -> list[Table]:
    """Tables of the same rows, as many columns in each as fit, so that no cell is cut off.

    Args:
        title: of the first table; the others go on below it.
        first: column that stands in all of them.
        columns: all others.
        width: of the terminal.
    """
    room = width - _needed(first) + PADDING - EDGES
    abreast: list[list[Column]] = [[]]
    filled = 0
    for column in columns:
        if filled + _needed(column) > room and abreast[-1]:
            abreast.append([])
            filled = 0
        abreast[-1].append(column)
        filled += _needed(column)
    return [_page(title if k == 0 else "", [first, *page]) for k, page in enumerate(abreast)]


def _needed(column: Column) -> int:
    """Letters that a column takes."""
    head, cells = column
    return max(map(len, [*head.split("\n"), *cells])) + PADDING


def _page(title: str, columns: Sequence[Column]) -> Table:
    rows = zip(*(cells for _, cells in columns), strict=True)
    table = grid(title, rows, *(head for head, _ in columns))
    for column in table.columns:
        column.no_wrap = True
    return table
