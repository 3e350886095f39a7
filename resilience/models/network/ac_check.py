"""Can the wires carry what devices feed in? AC power flow of any number of members at once.

Powers are taken as they are. In every island the largest forming unit is the root: it
holds the voltage, and gives what was not planned, losses above all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.network.powerflow import Flow, flow
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.case.schema import DeviceTable, ESSTable, GeneratorTable, GridTable


@dataclass(frozen=True)
class Carried:
    """What AC power flow says of many members, arrays (members,); NaN where one has no solution.

    Attributes:
        converged: False where there is no solution; such a member says nothing else.
        v_min_pu, v_max_pu: over the buses that are alive; NaN where none is.
        v_excess_pu: how far the worst bus lies outside its band; 0 within it.
        overload_mva: how far the worst line is beyond its rating; 0 within or without one.
        root_excess_mw: what the forming units together give or take beyond their ranges.
        root_worst_mw: the same of the worst of them.
        loss_mw: in all lines.
    """

    converged: Bools
    v_min_pu: Floats
    v_max_pu: Floats
    v_excess_pu: Floats
    overload_mva: Floats
    root_excess_mw: Floats
    root_worst_mw: Floats
    loss_mw: Floats


def carry(case: Case, power: Mapping[str, Floats], line_up: Bools) -> Carried:
    """Solves any number of members at once, islands included.

    Sources give none but the roots, which hold
    the grid's `v_pu`, or 1 pu.

    Args:
        case: network and devices.
        power: MW fed in by every device, (members,) by its name; loads are negative.
        line_up: (lines of the case, members) False where a line has failed.
    """
    closed = line_up & case.network.in_service[:, None]
    units, chosen = carriers(case, connected(case, closed))
    root = at_buses(case, units, chosen) > 0
    devices = [
        t for kind in ("load", "pv", "ess", "generator", "grid") for t in getattr(case, kind)
    ]
    p = at_buses(case, devices, np.array([power[t.name] for t in devices]))
    q = np.zeros_like(p)
    if case.load:
        slope = np.array([np.tan(np.arccos(load.power_factor)) for load in case.load])
        served = np.array([power[load.name] for load in case.load])
        q = at_buses(case, case.load, slope[:, None] * served)
    held = np.ones(len(p))
    for grid in case.grid:
        held[case.network.bus(grid.bus)] = grid.v_pu
    found = flow(case.network, p, q, closed, root, held)
    return _carried(found, _root_excess(case, found, units, chosen, power))


def _root_excess(
    case: Case, found: Flow, units: list[Any], chosen: Bools, power: Mapping[str, Floats]
) -> Floats:
    """(units, members) MW of every forming unit beyond its range, 0 where it carries nothing."""
    if not units:
        return np.zeros((1, len(found.converged)))
    bus = [case.network.bus(unit.bus) for unit in units]
    given = np.array([power[unit.name] for unit in units]) + found.p_root_mw[bus]
    least, most = np.array([power_range(unit) for unit in units]).T[:, :, None]
    beyond = np.maximum(np.maximum(given - most, least - given), 0.0)
    return np.where(chosen, beyond, 0.0)


def _carried(found: Flow, excess: Floats) -> Carried:
    solved = found.converged
    live = np.isfinite(found.v_pu)
    some = live.any(axis=0)

    def worst(values: Floats) -> Floats:
        return np.where(solved, np.nan_to_num(values).max(axis=0, initial=0.0), np.nan)

    return Carried(
        converged=solved,
        v_min_pu=np.where(some, np.where(live, found.v_pu, np.inf).min(axis=0), np.nan),
        v_max_pu=np.where(some, np.where(live, found.v_pu, -np.inf).max(axis=0), np.nan),
        v_excess_pu=worst(found.v_violation_pu),
        overload_mva=worst(found.overload_mva),
        root_excess_mw=np.where(solved, np.nan_to_num(excess).sum(axis=0), np.nan),
        root_worst_mw=worst(excess),
        loss_mw=found.loss_mw,
    )


def connected(case: Case, line_up: Bools) -> Situation:
    """The situation on the case's whole network, nothing merged: (lines, members) closed lines."""
    network, forming = case.network, np.zeros(len(case.network.bus_names), bool)
    forming[[network.bus(unit.bus) for unit in _forming(case)]] = True
    ends = np.stack([network.from_bus, network.to_bus])
    names, n = network.line_names, line_up.shape[1]
    return Situation(case.profile, names, ends, line_up, forming, n)


def roots(case: Case, situation: Situation) -> Bools:
    """(buses, members) one bus of every live island: its grid's, or its largest forming unit's.

    Raises:
        UsageError: a situation on a merged network.
    """
    return at_buses(case, *carriers(case, situation)) > 0


def _forming(case: Case) -> list[GridTable | GeneratorTable | ESSTable]:
    """Forming units, grids first, the largest before the smaller."""
    grids = sorted(case.grid, key=lambda t: -t.import_max_mw)
    others: list[GeneratorTable | ESSTable] = [*case.generator, *case.ess]
    others.sort(key=lambda t: -power_range(t)[1])
    return [unit for unit in (*grids, *others) if unit.grid_forming]


def power_range(unit: GridTable | GeneratorTable | ESSTable) -> tuple[float, float]:
    """Least and greatest power that a unit can feed in, MW."""
    from resilience.case.schema import ESSTable, GridTable

    if isinstance(unit, GridTable):
        return -unit.export_max_mw, unit.import_max_mw
    if isinstance(unit, ESSTable):
        return -unit.p_max_mw, -unit.p_min_mw
    return 0.0, unit.p_max_mw


def carriers(
    case: Case, situation: Situation
) -> tuple[list[GridTable | GeneratorTable | ESSTable], Bools]:
    """The forming units, and (units, members) whether a unit carries its island."""
    island = situation.island
    if len(island) != len(case.network.bus_names):
        raise UsageError(
            f"the situation has {len(island)} buses, the case {len(case.network.bus_names)}",
            hint="`connected` makes one on the whole network",
        )
    units, every = _forming(case), np.arange(situation.n)
    taken = np.zeros((island.max(initial=0) + 1, situation.n), bool)
    chosen = np.zeros((len(units), situation.n), bool)
    for k, unit in enumerate(units):
        mine = island[case.network.bus(unit.bus)]
        chosen[k] = ~taken[mine, every]
        taken[mine, every] = True
    return units, chosen


def at_buses(
    case: Case, devices: list[Any] | tuple[DeviceTable, ...], values: np.ndarray
) -> Floats:
    """(buses, members) the sum over the devices of every bus."""
    total = np.zeros((len(case.network.bus_names), values.shape[1]))
    bus = np.array([case.network.bus(device.bus) for device in devices], np.intp)
    np.add.at(total, bus, values)
    return total
