"""What the wind fields need to know of a storm at each time, in SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.earth.averaging import KNOT_MPS
from resilience.earth.sphere import legs
from resilience.fragility.tracks.track import Track, one_minute

ROTATION_PER_S = 7.29e-5
FASTEST_MPS = 30.0 * KNOT_MPS
STILL_M = 1e-3  # rounding, of which a power of the speed below 1 would make something


@dataclass(frozen=True, eq=False)
class Eye:
    """A storm at each time. All arrays are (times,).

    Attributes:
        lat, lon: degrees.
        rmw_m: radius of maximum wind.
        deficit_pa: pressure of the environment less that of the centre, 0 or more.
        rise_hpa_per_h: change of the central pressure since the time before; 0 at the first.
        vmax_mps: largest wind, a mean over one minute.
        pressure_from_wind: 1 where the central pressure is a regression on the wind, 0 where it was
            stated, in between on the way.
        east_mps, north_mps: translation since the time before, at most 30 knots; 0 at the first.
    """

    lat: Floats
    lon: Floats
    rmw_m: Floats
    deficit_pa: Floats
    rise_hpa_per_h: Floats
    vmax_mps: Floats
    pressure_from_wind: Floats
    east_mps: Floats
    north_mps: Floats

    @property
    def speed_mps(self) -> Floats:
        """(times,) of translation."""
        return np.hypot(self.east_mps, self.north_mps)

    @property
    def coriolis_per_s(self) -> Floats:
        """(times,) twice the rotation about the vertical, without sign."""
        return 2.0 * ROTATION_PER_S * np.sin(np.radians(np.abs(self.lat)))


def eye_of(track: Track) -> Eye:
    """The storm of a track at its own times, with winds converted to one-minute means."""
    track = one_minute(track)
    from_wind = track.pressure_from_wind
    hours = np.diff(track.seconds) / 3600.0
    length, east, north = legs(track.lat, track.lon)
    length[length < STILL_M] = 0.0
    speed = np.minimum(length / (3600.0 * hours), FASTEST_MPS)
    stays = track.present[1:] & track.present[:-1]  # a storm that begins has not deepened or moved
    speed, rise = speed * stays, np.diff(track.pressure_hpa) / hours * stays
    return Eye(
        track.lat,
        track.lon,
        1000.0 * track.rmw_km,
        100.0 * np.maximum(track.penv_hpa - track.pressure_hpa, 0.0),
        np.r_[0.0, rise],
        track.vmax_mps,
        np.zeros(len(track.time)) if from_wind is None else from_wind,
        np.r_[0.0, speed * east],
        np.r_[0.0, speed * north],
    )
