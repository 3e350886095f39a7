r"""What no storm does: blow far harder or far less than its pressures go with, or travel too fast.

Files of tracks and `[storm]` of a case are held against the same rules. With the latitude $\varphi$
and longitude $\lambda$ in degrees and the central pressure $p$ in hPa, the usual one-minute wind is

$$ u = 1216.5223 - 0.04086 \varphi - 0.04190 \lambda - 1.1797 p \quad \text{knots}, $$

CLIMADA's regression on IBTrACS. A wind is too strong beyond $1.4 u + 15$ kt. The factor leaves room
for small storms in high surroundings, the 15 kt for weak ones, whose pressure says little. Knots
taken for m/s are 1.94 times too large: above the limit for a usual storm of 28 kt or more.

A single wind may be odd, so the median of a track decides. In the best tracks of Rammasun (CMA),
Harvey (NHC) and Koinu (CMA) single winds come up to 0.86 of the limit, and medians up to 0.75;
with their knots taken for m/s the medians are 1.04 to 1.45 of it. A large storm with weak winds,
below 0.8 of the usual, may pass in knots. Pressures above 1000 hPa and winds below 17 m/s are left
out: they say little of each other.

A wind is too weak below $0.55 u$ at 985 hPa or less; again the median decides. In the 754 storms of
HURDAT2 that were so deep at any time (528 in the Atlantic, 226 in the eastern Pacific) the lowest
medians are 0.59, 0.62 and 0.68; of 115 storms of RSMC Tokyo it is 0.72. Metres per second taken for
knots are 0.51 of what they should be, and a calm of 0 that stands for a gap is none of it. Where an
agency's relation makes a one-minute wind weaker than the longer mean, the mean counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.earth.averaging import KNOT_MPS, Agency, from_one_minute, to_one_minute
from resilience.earth.sphere import legs

MAX_SPEED_KMH = 200.0
WIND_FACTOR, WIND_MARGIN_KT = 1.4, 15.0  # of the usual wind: the limit is factor * usual + margin
LOWEST_HPA, WEAK_HPA, STORMY_MPS = 850.0, 1000.0, 17.0
WEAKEST_SHARE, DEEP_HPA = 0.55, 985.0  # of the usual wind, and up to which pressure that holds
LON_LOW, LON_HIGH = -180.0, 360.0


def usual_wind_kt(lat: Floats, lon: Floats, pressure_hpa: Floats) -> Floats:
    """(n,) one-minute winds that go with central pressures, knots; not above 0 for weak lows."""
    east = (lon + 180.0) % 360.0 - 180.0
    return 1216.5223 - 0.04086 * lat - 0.04190 * east - 1.1797 * pressure_hpa


@dataclass(frozen=True)
class OddWind:
    """The oddest wind of a track whose winds do not go with its pressures.

    Attributes:
        point: index of the point, from 0.
        wind_mps: its wind, as all here in the averaging time of the track.
        pressure_hpa: its central pressure.
        usual_mps: the wind that usually goes with that pressure.
        limit_mps: the wind beyond which it must be in another unit, or be missing.
        weak: it is below the limit, not above.
    """

    point: int
    wind_mps: float
    pressure_hpa: float
    usual_mps: float
    limit_mps: float
    weak: bool

    def text(self, where: str) -> str:
        """The wind in words; `where` is its point, as messages name it."""
        wind = f"{self.wind_mps:.4g} m/s at {self.pressure_hpa:g} hPa"
        return f"{wind} in {where}, and most points alike"

    @property
    def allowed(self) -> str:
        """What it may be, in words."""
        bound = f"{self.limit_mps:.0f} m/s"
        return f"{f'{bound} or more' if self.weak else f'up to {bound}'} there; " + (
            f"{self.usual_mps:.0f} is usual"
        )


def odd_winds(
    lat: Floats, lon: Floats, pressure_hpa: Floats, vmax_mps: Floats, agency: Agency
) -> OddWind | None:
    """Winds too strong or too weak for their pressures, or None; see above.

    Args:
        lat: (n,) degrees; as in all of these, NaN is a gap.
        lon: (n,) degrees.
        pressure_hpa: (n,) in the centre.
        vmax_mps: (n,) largest wind, as stated.
        agency: whose winds they are; they are compared as means over one minute.
    """
    with np.errstate(over="ignore"):  # numbers that are no weather are refused by their own rules
        wind = to_one_minute(vmax_mps, agency)
        usual = KNOT_MPS * usual_wind_kt(lat, lon, pressure_hpa)
    above = WIND_FACTOR * usual + WIND_MARGIN_KT * KNOT_MPS
    below = WEAKEST_SHARE * usual
    stated = (pressure_hpa >= LOWEST_HPA) & np.isfinite(usual) & np.isfinite(wind)
    stormy = np.flatnonzero(stated & (pressure_hpa <= WEAK_HPA) & (wind > STORMY_MPS))
    deep = np.flatnonzero(stated & (pressure_hpa <= DEEP_HPA))
    strong = wind[stormy] / above[stormy]
    weak = np.maximum(wind, vmax_mps)[deep] / below[deep]
    if len(stormy) and np.median(strong) > 1.0:
        k, limit = int(stormy[np.argmax(strong)]), above
    elif len(deep) and np.median(weak) < 1.0:
        k, limit = int(deep[np.argmin(weak)]), below
    else:
        return None
    usual_mps, limit_mps = from_one_minute(np.array([usual[k], limit[k]]), agency).tolist()
    wind_mps, centre_hpa = float(vmax_mps[k]), float(pressure_hpa[k])
    if limit is below:
        limit_mps = min(limit_mps, float(below[k]))
    return OddWind(k, wind_mps, centre_hpa, usual_mps, limit_mps, weak=limit is below)


@dataclass(frozen=True)
class Leap:
    """A leg no storm can travel: a slip in a sign, or latitude and longitude exchanged.

    Attributes:
        point: index of the point where it ends, from 0.
        km: its length.
        hours: the time it takes.
    """

    point: int
    km: float
    hours: float

    @property
    def text(self) -> str:
        """The leg, in words."""
        return f"{self.km:.0f} km from the point before, {self.hours:g} h earlier"

    @property
    def allowed(self) -> str:
        """What it may be, in words."""
        return f"at most {MAX_SPEED_KMH:g} km/h"

    @property
    def hint(self) -> str:
        """What it usually is."""
        return "look for a sign, or for latitude and longitude exchanged"


def leaps(hours: Floats, lat: Floats, lon: Floats) -> list[Leap]:
    """Legs faster than `MAX_SPEED_KMH`; NaN is a time or place that is not known.

    Args:
        hours: (n,) time since any moment; legs that go back in time are left out.
        lat: (n,) degrees.
        lon: (n,) degrees.
    """
    if len(hours) < 2:
        return []
    lasts = np.diff(hours)
    km = legs(lat, lon)[0] / 1000.0
    far = (lasts > 0) & (km > MAX_SPEED_KMH * lasts)
    return [Leap(int(k) + 1, float(km[k]), float(lasts[k])) for k in np.flatnonzero(far)]
