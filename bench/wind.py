"""Wind of a storm at 1,000 points and 500 times, every model with its default asymmetry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.row import Row, below, timed
from resilience.fragility.tracks import Track, interpolated, track_of
from resilience.fragility.wind import MODELS, wind

POINTS, TIMES = 1000, 500


def storm() -> Track:
    """A storm that crosses the points at 5 m/s, at every 15 minutes."""
    hours = 6 * np.arange(22)
    track = track_of(
        {
            "time": np.datetime64("2020-09-01", "s") + (3600 * hours).astype("timedelta64[s]"),
            "lat": 16.0 + 0.05 * hours,
            "lon": 124.0 - 0.15 * hours,
            "vmax_mps": 50.0 + 10.0 * np.sin(hours / 20.0),
        },
        averaging_s=120,
    )
    step = np.timedelta64(900, "s")
    return interpolated(track, track.time[0] + step * np.arange(TIMES))


def fields() -> Iterator[Row]:
    rng = np.random.default_rng(0)
    lat, lon = rng.uniform(18.0, 22.0, POINTS), rng.uniform(110.0, 118.0, POINTS)
    track = storm()
    for model in MODELS:
        seconds = [timed(lambda name=model: wind(track, lat, lon, model=name))[0] for _ in range(7)]
        blown = wind(track, lat, lon, model=model)
        yield below(
            f"wind, {model}",
            float(np.median(seconds)),
            0.2,
            "s",
            f"{POINTS} points, {TIMES} times; up to {blown.speed_mps.max():.0f} m/s",
        )
