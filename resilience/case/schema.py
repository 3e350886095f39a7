"""The tables of a case file. Their JSON Schema is the reference of the format.

Every number carries its unit in its name: `_mw`, `_mwh`, `_mva`, `_pu`, `_h`. Prices are in the
currency of the case, per MWh. Rules that join two keys or two tables live in `checks.py`.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Name = Annotated[str, BeforeValidator(_text), Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Loose = Annotated[float, Field(allow_inf_nan=True)]
Efficiency = Annotated[float, Field(gt=0, le=1)]


class Table(BaseModel):
    """Base of all tables: immutable, strict about types, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class BusTable(Table):
    """`[[network.bus]]`: one bus of an inline network."""

    name: Name = Field(description="name of the bus")
    vn_kv: float = Field(gt=0, le=1000, description="nominal voltage, kV")
    v_min_pu: Positive | None = Field(
        None, description="lower voltage limit, pu; else the network's"
    )
    v_max_pu: Positive | None = Field(
        None, description="upper voltage limit, pu; else the network's"
    )


class BranchTable(Table):
    """`[[network.line]]`: one line of an inline network."""

    model_config = ConfigDict(populate_by_name=True, validate_by_alias=True)

    from_: Name = Field(alias="from", description="name of the bus at one end")
    to: Name = Field(description="name of the bus at the other end")
    r_ohm: float = Field(ge=0, description="series resistance, ohm")
    x_ohm: float = Field(ge=0, description="series reactance, ohm")
    rating_mva: Positive | None = Field(None, description="thermal limit, MVA; absent: none")
    in_service: bool = Field(True, description="false: open, as a tie line in normal operation")
    name: Name | None = Field(None, description='name of the line; default "from-to"')


class NetworkTable(Table):
    """`[network]`: exactly one of `pandapower`, `file`, or inline `bus` and `line` tables."""

    pandapower: str | None = Field(None, description="a function of pandapower.networks: case33bw")
    file: str | None = Field(
        None, description="pandapower .json or MATPOWER .m, from the case's folder"
    )
    bus: tuple[BusTable, ...] = Field((), strict=False, description="inline buses")
    line: tuple[BranchTable, ...] = Field((), strict=False, description="inline lines")
    impedance_scale: Positive = Field(1.0, description="multiplies every r and x")
    v_min_pu: Positive = Field(0.9, description="lower voltage limit of all buses, pu")
    v_max_pu: Positive = Field(1.1, description="upper voltage limit of all buses, pu")


class LineTable(Table):
    """`[[line]]`: says more about a line of the network, wherever the network comes from."""

    name: Name = Field(description="name of a line of the network")
    breakpoint: bool = Field(False, description="true: storms can break the feeder here")
    switchable: bool = Field(False, description="true: the plan may open or close it")
    switching_cost: NonNegative = Field(0.0, description="$ each time the plan opens or closes it")
    rating_mva: Positive | None = Field(
        None, description="thermal limit, MVA, in place of the network's"
    )


class TimeTable(Table):
    """`[time]`: the horizon."""

    start: datetime = Field(description="local date and time of the first slot's start")
    slots: int = Field(gt=0, description="number of time slots")
    step_min: Positive = Field(description="length of a slot, minutes")


class ProfilesTable(Table):
    """`[profiles]`: time series in per unit of each device's peak."""

    file: str | None = Field(None, description="CSV, CSV.GZ or Parquet; first column `time`")
    columns: dict[str, Annotated[tuple[Loose, ...], Field(strict=False)]] = Field(
        default_factory=dict, description="name = [one number per slot]"
    )


class DeviceTable(Table):
    """What every device has."""

    name: Name = Field(description="unique name of the device")
    bus: Name = Field(description="name of its bus")


class LoadTable(DeviceTable):
    """`[[load]]`: a demand that can be shed at a price."""

    p_max_mw: NonNegative = Field(description="peak demand, MW")
    profile: str | None = Field(None, description="profile column; absent: constant at the peak")
    power_factor: Efficiency = Field(1.0, description="cos phi, lagging, constant")
    shed_cost_per_mwh: NonNegative = Field(description="price of unserved energy, per MWh")
    priority: Positive = Field(1.0, description="multiplies the shed price")
    block: bool = Field(False, description="true: served whole or not at all")


class PVTable(DeviceTable):
    """`[[pv]]`: a photovoltaic plant."""

    p_max_mw: NonNegative = Field(description="output at a profile value of 1, MW")
    profile: str | None = Field(None, description="profile column; absent: constant at the peak")
    curtailable: bool = Field(True, description="false: all of its output must be taken")
    s_mva: Positive | None = Field(
        None, description="inverter rating, MVA; absent: unity power factor"
    )
    cost_per_mwh: float = Field(0.0, description="price of its energy, per MWh")


