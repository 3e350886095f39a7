"""What a fleet of devices is: a component, and the facts of it that everybody else reads.

Capacities, islands, plan tables, energy balances, pictures, reports, AC checks and rules are made
from these facts, so that nobody but the fleet itself knows which kinds of devices there are. The
fleets of a case are found through `DEVICES`, the registry of kinds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.profiles import MAX_PU
from resilience.case.schema import DEVICES, DeviceTable, GridTable, LoadTable
from resilience.errors import UsageError
from resilience.models.algebra import Labels, scatter
from resilience.models.components.base import Injection
from resilience.models.language.stage import Stage
from resilience.models.network.limits import Capacity
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case import Case

Role = Literal["dispatchable", "weather", "storage", "exchange", "load"]
"""What a fleet is to the rest of the microgrid.

- dispatchable: feeds in when it is called on, within `power_range`;
- weather: feeds in up to what the weather offers, its `expected` power;
- storage: moves energy in time, its state is `stored`;
- exchange: trades with a grid outside; its tables extend `GridTable`;
- load: takes its `expected` power, the datum `<kind>.demand`, or sheds it, the variable
  `<kind>.shed`, at least the datum `<kind>.shed_min`; its tables extend `LoadTable`.
"""


@dataclass(frozen=True)
class EnergyTerm:
    """One term of the energy balance.

    Attributes:
        key: its key in `Plan.energy_mwh`.
        words: what reports call it.
    """

    key: str
    words: str


@dataclass(frozen=True)
class DeviceFleet(ABC):
    """All devices of one kind in a microgrid.

    A new kind gives the class variables without a default, `emit`, `data` and `power_range`, and
    overrides the facts whose defaults do not fit. Arrays are (devices,), in the order of `tables`.

    Attributes:
        kind: key of its tables in case files; names of its variables, data and rows begin with it.
        role: see `Role`.
        title: what pictures call the fleet.
        colour: of its power in pictures, `#rrggbb`.
        flows: what its power in MW is made of: names of variables and data, each with the sign
            with which it feeds in.
        fed, intake: terms of the energy balance for what it feeds in and takes; loads have neither,
            their demand and what is shed are terms of their own.
        curtailed: term for what the weather offered and nobody took.
        limit: name of the datum with the most that it can feed in, MW: what the weather offers, or
            what the devices are able to; loads have none.
        forced: name of the datum with the least that it feeds in while its island is alive, MW;
            None where that is nothing.
        stored: name of its state of stored energy, MWh; None of all but storage.
        forms: name of its variable that is 1 where a device forms its island, of those devices (its
            labels) that do not whatever is decided.
        running: name of its variable that is 1 where a device runs; None without commitment.
        tables: one table per device.
        bus: index of every device's bus.
        fallible: names of those that may be out of order.
    """

    kind: ClassVar[str]
    role: ClassVar[Role]
    title: ClassVar[str]
    colour: ClassVar[str]
    flows: ClassVar[Mapping[str, float]]
    limit: ClassVar[str] = ""
    fed: ClassVar[EnergyTerm | None] = None
    intake: ClassVar[EnergyTerm | None] = None
    curtailed: ClassVar[EnergyTerm | None] = None
    forced: ClassVar[str | None] = None
    stored: ClassVar[str | None] = None
    forms: ClassVar[str | None] = None
    running: ClassVar[str | None] = None

    tables: Sequence[DeviceTable]
    bus: Ints
    fallible: frozenset[str] = frozenset()

    @classmethod
    @abstractmethod
    def showcase(cls) -> DeviceTable:
        """A table with every option that makes the fleet emit more, for the table of symbols."""

    @abstractmethod
    def emit(self, stage: Stage) -> Injection:
        """Declares variables, rows, structures and costs; returns what it feeds in."""

    @abstractmethod
    def data(self, situation: Situation) -> dict[str, Floats]:
        """Every datum it declared, arrays (devices, nodes)."""

    def start(self) -> dict[str, Floats]:
        """Its states at the start, arrays (devices,); none by default."""
        return {}

    @property
    def names(self) -> Labels:
        """Names of the devices."""
        return tuple(table.name for table in self.tables)

    @property
    def demand(self) -> str:
        """Name of a load's datum of what it asks for, MW."""
        return f"{self.kind}.demand"

    @property
    def shed(self) -> str:
        """Name of a load's variable of what is not served, MW."""
        return f"{self.kind}.shed"

    @property
    def shed_min(self) -> str:
        """Name of a load's datum of what cannot be served whatever is done, MW."""
        return f"{self.kind}.shed_min"

    @property
    def surplus(self) -> str:
        """Name of a load's variable of what it takes beside its demand, of the `cold` ones, MW."""
        return f"{self.kind}.surplus"

    @property
    def cold(self) -> Ints:
        """Loads that return with a surplus after an interruption, see `cold_load`."""
        return np.flatnonzero([getattr(t, "cold_load_share", 0.0) > 0.0 for t in self.tables])

    def surplus_max_mw(self) -> Floats:
        """(devices,) the greatest surplus of a load that returns, MW."""
        share = np.array([getattr(t, "cold_load_share", 0.0) for t in self.tables], float)
        return share * MAX_PU * -self.power_range()[0]

    @property
    def reactive(self) -> str:
        """Name of its variable of reactive power, Mvar, if it has one."""
        return f"{self.kind}.q"

    @abstractmethod
    def power_range(self) -> tuple[Floats, Floats]:
        """Least and greatest power that every device can feed in, MW; taking is negative."""

    def capacity(self) -> tuple[Floats, Floats]:
        """What every device can feed in and take, MVA, reactive power included.

        Beside what `expected` and `reactive_per_mw` say, which others add; so nothing by default
        for devices that are expected to follow a profile. It bounds what lines can be asked to
        carry: too much is harmless, too little is wrong.
        """
        p_min, p_max = self.power_range()
        if self.expected():
            surplus_mva = self.surplus_max_mw() * np.hypot(1.0, self.reactive_per_mw())
            return np.zeros(len(self.tables)), surplus_mva
        return np.maximum(p_max, 0.0), np.maximum(-p_min, 0.0)

    def apparent_mva(self) -> Floats:
        """(devices,) greatest apparent power, MVA, either way, likewise beside `expected`."""
        supply, demand = self.capacity()
        return supply + demand

    def size_mw(self) -> Floats:
        """Nominal power, MW, as lists of devices show it."""
        p_min, p_max = self.power_range()
        return np.maximum(p_max, -p_min)

    def size_mwh(self) -> Floats:
        """Energy that every device can hold, MWh."""
        return np.zeros(len(self.tables))

    def forming(self) -> Bools:
        """Whether a device can carry an island alone: those whose table says `grid_forming`."""
        return np.array([getattr(t, "grid_forming", False) for t in self.tables], bool)

    def must_take(self) -> Bools:
        """Whether a device feeds in the datum `forced` at least, which nobody can turn down."""
        return np.zeros(len(self.tables), bool)

    def with_spill(self, stage: Stage, fed: Injection) -> Injection:
        """What it feeds in less what must be taken and is not used: it came, and has its price."""
        units = np.flatnonzero(self.must_take())
        if self.forced is None or not len(units):
            return fed
        names = [self.names[k] for k in units]
        most_mw = stage[self.forced][units]
        spilled = stage.var(f"{self.kind}.spilled", names, 0.0, most_mw, about="power spilled")
        return replace(fed, p=fed.p - scatter(spilled, units, len(self.names), self.names))

    def forms_surely(self) -> Bools:
        """Whether a device forms its island whatever is decided, if it is in order; never more than
        `forming`.
        """
        return self.forming()

    def may_fail(self) -> Bools:
        """Whether a device may be out of order."""
        return np.array([name in self.fallible for name in self.names], bool)

    def available(self, situation: Situation) -> Floats:
        """(devices, nodes) 1 where a device is in order and its island alive, else 0."""
        alive = situation.alive_at(self.bus)
        return alive * situation.works(self.names) if self.fallible else alive

    def emit_forming(self, stage: Stage) -> None:  # noqa: B027 most fleets have nothing to declare
        """Declares the variable `forms` where `emit` does not anyway; the fleet is emitted."""

    def has_energy(self, energy: Floats) -> Bools:
        """(devices, nodes) or (devices, 1) whether a device has energy to form an island.

        Args:
            energy: (devices, nodes) MWh stored, of storage; of no account for all others.
        """
        return np.ones((len(self.tables), 1), bool)

    def voltage_pu(self) -> Floats:
        """Voltage that a device holds at its bus, pu; NaN where it holds none."""
        return np.full(len(self.tables), np.nan)

    def reactive_per_mw(self) -> Floats:
        """Mvar that go with every MW of devices with a constant power factor; else 0."""
        return np.zeros(len(self.tables))

    def reactive_alone(self) -> Floats:
        """Mvar fed in at a profile's 1 by devices without active power; else 0."""
        return np.zeros(len(self.tables))

    def is_block(self) -> Bools:
        """Whether a load can only be served whole."""
        return np.zeros(len(self.tables), bool)

    def expected(self) -> tuple[tuple[str | None, float], ...]:
        """Of every device whose power follows a profile: the profile, and MW fed in at its 1.

        Demand is negative. Forecasts err in these profiles; what nobody can foretell otherwise,
        such as the power of a dispatchable unit, is not here.
        """
        return ()

    def profiles(self) -> tuple[str | None, ...]:
        """Every profile that its data follow, prices included."""
        return tuple(profile for profile, _ in self.expected())

    def merge_key(self, table: Any) -> Hashable | None:
        """What devices at one bus share that no program at copperplate can tell apart.

        Such devices become one, of their total `p_max_mw` and the mean of their profiles. None: the
        device stays alone.
        """
        return None

    def power(self, values: Callable[[str], Floats]) -> Floats:
        """MW fed in, (devices, ...), from the values of the variables and data in `flows`.

        What cold loads take beside their demand is in it.
        """
        total: Floats | None = None
        for name, sign in self.flows.items():
            power = sign * values(name)
            total = power if total is None else total + power
        if total is not None and len(self.cold):
            total[self.cold] -= values(self.surplus)
        return np.empty(0) if total is None else total


