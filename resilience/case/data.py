"""`Case`: what a case file says, read, checked and immutable."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from resilience.arrays import Floats
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission
from resilience.case.schema import (
    DEVICES,
    BlackoutTable,
    DeviceTable,
    ESSTable,
    FallibleTable,
    GeneratorTable,
    GeographyTable,
    GridTable,
    LineTable,
    LoadTable,
    OutageTable,
    PlanTable,
    PVTable,
    StormTable,
    TankTable,
    UnitTable,
)
from resilience.case.window import Window
from resilience.errors import UsageError, did_you_mean
from resilience.shown import Shown

CASES_FROM: dict[str, Callable[..., Case]] = {}
"""What makes cases from `tables` and from a `net`; whoever reads cases gives it."""
AnyDevice = TypeVar("AnyDevice", bound=DeviceTable)


@dataclass(frozen=True)
class Outage:
    """One line, or unit, that is down; a slot that an outage touches at all counts as down.

    Attributes:
        line: name of the line, or of the unit.
        first: first slot in which it is down.
        stop: first slot after it in which it is back.
    """

    line: str
    first: int
    stop: int


@dataclass(frozen=True, eq=False, repr=False)
class Case(Shown):
    """A microgrid, its horizon, and the outages to plan for.

    Powers are in MW, energies in MWh, prices per MWh; `case.ess` is short for
    `case.devices["ess"]`.

    Attributes:
        name: what results are called after.
        description: what it is, for people.
        path: of its file; None where it came from none.
        network: buses and lines.
        start: when the first slot begins, local time.
        slots: length of the horizon.
        step_min: length of a slot, min.
        profiles: (slots,) per unit of the devices' peaks by name, tariffs per MWh under each grid's
            `tariff_profile`, and deliveries in m³ per h under each tank's `delivery_profile`.
        devices: tables of every kind of device by its key, in the order of the file.
        line: what the file says of single lines of the network.
        tank: fuel that generators share.
        outages: to plan for.
        terminal_value_per_mwh: credit for energy stored at the end.
        loss_cost_per_mwh: of what is lost in wires, besides what feeding it in costs.
        reserve_price_per_mwh: of being short of the storm reserve; None: from other prices.
        source: the merged case file as plain data.
        rebuild: reads the file again with changes; whoever reads cases gives itself.
        outage: the process that outages are drawn from, unless there is a storm.
        geography: how `places` are points on the earth.
        storm: weather on a track, what it breaks, and how that is mended.
        blackout: lines that are lost together, for a time that nobody knows.
        plan: what may be built before the storm.
        places: (x, y) of buses by name, in the network's source.
        omissions: what of the network's source is not modelled.
    """

    name: str
    description: str
    path: Path | None
    network: Network
    start: datetime
    slots: int
    step_min: float
    profiles: Mapping[str, Floats]
    devices: Mapping[str, tuple[DeviceTable, ...]]
    line: tuple[LineTable, ...]
    tank: tuple[TankTable, ...]
    outages: tuple[Outage, ...]
    terminal_value_per_mwh: float
    loss_cost_per_mwh: float
    reserve_price_per_mwh: float | None
    source: dict[str, Any]
    rebuild: Callable[[Case, dict[str, Any]], Case] = field(repr=False)
    outage: OutageTable = field(default_factory=OutageTable)
    geography: GeographyTable | None = None
    storm: StormTable | None = None
    blackout: BlackoutTable | None = None
    plan: PlanTable | None = None
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    omissions: tuple[Omission, ...] = ()

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any]) -> Case:
        """A case from plain tables, those of a case file.

        `Case.from_dict({"network": {"pandapower": "case33bw"}, "time": {"start": "2016-07-12",
        "slots": 24, "step_min": 60.0}, "grid": [{"bus": "1", "import_max_mw": 5.0, ...}], ...})`.
        `extends` names a case that these tables are laid over. Arrays, series, tuples and tables
        of other cases may stand in them, the start as text, outages as `parse_outages` takes them,
        and files are named from the working folder. What is None is left out.

        Raises:
            CaseError: every mistake in them.
            UsageError: there is no case of that name to extend.
        """
        return CASES_FROM["tables"](tables)

    @classmethod
    def from_pandapower(cls, net: object, **tables: Any) -> Case:
        """A case for a network of pandapower in memory, with what it knows of devices and costs.

        `Case.from_pandapower(net, ess=[{"name": "ess1", "bus": "7", "p_max_mw": 1.0, ...}])`. The
        network becomes inline tables, so the case needs no file; what of it has no place in a case
        is in `omissions`, and every plan tells it. Without `time` the horizon is a day in quarters
        of an hour; without prices imports, generators and shedding cost what `case new` writes.

        Args:
            net: a `pandapowerNet`.
            tables: as for `from_dict`, laid over those of the network, devices by name.

        Raises:
            CaseError: every mistake in the result.
            UsageError: no such network, or one with devices that a case cannot have.
        """
        return CASES_FROM["net"](net, tables)

    @property
    def load(self) -> tuple[LoadTable, ...]:
        """Tables `[[load]]`."""
        return cast(tuple[LoadTable, ...], self.devices["load"])

    @property
    def pv(self) -> tuple[PVTable, ...]:
        """Tables `[[pv]]`."""
        return cast(tuple[PVTable, ...], self.devices["pv"])

    @property
    def ess(self) -> tuple[ESSTable, ...]:
        """Tables `[[ess]]`."""
        return cast(tuple[ESSTable, ...], self.devices["ess"])

    @property
    def generator(self) -> tuple[GeneratorTable, ...]:
        """Tables `[[generator]]`."""
        return cast(tuple[GeneratorTable, ...], self.devices["generator"])

    @property
    def grid(self) -> tuple[GridTable, ...]:
        """Tables `[[grid]]`."""
        return cast(tuple[GridTable, ...], self.devices["grid"])

    def tables_of(self, table: type[AnyDevice]) -> tuple[AnyDevice, ...]:
        """All devices whose tables are of a type, whatever kind they are of.

        `tables_of(LoadTable)` has the `[[load]]`, and every kind whose table extends theirs.
        """
        every = (device for tables in self.devices.values() for device in tables)
        return tuple(device for device in every if isinstance(device, table))

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all devices, and tanks with deliveries, that may be out as lines may be."""
        return tuple(unit.name for unit in self.fallible)

    @property
    def fallible(self) -> tuple[FallibleTable, ...]:
        """Tables of `units`."""
        return (*self.tables_of(UnitTable), *(tank for tank in self.tank if tank.delivery))

    @property
    def fallible_units(self) -> tuple[str, ...]:
        """Names of the units that say how they fail, or that an outage hits."""
        lines, hit = set(self.network.line_names), {outage.line for outage in self.outages}
        return tuple(
            unit.name
            for unit in self.fallible
            if (unit.can_fail or unit.name in hit) and unit.name not in lines
        )

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of whatever has a status, up or down: lines of the network, then such units."""
        return (*self.network.line_names, *self.fallible_units)

    def element(self, name: str) -> int:
        """Position of a line or unit in `elements`.

        Raises:
            UsageError: there is no such line, or unit that can be out.
        """
        if name in self.fallible_units:
            return len(self.network.line_names) + self.fallible_units.index(name)
        return self.network.line(name)

    @property
    def file_name(self) -> str:
        """Name of its file, as messages have it; its own name where it came from none."""
        return self.path.name if self.path else self.name

    @property
    def step_h(self) -> float:
        """Length of a slot, h."""
        return self.step_min / 60.0

    @property
    def is_dated(self) -> bool:
        """Whether what comes has a date: a storm on its track, or a blackout, comes once.

        Its horizon is then the case's, and not some days of its profiles.
        """
        return self.blackout is not None or (self.storm is not None and bool(self.storm.points))

    @property
    def window(self) -> Window:
        """The horizon as times."""
        return Window(self.start, self.slots, self.step_min)

    def profile(self, name: str | None) -> Floats:
        """A profile over the horizon, (slots,); ones for None.

        Raises:
            UsageError: the case has no profile of that name.
        """
        if name is None:
            return np.ones(self.slots)
        if name not in self.profiles:
            names = ", ".join(self.profiles) or "none"
            raise UsageError(f"profile {name!r} is not in the case", f"known are {names}")
        return self.profiles[name]

    def slot_label(self, t: int) -> str:
        """When slot `t` starts: `14:30`, or `d2 14:30` beyond one day."""
        return self.window.label(t)

    def replace(self, **changes: Any) -> Case:
        """A copy with another horizon, other outages or other values.

        Sixteen days are `case.replace(start=datetime(2016, 8, 1), slots=16 * 96)`. Files are in
        memory after the first time, so this takes milliseconds.
        A new `start`, `slots` or `step_min` reads the profiles again and keeps outages at their
        times of day and date, as far as they fall into the new horizon. `outages` may be texts, as
        in a case file, tuples (line, start, stop), or `Outage`. `network` takes the tables of
        `[network]`, or a network of pandapower, whose devices are then of no account.

        Raises:
            CaseError: the result is no valid case; all mistakes are listed.
            UsageError: a key that cannot be replaced.
        """
        return self.rebuild(self, changes)

    def with_line(self, name: str, **changes: Any) -> Case:
        """A copy with other values for one line: `case.with_line("5-6", hardening=1.5)`.

        Takes the keys of `[[line]]`.

        Raises:
            UsageError: the network has no such line.
            CaseError: the result is no valid case; all mistakes are listed.
        """
        self.network.line(name)
        lines = {line.name: line for line in self.line}
        changed = lines.get(name, LineTable(name=name)).model_copy(update=changes)
        return self.rebuild(self, {"line": [*(lines | {name: changed}).values()]})

    def with_tank(self, name: str, **changes: Any) -> Case:
        """A copy with other values for one tank: `case.with_tank("t1", initial_m3=5.0)`.

        Takes the keys of `[[tank]]`.

        Raises:
            UsageError: no such tank or key.
            CaseError: the result is no valid case; all mistakes are listed.
        """
        names = [tank.name for tank in self.tank]
        if name not in names:
            raise UsageError(f"the case has no [[tank]] {name!r}", did_you_mean(name, names))
        tanks = [t.model_copy(update=changes) if t.name == name else t for t in self.tank]
        return self.rebuild(self, {"tank": tanks})

    def with_ess(self, name: str, **changes: Any) -> Case:
        """A copy with other values for one storage: `case.with_ess("ess1", e_mwh=3.0)`.

        Takes the keys of `[[ess]]`; raises as `with_device`.
        """
        return self.with_device("ess", name, **changes)

    def with_load(self, name: str, **changes: Any) -> Case:
        """A copy with other values for one load, keys of `[[load]]`; raises as `with_device`."""
        return self.with_device("load", name, **changes)

    def with_generator(self, name: str, **changes: Any) -> Case:
        """A copy with other values of a `[[generator]]`; raises as `with_device`."""
        return self.with_device("generator", name, **changes)

    def with_pv(self, name: str, **changes: Any) -> Case:
        """A copy with other values for one plant, keys of `[[pv]]`; raises as `with_device`."""
        return self.with_device("pv", name, **changes)

    def with_grid(self, name: str = "grid", **changes: Any) -> Case:
        """A copy with other values for one `[[grid]]`; raises as `with_device`."""
        return self.with_device("grid", name, **changes)

    def with_device(self, kind: str, name: str, /, **changes: Any) -> Case:
        """A copy with other values for one device; the result is checked as a case file is.

        What the file does not state and another key gives, as `p_min_mw` of a storage, follows.

        Args:
            kind: key of its tables, as `ess`.
            name: of the device.
            changes: values by key of the table.

        Raises:
            UsageError: no such kind, device or key.
            CaseError: the result is no valid case; all mistakes are listed.
        """
        if kind not in self.devices:
            raise UsageError(f"no kind of device is called {kind!r}", did_you_mean(kind, DEVICES))
        names = [device.name for device in self.devices[kind]]
        if name not in names:
            raise UsageError(f"the case has no [[{kind}]] {name!r}", did_you_mean(name, names))
        tables = [
            device.model_copy(update=changes) if device.name == name else device
            for device in self.devices[kind]
        ]
        return self.rebuild(self, {kind: tables})

    def equals(self, other: Case) -> bool:
        """Whether both cases mean the same, whatever files they came from."""
        horizon = ("start", "slots", "step_min")
        tables = ("outages", "outage", "geography", "line", "tank", "blackout", "plan")
        plain = ("name", "description", *horizon, *tables)
        return (
            all(getattr(self, key) == getattr(other, key) for key in plain)
            and all(self.devices.get(kind) == other.devices.get(kind) for kind in DEVICES)
            and self.terminal_value_per_mwh == other.terminal_value_per_mwh
            and self.loss_cost_per_mwh == other.loss_cost_per_mwh
            and self.reserve_price_per_mwh == other.reserve_price_per_mwh
            and self.network.equals(other.network)
            and repr(self.storm)
            == repr(other.storm)  # it may hold nan, and no two of them are equal
            and self.places == other.places
            and self.profiles.keys() == other.profiles.keys()
            and all(np.array_equal(v, other.profiles[k]) for k, v in self.profiles.items())
        )
