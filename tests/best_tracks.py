"""Rows of best tracks as they were published: facts, so that no test needs more than the tree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from resilience.fragility.tracks import Track, track_of


class BestTrack(NamedTuple):
    """Part of a storm's best track.

    Attributes:
        name: of the storm.
        source: who published it.
        agency: a name of `AGENCIES`.
        averaging_s: of its winds, s.
        rows: time, latitude and longitude in degrees, central pressure in hPa, wind in m/s.
    """

    name: str
    source: str
    agency: str
    averaging_s: float
    rows: tuple[tuple[str, float, float, float, float], ...]

    def track(self, averaging_s: float | None = None, penv_hpa: float | None = None) -> Track:
        """As a track of its agency, or its wind taken for a mean over so long."""
        time, lat, lon, pressure, wind = zip(*self.rows, strict=True)
        columns: dict[str, Sequence[Any]] = {
            "time": list(np.array(time, "datetime64[s]")),
            "lat": lat,
            "lon": lon,
            "pressure_hpa": pressure,
            "vmax_mps": wind,
        }
        whose = "" if averaging_s else self.agency
        return track_of(columns, averaging_s=averaging_s, agency=whose, penv_hpa=penv_hpa)


RAMMASUN = BestTrack(
    "Rammasun",
    "CMA-STI best track, annual file CH2014BST.txt; Ying et al. 2014, Lu et al. 2021",
    "cma",
    120.0,
    (
        ("2014-07-16T06", 15.1, 119.1, 975, 33),
        ("2014-07-16T12", 15.5, 117.8, 970, 35),
        ("2014-07-16T18", 16.0, 116.7, 965, 38),
        ("2014-07-17T00", 16.4, 115.8, 960, 40),
        ("2014-07-17T06", 16.8, 115.0, 950, 45),
        ("2014-07-17T12", 17.5, 114.3, 930, 50),
        ("2014-07-17T18", 18.5, 113.4, 920, 58),
        ("2014-07-18T00", 19.1, 112.3, 900, 65),
        ("2014-07-18T06", 19.9, 111.3, 888, 72),
        ("2014-07-18T12", 20.3, 110.3, 910, 60),
        ("2014-07-18T18", 21.0, 109.4, 935, 52),
        ("2014-07-19T00", 21.7, 108.3, 945, 48),
        ("2014-07-19T06", 22.1, 107.3, 970, 33),
        ("2014-07-19T12", 22.9, 106.2, 990, 23),
        ("2014-07-19T18", 23.0, 105.1, 996, 18),
    ),
)
HARVEY = BestTrack(
    "Harvey",
    "NHC HURDAT2, AL092017; knots times 0.514444",
    "usa",
    60.0,
    (
        ("2017-08-25T00", 25.0, -94.4, 973, 41.16),
        ("2017-08-25T06", 25.6, -95.1, 966, 46.30),
        ("2017-08-25T12", 26.3, -95.8, 949, 48.87),
        ("2017-08-25T18", 27.1, -96.3, 943, 54.02),
        ("2017-08-26T00", 27.8, -96.8, 941, 59.16),
        ("2017-08-26T03", 28.0, -96.9, 937, 59.16),
        ("2017-08-26T06", 28.2, -97.1, 948, 54.02),
        ("2017-08-26T12", 28.7, -97.3, 978, 33.44),
        ("2017-08-26T18", 29.0, -97.5, 991, 25.72),
    ),
)
KOINU = BestTrack(
    "Koinu",
    "IBTrACS v04, 2023271N14144, columns of CMA; knots times 0.514444",
    "cma",
    120.0,
    (
        ("2023-10-04T00", 22.2, 123.5, 945, 47.84),
        ("2023-10-04T06", 22.1, 122.7, 935, 51.96),
        ("2023-10-04T12", 22.0, 122.0, 930, 54.53),
        ("2023-10-04T18", 21.9, 121.3, 930, 54.53),
        ("2023-10-05T00", 21.9, 120.9, 945, 47.84),
        ("2023-10-05T06", 22.0, 120.0, 965, 39.61),
        ("2023-10-05T12", 22.0, 119.1, 970, 37.55),
        ("2023-10-05T18", 21.9, 118.4, 975, 34.98),
    ),
)
BEST_TRACKS = (RAMMASUN, HARVEY, KOINU)
