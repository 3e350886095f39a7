"""Rules that join the tables of a case."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from resilience.case.checks.failing import check_failing
from resilience.case.checks.grids import check_grids
from resilience.case.checks.parts import Parts
from resilience.case.checks.rules import broken_rules, check_units
from resilience.case.checks.tanks import check_tanks
from resilience.case.networks.network import Network
from resilience.case.reading import show
from resilience.case.schema import DEVICES
from resilience.case.tariff import wrong_tariff


def check_parts(parts: Parts) -> None:
    """Checks everything that joins two keys or two tables; mistakes go to the document."""
    for kind, device, title in parts.all_devices():
        parts.document.add_findings((kind, str(device.name)), title, broken_rules(kind, device))
    _check_names(parts)
    _check_prices(parts)
    check_tanks(parts)
    check_failing(parts)
    _check_forming(parts)
    if parts.network is not None:
        _check_lines(parts, parts.network)
        _check_buses(parts, parts.network)
        _check_voltages(parts, parts.network)
        check_grids(parts, parts.network)
        check_units(parts, parts.network)
        if parts.inline.complete:
            _check_connected(parts, parts.network)


def _check_names(parts: Parts) -> None:
    users = defaultdict(list)
    tanks = (("tank", tank, title) for tank, title in parts.tanks)
    for kind, device, title in (*parts.all_devices(), *tanks):
        if device.name:
            users[device.name].append((kind, title))
    for name, places in users.items():
        if len(places) > 1:
            kind, title = places[-1]
            value = f"{show(name)}, used by " + " and ".join(t for _, t in places)
            hint = "rename all but one; results are keyed by name"
            parts.document.add((kind, name), title, "name", value, "names used once", hint)
    line_names = set()
    for line, title in parts.lines:
        if line.name in line_names:
            hint = "put all keys of a line into one [[line]] table"
            parts.document.add(("line", line.name), title, "name", "a second table", "one", hint)
        line_names.add(line.name)


def _check_prices(parts: Parts) -> None:
    """Checks tariffs, and that imports have a price at all."""
    for grid, title in parts.devices.get("grid", []):
        name = str(grid.name)
        keys = _keys_in_file(parts, "grid", name)
        for key, value, allowed, hint in () if grid.tariff is None else wrong_tariff(grid.tariff):
            parts.document.add(("grid", name, "tariff"), title, key, value, allowed, hint)
        if keys.isdisjoint(("tariff", "import_cost_per_mwh")):
            key, hint = "import_cost_per_mwh", "add import_cost_per_mwh = ..., or tariff = ..."
            parts.document.add(("grid", name, key), title, key, "nothing", "a value", hint)
        if grid.export_tariff_factor is not None and "tariff" not in keys:
            key, value = "export_tariff_factor", f"{grid.export_tariff_factor:g}"
            hint = "add tariff = ..., or set export_cost_per_mwh in its place"
            where = ("grid", name, key)
            parts.document.add(where, title, key, value, "a multiple of a tariff", hint)


def _keys_in_file(parts: Parts, kind: str, name: str) -> set[str]:
    """The keys that a device has in the file, its defaults included."""
    return {*parts.document.defaults(kind), *parts.document.stated_keys(kind, name)}


def _check_forming(parts: Parts) -> None:
    kinds = [k for k, d in DEVICES.items() if "grid_forming" in d.table.model_fields]
    units = [device for kind in kinds for device, _ in parts.devices.get(kind, [])]
    if all(unit.grid_forming is False for unit in units):
        names = [f"[[{kind}]]" for kind in kinds]
        none = f"no {', '.join(names[:-1])} or {names[-1]}"
        value = f"false for all {len(units)} units" if units else none
        hint = "without a grid-forming unit every bus is dead; add one"
        parts.document.add((), "", "grid_forming", value, "true for at least one unit", hint)


def _check_lines(parts: Parts, network: Network) -> None:
    for line, title in parts.lines:
        if line.name and not (network.has_line(line.name) or line.name in parts.inline.line_names):
            where, hint = ("line", line.name), network.line_hint(line.name)
            parts.document.add(where, title, "name", show(line.name), "a line of the network", hint)


def _check_buses(parts: Parts, network: Network) -> None:
    for kind, device, title in parts.all_devices():
        exists = network.has_bus(device.bus) or device.bus in parts.inline.bus_names
        if device.bus and not exists:
            where, hint = (kind, str(device.name), "bus"), network.bus_hint(device.bus)
            parts.document.add(where, title, "bus", show(device.bus), "a bus of the network", hint)


def _check_voltages(parts: Parts, network: Network) -> None:
    wrong = np.flatnonzero(network.v_min_pu > network.v_max_pu)
    if wrong.size:
        i = int(wrong[0])
        value = f"{network.v_min_pu[i]:g} at bus {network.bus_names[i]}"
        allowed, hint = f"at most v_max_pu = {network.v_max_pu[i]:g}", "swap the two limits"
        parts.document.add(("network", "v_min_pu"), "[network]", "v_min_pu", value, allowed, hint)
    for grid, title in parts.devices.get("grid", []):
        if grid.v_pu is None or not grid.bus or not network.has_bus(grid.bus):
            continue
        i = network.bus(grid.bus)
        low, high = network.v_min_pu[i], network.v_max_pu[i]
        if low <= high and not low <= grid.v_pu <= high:
            allowed = f"{low:g} to {high:g}, the limits of bus {grid.bus}"
            where, hint = ("grid", str(grid.name), "v_pu"), "per unit of vn_kv; or widen the limits"
            parts.document.add(where, title, "v_pu", f"{grid.v_pu:g}", allowed, hint)


def _check_connected(parts: Parts, network: Network) -> None:
    """Refuses parts that no usable line joins to the largest one and that have no [[grid]]."""
    grids = {
        network.bus(grid.bus)
        for grid, _ in parts.devices.get("grid", [])
        if grid.bus and network.has_bus(grid.bus)
    }
    islands = [island for island in cut_off(network) if not grids.intersection(island)]
    if islands:
        count = sum(map(len, islands))
        names = [network.bus_names[i] for island in islands for i in island]
        few = ", ".join(names[:5]) + (", ..." if count > 5 else "")
        value = f"{count} of {len(network.bus_names)} buses cut off: {few}"
        allowed = "one connected network, switchable lines closed, or a [[grid]] in every part"
        hint = "add the missing line, or set in_service or switchable on one"
        parts.document.add(("network",), "[network]", "", value, allowed, hint)


def cut_off(network: Network) -> list[list[int]]:
    """Parts without a path to the largest one, every usable line closed; positions of buses."""
    neighbours: list[list[int]] = [[] for _ in network.bus_names]
    usable = network.in_service | network.switchable
    ends = (network.from_bus[usable].tolist(), network.to_bus[usable].tolist())
    for start, stop in zip(*ends, strict=True):
        neighbours[start].append(stop)
        neighbours[stop].append(start)
    unreached = set(range(len(network.bus_names)))
    parts = []
    while unreached:
        connected = [min(unreached)]
        unreached.discard(connected[0])
        for bus in connected:  # grows while it is walked through
            new = unreached.intersection(neighbours[bus])
            unreached -= new
            connected.extend(new)
        parts.append(sorted(connected))
    return sorted(parts, key=len, reverse=True)[1:]
