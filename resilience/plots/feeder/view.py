"""What happens on the feeder in every slot of a plan, as arrays: what maps of it are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.case.schema import GridTable
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.planning.plan import Plan
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.tables import SlotTable
from resilience.plots import panels
from resilience.plots.feeder.layout import Layout, layout

OPEN, CLOSED, OUT = 0, 1, 2
"""States of a line."""


@dataclass(frozen=True)
class MapDevice:
    """A unit that is drawn beside its bus.

    Attributes:
        name: of the unit.
        kind: title of its fleet.
        colour: of the fleet.
        bus: position of its bus.
        is_storage: whether it has a state of charge.
    """

    name: str
    kind: str
    colour: str
    bus: int
    is_storage: bool


@dataclass(frozen=True, eq=False)
class FeederMap:
    """A feeder through the slots of a plan; buses and lines are those of the case's network.

    Attributes:
        case: the case.
        places: where the buses are drawn.
        devices: sources and storage, in the order of `power_mw`.
        line_state: (lines, slots) `OPEN`, `CLOSED` or `OUT`.
        flow_mw: (lines, slots) from the first end to the second; NaN where the physics has no flow
            of this line.
        down_chance: (lines, slots) probability that a line is out, where outages are not known;
            None where they are.
        voltage_pu: (buses, slots); NaN where dead, None where the physics has no voltages.
        colour: (buses, slots) index in `panels.BAND`.
        demand_mw: (buses, slots) of all loads of the bus.
        shed_mw: (buses, slots) of it that is not served.
        power_mw: (devices, slots) fed in; a storage that charges is negative.
        soc: (devices, slots) share of the capacity at the end of the slot; NaN of all but storage.
    """

    case: Case
    places: Layout
    devices: tuple[MapDevice, ...]
    line_state: Ints
    flow_mw: Floats
    down_chance: Floats | None
    voltage_pu: Floats | None
    colour: Ints
    demand_mw: Floats
    shed_mw: Floats
    power_mw: Floats
    soc: Floats

    @property
    def slots(self) -> int:
        """Number of slots."""
        return self.power_mw.shape[1]


def feeder_map(plan: Plan | ScenarioPlan, case: Case) -> FeederMap:
    """The map of a plan; of one over scenarios, of its common schedule.

    Args:
        plan: the plan.
        case: the case that it was made for.
    """
    tables, slots = plan.tables, plan.tables["power"].values.shape[1]
    fleets = list(device_fleets(case).values())
    units = [
        (fleet, k)
        for fleet in in_roles(fleets, "exchange", "dispatchable", "weather", "storage")
        for k in range(len(fleet.names))
    ]
    devices = tuple(
        MapDevice(
            fleet.names[k], fleet.title, fleet.colour, int(fleet.bus[k]), fleet.role == "storage"
        )
        for fleet, k in units
    )
    names = [device.name for device in devices]
    voltage = tables.get("voltage")
    return FeederMap(
        case=case,
        places=layout(case),
        devices=devices,
        line_state=_line_state(case, tables, slots, is_known=isinstance(plan, Plan)),
        flow_mw=_rows(case.network.line_names, tables.get("line_power"), slots),
        down_chance=_chance(case, plan, slots),
        voltage_pu=None if voltage is None else _rows(case.network.bus_names, voltage, slots),
        colour=_island_colours(case, tables, slots),
        demand_mw=_at_buses(case, fleets, tables.get("demand"), slots),
        shed_mw=_at_buses(case, fleets, tables.get("shed"), slots),
        power_mw=_rows(names, tables["power"], slots),
        soc=_rows(names, tables.get("soc"), slots),
    )


def _rows(names: list[str] | tuple[str, ...], table: SlotTable | None, slots: int) -> Floats:
    """(names, slots) rows of a table; NaN where it has none."""
    values = np.full((len(names), slots), np.nan)
    if table is not None:
        row_of = {label: k for k, label in enumerate(table.labels)}
        for k, name in enumerate(names):
            if name in row_of:
                values[k] = table.values[row_of[name]]
    return values


def _line_state(case: Case, tables: Mapping[str, SlotTable], slots: int, *, is_known: bool) -> Ints:
    """(lines, slots) states; `is_known`: the outages of the case are those of the plan."""
    network = case.network
    closed = _rows(network.line_names, tables.get("line_closed"), slots)
    usual = np.where(network.in_service, CLOSED, OPEN)[:, None]
    state = np.where(np.isnan(closed), usual, np.where(closed > 0.5, CLOSED, OPEN))
    if is_known:
        state[lines_down(case, slots)] = OUT
    return state


def lines_down(case: Case, slots: int) -> Bools:
    """(lines, slots) where outages of the case hit its lines."""
    down = np.zeros((len(case.network.line_names), slots), bool)
    for outage in case.outages:
        if case.network.has_line(outage.line):
            down[case.network.line(outage.line), outage.first : outage.stop] = True
    return down


def _chance(case: Case, plan: Plan | ScenarioPlan, slots: int) -> Floats | None:
    if isinstance(plan, Plan) or plan.outages is None:
        return None
    outages = plan.outages
    chance = np.zeros((len(case.network.line_names), slots))
    for name, down in zip(outages.lines, outages.down, strict=True):
        if case.network.has_line(name):
            chance[case.network.line(name)] = (down @ outages.probability)[:slots]
    return chance


def _island_colours(case: Case, tables: Mapping[str, SlotTable], slots: int) -> Ints:
    network, table = case.network, tables.get("island")
    if table is None:
        return np.full((len(network.bus_names), slots), panels.GRID)
    on_grid = np.zeros(len(network.bus_names), bool)
    on_grid[[network.bus(grid.bus) for grid in case.tables_of(GridTable)]] = True
    return panels.band_colours(_rows(network.bus_names, table, slots).astype(int), on_grid)


def _at_buses(case: Case, fleets: list[DeviceFleet], table: SlotTable | None, slots: int) -> Floats:
    """(buses, slots) the sum over the loads of every bus."""
    total = np.zeros((len(case.network.bus_names), slots))
    if table is not None:
        for fleet in in_roles(fleets, "load"):
            np.add.at(total, fleet.bus, _rows(fleet.names, table, slots))
    return total
