"""The tables of a case file that are no devices: network, horizon, profiles, outages, head.

Every number carries its unit in its name: `_mw`, `_mwh`, `_mva`, `_pu`, `_h`. Prices are in the
currency of the case, per MWh. Rules that join two keys or two tables live in `checks.py`.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from resilience.case.schema.fields import (
    Loose,
    Money,
    Name,
    NonNegative,
    Positive,
    Price,
    Share,
    Table,
)
from resilience.case.schema.units import (
    Availability,
    FallibleTable,
    HoursToFailure,
    HoursToRepair,
)

MAX_SLOTS = 1_000_000
"""Of a horizon."""
MAX_SIGMA_SLOTS = 960
"""Ten days: beyond, a bell is as wide as the horizon, and a number is a slip."""
MAX_UNITS = 20
"""Alike, at one site."""
Often = Annotated[float, Field(gt=0, le=50)]
Life = Annotated[float, Field(gt=0, le=200)]
Slots = Annotated[int, Field(gt=0, le=366 * 96)]


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
    shunt_p_mw: float = Field(0.0, description="power that its shunts take at 1 pu, MW")
    shunt_q_mvar: float = Field(
        0.0,
        description="reactive power that its shunts take at 1 pu, Mvar; negative for capacitors",
    )
    lat_deg: float | None = Field(None, ge=-90, le=90, description="latitude, degrees north")
    lon_deg: float | None = Field(None, ge=-180, le=180, description="longitude, degrees east")


class BranchTable(Table):
    """`[[network.line]]`: one line or transformer of an inline network.

    A transformer has its ratio at `from` and its impedance in ohm of the voltage at `to`.
    """

    model_config = ConfigDict(populate_by_name=True, validate_by_alias=True)

    from_: Name = Field(alias="from", description="name of the bus at one end")
    to: Name = Field(description="name of the bus at the other end")
    r_ohm: float = Field(ge=0, description="series resistance, ohm")
    x_ohm: float = Field(ge=0, description="series reactance, ohm")
    b_us: float = Field(0.0, description="charging susceptance, microsiemens, half at either end")
    g_us: float = Field(0.0, description="leakage conductance, microsiemens, half at either end")
    tap_ratio: Positive | None = Field(
        None,
        description="makes it a transformer: its ratio at `from` over that of the two vn_kv; 1 at "
        "the nominal tap",
    )
    shift_degree: float = Field(
        0.0, description="phase shift of a transformer, degrees that `from` leads `to`"
    )
    rating_mva: Positive | None = Field(None, description="thermal limit, MVA; absent: none")
    angle_min_degree: float | None = Field(
        None,
        description="least that the voltage at `from` may lead that at `to` by, degrees, "
        "shift_degree included and not above it; absent: no limit",
    )
    angle_max_degree: float | None = Field(
        None, description="the most, likewise and not below shift_degree; absent: no limit"
    )
    in_service: bool = Field(True, description="false: open, as a tie line in normal operation")
    name: Name | None = Field(None, description='name of the line; default "from-to"')


class NetworkTable(Table):
    """`[network]`: exactly one of `pandapower`, `file`, or inline `bus` and `line` tables."""

    pandapower: Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$")] | None = Field(
        None, description="a function of pandapower.networks: case33bw"
    )
    file: str | None = Field(
        None, description="pandapower .json or MATPOWER .m, from the case's folder"
    )
    bus: tuple[BusTable, ...] = Field((), strict=False, description="inline buses")
    line: tuple[BranchTable, ...] = Field((), strict=False, description="inline lines")
    not_modelled: tuple[str, ...] = Field(
        (),
        strict=False,
        description="what of its source the inline tables leave out, in words: every plan tells it",
    )
    impedance_scale: Positive = Field(1.0, description="multiplies every r and x")
    v_min_pu: Positive | None = Field(
        None,
        description="lower voltage limit of all buses, pu; default: that of every bus in the "
        "network file, 0.9 where it states none",
    )
    v_max_pu: Positive | None = Field(
        None, description="upper voltage limit of all buses, pu; default: likewise, 1.1"
    )
    parallel_grids: bool = Field(
        False,
        description="true: several [[grid]] may feed one tree of closed lines; false: each tree "
        "hangs on one bus with a [[grid]] at most",
    )
    radial: bool = Field(
        True,
        description="false: switchable lines may close loops, and lines that cannot be switched "
        "may form some; every live bus still has to reach a source",
    )


class StrengthTable(Table):
    """`[[line.harden]]`: one way of strengthening a line before the storm."""

    factor: Annotated[float, Field(gt=1)] | None = Field(
        None, description="times as strong as the line is now; or say underground"
    )
    underground: bool = Field(False, description="true: it becomes a cable, which no storm breaks")
    cost: Money = Field(description="to build it, $")
    life_years: Life | None = Field(None, description="how long it lasts; else the plan's")


class SiteTable(Table):
    """`[[plan.site]]`: a place where storage, PV or generators may be built, in units alike."""

    name: Name = Field(
        description="of the units to be built, with a number where there are several"
    )
    kind: Name = Field(description="what the units are: ess, pv or generator")
    units: int = Field(1, ge=1, le=MAX_UNITS, description="how many may be built")
    cost: Money = Field(description="to build one of them, $")
    life_years: Life | None = Field(None, description="how long one lasts; else the plan's")
    unit: dict[str, Any] = Field(
        description="one of them: the keys of a table of its kind but for its name"
    )


class CatalogueTable(Table):
    """`[[plan.storm]]`: a storm that what is built is planned for, and how often it comes."""

    file: str | None = Field(
        None,
        description="track file, as for `--track`, laid on the horizon by whole days; absent: the "
        "storm of the case",
    )
    storm: str | None = Field(None, description="name or identifier, of several in the file")
    averaging_s: Positive | None = Field(
        None, description="time over which the file's wind is averaged, s, where it does not say"
    )
    agency: str | None = Field(None, description="whose winds, of several in the file")
    per_year: Often = Field(description="how many like it come in a year")


class PlanTable(Table):
    """`[plan]`: what may be built before the storm."""

    budget: Money | None = Field(None, description="most that may be spent, $")
    storms_per_year: Often | None = Field(
        None,
        description="how many storms like that of the case come in a year: what is built is then "
        "weighed against a year of storms; not beside [[plan.storm]], which say it each",
    )
    interest_rate: Share = Field(0.05, description="of the money that is spent, a year")
    life_years: Life = Field(40.0, description="how long what is built lasts")
    harden: tuple[StrengthTable, ...] = Field(
        (),
        strict=False,
        description="ways of strengthening every line that the storm may break and that does not "
        "say its own",
    )
    site: tuple[SiteTable, ...] = Field(
        (), strict=False, description="places where something may be built"
    )
    storm: tuple[CatalogueTable, ...] = Field(
        (), strict=False, description="storms of many years, in place of that of the case"
    )


class LineTable(Table):
    """`[[line]]`: says more about a line of the network, wherever the network comes from."""

    name: Name = Field(description="name of a line of the network")
    in_service: bool | None = Field(
        None,
        description="true: closed at first, false: open; absent: as the network has it",
    )
    breakpoint: bool = Field(False, description="true: storms can break the feeder here")
    switchable: bool = Field(False, description="true: the plan may open or close it")
    switching_cost: Money = Field(0.0, description="$ each time the plan opens or closes it")
    rating_mva: Positive | None = Field(
        None, description="thermal limit, MVA, in place of the network's"
    )
    underground: bool | None = Field(
        None,
        description="true: a cable, which no storm on a track breaks; absent: as the network file "
        "has it",
    )
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
    harden: tuple[StrengthTable, ...] = Field(
        (), strict=False, description="ways of strengthening it before the storm, one to be chosen"
    )
    tie_cost: Money | None = Field(
        None,
        description="to give this open line a switch before the storm, so that it may be closed, "
        "$; absent: not offered",
    )


class DeliveryTable(Table):
    """`[[tank.delivery]]`: fuel that arrives; usable from the first slot that starts no earlier."""

    time: datetime | None = Field(None, description="local date and time; or give hour")
    hour: NonNegative | None = Field(None, description="hours after the start; or give time")
    amount_m3: Positive = Field(description="fuel, m³; what finds no room is turned away")


class TankTable(FallibleTable):
    """`[[tank]]`: fuel that generators share; those that burn from it name it as their `tank`.

    What is out, where it is out, are its deliveries: what would come meanwhile does not.
    """

    name: Name = Field(description="unique name of the tank")
    capacity_m3: Positive = Field(description="fuel that it can hold, m³: a thousand litres")
    initial_m3: NonNegative | None = Field(
        default_factory=lambda data: data.get("capacity_m3"),
        description="fuel at the start, m³; default: full",
    )
    delivery: tuple[DeliveryTable, ...] = Field((), strict=False, description="fuel that arrives")
    mttf_h: HoursToFailure = None
    mttr_h: HoursToRepair = None
    availability: Availability = 1.0

    @property
    def delivery_profile(self) -> str | None:
        """Name of the profile of the case that holds deliveries, m³ per h; `None` without any."""
        return f"deliveries to {self.name}" if self.delivery else None


class TimeTable(Table):
    """`[time]`: the horizon."""

    start: datetime = Field(description="local date and time of the first slot's start")
    slots: int = Field(gt=0, le=MAX_SLOTS, description="number of time slots")
    step_min: Positive = Field(
        ge=1 / 60, le=7 * 24 * 60, description="length of a slot, minutes: a second to a week"
    )


class ProfilesTable(Table):
    """`[profiles]`: time series in per unit of each device's peak."""

    has_any_size: ClassVar[bool] = True

    file: str | None = Field(None, description="CSV, CSV.GZ or Parquet; first column `time`")
    columns: dict[str, Annotated[tuple[Loose, ...], Field(strict=False)]] = Field(
        default_factory=dict, description="name = [one number per slot]"
    )


