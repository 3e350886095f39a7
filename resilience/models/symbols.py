"""The symbol and unit table, read off a stage that holds every component with every option."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Ints
from resilience.case.schema import DeliveryTable, TankTable
from resilience.models.components import (
    Buses,
    ColdLoads,
    Energised,
    Generators,
    Lines,
    Tanks,
    Topology,
    fleet_classes,
)
from resilience.models.language.stage import Stage
from resilience.models.network.limits import FlowLimits

_TANK = TankTable(name="tank", capacity_m3=1.0, delivery=(DeliveryTable(hour=0.0, amount_m3=1.0),))


def showcase() -> Stage:
    """A two-bus stage in which every component emits all that it can."""
    stage = Stage(0.25, reactive=True)
    bus: Ints = np.zeros(1, np.intp)
    lines = Lines(
        names=("1-2",),
        from_bus=bus,
        to_bus=bus + 1,
        r=np.ones(1),
        x=np.ones(1),
        ratio=np.ones(1, complex),
        y_from=np.full(1, 1j),
        y_to=np.full(1, 1j),
        rating=np.ones(1),
        angle_min=np.full(1, -0.5),
        angle_max=np.full(1, 0.5),
        limits=FlowLimits((None,), np.ones(1), *np.ones((3, 1, 1))),
        determined=np.ones(1, bool),
        fallible=np.ones(1, bool),
        switchable=np.ones(1, bool),
        closed=np.ones(1, bool),
        switching_cost=np.ones(1),
        v_min=np.full(2, 0.9),
        v_max=np.full(2, 1.1),
        losses=True,
        may_be_dark=True,
        looped=np.ones(1, bool),
        loop_shift=np.zeros(1),
    )
    band, shunt, sure = (np.full(2, 0.9), np.full(2, 1.1)), np.full(2, 1j), np.zeros(2, bool)
    Buses(("1", "2"), *band, shunt, sure, is_charged=True, looped=np.ones(2, bool)).emit(stage)
    tables = [(kind, kind.showcase()) for kind in fleet_classes()]
    fleets = tuple(kind((table,), bus, frozenset({table.name})) for kind, table in tables)
    for fleet in fleets:
        fleet.emit(stage)
        if len(fleet.cold):
            ColdLoads(fleet).emit(stage)
        if isinstance(fleet, Generators):
            Tanks((_TANK,), fleet).emit(stage)
    lines.emit(stage)
    Topology(lines, ("1", "2"), np.ones(2, bool), np.zeros(2, bool)).emit(stage)
    cells = Energised(("1", "2"), np.arange(2), np.zeros(2, bool), fleets, lines)
    cells.emit(stage)
    cells.connect(stage)
    return stage


def symbol_table() -> list[dict[str, str]]:
    """One row per variable and datum: name, unit, kind (variable, binary, state, data), meaning."""
    stage = showcase()
    states = {after.name for _, after in stage.states}
    rows = []
    for block in [*stage.variables, *stage.datums]:
        if block.kind == "now":
            continue
        kind = "state" if block.name in states and block.kind != "design" else block.kind
        rows.append({"name": block.name, "unit": block.unit, "kind": kind, "meaning": block.about})
    return sorted(rows, key=lambda row: row["name"])
