"""Tracks of tropical cyclones: read, completed, interpolated, perturbed."""

from resilience.earth.averaging import AGENCIES
from resilience.fragility.tracks.columns import track_of
from resilience.fragility.tracks.ensemble import ensemble
from resilience.fragility.tracks.fill import RADII
from resilience.fragility.tracks.interpolate import interpolated
from resilience.fragility.tracks.read import read_track
from resilience.fragility.tracks.track import Track, one_minute

__all__ = [
    "AGENCIES",
    "RADII",
    "Track",
    "ensemble",
    "interpolated",
    "one_minute",
    "read_track",
    "track_of",
]