class OutageTable(Table):
    """`[outage]`: how storms break the lines marked `breakpoint`, where outages are drawn."""

    probability: float = Field(
        0.8, ge=0, lt=1, description="of an outage of a line on a day, the bell not cut by midnight"
    )
    height: float | None = Field(
        None, ge=0, lt=1, description="of the bell, as a probability per slot; replaces probability"
    )
    sigma_slots: Positive = Field(
        4.0, le=MAX_SIGMA_SLOTS, description="width of the bell, in slots of 15 minutes"
    )
    duration_slots: Annotated[tuple[Slots, Slots], Field(strict=False)] = Field(
        (12, 15), description="[shortest, longest] outage, in slots of 15 minutes, both included"
    )
    duration_law: Literal["uniform", "lognormal"] = Field(
        "uniform",
        description="of the lengths between these: all alike, or lognormal with the two ends two "
        "standard deviations from the median",
    )
    shift_slots: int = Field(
        3,
        ge=0,
        le=96,
        description="breakpoints after the first peak up to so many slots sooner or later",
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
        True, description="true: an outage runs on past midnight; false: it ends with its day"
    )
    centres: Annotated[tuple[Annotated[int, Field(ge=0, lt=96)], ...], Field(strict=False)] = Field(
        (),
        description="slots of 15 minutes at which the hazard may peak, all equally likely; "
        "empty: the whole day",
    )
    centre_error_slots: int = Field(
        0, ge=0, le=96, description="the centre is forecast with an error of up to so many slots"
    )
    rate: bool = Field(
        False, description="true: the bell is a rate per hour, so that the step does not matter"
    )


class HeadTable(Table):
    """The keys of a case file that stand before its first table."""

    name: Name | None = Field(None, description="name of the case; default: that of its file")
    description: str = Field("", description="what it is, for people")
    extends: str | None = Field(None, description="name or path of a case that this one varies")
    terminal_value_per_mwh: Price = Field(0.0, description="credit for energy stored at the end")
    loss_cost_per_mwh: Money = Field(
        0.0,
        description="of what is lost in wires, on top of what feeding it in costs; only with "
        "`distflow`",
    )
    reserve_price_per_mwh: float | None = Field(
        None,
        description="price of being short of the storm reserve of `mpc`, per MWh, between the "
        "dearest generator and the cheapest shedding; default: their mean",
    )
    outages: tuple[str, ...] = Field((), strict=False, description='"6-26@14:00-17:30", ...')
