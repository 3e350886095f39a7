"""Prices of a plan as text for a terminal: what a MWh costs hour by hour, and where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.table import Table

from resilience.planning.reading.prices import ALIKE, PriceRow
from resilience.text.actions import when
from resilience.text.grid import Column, pages

if TYPE_CHECKING:
    from resilience.case import Case

DIGITS = 4
ZERO = 1e-6
"""$/MWh below which a price is none."""


def price_table(case: Case, rows: Sequence[PriceRow], width: int) -> list[Table]:
    """Lowest, mean and highest price of every row, at which bus, and what is stored is worth."""
    times = [when(case, row.begins, row.ends) for row in rows]
    columns: list[Column] = [
        ("lowest\n$/MWh", _numbers(row.lowest for row in rows)),
        ("at\nbus", [_at(row, row.lowest_at) for row in rows]),
        ("mean\n$/MWh", _numbers(row.mean for row in rows)),
        ("highest\n$/MWh", _numbers(row.highest for row in rows)),
        ("at\nbus", [_at(row, row.highest_at) for row in rows]),
    ]
    worth = {
        "stored\n$/MWh": [(row.storage_low, row.storage_high) for row in rows],
        "fuel\n$/m³": [(row.fuel_low, row.fuel_high) for row in rows],
    }
    for head, ends in worth.items():
        if any(low is not None for low, _ in ends):
            columns.append((head, [_range(low, high) for low, high in ends]))
    title = "Prices at buses: means; of what is stored: at the end"
    return pages(title, ("from-to", times), columns, width)


def _numbers(values: Iterable[float | None]) -> list[str]:
    return ["." if value is None else _number(value) for value in values]


def _number(price: float) -> str:
    """A price with four digits; solvers know no more of it."""
    text = f"{price:.{DIGITS}g}" if abs(price) < 10.0**DIGITS else f"{price:.0f}"
    return "0" if abs(price) < ZERO else text


def _range(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return "."
    ends = _number(low), _number(high)
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def _at(row: PriceRow, bus: str) -> str:
    """A bus; `all` where none is dearer than another."""
    if row.lowest is None or row.highest is None:
        return "."
    differ = row.highest - row.lowest > ALIKE * max(abs(row.lowest), abs(row.highest))
    return bus if differ else "all"
