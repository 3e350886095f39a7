"""Tables of a plan: every quantity over the slots, and the energy balance they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.schema import DeviceTable
from resilience.models.case_program import CaseProgram, as_switched
from resilience.models.network.situation import Situation
from resilience.simulation.replay import per_slot, variables

UNITS = {
    "power": "MW fed in; storage: discharging positive; load: negative",
    "reactive": "Mvar fed in",
    "energy": "MWh stored at the end of the slot",
    "soc": "share of the capacity stored at the end of the slot",
    "demand": "MW",
    "shed": "MW",
    "pv_available": "MW",
    "voltage": "pu",
    "line_power": "MW at the sending end",
    "line_reactive": "Mvar at the sending end",
    "line_closed": "1 where the line can carry power",
    "island": "number of the island a bus belongs to; 0 is dead",
    "on": "1 where a generator runs",
    "variables": "every variable of the model, as `ess.charge[ess1]`, in its own unit",
}
"""Every table that a plan may have, and what it holds."""


@dataclass(frozen=True)
class SlotTable:
    """Values (columns, slots) of one quantity, a label per column."""

    labels: tuple[str, ...]
    values: Floats

    def __getitem__(self, label: str) -> Floats:
        """(slots,) the values of one label."""
        return self.values[self.labels.index(label)]


def tabulate(program: CaseProgram, z: Floats) -> dict[str, SlotTable]:
    """Every quantity as a table (columns, slots); names and units in `results.UNITS`."""
    standard, case, data = program.standard, program.case, program.data

    def values(name: str) -> Floats:
        return z[standard.columns(name)]

    power: dict[str, Floats] = {}
    for name, tables in (("generator.p", case.generator), ("pv.p", case.pv)):
        if tables:
            power |= dict(zip(standard.labels(name), values(name), strict=True))
    found: dict[str, SlotTable] = {}
    if case.ess:
        flow = values("ess.discharge") - values("ess.charge")
        names = standard.labels("ess.charge")
        power |= dict(zip(names, flow, strict=True))
        size = np.array([t.e_mwh for t in case.ess])[:, None]
        found["energy"] = SlotTable(names, values("ess.energy"))
        found["soc"] = SlotTable(names, values("ess.energy") / size)
    if case.grid:
        flow = values("grid.import") - values("grid.export")
        power |= dict(zip(standard.labels("grid.import"), flow, strict=True))
    if case.load:
        names = standard.labels("load.shed")
        power |= dict(zip(names, values("load.shed") - data["load.demand"], strict=True))
        found["demand"] = SlotTable(names, data["load.demand"])
        found["shed"] = SlotTable(names, values("load.shed"))
    if case.pv:
        found["pv_available"] = SlotTable(standard.labels("pv.p"), data["pv.available"])
    found["power"] = SlotTable(tuple(power), np.array(list(power.values())))
    found |= _wires(program, z)
    found |= _states(program, z, as_switched(program, z))
    return found | {"variables": SlotTable(variables(standard), per_slot(standard, z))}


def _wires(program: CaseProgram, z: Floats) -> dict[str, SlotTable]:
    standard, found = program.standard, {}
    if standard.has("bus.v_sq"):
        squares = np.maximum(z[standard.columns("bus.v_sq")], 0.0)
        found["voltage"] = SlotTable(standard.labels("bus.v_sq"), np.sqrt(squares))
    for table, name in (("line_power", "line.p"), ("line_reactive", "line.q")):
        if standard.has(name):
            found[table] = SlotTable(standard.labels(name), z[standard.columns(name)])
    if standard.has("line.p"):
        closed = as_switched(program, z).line_up
        found["line_closed"] = SlotTable(standard.labels("line.p"), closed.astype(float))
    return found


def _states(program: CaseProgram, z: Floats, situation: Situation) -> dict[str, SlotTable]:
    standard, case = program.standard, program.case
    island = np.where(situation.alive > 0.5, situation.island + 1, 0)
    bus_of = program.microgrid.bus_of
    found = {"island": SlotTable(case.network.bus_names, island[bus_of].astype(float))}
    reactive = [
        (name.split(".")[0], name)
        for name in ("generator.q", "pv.q", "ess.q", "grid.q")
        if standard.has(name)
    ]
    if reactive:
        labels = tuple(label for _, name in reactive for label in standard.labels(name))
        rows = np.concatenate([z[standard.columns(name)] for _, name in reactive])
        found["reactive"] = SlotTable(labels, rows)
    if standard.has("generator.on"):
        found["on"] = SlotTable(
            standard.labels("generator.on"), z[standard.columns("generator.on")]
        )
    return found


def balance(case: Case, tables: dict[str, SlotTable]) -> dict[str, float]:
    """The energy balance in MWh: what was fed in, what was taken, and what the wires lost."""
    power = tables["power"]

    def flow(devices: Sequence[DeviceTable], sign: float) -> float:
        rows = [power.labels.index(device.name) for device in devices]
        return float(np.maximum(sign * power.values[rows], 0.0).sum()) * case.step_h

    def total(name: str) -> float:
        return float(tables[name].values.sum()) * case.step_h if name in tables else 0.0

    found = {
        "demand": total("demand"),
        "shed": total("shed"),
        "pv": flow(case.pv, 1.0),
        "generators": flow(case.generator, 1.0),
        "import": flow(case.grid, 1.0),
        "discharge": flow(case.ess, 1.0),
        "charge": flow(case.ess, -1.0),
        "export": flow(case.grid, -1.0),
    }
    fed = sum(found[key] for key in ("pv", "generators", "import", "discharge"))
    taken = found["demand"] - found["shed"] + found["charge"] + found["export"]
    return found | {"losses": fed - taken, "pv_curtailed": total("pv_available") - found["pv"]}
