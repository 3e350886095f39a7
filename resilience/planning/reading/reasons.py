"""Why demand was shed: what stood in the way in the load's island, in that slot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.case_program import CaseProgram, as_switched
from resilience.models.components import DeviceFleet, in_roles
from resilience.planning.reading.fuel import without_fuel
from resilience.planning.tables import line_mva
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
    "rating": "a line on its way is at its rating",
    "angle": "a line on its way is at a limit of the angle between its ends",
    "block": "the load can only be served whole",
    "price": "shedding is cheaper than the sources left, or limits such as ramps hold them",
}
"""Each reason, in the order in which they are tried, with its meaning."""


@dataclass(frozen=True)
class ShedLoad:
    """One load in the slots in which one reason held it back.

    Attributes:
        fleet: of the load.
        row: of the load in its fleet.
        reason: key of `REASONS`.
        slots: (slots shed,) in which slots.
        mw: (slots shed,) shed in these, MW.
    """

    fleet: DeviceFleet
    row: int
    reason: str
    slots: Ints
    mw: Floats


def shed_loads(program: CaseProgram, z: Floats) -> list[ShedLoad]:
    """What was shed of every load, reason by reason; loads that are served are left out."""
    loads = in_roles(program.microgrid.fleets.values(), "load")
    if not loads:
        return []
    islands, causes, entries = as_switched(program, z).island, _causes(program, z), []
    for fleet in loads:
        shed, is_block = program.values(fleet.shed, z), fleet.is_block()
        slots: dict[tuple[int, str], list[int]] = {}
        for i, t in np.argwhere(shed > AT_LIMIT_TOLERANCE).tolist():
            bus = int(fleet.bus[i])
            reason = _reason(causes, bus, int(islands[bus, t]), t, bool(is_block[i]))
            slots.setdefault((i, reason), []).append(t)
        entries += [
            ShedLoad(fleet, i, reason, np.array(times), shed[i, times])
            for (i, reason), times in slots.items()
        ]
    return entries


def shed_by_reason(program: CaseProgram, loads: list[ShedLoad]) -> dict[str, dict[str, float]]:
    """MWh shed per load and reason, {load: {reason: MWh}}."""
    reasons: dict[str, dict[str, float]] = {}
    for entry in loads:
        mwh = float(entry.mw.sum()) * program.case.step_h
        reasons.setdefault(entry.fleet.names[entry.row], {})[entry.reason] = mwh
    return reasons


def _reason(causes: dict[str, Bools], bus: int, island: int, t: int, is_block: bool) -> str:
    if causes["dead"][island, t]:
        return "no source"
    if causes["bound"][island, t]:
        short = [reason for reason in ("energy", "fuel") if causes[reason][island, t]]
        return short[0] if short else "power"
    for reason in ("reactive", "saved", "fuel saved", "voltage"):
        if causes[reason][island, t]:
            return reason
    for reason in AT_LIMIT:
        if causes[reason][bus, t]:
            return reason
    return "block" if is_block else "price"


def _causes(program: CaseProgram, z: Floats) -> dict[str, Bools]:
    """(islands, slots) what is true of every island, see the names used in `_reason`.

    Those of `AT_LIMIT` are (buses, slots): which of them are behind such a line.
    """
    situation, fleets = as_switched(program, z), program.microgrid.fleets.values()
    none = np.zeros(situation.island.shape, bool)
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
        full, starved = source_limits(program, z, fleet)
        spare |= in_islands(fleet.bus, ~(full | starved))
        room |= in_islands(*reactive_room(program, z, fleet))
        kind = "energy" if fleet.role == "storage" else "fuel"
        empty[kind] |= in_islands(fleet.bus, starved & ~full)
        later = np.logical_or.accumulate(starved[:, ::-1], axis=1)[:, ::-1]
        saved[kind] |= in_islands(fleet.bus, ~(full | starved) & later)
    for fleet in in_roles(fleets, "load"):
        asks |= in_islands(fleet.bus, _asks_reactive(program, fleet))
    buses = np.arange(len(situation.forming))
    lowest, highest = voltage_limits(program, z)
    return {
        "dead": in_islands(buses, situation.alive < 0.5),
        "bound": ~spare,
        **empty,
        "reactive": asks & ~room,
        "saved": saved["energy"],
        "fuel saved": saved["fuel"],
        "voltage": in_islands(buses, lowest) & in_islands(buses, highest),
        **{
            reason: np.logical_or.reduce([none, *behind(program, z, at_limit(program, z)).values()])
            for reason, at_limit in AT_LIMIT.items()
        },
    }


def source_limits(program: CaseProgram, z: Floats, fleet: DeviceFleet) -> tuple[Bools, Bools]:
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


def reactive_room(program: CaseProgram, z: Floats, fleet: DeviceFleet) -> tuple[Ints, Bools]:
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


def voltage_limits(program: CaseProgram, z: Floats) -> tuple[Bools, Bools]:
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
    limit = program.microgrid.network.rating_mva[:, None] * RATING_SHARE - AT_LIMIT_TOLERANCE
    near = np.isfinite(limit) & (line_mva(program, z) >= limit)
    return near & as_switched(program, z).line_up


def at_angle(program: CaseProgram, z: Floats, name: str) -> Bools:
    """(lines, slots) whether a line is at `line.angle_min` or `line.angle_max`."""
    standard, names = program.standard, program.microgrid.network.line_names
    near = np.zeros((len(names), program.situation.n), bool)
    for row in standard.form.stage.rows:
        if row.name == name:
            rows = standard.rows(name)
            slack = program.vectors.row_upper[rows] - (standard.a @ z)[rows]
            near[[names.index(label) for label in row.labels]] = slack <= AT_LIMIT_TOLERANCE
    return near & as_switched(program, z).line_up


AT_LIMIT: Mapping[str, Callable[[CaseProgram, Floats], Bools]] = {
    "rating": _at_rating,
    "angle": lambda program, z: (
        at_angle(program, z, "line.angle_min") | at_angle(program, z, "line.angle_max")
    ),
}
"""(lines, slots) which lines are at what limit, by the keys of `REASONS`."""


def behind(program: CaseProgram, z: Floats, near: Bools) -> dict[int, Bools]:
    """Per line that is ever at a limit, (buses, slots) which buses it holds power back from.

    These are the ones that only that line feeds; in a loop, all of the island.

    Args:
        program: what was solved.
        z: (columns,) its point.
        near: (lines, slots) which lines are at it, see `AT_LIMIT`.
    """
    rows = np.flatnonzero(near.any(axis=1))
    if not len(rows):
        return {}
    microgrid, situation = program.microgrid, as_switched(program, z)
    flow = z[program.standard.columns("line.p")]
    held_back: dict[int, Bools] = {}
    for k in rows.tolist():
        slots = np.flatnonzero(near[k])
        up = situation.line_up[:, slots].copy()
        up[k] = False
        island, _ = microgrid.islands.lookup(up)
        ends = microgrid.network.from_bus[k], microgrid.network.to_bus[k]
        to, start = (np.where(flow[k, slots] > 0.0, *pair) for pair in (ends[::-1], ends))
        columns = np.arange(len(slots))
        in_loop = island[to, columns] == island[start, columns]
        parts = np.where(in_loop, situation.island[:, slots], island)
        held_back[k] = np.zeros(situation.island.shape, bool)
        held_back[k][:, slots] = parts == parts[to, columns]
    return held_back