AnyFleet = TypeVar("AnyFleet", DeviceFleet, type[DeviceFleet])
_FACTS: dict[Role, tuple[str, ...]] = {
    "dispatchable": ("limit", "fed"),
    "weather": ("limit", "fed", "curtailed"),
    "storage": ("limit", "fed", "intake", "stored"),
    "exchange": ("limit", "fed", "intake"),
    "load": (),
}
"""Class variables that a role needs and that have no default which fits."""
_TABLES: dict[Role, type[DeviceTable]] = {"load": LoadTable, "exchange": GridTable}
"""Roles whose tables have to extend another, since others read its prices and priorities."""


def fleet_class(kind: str) -> type[DeviceFleet]:
    """The component of a kind of device.

    Raises:
        UsageError: there is none, or one that does not fit the kind's table.
    """
    device = DEVICES[kind]
    module, _, name = device.component.partition(":")
    fleet = getattr(import_module(module), name, None)
    if not (isinstance(fleet, type) and issubclass(fleet, DeviceFleet) and fleet.kind == kind):
        raise UsageError(
            f"the component of [[{kind}]] is {device.component}; allowed: a DeviceFleet of the "
            f"kind {kind!r}",
            hint="see docs/concepts/model.md on adding a device",
        )
    base = _TABLES.get(fleet.role, DeviceTable)
    if not issubclass(device.table, base):
        raise UsageError(
            f"{device.table.__name__} of [[{kind}]] is no {base.__name__}, though its component "
            f"has the role {fleet.role!r}",
            hint=f"let the table extend {base.__name__}",
        )
    lacks = [name for name in _FACTS[fleet.role] if not getattr(fleet, name)]
    if lacks:
        raise UsageError(
            f"{fleet.__name__} has the role {fleet.role!r}, but no {', '.join(lacks)}",
            hint="see DeviceFleet for what they mean",
        )
    return fleet


