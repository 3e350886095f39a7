"""The tables of a case file for where it stands and what comes: `[geography]`, `[storm]`,
`[blackout]`.

Times of a storm are local, `utc_offset_h` hours ahead of UTC. Names of wind fields and curves are
those of `resilience.fragility`, which reads them.
"""

from __future__ import annotations

from datetime import date, datetime, timedelta
from typing import Annotated, Literal

from pydantic import Field

from resilience.case.schema.fields import Loose, Name, NonNegative, Positive, Share, Table

LAW_PARAMETERS: dict[str, tuple[str, ...]] = {
    "fixed": ("hours",),
    "uniform": ("shortest", "longest"),
    "lognormal": ("median", "sigma"),
    "exponential": ("mean",),
}
"""What the hours of a law are, law by law; sigma is of the logarithm."""
Law = Literal["fixed", "uniform", "lognormal", "exponential"]
Hours = Annotated[tuple[NonNegative, ...], Field(strict=False)]
Point = Annotated[tuple[datetime, float, float, Loose, Loose], Field(strict=False)]


class GeographyTable(Table):
    """`[geography]`: where the buses are, if not `lat_deg` and `lon_deg` of [[network.bus]] say."""

    degrees: bool = Field(
        False, description="true: the network file's coordinates are degrees of longitude, latitude"
    )
    synthetic: bool = Field(
        False,
        description="true: lengths from reactances, directions from the network file's drawing, "
        "placed at the anchor",
    )
    anchor_bus: Name | None = Field(
        None, description="bus that stands at the anchor; that of the first [[grid]] if omitted"
    )
    anchor_lat_deg: float | None = Field(None, ge=-90, le=90, description="degrees north")
    anchor_lon_deg: float | None = Field(None, ge=-180, le=180, description="degrees east")
    turn_deg: float = Field(0.0, ge=-360, le=360, description="turns the drawing clockwise")
    ohm_per_km: Positive = Field(
        0.35, description="reactance of 1 km of line, before the network's impedance_scale"
    )
    span_m: Positive = Field(50.0, description="longest distance between two poles, m")


class RepairTable(Table):
    """`[storm.repair]`: how long it takes to mend a line, and when crews may work."""

    law: Law = Field("lognormal", description="of the hours of work on one line")
    hours: Hours = Field(
        (6.0, 0.5),
        description="fixed: [hours]; uniform: [fewest, most]; lognormal: [median, sigma of the "
        "logarithm]; exponential: [mean]",
    )
    crews: int | None = Field(None, ge=1, description="lines mended at a time; absent: any number")
    priority: dict[str, float] = Field(
        default_factory=dict,
        description='{ "1-2" = 2, ... }: crews go to higher ones first, 0 where not given; among '
        "equals to the line that failed first",
    )
    wind_limit_mps: Positive = Field(
        20.0, description="no work at a line in a stronger wind, measured as its curve asks, m/s"
    )


class ForecastTable(Table):
    """`[storm.forecast]`: errors of the track, where it is a forecast."""

    members: int = Field(1, ge=1, le=1000, description="tracks drawn; 1: the track is certain")
    issued: datetime | None = Field(
        None, description="local time of the forecast, errors grow from then; absent: the start"
    )
    along_km_per_day: NonNegative = Field(
        40.0, description="standard deviation along the track after a day, km"
    )
    cross_km_per_day: NonNegative = Field(
        40.0, description="standard deviation across the track after a day, km"
    )
    intensity_mps: NonNegative = Field(
        5.0, description="standard deviation of vmax after a day, m/s"
    )
    seed: int = Field(0, ge=0, description="of the errors: they belong to the forecast")


class CloudTable(Table):
    """`[storm.cloud]`: PV under the storm's cloud, an assumption of the case; off without it."""

    factor: Share = Field(description="output that is left under the middle of the storm")
    radius_km: Positive = Field(
        description="distance from the middle at which nothing is lost; in between, linear"
    )


class CurveTable(Table):
    """`[storm.curves.<name>]`: a fragility curve of the case's own."""

    kind: Literal["lognormal", "piecewise", "tabulated"] = Field(
        "lognormal",
        description="lognormal: median_mps, beta; piecewise: v_crit_mps, "
        "v_collapse_mps, perhaps the first two; tabulated: speed_mps, probability",
    )
    median_mps: Positive | None = Field(None, description="speed at which one in two fails, m/s")
    beta: Positive | None = Field(
        None, description="standard deviation of the logarithm of strength"
    )
    v_crit_mps: Positive | None = Field(None, description="below it nothing fails, m/s")
    v_collapse_mps: Positive | None = Field(None, description="from it on everything fails, m/s")
    speed_mps: Annotated[tuple[NonNegative, ...], Field(strict=False)] | None = Field(
        None, description="speeds of a table, rising, m/s"
    )
    probability: Annotated[tuple[Share, ...], Field(strict=False)] | None = Field(
        None, description="of failure at these speeds, not falling"
    )
    averaging_s: Positive = Field(description="averaging time of the wind it wants, s; 3: a gust")
    height_m: Positive = Field(10.0, description="height of that wind above the ground, m")
    exposure: Literal["water", "land"] = Field("land", description="what lies upwind of it")
    source: str = Field("", description="where its numbers are from")


