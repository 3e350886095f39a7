r"""`[storm.cloud]`: what the cloud of a storm leaves of the output of PV plants.

$$ k(t) = f + (1 - f) \min(d(t) / R, 1) $$

with the distance $d$ from the storm's centre to the middle of the feeder, in the middle of a slot,
the centre going straight from point to point; $k = 1$ before the first point and after the last.
A shape of our own, for want of a source: the case states $f$ and $R$, and without the table nothing
is reduced. Profiles stay; plants follow products of them, named after them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from resilience.arrays import Floats
from resilience.case.checks.parts import Parts
from resilience.case.schema import CloudTable, PVTable, StormTable
from resilience.case.window import Window
from resilience.earth.sphere import RADIUS_M

_SUFFIX = " under the storm's cloud"
_CONSTANT = "peak"  # what a plant without a profile follows


def under_cloud(
    plants: Iterable[PVTable], profiles: Mapping[str, Floats], parts: Parts
) -> tuple[tuple[PVTable, ...], dict[str, Floats]]:
    """Plants that follow reduced profiles, and these; plants as they are without a cloud."""
    plants, storm, window = tuple(plants), parts.storm, parts.window
    if storm is None or storm.cloud is None or not storm.points or window is None:
        return plants, {}
    factor = _cloud_factor(storm, storm.cloud, window, _middle(parts))
    shaded, reduced = [], {}
    for plant in plants:
        name = (plant.profile or _CONSTANT) + _SUFFIX
        reduced[name] = factor if plant.profile is None else profiles[plant.profile] * factor
        reduced[name].setflags(write=False)
        shaded.append(plant.model_copy(update={"profile": name}))
    return tuple(shaded), reduced


def is_reduced(profile: str | None) -> bool:
    """Whether a profile is one that `under_cloud` made."""
    return profile is not None and profile.endswith(_SUFFIX)


def bare_profile(profile: str | None) -> str | None:
    """The profile that a plant follows in a clear sky."""
    if profile is None or not is_reduced(profile):
        return profile
    name = profile.removesuffix(_SUFFIX)
    return None if name == _CONSTANT else name


def _cloud_factor(
    storm: StormTable, cloud: CloudTable, window: Window, place: tuple[float, float]
) -> Floats:
    """Share of PV output that a storm leaves in every slot, (slots,), at (latitude, longitude)."""
    first = storm.on_horizon(storm.points[0][0])
    seconds = [(storm.on_horizon(point[0]) - first).total_seconds() for point in storm.points]
    start = (window.start - first).total_seconds()
    middle = start + 60.0 * window.step_min * (np.arange(window.slots) + 0.5)
    lat = np.interp(middle, seconds, [point[1] for point in storm.points])
    lon = np.interp(middle, seconds, np.unwrap([point[2] for point in storm.points], period=360.0))
    share = np.minimum(_distance_km(lat, lon, *place) / cloud.radius_km, 1.0)
    factor = cloud.factor + (1.0 - cloud.factor) * share
    return np.where((middle >= seconds[0]) & (middle <= seconds[-1]), factor, 1.0)


def _middle(parts: Parts) -> tuple[float, float]:
    """Latitude and longitude of the feeder: its anchor, or the middle of its buses."""
    table = parts.geography
    if table is not None and table.anchor_lat_deg is not None and table.anchor_lon_deg is not None:
        return table.anchor_lat_deg, table.anchor_lon_deg
    lon, lat = np.array(list(parts.places.values())).T
    return float(lat.mean()), float(np.unwrap(lon, period=360.0).mean())


def _distance_km(lat: Floats, lon: Floats, to_lat: float, to_lon: float) -> Floats:
    """Great-circle distances, (n,), by the haversine formula."""
    start, end = np.radians(lat), math.radians(to_lat)
    across = np.cos(start) * math.cos(end) * np.sin(np.radians(lon - to_lon) / 2.0) ** 2
    return 2.0 * RADIUS_M / 1000.0 * np.arcsin(np.sqrt(np.sin((start - end) / 2.0) ** 2 + across))
