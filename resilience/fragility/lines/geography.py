"""Where a feeder stands: buses and spans on the earth, from a case.

Buses have coordinates, or a synthetic place: a line is as long as its reactance says, its direction
is that of the network's drawing, and the whole hangs from a bus that stands at the anchor. Lines
that close a loop join their ends. Distances and directions are those of the WGS 84 ellipsoid; spans
are placed in the azimuthal equidistant projection about the first bus, which is exact to
centimetres over a feeder's size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.checks.geography import geography_findings
from resilience.case.schema import GeographyTable
from resilience.errors import CaseError, Mistake

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True, eq=False)
class Geography:
    """A feeder on the earth. Lines are those of the case's network, in its order.

    Attributes:
        bus_lat_deg, bus_lon_deg: (buses,) degrees north and east.
        length_km: (lines,) length of every line; 0 for a transformer.
        span_line: (spans,) line of every span, rising; transformers and lines that can never be
            closed have none.
        span_lat_deg, span_lon_deg: (spans,) of the middle of every span.
        span_bearing_deg: (spans,) direction of every span, degrees clockwise from north.
        synthetic: the places are made up.
    """

    bus_lat_deg: Floats
    bus_lon_deg: Floats
    length_km: Floats
    span_line: Ints
    span_lat_deg: Floats
    span_lon_deg: Floats
    span_bearing_deg: Floats
    synthetic: bool

    @property
    def middle(self) -> tuple[float, float]:
        """Latitude and longitude of the middle of the buses, also astride the dateline."""
        away = (self.bus_lon_deg - self.bus_lon_deg[0] + 180.0) % 360.0 - 180.0
        lon = float(self.bus_lon_deg[0] + away.mean())
        return float(self.bus_lat_deg.mean()), (lon + 180.0) % 360.0 - 180.0

    @property
    def bus_km(self) -> tuple[Floats, Floats]:
        """(buses,) km east and north of the first bus."""
        lat, lon = self.bus_lat_deg, self.bus_lon_deg
        east, north = _plane(lat, lon, lat[0], lon[0])
        return east / 1000.0, north / 1000.0

    @property
    def about(self) -> str:
        """What kind of geography it is, in words."""
        return "synthetic geography" if self.synthetic else "geography of the case"


def geography(case: Case) -> Geography:
    """Where the feeder of a case stands.

    Raises:
        CaseError: buses without coordinates, or a geography with mistakes; all of them are listed.
    """
    from pyproj import Geod

    table = case.geography or GeographyTable()
    _check(case, table)
    lat, lon = _synthetic(case, table) if table.synthetic else _stated(case)
    network, earth = case.network, Geod(ellps="WGS84")
    i, j = network.from_bus, network.to_bus
    bearing, _, metres = earth.inv(lon[i], lat[i], lon[j], lat[j])
    length = np.where(network.vn_kv[i] == network.vn_kv[j], np.asarray(metres) / 1000.0, 0.0)
    usable = (length > 0.0) & (network.in_service | network.switchable)
    span_m = np.full(len(length), table.span_m)
    for line_table in case.line:
        span_m[network.line(line_table.name)] = line_table.span_m or table.span_m
    count = np.where(usable, np.maximum(np.ceil(1000.0 * length / span_m - 1e-6), 1.0), 0.0)
    line = np.repeat(np.arange(len(length)), count.astype(np.intp))
    first = np.concatenate([[0], np.cumsum(count)])[:-1]
    share = (np.arange(len(line)) - first[line] + 0.5) / count[line]
    x, y = _plane(lat, lon, lat[0], lon[0])
    span_lat, span_lon = _earth(
        x[i[line]] + share * (x[j] - x[i])[line],
        y[i[line]] + share * (y[j] - y[i])[line],
        lat[0],
        lon[0],
    )
    return Geography(
        lat, lon, length, line, span_lat, span_lon, np.asarray(bearing)[line] % 360.0,
        table.synthetic,
    )  # fmt: skip


def _check(case: Case, table: GeographyTable) -> None:
    inline = bool(case.source.get("network", {}).get("bus"))
    mistakes = [
        Mistake(case.file_name, "[geography]", *finding)
        for finding in geography_findings(
            table, case.network, case.places, inline=inline, grid_bus=_grid_bus(case)
        )
    ]
    if mistakes:
        raise CaseError(mistakes)


def _grid_bus(case: Case) -> str | None:
    return case.grid[0].bus if case.grid else None


def _stated(case: Case) -> tuple[Floats, Floats]:
    lon, lat = np.array([case.places[name] for name in case.network.bus_names]).T
    return lat, lon


def _synthetic(case: Case, table: GeographyTable) -> tuple[Floats, Floats]:
    """Latitudes and longitudes of buses that hang from the anchor."""
    network = case.network
    drawn = np.array([case.places[name] for name in network.bus_names])
    scale = case.source["network"].get("impedance_scale", 1.0)
    ohm = np.abs(network.x_pu) / scale * network.vn_kv[network.from_bus] ** 2
    length_m = 1000.0 * ohm / table.ohm_per_km
    position = np.zeros_like(drawn)
    root = network.bus(str(table.anchor_bus or _grid_bus(case)))
    for line, near, far in _outwards(case, root):
        step = drawn[far] - drawn[near]
        size = np.hypot(*step) or 1.0
        position[far] = position[near] + length_m[line] * step / size
    turn = np.radians(table.turn_deg)
    east = np.cos(turn) * position[:, 0] + np.sin(turn) * position[:, 1]
    north = -np.sin(turn) * position[:, 0] + np.cos(turn) * position[:, 1]
    assert table.anchor_lat_deg is not None
    assert table.anchor_lon_deg is not None
    return _earth(east, north, table.anchor_lat_deg, table.anchor_lon_deg)


def _outwards(case: Case, root: int) -> Iterator[tuple[int, int, int]]:
    """(line, near bus, far bus) from the root on: lines in service first, then those that may be.

    Of a part that no line joins, the first bus stands at the anchor as well.
    """
    network = case.network
    neighbours: list[list[tuple[int, int]]] = [[] for _ in network.bus_names]
    ends = zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True)
    for line, (a, b) in enumerate(ends):
        neighbours[a].append((line, b))
        neighbours[b].append((line, a))
    reached: dict[int, None] = {}
    for start in (root, *range(len(neighbours))):
        if start in reached:
            continue
        reached[start] = None
        for usable in (network.in_service, network.switchable, np.ones_like(network.switchable)):
            frontier = list(reached)
            for bus in frontier:
                for line, neighbour in neighbours[bus]:
                    if usable[line] and neighbour not in reached:
                        reached[neighbour] = None
                        frontier.append(neighbour)
                        yield line, bus, neighbour


def _plane(lat: Floats, lon: Floats, lat_0: float, lon_0: float) -> tuple[Floats, Floats]:
    """Metres east and north of a point."""
    from pyproj import Proj

    x, y = Proj(proj="aeqd", lat_0=lat_0, lon_0=lon_0, ellps="WGS84")(lon, lat)
    return np.asarray(x), np.asarray(y)


def _earth(east: Floats, north: Floats, lat_0: float, lon_0: float) -> tuple[Floats, Floats]:
    """Latitudes and longitudes of points given in metres east and north of one."""
    from pyproj import Proj

    plane = Proj(proj="aeqd", lat_0=lat_0, lon_0=lon_0, ellps="WGS84")
    lon, lat = plane(east, north, inverse=True)
    return np.asarray(lat), np.asarray(lon)