def fleet_classes() -> list[type[DeviceFleet]]:
    """The components of all kinds there are, in the order of the registry."""
    return [fleet_class(kind) for kind in DEVICES]


def device_fleets(case: Case, bus_of: Ints | None = None) -> dict[str, DeviceFleet]:
    """The fleets of a case by kind; kinds of which it has no device are left out.

    Args:
        case: network and devices.
        bus_of: (buses of the case,) index of each in a merged network; the case's own if omitted.
    """
    fleets, fallible_units = {}, frozenset(case.fallible_units)
    for kind, tables in case.devices.items():
        if tables:
            bus = np.array([case.network.bus(table.bus) for table in tables], np.intp)
            bus = bus if bus_of is None else bus_of[bus]
            fallible = fallible_units.intersection(table.name for table in tables)
            fleets[kind] = fleet_class(kind)(tables, bus, fallible)
    return fleets


def in_roles(fleets: Iterable[AnyFleet], *roles: Role) -> list[AnyFleet]:
    """Those fleets that have one of the roles, in the order of the roles."""
    fleets = list(fleets)
    return [fleet for role in roles for fleet in fleets if fleet.role == role]


def bus_capacity(
    fleets: Iterable[DeviceFleet], buses: int
) -> tuple[tuple[str | None, ...], Capacity]:
    """What the devices at every bus can do, and the profiles in which that is linear."""
    fleets = list(fleets)
    expected = [fleet.expected() for fleet in fleets]
    names = tuple(dict.fromkeys([None, *(name for follows in expected for name, _ in follows)]))
    supply, demand, apparent = np.zeros((3, buses, len(names)))
    for fleet, follows in zip(fleets, expected, strict=True):
        feeds, takes = fleet.capacity()
        constant = np.full(len(fleet.bus), names.index(None))
        np.add.at(supply, (fleet.bus, constant), feeds)
        np.add.at(demand, (fleet.bus, constant), takes)
        np.add.at(apparent, (fleet.bus, constant), fleet.apparent_mva())
        if follows:
            p = np.array([mw for _, mw in follows])
            q = p * fleet.reactive_per_mw() + fleet.reactive_alone()
            place = fleet.bus, np.array([names.index(name) for name, _ in follows])
            np.add.at(supply, place, np.maximum(np.maximum(p, q), 0.0))
            np.add.at(demand, place, np.maximum(-np.minimum(p, q), 0.0))
            np.add.at(apparent, place, np.hypot(p, q))
    return names, Capacity(supply, demand, apparent)
