"""Why demand was shed: what stood in the way in the load's island, in that slot."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.case_program import CaseProgram, as_switched
from resilience.models.components import DeviceFleet, in_roles
from resilience.planning.reading.fuel import without_fuel
from resilience.tolerances import AT_LIMIT_TOLERANCE

POLYGON_SHARE = 0.96  # of its rating at which an inverter stands at it, however coarse its polygon
RATING_SHARE = 0.999  # the same of a line

_SHORT = ("energy", "fuel")
"""What a source may lack, of storage and of a generator with a tank."""

REASONS = {
    "no source": "its island has no grid-forming unit",
    "power": "sources of its island are at their limits",
    "energy": "sources of its island are at their limits, storage is empty",
    "fuel": "sources of its island are at their limits, a tank is empty",
    "reactive": "reactive power of its island is at its limit (s_mva, q_max_mvar)",
    "saved": "storage saves what it has for a later slot",
    "fuel saved": "generators save what is in the tank for a later slot",
    "voltage": "voltages of its island are at both ends of their band",
    "rating": "a line of its island is at its rating",
    "block": "the load can only be served whole",
    "price": "shedding is cheaper than the sources left, or limits such as ramps hold them",
}
"""Each reason, in the order in which they are tried, with its meaning."""


def shed_reasons(program: CaseProgram, z: Floats) -> dict[str, dict[str, float]]:
    """MWh shed per load and reason, {load: {reason: MWh}}; loads that are served are left out."""
    loads = in_roles(program.microgrid.fleets.values(), "load")
    if not loads:
        return {}
    islands, causes = as_switched(program, z).island, _causes(program, z)
    reasons: dict[str, dict[str, float]] = {}
    for fleet in loads:
        shed, island, is_block = program.values(fleet.shed, z), islands[fleet.bus], fleet.is_block()
        for i, t in np.argwhere(shed > AT_LIMIT_TOLERANCE):
            reason = _reason(causes, int(island[i, t]), int(t), bool(is_block[i]))
            mwh = float(shed[i, t]) * program.case.step_h
            by_reason = reasons.setdefault(fleet.names[int(i)], {})
            by_reason[reason] = by_reason.get(reason, 0.0) + mwh
    return reasons


def _reason(causes: dict[str, Bools], island: int, t: int, is_block: bool) -> str:
    if causes["dead"][island, t]:
        return "no source"
    if causes["bound"][island, t]:
        short = [reason for reason in ("energy", "fuel") if causes[reason][island, t]]
        return short[0] if short else "power"
    for reason in ("reactive", "saved", "fuel saved", "voltage", "rating"):
        if causes[reason][island, t]:
            return reason
    return "block" if is_block else "price"


def _causes(program: CaseProgram, z: Floats) -> dict[str, Bools]:
    """(islands, slots) what is true of every island: see the names used in `_reason`."""
    network, situation = program.microgrid.network, as_switched(program, z)
    fleets = program.microgrid.fleets.values()
    shape = (int(situation.island.max()) + 1, situation.n)

    def in_islands(bus: Ints, holds: Bools) -> Bools:
        """Islands in which `holds` (devices, slots) is true of any device at the buses."""
        islands = np.zeros(shape, bool)
        places = situation.island[bus]
        slots = np.broadcast_to(np.arange(situation.n), places.shape)
        np.logical_or.at(islands, (places, slots), holds)
        return islands

    spare, asks, room = (np.zeros(shape, bool) for _ in range(3))
    empty, saved = ({kind: np.zeros(shape, bool) for kind in _SHORT} for _ in range(2))
    for fleet in in_roles(fleets, "weather", "dispatchable", "exchange", "storage"):
        full, starved = _source(program, z, fleet)
        spare |= in_islands(fleet.bus, ~(full | starved))
        room |= in_islands(*_reactive_room(program, z, fleet))
        kind = "energy" if fleet.role == "storage" else "fuel"
        empty[kind] |= in_islands(fleet.bus, starved & ~full)
        later = np.logical_or.accumulate(starved[:, ::-1], axis=1)[:, ::-1]
        saved[kind] |= in_islands(fleet.bus, ~(full | starved) & later)
    for fleet in in_roles(fleets, "load"):
        asks |= in_islands(fleet.bus, _asks_reactive(program, fleet))
    buses = np.arange(len(situation.forming))
    lowest, highest = _voltage_limits(program, z)
    return {
        "dead": in_islands(buses, situation.alive < 0.5),
        "bound": ~spare,
        **empty,
        "reactive": asks & ~room,
        "saved": saved["energy"],
        "fuel saved": saved["fuel"],
        "voltage": in_islands(buses, lowest) & in_islands(buses, highest),
        "rating": in_islands(network.from_bus, _at_rating(program, z)),
    }


def _source(program: CaseProgram, z: Floats, fleet: DeviceFleet) -> tuple[Bools, Bools]:
    """(devices, slots) whether a device feeds in all it can, and if it has no energy or fuel."""
    standard, vectors = program.standard, program.vectors
    full = np.ones((len(fleet.tables), program.situation.n), bool)
    for name, sign in fleet.flows.items():
        if sign > 0:
            columns = standard.columns(name)
            full &= z[columns] >= vectors.upper[columns] - AT_LIMIT_TOLERANCE
    if fleet.stored is None:
        return full, without_fuel(program, z, fleet)
    energy = standard.columns(fleet.stored)
    return full, z[energy] <= vectors.lower[energy] + AT_LIMIT_TOLERANCE


def _asks_reactive(program: CaseProgram, loads: DeviceFleet) -> Bools:
    """(loads, slots) whether a load asks for reactive power that the physics carries."""
    asks = (loads.reactive_per_mw() > 0.0) & program.standard.has("line.q")
    return asks[:, None] & (program.data[loads.demand] > AT_LIMIT_TOLERANCE)


def _reactive_room(program: CaseProgram, z: Floats, fleet: DeviceFleet) -> tuple[Ints, Bools]:
    """Bus of devices with reactive power, and (devices, slots) whether they could give more."""
    standard = program.standard
    if not standard.has(fleet.reactive):
        return np.empty(0, np.intp), np.empty((0, program.situation.n), bool)
    columns = standard.columns(fleet.reactive)
    below = z[columns] < program.vectors.upper[columns] - AT_LIMIT_TOLERANCE
    room = below & ~_at_disc(program, z, f"{fleet.kind}.rating", below.shape)
    rows = [fleet.names.index(name) for name in standard.labels(fleet.reactive)]
    return fleet.bus[rows], room


def _at_disc(program: CaseProgram, z: Floats, name: str, shape: tuple[int, ...]) -> Bools:
    """(devices, slots) whether an inverter is at its rating, as closely as its polygon allows."""
    for structure in program.standard.structures:
        if structure.name == name:
            length = np.sqrt(sum(x**2 for x in structure.values(z)))
            return (length >= POLYGON_SHARE * structure.limits[0]).reshape(shape[::-1]).T
    return np.zeros(shape, bool)


def _voltage_limits(program: CaseProgram, z: Floats) -> tuple[Bools, Bools]:
    """(buses, slots) lowest voltage allowed, and highest; a held voltage can only be the latter.

    Only both in one island bind: without an upper limit the whole island could be raised.
    """
    standard = program.standard
    if not standard.has("bus.v_sq"):
        none = np.zeros((len(program.microgrid.network.bus_names), program.situation.n), bool)
        return none, none
    columns = standard.columns("bus.v_sq")
    low, high = program.vectors.lower[columns], program.vectors.upper[columns]
    lowest = (z[columns] <= low + AT_LIMIT_TOLERANCE) & (low < high)
    return lowest, z[columns] >= high - AT_LIMIT_TOLERANCE


def _at_rating(program: CaseProgram, z: Floats) -> Bools:
    """(lines, slots) whether a line is at its rating at either end."""
    standard, network = program.standard, program.microgrid.network
    limit = network.rating_mva[:, None] * RATING_SHARE - AT_LIMIT_TOLERANCE
    near = np.zeros((len(network.line_names), program.situation.n), bool)
    if not standard.has("line.p"):
        return near
    near |= np.isfinite(limit) & (np.abs(z[standard.columns("line.p")]) >= limit)
    for structure in standard.structures:
        if structure.name in ("line.rating", "line.rating_end"):
            rows = [network.line_names.index(name) for name in structure.labels]
            length = np.sqrt(sum(x**2 for x in structure.values(z)))
            near[rows] |= limit[rows] <= length.reshape(-1, len(rows)).T
    return near & as_switched(program, z).line_up
