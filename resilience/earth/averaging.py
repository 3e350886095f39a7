"""Averaging times of agencies, and what their winds are as means over one minute.

Agencies report the largest wind as means over 1, 2, 3 or 10 minutes, and estimate it in different
ways. The relations v = a v(1 min) + b, in knots, are those CLIMADA uses for the agency columns of
IBTrACS. They are practice, not physics: CMA's two minutes are raised more than ten minutes are
elsewhere. Winds of no known agency are converted by their averaging time alone, `NAMELESS`: the
longer the mean, the lower. The factors are those of Harper, Kepert and Ginger 2010 (WMO/TD-No.
1555) at sea: 0.93 for ten minutes as recommended, 1.02/1.05 and 1.00/1.05 for two and three, the
ratios of their gust factors of two, three and one minute in ten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats

KNOT_MPS = 0.514444
NAUTICAL_MILE_KM = 1.852


@dataclass(frozen=True)
class Agency:
    """How an agency reports the largest wind: v = factor v(1 min) + offset.

    Attributes:
        averaging_s: averaging time, s.
        factor: of the one-minute mean.
        offset_kt: knots.
    """

    averaging_s: float
    factor: float
    offset_kt: float = 0.0


AGENCIES: dict[str, Agency] = {
    "usa": Agency(60.0, 1.0),
    "tokyo": Agency(600.0, 0.60, 23.3),
    "cma": Agency(120.0, 0.871),
    "hko": Agency(600.0, 0.9),
    "newdelhi": Agency(180.0, 1.0),
    "reunion": Agency(600.0, 0.88),
    "bom": Agency(600.0, 0.88),
    "nadi": Agency(600.0, 0.88),
    "wellington": Agency(600.0, 0.88),
}
NAMELESS: dict[float, Agency] = {
    60.0: Agency(60.0, 1.0),
    120.0: Agency(120.0, 1.02 / 1.05),
    180.0: Agency(180.0, 1.00 / 1.05),
    600.0: Agency(600.0, 0.93),
}


def relation(averaging_s: float, agency: str = "") -> Agency:
    """The relation of an agency, or that of an averaging time where no agency is named."""
    return AGENCIES[agency] if agency else NAMELESS[averaging_s]


def to_one_minute(v_mps: Floats, agency: Agency) -> Floats:
    """Winds of an agency, m/s, as means over one minute; no wind stays none."""
    return np.maximum(v_mps - agency.offset_kt * KNOT_MPS, 0.0) / agency.factor


def from_one_minute(v_mps: Floats, agency: Agency) -> Floats:
    """One-minute winds, m/s, as an agency would report them."""
    return np.where(v_mps > 0, agency.factor * v_mps + agency.offset_kt * KNOT_MPS, 0.0)
