"""Wind of a storm at points over time, labelled with what it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.earth.sphere import seen_from
from resilience.errors import UsageError
from resilience.fragility.tracks.track import Track
from resilience.fragility.wind.asymmetry import ASYMMETRIES, INFLOWS
from resilience.fragility.wind.convert import EXPOSURES, Kind, factor
from resilience.fragility.wind.eye import Eye, eye_of
from resilience.fragility.wind.fields import MODELS

BLOCK = 20_000  # points times times worked on together: memory does not grow with the points
NEAREST_M = 1.0  # a point nearer to the eye is as far away as this: fields have no value at 0


@dataclass(frozen=True, eq=False)
class Wind:
    """Wind at points over time.

    Attributes:
        speed_mps: (points, times).
        direction_deg: (points, times) towards which it blows, clockwise from north.
        averaging_s: the speed is a mean over so long, s; a gust of 3 s is one.
        height_m: above ground.
        exposure: `water` or `land`, what lies upwind.
        factors: conversions that were made, with their sources.
    """

    speed_mps: Floats
    direction_deg: Floats
    averaging_s: float
    height_m: float
    exposure: str
    factors: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """Averaging time, height and exposure."""
        return Kind(self.averaging_s, self.height_m, self.exposure)

    def to(
        self,
        *,
        averaging_s: float | None = None,
        height_m: float | None = None,
        exposure: str | None = None,
        roughness: str = "knaff2011",
        inland_km: ArrayLike | None = None,
    ) -> Wind:
        """The same wind as another kind; what is None stays. Directions stay.

        Args:
            averaging_s: 60, 600, 3, or 0.2 over land.
            height_m: 10, or for means over a minute or more 2 to 200.
            exposure: `water` or `land`.
            roughness: `knaff2011` (0.8 over land) or `tchazards` (by the distance from the coast).
            inland_km: (points,) distance from the coast, for `tchazards`.

        Raises:
            UsageError: a conversion without a source; see `convert.py`.
        """
        if exposure is not None and exposure not in EXPOSURES:
            raise UsageError(
                f"exposure {exposure!r}; allowed: {', '.join(EXPOSURES)}",
                hint="open country counts as land",
            )
        target = Kind(
            self.averaging_s if averaging_s is None else float(averaging_s),
            self.height_m if height_m is None else float(height_m),
            self.exposure if exposure is None else exposure,
        )
        value, names = factor(self.kind, target, roughness, inland_km)
        if value.shape[0] not in (1, len(self.speed_mps)):
            raise UsageError(
                f"inland_km of {value.shape[0]} points; allowed: {len(self.speed_mps)}",
                hint="one distance per point",
            )
        return replace(
            self,
            speed_mps=self.speed_mps * value,
            factors=(*self.factors, *names),
            **target._asdict(),
        )


def wind(
    track: Track,
    lat: ArrayLike,
    lon: ArrayLike,
    *,
    model: str = "holland2008",
    asymmetry: str | None = None,
    inflow: str | None = None,
    cutoff_km: float | None = None,
    threshold_mps: float | None = None,
) -> Wind:
    """Wind of a storm at points: one-minute means at 10 m over water, at the times of the track.

    Interpolate the track first; its wind is converted from its averaging time. Rotation is
    counter-clockwise in the northern hemisphere, clockwise in the southern.

    Args:
        track: the storm, (times,).
        lat: (points,) degrees north.
        lon: (points,) degrees east.
        model: a name of `MODELS`.
        asymmetry: a name of `ASYMMETRIES`: how the translation enters; the model's own if None.
        inflow: a name of `INFLOWS`, or None for a tangential wind.
        cutoff_km: no wind farther from the eye than this. CLIMADA has 300; None for no limit.
        threshold_mps: no wind where it is weaker than this. CLIMADA has 17.5; None for no limit.

    Raises:
        UsageError: a point off the Earth, or an unknown model or option; all of them are listed.
    """
    lat, lon = np.atleast_1d(np.asarray(lat, float)), np.atleast_1d(np.asarray(lon, float))
    _check_points(lat, lon)
    _check_names(model, asymmetry, inflow)
    share = ASYMMETRIES[asymmetry or MODELS[model].asymmetry]
    eye = eye_of(track)
    speed, direction = np.empty((2, len(lat), len(track.time)))
    rows = max(BLOCK // len(track.time), 1)
    for start in range(0, len(lat), rows):
        block = slice(start, start + rows)
        distance, east, north = seen_from((eye.lat, eye.lon), (lat[block], lon[block]))
        np.maximum(distance, NEAREST_M, out=distance)
        ratio = eye.rmw_m / distance
        angle = None if inflow is None else INFLOWS[inflow](ratio)
        u, v = _vortex(MODELS[model].field(distance, eye, share), east, north, eye, angle)
        carried = share(ratio)
        u += carried * eye.east_mps
        v += carried * eye.north_mps
        np.sqrt(u * u + v * v, out=speed[block])
        np.arctan2(u, v, out=direction[block])
        if cutoff_km is not None:
            speed[block] *= distance <= 1000.0 * cutoff_km
    if threshold_mps is not None:
        speed *= speed >= threshold_mps
    direction *= 180.0 / np.pi
    direction[direction < 0.0] += 360.0
    return Wind(speed, direction, 60.0, 10.0, "water")


def _vortex(
    speed: Floats, east: Floats, north: Floats, eye: Eye, inflow_deg: Floats | None
) -> tuple[Floats, Floats]:
    """East and north component of the rotating wind; `east`, `north` point away from the eye."""
    turn = np.where(eye.lat < 0.0, -1.0, 1.0)
    if inflow_deg is None:
        turning = speed * turn
        return -turning * north, turning * east
    angle = np.radians(inflow_deg)
    turning, inwards = speed * np.cos(angle) * turn, speed * np.sin(angle)
    return -turning * north - inwards * east, turning * east - inwards * north


def _check_points(lat: Floats, lon: Floats) -> None:
    wrong = []
    if lat.shape != lon.shape or lat.ndim != 1:
        wrong.append(f"latitudes of shape {lat.shape}, longitudes of {lon.shape}")
    for name, values, low, high in (("latitude", lat, -90, 90), ("longitude", lon, -180, 360)):
        outside = np.flatnonzero(~((low <= values) & (values <= high)))
        wrong += [f"point {k}: {name} {values[k]:g}" for k in outside[:10]]
    if wrong:
        raise UsageError(
            f"{'; '.join(wrong)}; allowed: (points,), latitudes -90 to 90, longitudes -180 to 360",
            hint="latitude comes first",
        )


def _check_names(model: str, asymmetry: str | None, inflow: str | None) -> None:
    options: tuple[tuple[str, str | None, Mapping[str, object]], ...] = (
        ("model", model, MODELS),
        ("asymmetry", asymmetry, ASYMMETRIES),
        ("inflow", inflow, INFLOWS),
    )
    wrong = [
        f"{key} {value!r}; allowed: {', '.join(table)}"
        for key, value, table in options
        if value is not None and value not in table
    ]
    if wrong:
        raise UsageError("wind: " + "; ".join(wrong), hint="leave an option out for its default")
