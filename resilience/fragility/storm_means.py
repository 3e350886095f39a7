"""What a set of storms does to a feeder on average: the means that fewer storms must keep.

Load at risk is the load behind every line that is down, over time; loads behind two of them count
twice, and so does what a unit gives that is out. The grid is lost where no load hangs on it at some
time.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.critical import critical_loads
from resilience.case.schema import LoadTable
from resilience.fragility.likely import patterns_of
from resilience.fragility.outages.reduction import load_behind_mw
from resilience.fragility.outages.scenarios import Scenarios

AT_RISK, ANY_LINE, GRID_LOST = "load at risk, MWh", "any line fails", "the grid is lost"
CHANCES = (ANY_LINE, GRID_LOST)
"""Moments that are chances; the others are amounts."""


def moments(case: Case, scenarios: Scenarios) -> dict[str, Floats]:
    """What every scenario does, by name, (scenarios,) each; expectations are the moments.

    Load at risk in MWh; 1 where any line fails, where the grid is lost; the hours that each unit is
    out; and those that the bus of each critical load is off the grid.

    Args:
        case: the case.
        scenarios: over its horizon.
    """
    hours, names = scenarios.down.sum(axis=1) * case.step_h, set(case.network.line_names)
    by_scenario = {
        AT_RISK: load_behind_mw(case, scenarios.lines) @ hours,
        ANY_LINE: scenarios.restricted_to(names).down.any(axis=(0, 1)).astype(float),
    }
    units = (k for k, name in enumerate(scenarios.lines) if name not in names)
    by_scenario |= {f"{scenarios.lines[k]} out, h": hours[k] for k in units}
    network, patterns = case.network, patterns_of(case, scenarios)
    loads = case.tables_of(LoadTable)
    buses = np.array([network.bus(load.bus) for load in loads], np.intp)
    apart = np.logical_not(patterns.grid[buses])
    by_scenario[GRID_LOST] = (
        np.asarray(apart.all(axis=0))[patterns.number].any(axis=0).astype(float)
    )
    for k in np.flatnonzero(critical_loads(case)):
        hours_apart = apart[k, patterns.number].sum(axis=0) * case.step_h
        by_scenario[f"{loads[k].name} off the grid, h"] = hours_apart
    return by_scenario


def expected_moments(by_scenario: Mapping[str, Floats], probability: Floats) -> dict[str, float]:
    """The moments: expectations of what `moments` gives, by the weights (scenarios,)."""
    return {name: float(probability @ values) for name, values in by_scenario.items()}
