"""The tables of a case file. Their JSON Schema is the reference of the format.

Every number carries its unit in its name: `_mw`, `_mwh`, `_mva`, `_pu`, `_h`. Prices are in the
currency of the case, per MWh. Rules that join two keys or two tables live in `checks.py`.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from resilience.case.schema.fields import (
    Efficiency,
    Loose,
    Name,
    NonNegative,
    Positive,
    Share,
    Table,
)
from resilience.case.schema.storm import GeographyTable, StormTable


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
    lat_deg: float | None = Field(None, ge=-90, le=90, description="latitude, degrees north")
    lon_deg: float | None = Field(None, ge=-180, le=180, description="longitude, degrees east")


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
    underground: bool = Field(False, description="true: a cable, which no storm on a track breaks")
    pole: Name | None = Field(
        None, description="fragility curve of what it hangs from, in place of the storm's"
    )
    hardening: Positive | None = Field(
        None,
        description="multiplies the median strength of its poles and conductors, in place of the "
        "storm's",
    )
    span_m: Positive | None = Field(
        None, description="longest distance between its poles, m, in place of the geography's"
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
    critical: bool = Field(
        False,
        description="true: reports tell its service apart; where no load is marked, those of a "
        "priority above 1 count",
    )
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

    @property
    def marginal_cost_per_mwh(self) -> float:
        """Cost of one more MWh: that of the steepest piece where there is a curve."""
        if self.cost_curve is None:
            return self.cost_per_mwh
        points = zip(self.cost_curve, self.cost_curve[1:], strict=False)
        return max((y2 - y1) / (x2 - x1) for (x1, y1), (x2, y2) in points)


class GridTable(DeviceTable):
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
        None, description="profile column that multiplies all prices, the tariff too"
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


class OutageTable(Table):
    """`[outage]`: how storms break the lines marked `breakpoint`, where outages are drawn."""

    probability: float = Field(
        0.8, ge=0, lt=1, description="of an outage of a line on a day, the bell not cut by midnight"
    )
    height: float | None = Field(
        None, ge=0, lt=1, description="of the bell, as a probability per slot; replaces probability"
    )
    sigma_slots: Positive = Field(4.0, description="width of the bell, in slots of 15 minutes")
    duration_slots: Annotated[
        tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]], Field(strict=False)
    ] = Field(
        (12, 15), description="[shortest, longest] outage, in slots of 15 minutes, both included"
    )
    shift_slots: int = Field(
        3, ge=0, description="breakpoints after the first peak up to so many slots sooner or later"
    )
    shared_shift: bool = Field(False, description="true: all of them are shifted alike")
    common_draw: bool = Field(
        False, description="true: one random number per slot for all lines, not one each"
    )
    refail: bool = Field(False, description="true: a line may fail again on the same day")
    wrap: bool = Field(
        False, description="true: what midnight cuts off the bell appears at the day's other end"
    )
    overnight: bool = Field(
        False, description="true: an outage runs on past midnight; false: it ends with its day"
    )
    centres: Annotated[tuple[Annotated[int, Field(ge=0, lt=96)], ...], Field(strict=False)] = Field(
        (),
        description="slots of 15 minutes at which the hazard may peak, all equally likely; "
        "empty: the whole day",
    )
    centre_error_slots: int = Field(
        0, ge=0, description="the centre is forecast with an error of up to so many slots"
    )
    rate: bool = Field(
        False, description="true: the bell is a rate per hour, so that the step does not matter"
    )


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
    reserve_price_per_mwh: float | None = Field(
        None,
        description="price of being short of the storm reserve of `mpc`, per MWh, between the "
        "dearest generator and the cheapest shedding; default: their mean",
    )
    outages: tuple[str, ...] = Field((), strict=False, description='"6-26@14:00-17:30", ...')


class CaseTable(HeadTable):
    """A whole case file."""

    network: NetworkTable
    line: tuple[LineTable, ...] = Field((), strict=False)
    time: TimeTable
    profiles: ProfilesTable = Field(default_factory=ProfilesTable)
    outage: OutageTable = Field(default_factory=OutageTable)
    geography: GeographyTable | None = None
    storm: StormTable | None = None
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
