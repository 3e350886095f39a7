"""Can the wires carry what devices feed in? AC power flow of any number of members at once.

Powers are taken as they are. In every island the largest unit that forms then is the root: it
holds the voltage, and gives what was not planned, losses above all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.models.network.powerflow import Flow, flow
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class Carried:
    """What AC power flow says of many members, arrays (members,); NaN where one has no solution.

    Attributes:
        converged: False where there is no solution; such a member says nothing else.
        v_min_pu, v_max_pu: over the buses that are alive; NaN where none is.
        v_excess_pu: how far the worst bus lies outside its band; 0 within it.
        overload_mva: how far the worst line is beyond its rating; 0 within or without one.
        angle_excess_degree: how far the voltages at the ends of the worst line are apart beyond its
            limit; 0 within or without one.
        root_excess_mw: what the forming units together give or take beyond their ranges.
        root_worst_mw: the same of the worst of them.
        loss_mw: in all lines.
    """

    converged: Bools
    v_min_pu: Floats
    v_max_pu: Floats
    v_excess_pu: Floats
    overload_mva: Floats
    angle_excess_degree: Floats
    root_excess_mw: Floats
    root_worst_mw: Floats
    loss_mw: Floats


def carry(
    case: Case,
    power: Mapping[str, Floats],
    closed: Bools,
    energy: Floats,
    alone: Floats | float = 0.0,
    running: Mapping[str, Floats] | None = None,
) -> Carried:
    """Solves any number of members at once, islands included.

    Sources give no reactive power but the roots, which hold the voltage of the grid, or 1 pu.

    Args:
        case: network and devices.
        power: MW fed in by every device, (members,) by its name; loads are negative.
        closed: (lines of the case, members) where a line carries power.
        energy: (units, members) MWh in storage as the slot begins.
        alone: (buses, members) Mvar fed in by devices without active power.
        running: (members,) 1 where a unit with commitment runs, or one that may fail is in order,
            by its name.
    """
    fleets = list(device_fleets(case).values())
    units = forming_units(fleets)
    forms = forming_then(fleets, units, energy, running)
    chosen = carriers(case, units, connected(case, closed), forms)
    root = at_buses(case, units.bus, chosen) > 0
    p, q = injections(case, fleets, power, closed.shape[1])
    solution = flow(case.network, p, q + alone, closed, root, held_voltages(case, fleets))
    return _carried(solution, _root_excess(solution, units, chosen, power))


def injections(
    case: Case, fleets: list[DeviceFleet], power: Mapping[str, Floats], members: int
) -> tuple[Floats, Floats]:
    """(buses, members) MW and Mvar, of devices that give reactive power with active alone."""
    p = np.zeros((len(case.network.bus_names), members))
    q = np.zeros_like(p)
    for fleet in fleets:
        fed = np.array([power[name] for name in fleet.names])
        np.add.at(p, fleet.bus, fed)
        np.add.at(q, fleet.bus, fleet.reactive_per_mw()[:, None] * fed)
    return p, q


def reactive_alone(case: Case, fleets: Iterable[DeviceFleet]) -> Floats:
    """(buses, slots) Mvar fed in by devices without active power, none of it shed."""
    q = np.zeros((len(case.network.bus_names), case.slots))
    for fleet in fleets:
        if fleet.reactive_alone().any():
            profiles = np.array([case.profile(name) for name, _ in fleet.expected()])
            np.add.at(q, fleet.bus, fleet.reactive_alone()[:, None] * profiles)
    return q


def held_voltages(case: Case, fleets: list[DeviceFleet]) -> Floats:
    """(buses,) pu that a device holds there where the bus is a root; 1 where none says so."""
    volts = np.ones(len(case.network.bus_names))
    for fleet in fleets:
        voltage = fleet.voltage_pu()
        holds = np.isfinite(voltage)
        volts[fleet.bus[holds]] = voltage[holds]
    return volts


def _root_excess(
    solution: Flow, units: FormingUnits, chosen: Bools, power: Mapping[str, Floats]
) -> Floats:
    """(units, members) MW of every forming unit beyond its range, 0 where it carries nothing."""
    if not units.names:
        return np.zeros((1, len(solution.converged)))
    planned = np.array([power[name] for name in units.names])
    fed = planned + solution.p_root_mw[units.bus]
    p_min, p_max = units.p_min_mw[:, None], units.p_max_mw[:, None]
    beyond = np.maximum(np.maximum(fed - p_max, p_min - fed), 0.0)
    return np.where(chosen, beyond, 0.0)


def _carried(solution: Flow, excess: Floats) -> Carried:
    solved = solution.converged
    live = np.isfinite(solution.v_pu)
    any_live = live.any(axis=0)

    def worst(values: Floats) -> Floats:
        return np.where(solved, np.nan_to_num(values).max(axis=0, initial=0.0), np.nan)

    return Carried(
        converged=solved,
        v_min_pu=np.where(any_live, np.where(live, solution.v_pu, np.inf).min(axis=0), np.nan),
        v_max_pu=np.where(any_live, np.where(live, solution.v_pu, -np.inf).max(axis=0), np.nan),
        v_excess_pu=worst(solution.v_violation_pu),
        overload_mva=worst(solution.overload_mva),
        angle_excess_degree=worst(solution.angle_excess_degree),
        root_excess_mw=np.where(solved, np.nan_to_num(excess).sum(axis=0), np.nan),
        root_worst_mw=worst(excess),
        loss_mw=solution.loss_mw,
    )


def connected(case: Case, line_up: Bools) -> Situation:
    """The situation on the case's whole network, nothing merged: (lines, members) closed lines."""
    network, forming = case.network, np.zeros(len(case.network.bus_names), bool)
    for fleet in device_fleets(case).values():
        forming[fleet.bus[fleet.forming()]] = True
    ends = np.stack([network.from_bus, network.to_bus])
    names, n = network.line_names, line_up.shape[1]
    return Situation(case.profile, names, ends, line_up, forming, n)


