"""Why demand was shed: what stood in the way in the load's island, in that slot."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.case_program import CaseProgram, as_switched
from resilience.tolerances import AT_LIMIT_TOLERANCE

REASONS = {
    "no source": "its island has no grid-forming unit",
    "power": "sources of its island are at their limits",
    "energy": "sources of its island are at their limits, storage is empty",
    "reactive": "reactive power of its island is at its limit (s_mva, q_max_mvar)",
    "saved": "storage saves what it has for a later slot",
    "voltage": "voltages of its island are at both ends of their band",
    "rating": "a line of its island is at its rating",
    "block": "the load can only be served whole",
    "price": "shedding is cheaper than the sources left, or limits such as ramps hold them",
}
"""Each reason, in the order in which they are tried, with its meaning."""


def shed_reasons(program: CaseProgram, z: Floats) -> dict[str, dict[str, float]]:
    """MWh shed per load and reason, {load: {reason: MWh}}; loads that are served are left out."""
    standard, case = program.standard, program.case
    if not case.load:
        return {}
    shed = z[standard.columns("load.shed")]
    island = as_switched(program, z).island[program.microgrid.at(case.load)]
    causes = _causes(program, z)
    found: dict[str, dict[str, float]] = {}
    for i, t in np.argwhere(shed > AT_LIMIT_TOLERANCE):
        table = case.load[int(i)]
        reason = _reason(causes, int(island[i, t]), int(t), table.block)
        mwh = float(shed[i, t]) * case.step_h
        by_reason = found.setdefault(table.name, {})
        by_reason[reason] = by_reason.get(reason, 0.0) + mwh
    return found


def _reason(causes: dict[str, Bools], island: int, t: int, block: bool) -> str:
    if causes["dead"][island, t]:
        return "no source"
    if causes["bound"][island, t]:
        return "energy" if causes["empty"][island, t] else "power"
    for reason in ("reactive", "saved", "voltage", "rating"):
        if causes[reason][island, t]:
            return reason
    return "block" if block else "price"


def _causes(program: CaseProgram, z: Floats) -> dict[str, Bools]:
    """(islands, slots) what is true of every island: see the names used in `_reason`."""
    microgrid, situation = program.microgrid, as_switched(program, z)
    shape = (int(situation.island.max()) + 1, situation.n)

    def some(at: Ints, holds: Bools) -> Bools:
        """Islands in which `holds` (devices, slots) is true of any device at the buses `at`."""
        found = np.zeros(shape, bool)
        places = situation.island[at]
        slots = np.broadcast_to(np.arange(situation.n), places.shape)
        np.logical_or.at(found, (places, slots), holds)
        return found

    spare, empty, saved = (np.zeros(shape, bool) for _ in range(3))
    for at, full, starved in _sources(program, z):
        spare |= some(at, ~(full | starved))
        empty |= some(at, starved & ~full)
    if program.case.ess:
        at, full, starved = _sources(program, z)[-1]
        later = np.logical_or.accumulate(starved[:, ::-1], axis=1)[:, ::-1]
        saved = some(at, ~(full | starved) & later)
    buses = np.arange(len(situation.forming))
    lowest, highest = _voltage_limits(program, z)
    return {
        "dead": some(buses, situation.alive < 0.5),
        "bound": ~spare,
        "empty": empty,
        "reactive": some(microgrid.at(program.case.load), _asks_reactive(program))
        & ~some(*_reactive_room(program, z)),
        "saved": saved,
        "voltage": some(buses, lowest) & some(buses, highest),
        "rating": some(microgrid.network.from_bus, _at_rating(program, z)),
    }


def _sources(program: CaseProgram, z: Floats) -> list[tuple[Ints, Bools, Bools]]:
    """Per fleet: bus of every device, whether it feeds all it can, whether it has no energy.

    Storage comes last.
    """
    standard, case, microgrid = program.standard, program.case, program.microgrid
    upper = program.vectors.upper
    found: list[tuple[Ints, Bools, Bools]] = []
    fleets = (("pv.p", case.pv), ("generator.p", case.generator), ("grid.import", case.grid))
    for name, tables in fleets:
        if tables:
            columns = standard.columns(name)
            full = z[columns] >= upper[columns] - AT_LIMIT_TOLERANCE
            found.append((microgrid.at(tables), full, np.zeros_like(full)))
    if case.ess:
        columns, energy = standard.columns("ess.discharge"), standard.columns("ess.energy")
        full = z[columns] >= upper[columns] - AT_LIMIT_TOLERANCE
        starved = z[energy] <= program.vectors.lower[energy] + AT_LIMIT_TOLERANCE
        found.append((microgrid.at(case.ess), full, starved))
    return found


def _asks_reactive(program: CaseProgram) -> Bools:
    """(loads, slots) whether a load asks for reactive power that the physics carries."""
    factors = np.array([t.power_factor for t in program.case.load])
    asks = (factors < 1.0) & program.standard.has("line.q")
    return asks[:, None] & (program.data["load.demand"] > AT_LIMIT_TOLERANCE)


def _reactive_room(program: CaseProgram, z: Floats) -> tuple[Ints, Bools]:
    """Bus of every device, and whether it could feed in more reactive power, (devices, slots)."""
    standard, case, microgrid = program.standard, program.case, program.microgrid
    places, room = [np.empty(0, np.intp)], [np.empty((0, program.situation.n), bool)]
    inverters = [t for t in case.pv if t.s_mva], [t for t in case.ess if t.s_mva]
    fleets = (("generator", case.generator), ("grid", case.grid), ("pv", inverters[0]))
    for name, tables in (*fleets, ("ess", inverters[1])):
        if tables and standard.has(f"{name}.q"):
            columns = standard.columns(f"{name}.q")
            below = z[columns] < program.vectors.upper[columns] - AT_LIMIT_TOLERANCE
            places.append(microgrid.at(tables))
            room.append(below & ~_at_disc(program, z, f"{name}.rating", below.shape))
    return np.concatenate(places), np.concatenate(room)


def _at_disc(program: CaseProgram, z: Floats, name: str, shape: tuple[int, ...]) -> Bools:
    """(devices, slots) whether an inverter is at its rating, as closely as its polygon allows."""
    for structure in program.standard.structures:
        if structure.name == name:
            length = np.sqrt(sum(x**2 for x in structure.values(z)))
            return (length >= 0.96 * structure.limits[0]).reshape(shape[::-1]).T
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
    at_low = (z[columns] <= low + AT_LIMIT_TOLERANCE) & (low < high)
    return at_low, z[columns] >= high - AT_LIMIT_TOLERANCE


def _at_rating(program: CaseProgram, z: Floats) -> Bools:
    standard, network = program.standard, program.microgrid.network
    if not standard.has("line.p"):
        return np.zeros((len(network.line_names), program.situation.n), bool)
    flow = z[standard.columns("line.p")] ** 2
    if standard.has("line.q"):
        flow = flow + z[standard.columns("line.q")] ** 2
    rating = network.rating_mva[:, None]
    near = np.isfinite(rating) & (np.sqrt(flow) >= rating * 0.999 - AT_LIMIT_TOLERANCE)
    return near & as_switched(program, z).line_up
