"""Where a feeder stands: buses and spans on the earth, from a case.

Buses have coordinates, or a synthetic place: a line is as long as its reactance says, its direction
is that of the network's drawing, and the whole hangs from a bus that stands at the anchor. Lines
that close a loop join their ends. Where buses have coordinates, a line takes the way that its
network's source draws, or else the straight one, and is as long as the source says, or else as that
way; its spans are spread evenly over the way. Distances and directions are those of the WGS 84
ellipsoid; spans are placed in the azimuthal equidistant projection about the first bus, which is
exact to centimetres over a feeder's size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.checks.geography import geography_findings
from resilience.case.networks.course import Course, Points
from resilience.case.schema import GeographyTable
from resilience.errors import CaseError, Mistake

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.case.networks.network import Network


@dataclass(frozen=True, eq=False)
class Geography:
    """A feeder on the earth. Lines are those of the case's network, in its order.

    Attributes:
        bus_lat_deg, bus_lon_deg: (buses,) degrees north and east.
        length_km: (lines,) length of every line, by the network's source or as drawn; 0 for a
            transformer.
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


@dataclass(frozen=True, eq=False)
class _Ways:
    """The ways of all lines, as straight pieces one after another.

    Attributes:
        line: (pieces,) line of every piece, rising.
        lat_deg, lon_deg: (2, pieces) where it begins and ends.
        metres: (pieces,) its length.
        bearing_deg: (pieces,) its direction, clockwise from north.
    """

    line: Ints
    lat_deg: Floats
    lon_deg: Floats
    metres: Floats
    bearing_deg: Floats


def geography(case: Case) -> Geography:
    """Where the feeder of a case stands.

    Raises:
        CaseError: buses without coordinates, or a geography with mistakes; all of them are listed.
    """
    table = case.geography or GeographyTable()
    _check(case, table)
    lat, lon = _synthetic(case, table) if table.synthetic else _stated(case)
    ways = _ways(case.network, lat, lon, {} if table.synthetic else case.network.courses)
    length = _length_km(case.network, ways, {} if table.synthetic else case.network.courses)
    line, share = _spans(case, table, length)
    span_lat, span_lon, bearing = _along(ways, line, share, (float(lat[0]), float(lon[0])))
    return Geography(lat, lon, length, line, span_lat, span_lon, bearing, table.synthetic)


def _ways(network: Network, lat: Floats, lon: Floats, courses: Mapping[str, Course]) -> _Ways:
    """The drawn way of every line, or the straight one."""
    from pyproj import Geod

    points: list[Points] = []
    for name, i, j in zip(network.line_names, network.from_bus, network.to_bus, strict=True):
        drawn = courses[name].points if name in courses else ()
        ends = ((float(lon[i]), float(lat[i])), (float(lon[j]), float(lat[j])))
        on_earth = all(abs(x) <= 180.0 and abs(y) <= 90.0 for x, y in drawn)
        points.append(drawn if drawn and on_earth else ends)
    first = np.array([p for way in points for p in way[:-1]], float).reshape(-1, 2)
    last = np.array([p for way in points for p in way[1:]], float).reshape(-1, 2)
    bearing, _, metres = Geod(ellps="WGS84").inv(*first.T, *last.T)
    lon_deg, lat_deg = np.stack([first.T, last.T], axis=1)
    line = np.repeat(np.arange(len(points)), [len(way) - 1 for way in points])
    return _Ways(line, lat_deg, lon_deg, np.asarray(metres), np.asarray(bearing) % 360.0)


def _length_km(network: Network, ways: _Ways, courses: Mapping[str, Course]) -> Floats:
    """(lines,) length by the source, or else of the way; 0 for transformers."""
    drawn = np.bincount(ways.line, ways.metres, len(network.line_names)) / 1000.0
    stated = [courses[name].length_km if name in courses else None for name in network.line_names]
    length = np.array([d if s is None else s for s, d in zip(stated, drawn, strict=True)])
    is_line = network.vn_kv[network.from_bus] == network.vn_kv[network.to_bus]
    return np.where(is_line, length, 0.0)


def _spans(case: Case, table: GeographyTable, length_km: Floats) -> tuple[Ints, Floats]:
    """(spans,) line of every span, and how far along it its middle is, 0 to 1."""
    network = case.network
    usable = (length_km > 0.0) & (network.in_service | network.switchable)
    span_m = np.full(len(length_km), table.span_m)
    for line_table in case.line:
        span_m[network.line(line_table.name)] = line_table.span_m or table.span_m
    count = np.where(usable, np.maximum(np.ceil(1000.0 * length_km / span_m - 1e-6), 1.0), 0.0)
    line = np.repeat(np.arange(len(length_km)), count.astype(np.intp))
    first = np.concatenate([[0], np.cumsum(count)])[:-1]
    return line, (np.arange(len(line)) - first[line] + 0.5) / count[line]


def _along(
    ways: _Ways, line: Ints, share: Floats, middle: tuple[float, float]
) -> tuple[Floats, Floats, Floats]:
    """(spans,) latitude, longitude and bearing at shares of the ways of lines."""
    stop = np.cumsum(ways.metres)
    begin = stop - ways.metres
    first = np.searchsorted(ways.line, line, side="left")
    last = np.searchsorted(ways.line, line, side="right") - 1
    metres = begin[first] + share * (stop[last] - begin[first])
    piece = np.clip(np.searchsorted(stop, metres, side="left"), first, last)
    inside = (metres - begin[piece]) / np.maximum(ways.metres[piece], 1e-9)
    x, y = _plane(ways.lat_deg, ways.lon_deg, *middle)
    at_x, at_y = (c[0, piece] + inside * (c[1] - c[0])[piece] for c in (x, y))
    lat, lon = _earth(at_x, at_y, *middle)
    return lat, lon, ways.bearing_deg[piece]


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