class ESSTable(DeviceTable):
    """`[[ess]]`: a storage system. Powers are at the grid side, charging positive."""

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
    efficiency_charge: Efficiency = Field(1.0, description="energy stored per energy taken")
    efficiency_discharge: Efficiency = Field(1.0, description="energy delivered per energy drawn")
    degradation_cost_per_mwh: NonNegative = Field(0.0, description="per MWh discharged")
    s_mva: Positive | None = Field(
        None, description="inverter rating, MVA; absent: unity power factor"
    )
    grid_forming: bool = Field(True, description="true: can carry an island alone")


class GeneratorTable(DeviceTable):
    """`[[generator]]`: a dispatchable unit with commitment."""

    p_min_mw: NonNegative = Field(0.0, description="least output while on, MW")
    p_max_mw: NonNegative = Field(description="greatest output, MW")
    cost_per_mwh: float = Field(0.0, description="marginal cost, per MWh")
    cost_curve: (
        Annotated[
            tuple[Annotated[tuple[float, float], Field(strict=False)], ...], Field(strict=False)
        ]
        | None
    ) = Field(None, description="[[p_mw, cost_per_h], ...], p rising; replaces cost_per_mwh")
    no_load_cost_per_h: NonNegative = Field(0.0, description="cost of being on, per h")
    start_cost: NonNegative = Field(0.0, description="cost of one start")
    ramp_up_mw_per_h: Positive | None = Field(None, description="MW per h; absent: no limit")
    ramp_down_mw_per_h: Positive | None = Field(None, description="MW per h; absent: no limit")
    min_up_h: NonNegative = Field(0.0, description="least time on, h")
    min_down_h: NonNegative = Field(0.0, description="least time off, h")
    initial_on: bool = Field(False, description="status before the first slot")
    initial_hours: NonNegative = Field(24.0, description="time in that status so far, h")
    p_initial_mw: NonNegative = Field(0.0, description="output before the first slot, MW")
    q_min_mvar: float = Field(0.0, description="least reactive output, Mvar")
    q_max_mvar: float = Field(0.0, description="greatest reactive output, Mvar")
    grid_forming: bool = Field(True, description="true: can carry an island alone")


class GridTable(DeviceTable):
    """`[[grid]]`: a connection to the grid outside."""

    name: Name = Field("grid", description="unique name of the connection")
    import_max_mw: NonNegative = Field(description="greatest import, MW")
    export_max_mw: NonNegative = Field(0.0, description="greatest export, MW")
    import_cost_per_mwh: float = Field(description="price paid per MWh imported")
    export_cost_per_mwh: float = Field(
        0.0, description="price paid per MWh exported; negative: earned"
    )
    price_profile: str | None = Field(
        None, description="profile column that multiplies both prices"
    )
    q_max_mvar: NonNegative = Field(
        default_factory=lambda data: data.get("import_max_mw", 0.0),
        description="limit of reactive power in either direction, Mvar; default import_max_mw",
    )
    v_pu: Positive = Field(1.0, description="voltage it holds at its bus, pu")
    grid_forming: bool = Field(True, description="true: carries whatever is connected to it")


class DefaultsTable(Table):
    """`[defaults.<kind>]`: values for the keys that a device of the kind does not give itself."""

    load: dict[str, Any] = Field(default_factory=dict, description="for every [[load]]")
    pv: dict[str, Any] = Field(default_factory=dict, description="for every [[pv]]")
    ess: dict[str, Any] = Field(default_factory=dict, description="for every [[ess]]")
    generator: dict[str, Any] = Field(default_factory=dict, description="for every [[generator]]")
    grid: dict[str, Any] = Field(default_factory=dict, description="for every [[grid]]")


class HeadTable(Table):
    """The keys of a case file that stand before its first table."""

    name: str | None = Field(None, description="name of the case; default: that of its file")
    description: str = Field("", description="what it is, for people")
    extends: str | None = Field(None, description="name or path of a case that this one varies")
    terminal_value_per_mwh: float = Field(0.0, description="credit for energy stored at the end")
    outages: tuple[str, ...] = Field((), strict=False, description='"6-26@14:00-17:30", ...')


class CaseTable(HeadTable):
    """A whole case file."""

    network: NetworkTable
    line: tuple[LineTable, ...] = Field((), strict=False)
    time: TimeTable
    profiles: ProfilesTable = Field(default_factory=ProfilesTable)
    defaults: DefaultsTable = Field(default_factory=DefaultsTable)
    load: tuple[LoadTable, ...] = Field((), strict=False)
    pv: tuple[PVTable, ...] = Field((), strict=False)
    ess: tuple[ESSTable, ...] = Field((), strict=False)
    generator: tuple[GeneratorTable, ...] = Field((), strict=False)
    grid: tuple[GridTable, ...] = Field((), strict=False)


DEVICES: dict[str, type[DeviceTable]] = {
    "load": LoadTable,
    "pv": PVTable,
    "ess": ESSTable,
    "generator": GeneratorTable,
    "grid": GridTable,
}


def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file."""
    return CaseTable.model_json_schema(by_alias=True)
