"""A track at other times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from resilience.errors import UsageError
from resilience.fragility.tracks.track import Track


def interpolated(track: Track, times: ArrayLike) -> Track:
    """The track at given times: a cubic spline through the places, all else linear.

    The spline is scipy's `CubicSpline` with its not-a-knot ends, through the whole track; of three
    points it is a parabola, of two a line. Linear places would change the largest wind at a point
    by up to 1.4 m/s. Longitudes are continuous across the dateline. Before the track begins and
    after it ends there is no storm: it rests at its first or last place without wind and without a
    deficit of pressure, so that every wind field is calm (`Track.present` is False).

    Args:
        track: at least two points.
        times: (m,) datetime64 or text, UTC, rising.

    Raises:
        UsageError: times that do not rise.
    """
    from scipy.interpolate import CubicSpline

    moments = np.atleast_1d(np.asarray(times, "datetime64[s]"))
    falls = np.diff(moments) <= np.timedelta64(0, "s")
    if not len(moments) or np.isnat(moments).any() or falls.any():
        raise UsageError(
            f"{len(moments)} times to interpolate track {track.name!r} at; allowed: rising times",
            hint="np.arange(start, stop, step) makes them",
        )
    x = track.seconds
    seconds = (moments - track.time[0]).astype("timedelta64[s]").astype(float)
    inside = (seconds >= 0.0) & (seconds <= x[-1])
    clipped = np.clip(seconds, 0.0, x[-1])
    penv, pressure, vmax, rmw = (
        np.interp(clipped, x, values)
        for values in (track.penv_hpa, track.pressure_hpa, track.vmax_mps, track.rmw_km)
    )
    from_wind = track.pressure_from_wind
    return replace(
        track,
        time=moments,
        lat=np.clip(CubicSpline(x, track.lat)(clipped), -90.0, 90.0),
        lon=CubicSpline(x, np.unwrap(track.lon, period=360.0))(clipped),
        pressure_hpa=np.where(inside, pressure, penv),
        vmax_mps=np.where(inside, vmax, 0.0),
        rmw_km=rmw,
        penv_hpa=penv,
        pressure_from_wind=None if from_wind is None else np.interp(clipped, x, from_wind),
    )