class StormTable(Table):
    """`[storm]`: the storm that breaks lines, and how; without `points`, a track file is needed."""

    name: str = Field("", description="name of the storm")
    source: str = Field("", description="where its facts are from")
    points: Annotated[tuple[Point, ...], Field(strict=False)] = Field(
        (),
        description="[[time, lat_deg, lon_deg, pressure_hpa, vmax_mps], ...]: local time, centre, "
        "central pressure, sustained wind; nan where one of the last two is unknown, or both, but "
        "not in every point. Longitudes -180 to 360",
    )
    averaging_s: Positive | None = Field(
        None,
        description="time over which vmax is averaged, s: 60, 120, 180 or 600; needed with points "
        "unless the agency says it",
    )
    agency: str = Field(
        "",
        description="whose winds the points are: usa, tokyo, cma, hko, newdelhi, reunion, bom, "
        "nadi or wellington; its practice makes one-minute means of them; absent: averaging_s does",
    )
    utc_offset_h: float = Field(0.0, ge=-12, le=14, description="local time less UTC, h")
    day: date | None = Field(
        None, description="day of the storm that is laid on the day `laid_on`; absent: as dated"
    )
    laid_on: date | None = Field(None, description="day of the horizon that stands for `day`")
    rmw_km: Positive | None = Field(
        None, description="radius of maximum wind, km; absent: regressed"
    )
    rmw: str = Field("ibtracs", description="regression for the radius of maximum wind")
    basin: Literal["", "NA", "EP", "SA", "NI", "SI", "WP", "SP"] = Field(
        "", description="ocean, for the usual pressure around a storm"
    )
    penv_hpa: float | None = Field(
        None,
        ge=950,
        le=1050,
        description="pressure around the storm; absent: the basin's usual one",
    )
    wind: str = Field("holland2008", description="wind field")
    asymmetry: str | None = Field(
        None, description="how the storm's motion adds to its wind; absent: as the field has it"
    )
    inflow: str | None = Field(
        None, description="how the wind turns towards the eye; absent: it does not"
    )
    roughness: str = Field("knaff2011", description="how land slows the wind down")
    inland_km: NonNegative | None = Field(
        None, description='distance from the coast, km, for roughness = "tchazards"'
    )
    pole: str = Field("pole", description="fragility curve of a pole")
    conductor: str | None = Field(None, description="fragility curve of a span; absent: none fails")
    curves: dict[str, CurveTable] = Field(
        default_factory=dict, description="fragility curves beside those that come with the package"
    )
    hardening: Positive = Field(1.0, description="multiplies the median strength of every curve")
    correlation: Share = Field(0.3, description="of the strengths of all poles in a storm")
    by_angle: bool = Field(False, description="true: only the wind across a line counts")
    mode: Literal["running_max", "rate", "per_slot"] = Field(
        "running_max",
        description="how winds add up: one strength per pole and storm; a rate per hour; a draw "
        "per slot, which depends on the step",
    )
    lines: Literal["all", "breakpoints"] = Field(
        "all",
        description="lines that the storm may break: all but cables, or the breakpoints only",
    )
    repair: RepairTable = Field(default_factory=RepairTable)
    forecast: ForecastTable = Field(default_factory=ForecastTable)
    cloud: CloudTable | None = None

    @property
    def shift(self) -> timedelta:
        """What is added to the storm's local times to lay it on the horizon: whole days."""
        if self.day is None or self.laid_on is None:
            return timedelta(0)
        return self.laid_on - self.day

    def on_horizon(self, local: datetime) -> datetime:
        """The time of the horizon at a local time of the storm."""
        return local + self.shift

    def utc(self, on_horizon: datetime) -> datetime:
        """UTC of the storm at a time of the horizon."""
        return on_horizon - self.shift - timedelta(hours=self.utc_offset_h)


class BlackoutTable(Table):
    """`[blackout]`: lines that are lost together, and back together after an unknown time."""

    lines: Annotated[tuple[Name, ...], Field(strict=False)] = Field(
        (), description="names of the lines that are lost; empty: all breakpoints"
    )
    start: datetime | None = Field(
        None, description="local date and time of the loss; absent: the first slot's start"
    )
    law: Law = Field("lognormal", description="of the hours until the lines are back")
    hours: Hours = Field(
        (24.0, 0.8),
        description="fixed: [hours]; uniform: [fewest, most]; lognormal: [median, sigma of the "
        "logarithm]; exponential: [mean]",
    )
    longest_h: Positive | None = Field(
        None, description="hours after which the lines are back for certain; absent: no limit"
    )
