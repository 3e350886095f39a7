"""Rules for several grid connections: what may stand at one bus, and what may feed one tree."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from resilience.arrays import Bools, Ints
from resilience.case.checks.parts import Parts
from resilience.case.networks.network import Network
from resilience.tolerances import INPUT_TOLERANCE

Placed = list[tuple[Any, str, int]]
"""Tables `[[grid]]` with their titles in messages and the positions of their buses."""


def check_grids(parts: Parts, network: Network) -> None:
    """Notes grids that cannot stand together: two voltages in one place, or one tree with two."""
    grids = [
        (grid, title, network.bus(grid.bus))
        for grid, title in parts.devices.get("grid", [])
        if grid.bus and network.has_bus(grid.bus)
    ]
    fixed = network.in_service & ~network.switchable
    short = fixed & (network.r_pu == 0.0) & (network.x_pu == 0.0) & (network.tap == 1.0)
    _check_voltages(parts, grids, _joined(network, short))
    if not network.parallel_grids:
        # What loops may join cannot be kept apart by counting the lines of trees.
        loops = network.in_service | network.switchable
        _check_parallel(parts, grids, _joined(network, fixed if network.radial else loops))


def _joined(network: Network, lines: Bools) -> Ints:
    """(buses,) number of the group that each bus belongs to when `lines` (lines,) join buses."""
    ends = network.from_bus[lines], network.to_bus[lines]
    n = len(network.bus_names)
    graph = sp.coo_array((np.ones(len(ends[0])), ends), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.intp)


def _check_voltages(parts: Parts, grids: Placed, group: Ints) -> None:
    """Notes two voltages at one bus, or at buses that lines without impedance make one."""
    first: dict[int, tuple[Any, str]] = {}
    for grid, title, bus in grids:
        before, title_before = first.setdefault(int(group[bus]), (grid, title))
        if grid.v_pu is None or before.v_pu is None:
            continue
        if abs(grid.v_pu - before.v_pu) > INPUT_TOLERANCE:
            value = f"{grid.v_pu:g}, where {title_before} at bus {before.bus} holds {before.v_pu:g}"
            allowed, hint = "one voltage at one bus", "give both the same v_pu, or a bus each"
            where = ("grid", str(grid.name), "v_pu")
            parts.document.add(where, title, "v_pu", value, allowed, hint)


def _check_parallel(parts: Parts, grids: Placed, group: Ints) -> None:
    """Notes grids at several buses that lines connect which nothing keeps open."""
    together = defaultdict(list)
    for entry in grids:
        together[int(group[entry[2]])].append(entry)
    for entries in together.values():
        if len({place for _, _, place in entries}) > 1:
            grid, title, _ = entries[-1]
            names = " and ".join(
                f"{table_title} ({table.bus})" for table, table_title, _ in entries
            )
            allowed = "one bus with a grid per tree of closed lines"
            hint = (
                "set parallel_grids = true in [network] if they may run in parallel, mark a line "
                "between them switchable, or open one"
            )
            where, value = ("grid", str(grid.name), "bus"), f"{names} on closed lines"
            parts.document.add(where, title, "bus", value, allowed, hint)
