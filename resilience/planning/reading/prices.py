"""Prices of a plan: what a MWh more of demand costs at every bus, and what is stored is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.case_program import CaseProgram, as_switched, horizon
from resilience.models.components import in_roles
from resilience.models.components.line import Lines
from resilience.models.methods.prices import row_prices
from resilience.models.microgrid import Physics
from resilience.planning.tables import LEVEL, SlotTable

ALIKE = 1e-6
"""Share of a price within which buses are said to have the same."""
HOUR_MIN = 60.0
"""Minutes of a row of prices."""


@dataclass(frozen=True)
class PriceRow:
    """Prices of a row of slots, $/MWh, and of fuel $/m³; None where there is none.

    Attributes:
        begins: first slot.
        ends: first slot behind it.
        lowest, mean, highest: over the buses that are alive, of their means over the slots.
        lowest_at, highest_at: bus with that price, the first of several; empty where none is alive.
        storage_low, storage_high: least and greatest worth of a MWh among the storages, at the end.
        fuel_low, fuel_high: least and greatest worth of a m³ among the tanks, at the end.
    """

    begins: int
    ends: int
    lowest: float | None = None
    lowest_at: str = ""
    mean: float | None = None
    highest: float | None = None
    highest_at: str = ""
    storage_low: float | None = None
    storage_high: float | None = None
    fuel_low: float | None = None
    fuel_high: float | None = None


def price_rows(tables: Mapping[str, SlotTable], per_row: int) -> list[PriceRow]:
    """What `price_tables` hold, in rows of so many slots."""
    buses = tables["bus_price"]
    slots = buses.values.shape[1]
    rows = []
    for begins in range(0, slots, per_row):
        ends = min(begins + per_row, slots)
        prices = _means(buses.values[:, begins:ends])
        storage = _ends(tables.get("storage_value"), ends - 1)
        fuel = _ends(tables.get("fuel_value"), ends - 1)
        alive = np.isfinite(prices)
        if not alive.any():
            rows.append(PriceRow(begins, ends, None, "", None, None, "", *storage, *fuel))
            continue
        lowest, mean, highest = (float(f(prices[alive])) for f in (np.min, np.mean, np.max))
        alike = ALIKE * max(abs(lowest), abs(highest))
        low, high = (
            buses.labels[int(np.flatnonzero(alive & is_there)[0])]
            for is_there in (prices <= lowest + alike, prices >= highest - alike)
        )
        rows.append(PriceRow(begins, ends, lowest, low, mean, highest, high, *storage, *fuel))
    return rows


def _means(values: Floats) -> Floats:
    """(rows,) the mean of every row over what is a number in it; NaN where nothing is."""
    is_number = np.isfinite(values)
    count = is_number.sum(axis=1)
    total = np.where(is_number, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _ends(table: SlotTable | None, slot: int) -> tuple[float | None, float | None]:
    """Least and greatest value of a slot."""
    if table is None or not len(table.values):
        return None, None
    values = table.values[:, slot]
    return float(values.min()), float(values.max())


def price_tables(case: Case, physics: Physics, variables: SlotTable) -> dict[str, SlotTable]:
    """Tables of `tables.PRICE_UNITS`: marginal costs with the integers of the plan held.

    Args:
        case: the case as solved.
        physics: of the plan.
        variables: its table of all variables.

    Raises:
        SolverError: a solver found no optimum in time.
    """
    program = _with_room(horizon(case, physics))
    z = _point(program, variables)
    slopes = row_prices(program, z)
    tables = {"bus_price": _bus_prices(program, z, slopes)}
    standard = program.standard
    storage = [f for f in in_roles(program.microgrid.fleets.values(), "storage") if f.stored]
    names = [(f.names, f"{f.kind}.dynamics") for f in storage]
    if names:
        worth = np.concatenate([-slopes[standard.rows(row)] for _, row in names])
        labels = tuple(name for units, _ in names for name in units)
        tables["storage_value"] = SlotTable(labels, worth)
    if standard.has(LEVEL):
        worth = -slopes[standard.rows("tank.dynamics")]
        tables["fuel_value"] = SlotTable(standard.labels(LEVEL), worth)
    return tables


def _with_room(program: CaseProgram) -> CaseProgram:
    """The program with lines that may carry a little more than its devices ask of them."""
    data = dict(program.data)
    for component in program.microgrid.components:
        if isinstance(component, Lines):
            data |= component.with_room(data, program.situation)
    return replace(program, data=data)


def _bus_prices(program: CaseProgram, z: Floats, slopes: Floats) -> SlotTable:
    """$/MWh at every bus of the case; NaN in dead islands, where nothing more can be had."""
    case, microgrid = program.case, program.microgrid
    price = slopes[program.standard.rows("balance.p")] / case.step_h
    price[as_switched(program, z).alive < 0.5] = np.nan
    return SlotTable(case.network.bus_names, price[microgrid.bus_of])


def _point(program: CaseProgram, variables: SlotTable) -> Floats:
    """(columns,) the point that a plan's table of variables tells of."""
    standard = program.standard
    z = np.clip(0.0, program.vectors.lower, program.vectors.upper)
    for name, columns in standard.initial.items():
        z[columns] = program.x0[name]
    z[standard.copies[0].own_columns] = variables.values.T
    return z
