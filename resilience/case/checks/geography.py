"""Whether a case says where its buses are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.networks.network import Network
from resilience.case.reading import show
from resilience.case.schema import GeographyTable

_MIN_OHM_PER_KM, _LONG_KM = 0.01, 5.0
"""Cables have 0.07 or more, overhead lines 0.3; less by the network's impedance scale."""
_COORDINATES_HINT = (
    "give lat_deg and lon_deg to every [[network.bus]], or set degrees or synthetic in [geography]"
)


def check_geography(parts: Parts) -> None:
    """Notes what is wrong with the places of the buses, which a case with a storm needs."""
    for bus in parts.inline.buses.values():
        for key, partner in (("lat_deg", "lon_deg"), ("lon_deg", "lat_deg")):
            if getattr(bus, key) is None and getattr(bus, partner) is not None:
                title, hint = f"[[network.bus]] {bus.name}", f"add {key} = ..., or drop {partner}"
                parts.document.add(("network", "bus"), title, key, "nothing", "a value", hint)
    if parts.network is None or (parts.geography is None and parts.storm is None):
        return
    table, inline = parts.geography or GeographyTable(), bool(parts.inline.bus_names)
    findings = geography_findings(
        table, parts.network, parts.places, inline=inline, grid_bus=_grid_bus(parts)
    )
    parts.document.add_findings(("geography",), "[geography]", findings)


def geography_findings(
    table: GeographyTable,
    network: Network,
    places: Mapping[str, tuple[float, float]],
    *,
    inline: bool,
    grid_bus: str | None,
) -> Iterator[Finding]:
    """What is wrong with a geography, one finding for all buses that lack the same.

    Args:
        table: the case's.
        network: the network.
        places: what its source has for its buses.
        inline: the network is inline, its places are degrees.
        grid_bus: bus of the first grid connection.
    """
    if table.synthetic and (table.degrees or inline):
        value = "true, and degrees too" if table.degrees else "true, and inline buses"
        hint = "a synthetic geography needs the drawing in a network file; drop the other"
        yield "synthetic", value, "one of the two", hint
        return
    if table.synthetic:
        yield from _anchor(table, network, grid_bus)
    usable = places if table.synthetic or table.degrees or inline else {}
    missing = [name for name in network.bus_names if name not in usable]
    if missing:
        needed = "a place in the network file's drawing" if table.synthetic else "coordinates"
        value = f"{len(missing)} of {len(network.bus_names)} buses without {needed}: "
        hint = _coordinates_hint(table, places)
        yield "", value + _listed(missing), f"{needed} for every bus", hint
    if not table.synthetic:
        far = [n for n in network.bus_names if n in usable and not _on_earth(*usable[n])]
        if far:
            value = f"{len(far)} buses beyond 180 degrees of longitude or 90 of latitude: "
            hint = "a drawing is no map: set synthetic = true and an anchor"
            yield "degrees", value + _listed(far), "degrees of longitude and latitude", hint
        elif not missing:
            yield from _stretched(network, places)


def _stretched(network: Network, places: Mapping[str, tuple[float, float]]) -> Iterator[Finding]:
    """Long lines without reactance to speak of: a drawing, or a slip in a coordinate."""
    from pyproj import Geod

    lon, lat = np.array([places[name] for name in network.bus_names]).T
    i, j = network.from_bus, network.to_bus
    km = np.asarray(Geod(ellps="WGS84").inv(lon[i], lat[i], lon[j], lat[j])[2]) / 1000.0
    ohm = np.abs(network.x_pu) * network.vn_kv[i] ** 2
    odd = (network.vn_kv[i] == network.vn_kv[j]) & (km > _LONG_KM)
    odd &= network.in_service & (ohm < _MIN_OHM_PER_KM * km)
    if odd.any():
        lines = [f"{network.line_names[k]}, {km[k]:.0f} km" for k in np.flatnonzero(odd)]
        count = "1 line" if len(lines) == 1 else f"{len(lines)} lines"
        value = f"{count} too long for the reactance: {_listed(lines, 5)}"
        allowed = f"{_MIN_OHM_PER_KM:g} ohm per km or more"
        hint = "a slip in a coordinate, or a drawing: then set synthetic = true and an anchor"
        yield "", value, allowed, hint


def _anchor(table: GeographyTable, network: Network, grid_bus: str | None) -> Iterator[Finding]:
    for key in ("anchor_lat_deg", "anchor_lon_deg"):
        if getattr(table, key) is None:
            hint = "a synthetic geography is laid out from a point that the case names"
            yield key, "nothing", "a value", hint
    bus = table.anchor_bus or grid_bus
    if bus is None:
        yield "anchor_bus", "nothing, and no [[grid]]", "a bus of the network", "name the bus"
    elif table.anchor_bus and not network.has_bus(table.anchor_bus):
        hint = network.bus_hint(table.anchor_bus)
        yield "anchor_bus", show(table.anchor_bus), "a bus of the network", hint


def _coordinates_hint(table: GeographyTable, places: Mapping[str, tuple[float, float]]) -> str:
    if places and not table.synthetic and all(_on_earth(*place) for place in places.values()):
        return (
            "if the network file's coordinates are degrees, set degrees = true in [geography]; "
            "if they are a drawing, set synthetic = true"
        )
    return _COORDINATES_HINT


def _grid_bus(parts: Parts) -> str | None:
    return next((grid.bus for grid, _ in parts.devices.get("grid", []) if grid.bus), None)


def _on_earth(lon: float, lat: float) -> bool:
    return -180.0 <= lon <= 180.0 and -90.0 <= lat <= 90.0


def _listed(names: list[str], max_listed: int = 40) -> str:
    return ", ".join(names[:max_listed]) + (", ..." if len(names) > max_listed else "")
