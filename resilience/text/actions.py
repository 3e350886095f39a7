"""What to do, as text for a terminal: a list of instructions, and a schedule by the hour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from resilience.arrays import Floats, Ints
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.text.grid import Column, pages

if TYPE_CHECKING:
    from collections.abc import Mapping

    from resilience.case import Case
    from resilience.planning.reading.instructions import Instruction
    from resilience.planning.scenarios.first_failures import FirstFailure
    from resilience.planning.tables import SlotTable

MAX_LINES = 40
"""Of a list of instructions; what follows is only counted."""
MAX_FAILURES = 4
SCHEDULE_MIN = 60.0
"""Minutes of a row of the schedule."""


def action_list(case: Case, to_do: Sequence[Instruction], head: str) -> RenderableType:
    """Instructions in time, those of one time and verb on one line."""
    title = Text.assemble((head, "bold"), (": mean MW, and MWh stored at the end", "dim"))
    lines = _instruction_rows(case, to_do)
    rows = Table.grid(padding=(0, 0, 0, 2))
    for time, words in lines[:MAX_LINES]:
        rows.add_row(time, words)
    if not lines:
        rows.add_row("nothing: no unit is asked to do anything")
    if len(lines) > MAX_LINES:
        rows.add_row("...", f"and {len(lines) - MAX_LINES} more; plan.actions() has all of them")
    for time, words in _rest_rows(case, to_do) if lines else ():
        rows.add_row(time, words)
    return Group(title, rows)


def action_rows(case: Case, to_do: Sequence[Instruction]) -> list[tuple[str, str]]:
    """When and what, a row for the instructions of one time and verb; then which storage rests."""
    return _instruction_rows(case, to_do) + (_rest_rows(case, to_do) if to_do else [])


def _rest_rows(case: Case, to_do: Sequence[Instruction]) -> list[tuple[str, str]]:
    """Which storage rests whenever no instruction names it, and which always."""
    busy = {item.unit for item in to_do}
    names = [
        name for fleet in in_roles(device_fleets(case).values(), "storage") for name in fleet.names
    ]
    idle = [name for name in names if name not in busy]
    partly = [name for name in names if name in busy]
    rows = {"other times": partly, "all the time": idle}
    return [(time, f"rest {', '.join(units)}") for time, units in rows.items() if units]


def _instruction_rows(case: Case, to_do: Sequence[Instruction]) -> list[tuple[str, str]]:
    """When and what, a row for the instructions of one time and verb."""
    lines: dict[tuple[int, int, str], list[str]] = {}
    for item in to_do:
        lines.setdefault((item.first, item.stop, item.verb), []).append(_what(item))
    return [
        (when(case, first, stop), f"{verb} {', '.join(units)}")
        for (first, stop, verb), units in lines.items()
    ]


def when(case: Case, first: int, stop: int) -> str:
    """`14:00-17:30`, or `14:00` of what happens at once."""
    window = case.window
    if stop <= first:
        return window.label(first)
    return f"{window.label(first)}-{window.end_label(stop)}"


def _what(item: Instruction) -> str:
    if math.isnan(item.high_mw):
        return item.unit
    link = "by" if item.verb in ("curtail", "shed") else "at"
    stored = "" if math.isnan(item.stored_mwh) else f" to {item.stored_mwh:.3g} MWh"
    return f"{item.unit} {link} {mw_range(item.low_mw, item.high_mw)} MW{stored}"


def mw_range(low: float, high: float) -> str:
    """`0.16-0.19`, to a hundredth of the greater; one number where both are written alike."""
    texts = [_number(value, high) for value in (low, high)]
    return texts[0] if texts[0] == texts[1] else "-".join(texts)


def _number(value: float, largest: float) -> str:
    """A number with as many decimals as the largest beside it needs for three digits."""
    decimals = max(2 - math.floor(math.log10(largest)), 0) if largest > 0.0 else 0
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if decimals else text


def failure_tables(
    case: Case, failures: Sequence[FirstFailure], width: int
) -> list[RenderableType]:
    """What storage and generators do when certain lines fail first, the likeliest first."""
    cells = failure_cells(case, failures)
    more = len(failures) - len(cells.heads)
    title = "If an outage shows: mean MW of the first two hours, fed in is positive"
    title += f" ({more} less likely sets of lines left out)" if more > 0 else ""
    names = [row[0] for row in cells.rows]
    columns = [(head, [row[k] for row in cells.rows]) for k, head in enumerate(cells.heads, 1)]
    tables = pages(title, ("first down", names), columns, width)
    idle = [Text(f"at rest in all of them: {', '.join(cells.idle)}\n")] if cells.idle else []
    return [*tables, *idle]


class FailureCells(NamedTuple):
    """What is done when lines fail first, as text.

    Attributes:
        heads: which lines, how likely, and when, of the likeliest failures.
        rows: a unit and its mean power in each, MW; then what is shed to the end, MWh.
        idle: units that do nothing in any of them.
    """

    heads: list[str]
    rows: list[tuple[str, ...]]
    idle: list[str]


def failure_cells(case: Case, failures: Sequence[FirstFailure]) -> FailureCells:
    """The likeliest failures, and what every storage and generator does in each."""
    shown = failures[:MAX_FAILURES]
    units = dict.fromkeys(response.unit for failure in shown for response in failure.responses)
    rows = []
    for unit in units:
        means = [_mean(failure, unit) for failure in shown]
        rows.append((unit, *(f"{mean:+.3f}" if abs(mean) >= 5e-4 else "." for mean in means)))
    if any(failure.shed_mwh >= 5e-4 for failure in shown):
        rows.append(("MWh shed", *(f"{failure.shed_mwh:.3f}" for failure in shown)))
    fleets = in_roles(device_fleets(case).values(), "storage", "dispatchable")
    idle = [name for fleet in fleets for name in fleet.names if name not in units]
    return FailureCells([_head(case, failure) for failure in shown], rows, idle)


def _mean(failure: FirstFailure, unit: str) -> float:
    return sum(response.mean_mw for response in failure.responses if response.unit == unit)


def _head(case: Case, failure: FirstFailure) -> str:
    """Which lines, how likely, and when."""
    first, last = case.slot_label(failure.earliest), case.slot_label(failure.latest)
    times = first if first == last else f"{first}-{last}"
    return f"{'+'.join(failure.lines)}\n{100 * failure.probability:.1f} %\n{times}"


def schedule(case: Case, tables: Mapping[str, SlotTable], width: int) -> list[Table]:
    """Hourly tables, as many columns in each as fit: powers are means, energy is at the end."""
    slots = tables["power"].values.shape[1]
    per_row = max(round(SCHEDULE_MIN / case.step_min), 1)
    starts = np.arange(0, slots, per_row)
    stops = np.minimum(starts + per_row, slots)
    times = [when(case, int(a), int(b)) for a, b in zip(starts, stops, strict=True)]
    title = "Schedule: MW are means, fed in is positive; MWh at the end"
    return pages(title, ("from-to", times), _columns(case, tables, starts, stops), width)


def _columns(
    case: Case, tables: Mapping[str, SlotTable], starts: Ints, stops: Ints
) -> list[Column]:
    """Columns of all units, hour by hour."""
    fleets = list(device_fleets(case).values())

    def means(values: Floats) -> list[str]:
        hourly = np.add.reduceat(values, starts) / (stops - starts)
        largest = float(np.abs(hourly).max(initial=0.0))
        decimals = max(2 - math.floor(math.log10(largest)), 0) if largest > 0.0 else 0
        small = 0.5 * 10.0**-decimals
        return [f"{v:+.{decimals}f}" if abs(v) > small else "." for v in hourly]

    columns: list[Column] = []
    for fleet in in_roles(fleets, "storage"):
        for name in fleet.names:
            columns.append((f"{name}\nMW", means(tables["power"][name])))
            stored = tables["energy"][name][stops - 1]
            columns.append((f"{name}\nMWh", [f"{value:.3g}" for value in stored]))
    for fleet in in_roles(fleets, "dispatchable"):
        columns += [(f"{name}\nMW", means(tables["power"][name])) for name in fleet.names]
    for fleet in in_roles(fleets, "weather", "exchange", "load"):
        if fleet.names:
            columns.append((f"{fleet.title}\nMW", means(_total(tables["power"], fleet))))
    if "shed" in tables:
        columns.append(("shed\nMW", means(tables["shed"].values.sum(axis=0))))
    return columns + _positions(case, tables, stops)


def _positions(case: Case, tables: Mapping[str, SlotTable], stops: Ints) -> list[Column]:
    """Whether switchable lines are closed at the end of each row."""
    closed, columns = tables.get("line_closed"), list[Column]()
    if closed is not None:
        for k in np.flatnonzero(case.network.switchable).tolist():
            name = case.network.line_names[k]
            words = ["closed" if v > 0.5 else "open" for v in closed[name][stops - 1]]
            columns.append((f"{name}\nat end", words))
    return columns


def _total(power: SlotTable, fleet: DeviceFleet) -> Floats:
    rows = [power.labels.index(name) for name in fleet.names]
    return np.asarray(power.values[rows].sum(axis=0))
