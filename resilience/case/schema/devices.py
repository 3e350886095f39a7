"""The tables of devices, and the one list of their kinds: whoever needs all loops over it.

What components need beyond the keys of a file is a property of the table, so that a table of
another kind may have it, too: prices above all, which everybody who weighs one device against
another asks every table for.

A kind is a key of case files, the table behind that key, and the component that holds its physics.
The component stands in `DEVICES` by name, because cases know nothing of models. A kind of your own
is one file with table and component, and one call before the case is read:

    register_device(DeviceKind("wind", WindTable, "my_package.wind:Wind"))
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from types import GenericAlias
from typing import Annotated, Any, ClassVar

from pydantic import Field, create_model

from resilience.case.schema.fields import (
    Efficiency,
    Money,
    Name,
    NonNegative,
    Positive,
    Share,
    Table,
)
from resilience.case.schema.loads import LoadTable
from resilience.case.schema.storm import BlackoutTable, GeographyTable, StormTable
from resilience.case.schema.tables import (
    HeadTable,
    LineTable,
    NetworkTable,
    OutageTable,
    PlanTable,
    ProfilesTable,
    TankTable,
    TimeTable,
)
from resilience.case.schema.units import (
    MAX_MEAN_H,
    Availability,
    DeviceTable,
    HoursToFailure,
    HoursToRepair,
    UnitTable,
)
from resilience.errors import UsageError

MAX_HOURS = 10_000.0
"""Over a year, of anything that a machine does on end."""


class PVTable(UnitTable):
    """`[[pv]]`: a photovoltaic plant."""

    buildable: ClassVar[Mapping[str, object]] = {"curtailable": True, "can_fail": False}

    p_max_mw: NonNegative = Field(description="output at a profile value of 1, MW")
    profile: str | None = Field(None, description="profile column; absent: constant at the peak")
    curtailable: bool = Field(True, description="false: all of its output must be taken")
    s_mva: Positive | None = Field(
        None, description="inverter rating, MVA; absent: unity power factor"
    )
    q_mvar: float = Field(
        0.0,
        description="reactive power at p_max_mw, Mvar, in proportion to its power; negative: "
        "taken. Not beside s_mva",
    )
    cost_per_mwh: float = Field(0.0, description="price of its energy, per MWh")
    mttf_h: HoursToFailure = None
    mttr_h: HoursToRepair = None
    availability: Availability = 1.0


class ESSTable(UnitTable):
    """`[[ess]]`: a storage system. Powers are at the grid side, charging positive."""

    buildable: ClassVar[Mapping[str, object]] = {"soc_final_min": None, "can_fail": False}

    p_max_mw: NonNegative = Field(description="charging limit, MW")
    p_min_mw: float = Field(
        default_factory=lambda data: -data.get("p_max_mw", 0.0),
        le=0,
        description="discharging limit as a negative power, MW; default -p_max_mw",
    )
    e_mwh: Positive = Field(description="energy capacity, MWh")
    soc_min: Share = Field(0.0, description="lowest state of charge, share of e_mwh")
    soc_max: Share = Field(1.0, description="highest state of charge, share of e_mwh")
    soc_initial: Share = Field(0.5, description="state of charge at the start, share of e_mwh")
    soc_final_min: Share | None = Field(
        None,
        description="lowest state of charge at the end of the horizon, share of e_mwh; absent: "
        "none but soc_min",
    )
    efficiency_charge: Efficiency = Field(1.0, description="energy stored per energy taken")
    efficiency_discharge: Efficiency = Field(1.0, description="energy delivered per energy drawn")
    degradation_cost_per_mwh: NonNegative = Field(0.0, description="per MWh discharged")
    s_mva: Positive | None = Field(
        None, description="inverter rating, MVA; absent: unity power factor"
    )
    grid_forming: bool = Field(True, description="true: can carry an island alone")
    mttf_h: HoursToFailure = None
    mttr_h: HoursToRepair = None
    availability: Availability = 1.0


_COMMITMENT = ("p_min_mw", "no_load_cost_per_h", "start_cost", "min_up_h", "min_down_h")
"""Keys of a generator that need an on/off decision where they are not 0."""


class GeneratorTable(UnitTable):
    """`[[generator]]`: a dispatchable unit with commitment."""

    stands_by: ClassVar[bool] = True
    buildable: ClassVar[Mapping[str, object]] = {
        "needs_commitment": False, "ramp_up_mw_per_h": None, "ramp_down_mw_per_h": None,
        "cost_curve": None, "tank": None, "can_fail": False,
    }  # fmt: skip

    p_min_mw: NonNegative = Field(0.0, description="least output while on, MW")
    p_max_mw: NonNegative = Field(description="greatest output, MW")
    cost_per_mwh: float = Field(0.0, description="marginal cost, per MWh")
    cost_curve: (
        Annotated[
            tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)
        ]
        | None
    ) = Field(None, description="[[p_mw, cost_per_h], ...], p rising; replaces cost_per_mwh")
    no_load_cost_per_h: Money = Field(0.0, description="cost of being on, per h")
    start_cost: Money = Field(0.0, description="cost of one start")
    ramp_up_mw_per_h: Positive | None = Field(None, description="MW per h; absent: no limit")
    ramp_down_mw_per_h: Positive | None = Field(None, description="MW per h; absent: no limit")
    min_up_h: NonNegative = Field(0.0, le=MAX_HOURS, description="least time on, h")
    min_down_h: NonNegative = Field(0.0, le=MAX_HOURS, description="least time off, h")
    initial_on: bool = Field(False, description="status before the first slot")
    initial_hours: NonNegative = Field(
        24.0, le=MAX_HOURS, description="time in that status so far, h"
    )
    p_initial_mw: NonNegative = Field(0.0, description="output before the first slot, MW")
    tank: Name | None = Field(
        None, description="name of the [[tank]] that it burns from; absent: fuel never ends"
    )
    fuel_m3_per_mwh: Positive | None = Field(
        None, description="fuel per MWh, m³: litres per kWh are the same number"
    )
    fuel_no_load_m3_per_h: NonNegative = Field(
        0.0, description="fuel of being on, m³ per h, beside fuel_m3_per_mwh"
    )
    fuel_curve: (
        Annotated[
            tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)
        ]
        | None
    ) = Field(
        None,
        description="[[p_mw, m3_per_h], ...], p and fuel rising, convex; replaces fuel_m3_per_mwh",
    )
    q_min_mvar: float = Field(0.0, description="least reactive output, Mvar")
    q_max_mvar: float = Field(0.0, description="greatest reactive output, Mvar")
    grid_forming: bool = Field(True, description="true: can carry an island alone")
    start_failure: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="probability that it fails to start when its bus loses the main grid",
    )
    mttf_h: Positive | None = Field(
        None,
        le=MAX_MEAN_H,
        description="mean time to failure, h, exponential, while its bus is without the main grid; "
        "absent: it does not fail",
    )
    mttr_h: HoursToRepair = None
    availability: Availability = 1.0

    @property
    def marginal_cost_per_mwh(self) -> float:
        """Cost of one more MWh: that of the steepest piece where there is a curve."""
        if self.cost_curve is None:
            return self.cost_per_mwh
        points = zip(self.cost_curve, self.cost_curve[1:], strict=False)
        return max((y2 - y1) / (x2 - x1) for (x1, y1), (x2, y2) in points)

    @property
    def fuel_pieces(self) -> tuple[tuple[float, float], ...]:
        """(m³ per MWh, m³ per h at no output) of every piece of its fuel curve, extended to 0.

        What it burns while it is on is the largest of them, since the curve is convex.
        """
        if self.fuel_curve is None:
            return ((self.fuel_m3_per_mwh or 0.0, self.fuel_no_load_m3_per_h),)
        pieces = []
        for (x1, y1), (x2, y2) in pairwise(self.fuel_curve):
            slope = (y2 - y1) / (x2 - x1)
            pieces.append((slope, y1 - slope * x1))
        return tuple(pieces)

    @property
    def needs_commitment(self) -> bool:
        """Whether it matters if it is on at no output, so that this is decided."""
        burns = self.tank is not None and self.fuel_pieces[0][1] > 0.0
        return burns or any(getattr(self, key) for key in _COMMITMENT)


class GridTable(UnitTable):
    """`[[grid]]`: a connection to the grid outside."""

    name: Name = Field("grid", description="unique name of the connection")
    import_max_mw: NonNegative = Field(description="greatest import, MW")
    export_max_mw: NonNegative = Field(0.0, description="greatest export, MW")
    tariff: (
        Annotated[
            tuple[Annotated[tuple[str, float], Field(strict=False)], ...], Field(strict=False)
        ]
        | None
    ) = Field(
        None,
        description='[["00:00", 0.1], ["06:00", 0.3], ...]: time of day from which a price per '
        "MWh imported holds, every day alike; replaces import_cost_per_mwh",
    )
    import_cost_per_mwh: float | None = Field(
        None, description="price paid per MWh imported; needed where there is no tariff"
    )
    export_cost_per_mwh: float = Field(
        0.0, description="price paid per MWh exported; negative: earned"
    )
    export_tariff_factor: float | None = Field(
        None,
        description="price per MWh exported as a multiple of the tariff: 1 is paid as imports "
        "are, -1 earns it; replaces export_cost_per_mwh",
    )
    price_profile: str | None = Field(
        None,
        description="profile column that multiplies all prices, the tariff too; may be negative",
    )
    q_max_mvar: NonNegative = Field(
        default_factory=lambda data: data.get("import_max_mw", 0.0),
        description="limit of reactive power in either direction, Mvar; default import_max_mw",
    )
    v_pu: Positive = Field(1.0, description="voltage it holds at its bus, pu")
    grid_forming: bool = Field(True, description="true: carries whatever is connected to it")

    @property
    def tariff_profile(self) -> str | None:
        """Name of the profile of the case that holds the tariff, per MWh; `None` without one."""
        return None if self.tariff is None else f"tariff of {self.name}"

    @property
    def import_price(self) -> tuple[float, str | None]:
        """Price per MWh imported, as a factor and the profile that it multiplies."""
        if self.tariff is not None:
            return 1.0, self.tariff_profile
        return self.import_cost_per_mwh or 0.0, self.price_profile

    @property
    def export_price(self) -> tuple[float, str | None]:
        """Price per MWh exported, as a factor and the profile that it multiplies."""
        if self.export_tariff_factor is not None:
            return self.export_tariff_factor, self.tariff_profile
        return self.export_cost_per_mwh, self.price_profile


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
    tank: tuple[TankTable, ...] = Field((), strict=False)
    time: TimeTable
    profiles: ProfilesTable = Field(default_factory=ProfilesTable)
    outage: OutageTable = Field(default_factory=OutageTable)
    geography: GeographyTable | None = None
    storm: StormTable | None = None
    blackout: BlackoutTable | None = None
    plan: PlanTable | None = None


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
