"""The one list of the kinds of devices: whoever needs all of them loops over it.

A kind is a key of case files, the table behind that key, and the component that holds its physics.
The component stands there by name, because cases know nothing of models; `models.components` finds
it. A kind of your own is one file with table and component, and one call before the case is read:

    register_device(DeviceKind("wind", WindTable, "my_package.wind:Wind"))
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from types import GenericAlias
from typing import Any

from pydantic import Field, create_model

from resilience.case.schema.devices import (
    DeviceTable,
    ESSTable,
    GeneratorTable,
    GridTable,
    LoadTable,
    PVTable,
)
from resilience.case.schema.fields import Table
from resilience.case.schema.storm import GeographyTable, StormTable
from resilience.case.schema.tables import (
    HeadTable,
    LineTable,
    NetworkTable,
    OutageTable,
    ProfilesTable,
    TimeTable,
)
from resilience.errors import UsageError


@dataclass(frozen=True)
class DeviceKind:
    """A kind of device.

    Attributes:
        kind: key of its tables in a case file: `ess` for `[[ess]]`; its variables begin with it.
        table: what one table may say.
        component: `module:Class` of its physics, a `DeviceFleet`.
    """

    kind: str
    table: type[DeviceTable]
    component: str


_COMPONENTS = "resilience.models.components"
DEVICES: dict[str, DeviceKind] = {
    device.kind: device
    for device in (
        DeviceKind("load", LoadTable, f"{_COMPONENTS}.load:Loads"),
        DeviceKind("pv", PVTable, f"{_COMPONENTS}.pv:PV"),
        DeviceKind("ess", ESSTable, f"{_COMPONENTS}.ess:ESS"),
        DeviceKind("generator", GeneratorTable, f"{_COMPONENTS}.generator:Generators"),
        DeviceKind("grid", GridTable, f"{_COMPONENTS}.grid:Grids"),
    )
}
"""Every kind by its key, in the order in which cases list them."""


def register_device(device: DeviceKind) -> None:
    """Makes a kind of device known to case files, models, plans and pictures.

    Raises:
        UsageError: the key is no plain word or already means something in a case file, or the
            component is not named as `module:Class`.
    """
    if not device.kind.isidentifier():
        raise UsageError(
            f"a kind of device cannot be called {device.kind!r}",
            hint="take a lower-case word: it is a key of case files and begins names of variables",
        )
    if device.kind in case_table().model_fields:
        raise UsageError(
            f"[[{device.kind}]] already means something in a case file",
            hint="choose another kind, or unregister the one there is",
        )
    if device.component.count(":") != 1:
        raise UsageError(
            f"the component of {device.kind!r} is {device.component!r}; allowed: module:Class",
            hint='"my_package.wind:Wind", say',
        )
    DEVICES[device.kind] = device


def unregister_device(kind: str) -> None:
    """Takes a kind back.

    Raises:
        UsageError: there is no such kind.
    """
    if kind not in DEVICES:
        raise UsageError(f"no kind of device is called {kind!r}", "known are " + ", ".join(DEVICES))
    del DEVICES[kind]


class _NetworkAndTime(HeadTable):
    """The tables of a case file but for its devices."""

    network: NetworkTable
    line: tuple[LineTable, ...] = Field((), strict=False)
    time: TimeTable
    profiles: ProfilesTable = Field(default_factory=ProfilesTable)
    outage: OutageTable = Field(default_factory=OutageTable)
    geography: GeographyTable | None = None
    storm: StormTable | None = None


def defaults_table() -> type[Table]:
    """Table of `[defaults.<kind>]`, for the kinds that there are now."""
    return _case_models(tuple(DEVICES.values()))[0]


def case_table() -> type[HeadTable]:
    """Table of a whole case file, for the kinds that there are now."""
    return _case_models(tuple(DEVICES.values()))[1]


@lru_cache(maxsize=8)
def _case_models(devices: tuple[DeviceKind, ...]) -> tuple[type[Table], type[HeadTable]]:
    sections: dict[str, Any] = {
        d.kind: (
            dict[str, Any],
            Field(default_factory=dict, description=f"for every [[{d.kind}]]"),
        )
        for d in devices
    }
    defaults = create_model(
        "DefaultsTable",
        __base__=Table,
        __doc__="`[defaults.<kind>]`: values for the keys that a device of the kind does not give "
        "itself.",
        **sections,
    )
    lists: dict[str, Any] = {
        d.kind: (GenericAlias(tuple, (d.table, ...)), Field((), strict=False)) for d in devices
    }
    case = create_model(
        "CaseTable",
        __base__=_NetworkAndTime,
        __doc__="A whole case file.",
        defaults=(defaults, Field(default_factory=defaults)),
        **lists,
    )
    return defaults, case


def case_schema() -> dict[str, Any]:
    """JSON Schema of a case file, the reference of the format."""
    return case_table().model_json_schema(by_alias=True)
