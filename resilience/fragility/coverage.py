"""Whether a track and a horizon belong together: times in common, and no wind that is cut off."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Times
from resilience.case.schema import StormTable
from resilience.earth.sphere import seen_from
from resilience.errors import UsageError
from resilience.fragility.lines.geography import Geography
from resilience.fragility.tracks import Track

if TYPE_CHECKING:
    from resilience.case import Case

STILL_BLOWS_MPS = 20.0
"""In the measure of the poles' curve: crews wait for less, and no pole fails in it."""


def check_overlap(case: Case, track: Track, place: Geography, times: Times) -> None:
    """Checks that a track has a time in common with the horizon.

    Raises:
        UsageError: it has none; says on which day the storm is nearest.
    """
    if track.time[-1] >= times[0] and track.time[0] <= times[-1]:
        return
    table = case.storm or StormTable()
    local = _python(nearest_time(track, place)) + timedelta(hours=table.utc_offset_h)
    first, last = (_python(time) for time in (track.time[0], track.time[-1]))
    begin, end = (table.utc(time) for time in (case.window.start, case.window.stop))
    raise UsageError(
        f"track {track.name!r}, {first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M} UTC, misses the "
        f"horizon, {begin:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC of the storm; allowed: times "
        "in common",
        hint=f"the storm is nearest on {local:%Y-%m-%d}: in [storm] write day = {local:%Y-%m-%d} "
        f"and laid_on = a day of the horizon, {case.start:%Y-%m-%d} for one",
    )


def nearest_time(track: Track, place: Geography) -> np.datetime64:
    """UTC of the point of a track that is nearest to the middle of a feeder."""
    lat, lon = place.middle
    nearest = seen_from((track.lat, track.lon), ([lat], [lon]))[0][0].argmin()
    return np.datetime64(track.time[nearest])


def check_ends(case: Case, track: Track, times: Times, speed_mps: Floats) -> None:
    """Checks that it does not blow at the feeder where a track begins or ends: no wind is known
    beyond, and none is not what blows there.

    Args:
        case: the case.
        track: the storm.
        times: (moments,) UTC of the horizon.
        speed_mps: (spans, slots) wind as the poles' curve wants it, the mean of members.

    Raises:
        UsageError: a storm gale that the track cuts off within the horizon.
    """
    inside = np.flatnonzero((times >= track.time[0]) & (times <= track.time[-1]))
    if not len(inside):
        return
    blows = speed_mps.max(axis=0)
    per_slot = len(times) // case.slots
    first, last = int(inside[0]) // per_slot, int(inside[-1]) // per_slot
    for slot, cut, word, way in (
        (first, inside[0] > 0, "begins", "before"),
        (last, inside[-1] < len(times) - 1, "ends", "after"),
    ):
        if cut and blows[slot] > STILL_BLOWS_MPS:
            raise UsageError(
                f"track {track.name!r} {word} at {case.slot_label(slot)} while it blows "
                f"{blows[slot]:.0f} m/s at the feeder; allowed: up to {STILL_BLOWS_MPS:g} m/s",
                hint=f"the wind {way} that is unknown, not nothing: add points, or let the horizon "
                "begin and end within the track",
            )


def _python(time: np.datetime64) -> datetime:
    """The time as a datetime."""
    return time.astype("datetime64[s]").item()
