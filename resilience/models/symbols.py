"""The symbol and unit table, read off a stage that holds every component with every option."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Ints
from resilience.case.schema import ESSTable, GeneratorTable, GridTable, LoadTable, PVTable
from resilience.models import components as parts
from resilience.models.language.stage import Stage


def showcase() -> Stage:
    """A two-bus stage in which every component emits all that it can."""
    stage = Stage(0.25, reactive=True)
    bus: Ints = np.zeros(1, np.intp)
    lines = parts.Lines(
        names=("1-2",),
        from_bus=bus,
        to_bus=bus + 1,
        r=np.ones(1),
        x=np.ones(1),
        rating=np.ones(1),
        flow_max=np.ones(1),
        fallible=np.ones(1, bool),
        switchable=np.ones(1, bool),
        closed=np.ones(1, bool),
        switching_cost=np.ones(1),
        v_band=(0.9, 1.1),
        losses=True,
    )
    load = LoadTable(name="load", bus="1", p_max_mw=1.0, shed_cost_per_mwh=1.0, block=True)
    plant = PVTable(name="pv", bus="1", p_max_mw=1.0, s_mva=1.1)
    storage = ESSTable(name="ess", bus="1", p_max_mw=1.0, e_mwh=1.0, s_mva=1.1)
    unit = GeneratorTable(
        name="generator",
        bus="1",
        p_max_mw=1.0,
        p_min_mw=0.3,
        start_cost=1.0,
        min_up_h=1.0,
        min_down_h=1.0,
        ramp_up_mw_per_h=1.0,
    )
    grid = GridTable(name="grid", bus="1", import_max_mw=1.0, import_cost_per_mwh=1.0)
    parts.Buses(("1", "2"), np.full(2, 0.9), np.full(2, 1.1)).emit(stage)
    parts.Loads((load,), bus).emit(stage)
    parts.PV((plant,), bus).emit(stage)
    parts.ESS((storage,), bus).emit(stage)
    parts.Generators((unit,), bus).emit(stage)
    parts.Grids((grid,), bus).emit(stage)
    lines.emit(stage)
    parts.Topology(lines, ("1", "2"), np.ones(2, bool)).emit(stage)
    return stage


def symbol_table() -> list[dict[str, str]]:
    """One row per variable and datum: name, unit, kind (variable, binary, state, data), meaning."""
    stage = showcase()
    states = {after.name for _, after in stage.states}
    rows = []
    for block in [*stage.variables, *stage.datums]:
        if block.kind == "now":
            continue
        kind = "state" if block.name in states else block.kind
        rows.append({"name": block.name, "unit": block.unit, "kind": kind, "meaning": block.about})
    return sorted(rows, key=lambda row: row["name"])
