"""Tables of a plan: every quantity over the slots, and the energy balance they make."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Complexes, Floats
from resilience.case import Case
from resilience.models.case_program import CaseProgram, as_switched
from resilience.models.components import DeviceFleet, device_fleets, fleet_classes, in_roles
from resilience.models.microgrid import Microgrid
from resilience.models.network.situation import Situation

LEVEL, DELIVERY = "tank.level", "tank.delivery"
_UNITS = {
    "power": "MW fed in; storage: discharging positive; load: negative",
    "reactive": "Mvar fed in",
    "energy": "MWh stored at the end of the slot",
    "soc": "share of the capacity stored at the end of the slot",
    "demand": "MW",
    "shed": "MW",
    "surplus": "MW that a load takes beside its demand after an interruption",
}
PRICE_UNITS = {
    "bus_price": "$/MWh that a little more demand at a bus costs; empty in dead islands",
    "storage_value": "$/MWh that a little more stored at the end of the slot saves",
    "fuel_value": "$/m³ that a little more fuel at the end of the slot saves",
}
"""Tables that are made when they are asked for, with one more solve."""
_MORE_UNITS = {
    "voltage": "pu",
    "line_power": "MW at the sending end",
    "line_reactive": "Mvar at the sending end",
    "line_loading": "% of the rating at the more loaded end",
    "line_closed": "1 where the line can carry power",
    "island": "number of the island a bus belongs to; 0 is dead",
    "fuel": "m³ in the tank at the end of the slot",
    "on": "1 where a generator runs",
    "trip": "1 where a generator stops as an outage begins in its island",
    "variables": "every variable of the model, as `ess.charge[ess1]`, in its own unit",
}


def table_units() -> dict[str, str]:
    """Every table that a plan may have, and what it holds."""
    weather = {available_table(fleet): "MW" for fleet in in_roles(fleet_classes(), "weather")}
    return _UNITS | weather | _MORE_UNITS | PRICE_UNITS


def available_table(fleet: DeviceFleet | type[DeviceFleet]) -> str:
    """Table of what the weather offers a fleet."""
    return f"{fleet.kind}_available"


@dataclass(frozen=True)
class SlotTable:
    """Values of one quantity.

    Attributes:
        labels: a label per row, of devices, buses or lines.
        values: (labels, slots).
    """

    labels: tuple[str, ...]
    values: Floats

    def __getitem__(self, label: str) -> Floats:
        """(slots,) the values of one label."""
        return self.values[self.labels.index(label)]


def tabulate(program: CaseProgram, z: Floats) -> dict[str, SlotTable]:
    """Every quantity as a table (columns, slots); names and units in `table_units`."""
    fleets = program.microgrid.fleets.values()
    tables = _stored(program, z, in_roles(fleets, "storage"))
    tables |= _demand(program, z, in_roles(fleets, "load"))
    for fleet in in_roles(fleets, "weather"):
        tables[available_table(fleet)] = SlotTable(fleet.names, program.values(fleet.limit, z))
    order = in_roles(fleets, "dispatchable", "weather", "storage", "exchange", "load")
    power = [(fleet, fleet.power(lambda name: program.values(name, z))) for fleet in order]
    tables["power"] = _stacked(program, power)
    tables |= _wires(program, z)
    tables |= _states(program, z, as_switched(program, z))
    return tables | {"variables": SlotTable(program.slot_variables, program.slot_values(z))}


def _stacked(program: CaseProgram, rows: Iterable[tuple[DeviceFleet, Floats]]) -> SlotTable:
    """One table of several fleets, the rows of each below those of the one before."""
    rows = list(rows)
    values = [np.empty((0, program.standard.tree.n)), *(values for _, values in rows)]
    return SlotTable(
        tuple(name for fleet, _ in rows for name in fleet.names), np.concatenate(values)
    )


def _stored(program: CaseProgram, z: Floats, storage: list[DeviceFleet]) -> dict[str, SlotTable]:
    rows = [(fleet, program.values(fleet.stored, z)) for fleet in storage if fleet.stored]
    if not rows:
        return {}
    shares = [(fleet, energy / fleet.size_mwh()[:, None]) for fleet, energy in rows]
    return {"energy": _stacked(program, rows), "soc": _stacked(program, shares)}


def _demand(program: CaseProgram, z: Floats, loads: list[DeviceFleet]) -> dict[str, SlotTable]:
    if not loads:
        return {}
    tables = {
        "demand": _stacked(program, [(f, program.values(f.demand, z)) for f in loads]),
        "shed": _stacked(program, [(f, program.values(f.shed, z)) for f in loads]),
    }
    cold = [fleet for fleet in loads if len(fleet.cold)]
    if cold:
        names = tuple(fleet.names[k] for fleet in cold for k in fleet.cold)
        surplus = np.concatenate([program.values(fleet.surplus, z) for fleet in cold])
        tables["surplus"] = SlotTable(names, surplus)
    return tables


def _wires(program: CaseProgram, z: Floats) -> dict[str, SlotTable]:
    standard = program.standard
    tables: dict[str, SlotTable] = {}
    if standard.has("bus.v_sq"):
        squares = np.maximum(z[standard.columns("bus.v_sq")], 0.0)
        tables["voltage"] = SlotTable(standard.labels("bus.v_sq"), np.sqrt(squares))
    if standard.has("line.p"):
        sent = _sent(program, z)
        tables["line_power"] = SlotTable(standard.labels("line.p"), sent.real)
        if standard.has("line.q"):
            tables["line_reactive"] = SlotTable(standard.labels("line.q"), sent.imag)
        rated = np.isfinite(program.microgrid.network.rating_mva)
        if rated.any():
            names = tuple(np.array(standard.labels("line.p"))[rated].tolist())
            loading = (
                line_mva(program, z)[rated] / program.microgrid.network.rating_mva[rated, None]
            )
            tables["line_loading"] = SlotTable(names, 100.0 * loading)
        closed = as_switched(program, z).line_up
        tables["line_closed"] = SlotTable(standard.labels("line.p"), closed.astype(float))
    return tables


def line_mva(program: CaseProgram, z: Floats) -> Floats:
    """(lines, slots) MVA at the end of each rated line where there are more; 0 of the others."""
    standard, network = program.standard, program.microgrid.network
    mva = np.zeros((len(network.line_names), standard.tree.n))
    if not standard.has("line.p"):
        return mva
    rated = np.isfinite(network.rating_mva)
    mva[rated] = np.abs(z[standard.columns("line.p")])[rated]
    for structure in standard.structures:
        if structure.name in ("line.rating", "line.rating_end"):
            rows = [network.line_names.index(name) for name in structure.labels]
            length = np.sqrt(sum(x**2 for x in structure.values(z))).reshape(-1, len(rows)).T
            mva[rows] = np.maximum(mva[rows], length)
    return mva


def _sent(program: CaseProgram, z: Floats) -> Complexes:
    """(lines, slots) MW + j Mvar that leave the first bus of every line, charging included."""
    standard, network = program.standard, program.microgrid.network
    sent: Complexes = z[standard.columns("line.p")].astype(complex)
    if not standard.has("line.q"):
        return sent
    sent += 1j * z[standard.columns("line.q")]
    charged = np.flatnonzero(network.y_from_pu)
    if not len(charged):
        return sent
    v_sq = z[standard.columns("bus.v_sq")][network.from_bus] / network.tap[:, None] ** 2
    if standard.has("line.from_sq"):
        rows = [network.line_names.index(name) for name in standard.labels("line.from_sq")]
        v_sq[rows] = z[standard.columns("line.from_sq")]
    sent[charged] += network.y_from_pu[charged, None].conj() * v_sq[charged]
    return sent


def _states(program: CaseProgram, z: Floats, situation: Situation) -> dict[str, SlotTable]:
    standard, case = program.standard, program.case
    fleets = program.microgrid.fleets.values()
    island = np.where(situation.alive > 0.5, situation.island + 1, 0)
    bus_of = program.microgrid.bus_of
    tables = {"island": SlotTable(case.network.bus_names, island[bus_of].astype(float))}
    order = in_roles(fleets, "dispatchable", "weather", "storage", "exchange", "load")
    for table, names in (
        ("reactive", [fleet.reactive for fleet in order]),
        ("on", [fleet.running for fleet in order if fleet.running is not None]),
        ("fuel", [LEVEL]),
    ):
        there = [name for name in names if standard.has(name)]
        if there:
            labels = tuple(label for name in there for label in standard.labels(name))
            rows = np.concatenate([z[standard.columns(name)] for name in there])
            tables[table] = SlotTable(labels, rows)
    return tables | _trips(program, z)


def _trips(program: CaseProgram, z: Floats) -> dict[str, SlotTable]:
    """Committed units that stop in a slot in which an outage begins in their island."""
    fleets = [f for f in program.microgrid.fleets.values() if program.standard.has(str(f.running))]
    labels: list[str] = []
    stops = [np.empty((0, program.standard.tree.n), bool)]
    for fleet in fleets:
        name = str(fleet.running)
        committed = program.standard.labels(name)
        on = np.column_stack([program.x0[name], z[program.standard.columns(name)]]) > 0.5
        bus = fleet.bus[[fleet.names.index(label) for label in committed]]
        stops.append(on[:, :-1] & ~on[:, 1:] & program.situation.outage_begins[bus])
        labels += committed
    tripped = np.concatenate(stops).astype(float)
    return {"trip": SlotTable(tuple(labels), tripped)} if tripped.any() else {}


def trip_notes(case: Case, tables: dict[str, SlotTable]) -> list[str]:
    """A sentence per unit and slot of a trip."""
    if "trip" not in tables:
        return []
    table = tables["trip"]
    return [
        f"{table.labels[k]} trips at {case.slot_label(int(t))}, as an outage begins in its island"
        for k, t in np.argwhere(table.values > 0.5)
    ]


def copperplate_notes(case: Case, physics: str) -> list[str]:
    """A sentence on the power that flows to earth where the physics has no voltages for it."""
    network = case.network
    closed = network.in_service | network.switchable
    ends = (network.y_from_pu / network.tap**2 + network.y_to_pu)[closed]
    mw = float(network.y_bus_pu.real.sum() + ends.real.sum())
    if physics != "copperplate" or mw <= 0.0:
        return []
    return [
        f"copperplate leaves out {mw:.4g} MW that flow to earth at 1 pu: shunts, iron losses, "
        "impedances of loads"
    ]


def limit_notes(microgrid: Microgrid) -> list[str]:
    """A sentence where the bound rests on limits of flows that are not proven."""
    if microgrid.flow_limits_proven:
        return []
    return [
        "what lines of loops can carry is limited by numbers that are audited and not proven here; "
        "the bound rests on them"
    ]


def balance(case: Case, tables: Mapping[str, SlotTable]) -> dict[str, float]:
    """The energy balance in MWh: what was fed in, what was intake, and what the wires lost."""
    power, fleets = tables["power"], device_fleets(case)

    def flow(kind: str, sign: float) -> float:
        names = fleets[kind].names if kind in fleets else ()
        rows = [power.labels.index(name) for name in names]
        return float(np.maximum(sign * power.values[rows], 0.0).sum()) * case.step_h

    def total(name: str) -> float:
        return float(tables[name].values.sum()) * case.step_h if name in tables else 0.0

    every = fleet_classes()
    sources = in_roles(every, "weather", "dispatchable", "exchange", "storage")
    sinks = in_roles(every, "weather", "dispatchable", "storage", "exchange")
    fed = {f.fed.key: flow(f.kind, 1.0) for f in sources if f.fed}
    intake = {f.intake.key: flow(f.kind, -1.0) for f in sinks if f.intake}
    curtailed = {
        f.curtailed.key: total(available_table(f)) - fed[f.fed.key]
        for f in every
        if f.curtailed and f.fed
    }
    demand, shed = total("demand"), total("shed")
    surplus = {"surplus": total("surplus")} if "surplus" in tables else {}
    served = demand - shed + sum(surplus.values())
    losses = sum(fed.values()) - sum(intake.values(), start=served)
    return {
        "demand": demand, "shed": shed, **surplus, **fed, **intake, "losses": losses, **curtailed
    }  # fmt: skip
