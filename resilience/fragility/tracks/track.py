"""A storm's track: where its eye is, how deep, how strong, and what was not said but filled in."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from resilience.arrays import Bools, Floats, Times
from resilience.earth.averaging import relation, to_one_minute


@dataclass(frozen=True, eq=False)
class Track:
    """A tropical cyclone, point by point. All arrays are (n,).

    Attributes:
        name: of the storm.
        source: file, and whose analysis it is.
        time: UTC, rising, to the second.
        lat, lon: of the eye, degrees north and east. Longitudes of an interpolated track go on
            beyond 180 where it crosses the dateline.
        pressure_hpa: in the centre.
        vmax_mps: largest sustained wind, a mean over `averaging_s` at 10 m over water.
        rmw_km: radius of maximum wind.
        penv_hpa: pressure of the surroundings.
        averaging_s: of `vmax_mps`: 60, 120, 180 or 600.
        filled: field -> how many of its values were filled in, and how. Empty where nothing was.
        agency: whose winds they are, a name of `averaging.AGENCIES`, or empty.
        pressure_from_wind: 1 where the pressure is a regression on the wind, 0 where it was stated,
            in between on the way from one to the other; None where all were stated. Wind fields
            keep the wind where it is 1.
    """

    name: str
    source: str
    time: Times
    lat: Floats
    lon: Floats
    pressure_hpa: Floats
    vmax_mps: Floats
    rmw_km: Floats
    penv_hpa: Floats
    averaging_s: float
    filled: dict[str, str] = field(default_factory=dict)
    agency: str = ""
    pressure_from_wind: Floats | None = None

    @property
    def present(self) -> Bools:
        """(n,) False where there is no storm: neither wind nor a deficit of pressure."""
        return (self.vmax_mps > 0) | (self.pressure_hpa < self.penv_hpa)

    @property
    def seconds(self) -> Floats:
        """(n,) since the first point."""
        return (self.time - self.time[0]).astype("timedelta64[s]").astype(float)


def one_minute(track: Track) -> Track:
    """The track with winds as means over one minute; itself where they are."""
    if track.averaging_s == 60.0:
        return track
    v = to_one_minute(track.vmax_mps, relation(track.averaging_s, track.agency))
    return replace(track, vmax_mps=v, averaging_s=60.0, agency="usa")
