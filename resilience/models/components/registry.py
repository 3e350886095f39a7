"""From kinds of devices to their components: all fleets of a case, found through the registry."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from resilience.arrays import Ints
from resilience.case.schema import DEVICES, DeviceTable, GridTable, LoadTable
from resilience.errors import UsageError
from resilience.models.components.fleet import DeviceFleet, Role

if TYPE_CHECKING:
    from resilience.case import Case

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
    fleets = {}
    for kind, tables in case.devices.items():
        if tables:
            bus = np.array([case.network.bus(table.bus) for table in tables], np.intp)
            fleets[kind] = fleet_class(kind)(tables, bus if bus_of is None else bus_of[bus])
    return fleets


def in_roles(fleets: Iterable[AnyFleet], *roles: Role) -> list[AnyFleet]:
    """Those fleets that have one of the roles, in the order of the roles."""
    fleets = list(fleets)
    return [fleet for role in roles for fleet in fleets if fleet.role == role]