def roots(case: Case, situation: Situation, energy: Floats | None = None) -> Bools:
    """(buses, members) one bus of every live island: its grid's, or its largest forming unit's.

    Args:
        case: network and devices.
        situation: on the whole network.
        energy: (units, members) MWh in storage as the slot begins; enough in all if omitted.

    Raises:
        UsageError: a situation on a merged network.
    """
    fleets = list(device_fleets(case).values())
    units = forming_units(fleets)
    forms = np.ones((len(units.names), situation.n), bool)
    if energy is not None:
        forms = forming_then(fleets, units, energy)
    return at_buses(case, units.bus, carriers(case, units, situation, forms)) > 0


@dataclass(frozen=True)
class FormingUnits:
    """The devices that can carry an island, those that are preferred first. Arrays are (units,).

    Attributes:
        names: of the devices.
        bus: index of each one's bus in the case's network.
        p_min_mw, p_max_mw: the power that it can feed in.
    """

    names: tuple[str, ...]
    bus: Ints
    p_min_mw: Floats
    p_max_mw: Floats


def forming_units(fleets: list[DeviceFleet]) -> FormingUnits:
    """Grids first, the largest before the smaller, then all others alike."""
    rows: list[tuple[bool, float, str, int, float]] = []
    for fleet in in_roles(fleets, "exchange", "dispatchable", "storage", "weather", "load"):
        for k in np.flatnonzero(fleet.forming()):
            p_min, p_max = (float(limit[k]) for limit in fleet.power_range())
            is_inner = fleet.role != "exchange"
            rows.append((is_inner, -p_max, fleet.names[k], int(fleet.bus[k]), p_min))
    rows.sort(key=lambda row: row[:2])
    return FormingUnits(
        names=tuple(name for _, _, name, _, _ in rows),
        bus=np.array([bus for *_, bus, _ in rows], np.intp),
        p_min_mw=np.array([p_min for *_, p_min in rows], float),
        p_max_mw=np.array([-minus_p_max for _, minus_p_max, *_ in rows], float),
    )


def forming_then(
    fleets: Iterable[DeviceFleet],
    units: FormingUnits,
    energy: Floats,
    running: Mapping[str, Floats] | None = None,
) -> Bools:
    """(units, members) whether a unit forms an island then: it has energy to give, and runs.

    Args:
        fleets: all devices.
        units: those of them that can.
        energy: (storage units, members) MWh in storage as the slot begins.
        running: (members,) 1 where a unit with commitment runs, or one that may fail is in order,
            by its name.
    """
    able = {name: on > 0.5 for name, on in (running or {}).items()}
    members = energy.shape[1]
    for fleet in fleets:
        has = np.broadcast_to(fleet.has_energy(energy), (len(fleet.tables), members))
        able |= {name: has[k] & able.get(name, True) for k, name in enumerate(fleet.names)}
    return np.array([able[name] for name in units.names], bool).reshape(-1, members)


def carriers(case: Case, units: FormingUnits, situation: Situation, forms: Bools) -> Bools:
    """(units, members) whether a unit carries its island: the first of those that form it.

    Args:
        case: network and devices.
        units: those that can.
        situation: on the whole network.
        forms: (units, members) whether they do.

    Raises:
        UsageError: a situation on a merged network.
    """
    island = situation.island
    if len(island) != len(case.network.bus_names):
        raise UsageError(
            f"the situation has {len(island)} buses, the case {len(case.network.bus_names)}",
            hint="`connected` makes one on the whole network",
        )
    every = np.arange(situation.n)
    has_root = np.zeros((island.max(initial=0) + 1, situation.n), bool)
    chosen = np.zeros((len(units.names), situation.n), bool)
    for k, bus in enumerate(units.bus):
        mine = island[bus]
        chosen[k] = forms[k] & ~has_root[mine, every]
        has_root[mine, every] |= forms[k]
    return chosen


def at_buses(case: Case, bus: Ints, values: np.ndarray) -> Floats:
    """(buses, members) the sum of values (devices, members) over the devices of every bus."""
    total = np.zeros((len(case.network.bus_names), values.shape[1]))
    np.add.at(total, bus, values)
    return total
