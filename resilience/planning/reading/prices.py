"""Prices of a plan: what a MWh more of demand costs at every bus, and what is stored is worth."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.case_program import CaseProgram, as_switched, horizon
from resilience.models.components import in_roles
from resilience.models.methods.prices import row_prices
from resilience.models.microgrid import Physics
from resilience.planning.tables import LEVEL, SlotTable


def price_tables(case: Case, physics: Physics, variables: SlotTable) -> dict[str, SlotTable]:
    """Tables of `tables.PRICE_UNITS`: marginal costs with the integers of the plan held.

    Args:
        case: the case as solved.
        physics: of the plan.
        variables: its table of all variables.

    Raises:
        SolverError: a solver found no optimum in time.
    """
    program = horizon(case, physics)
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
