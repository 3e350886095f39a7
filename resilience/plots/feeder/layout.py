"""Where the buses of a feeder are drawn: their coordinates, or else a tree that hangs together.

The tree is a one-line diagram: a step to the right for every line from the grid on, the way to the
most buses straight ahead, and every lateral on a row of its own below those before it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.schema import GridTable

MAX_LAT_DEG = 85.0


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the buses of a case, in the order of its network.

    Attributes:
        x: (buses,) to the right, from 0; the longer side of the drawing is 1.
        y: (buses,) upwards, likewise.
        is_computed: no source states them.
    """

    x: Floats
    y: Floats
    is_computed: bool


def layout(case: Case) -> Layout:
    """Where the buses of a case are drawn."""
    names = case.network.bus_names
    if all(name in case.places for name in names):
        x, y = np.array([case.places[name] for name in names], float).reshape(-1, 2).T
        if len(set(zip(x.tolist(), y.tolist(), strict=True))) > len(names) // 2:
            is_earth = case.geography is not None and not case.geography.synthetic
            shrunk = np.cos(np.radians(np.clip(y.mean(), -MAX_LAT_DEG, MAX_LAT_DEG)))
            return _scaled(x * shrunk if is_earth else x, y, is_computed=False)
    return _scaled(*_diagram(case), is_computed=True)


def _scaled(x: Floats, y: Floats, *, is_computed: bool) -> Layout:
    x, y = x - x.min(), y - y.min()
    side = max(float(x.max()), float(y.max()))
    return Layout(x / (side or 1.0), y / (side or 1.0), is_computed)


def _diagram(case: Case) -> tuple[Floats, Floats]:
    """Columns and rows of a one-line diagram; rows grow downwards, so they are negative."""
    children, roots, order = _tree(case)
    sizes = np.ones(len(children), np.intp)
    for bus in reversed(order):
        sizes[bus] += sum(sizes[child] for child in children[bus])
    column, row = np.zeros(len(children)), np.full(len(children), np.nan)
    rows = 0
    stack = roots[::-1]
    while stack:
        bus = stack.pop()
        if np.isnan(row[bus]):
            row[bus], rows = rows, rows + 1
        # The way to the most buses keeps the row; the others get one each when it has been drawn.
        ahead = sorted(children[bus], key=lambda child: (sizes[child], -child))
        column[ahead] = column[bus] + 1.0
        row[ahead[-1:]] = row[bus]
        stack += ahead
    height = max(float(row.max()), 1.0)
    wide = max(float(column.max()), 1.0)
    return column, -row * min(max(0.5 * wide / height, 0.3), 2.0)


def _tree(case: Case) -> tuple[list[list[int]], list[int], list[int]]:
    """Children of every bus, the buses that hang from none, and all of them from the roots on."""
    network = case.network
    neighbours: list[list[tuple[int, int]]] = [[] for _ in network.bus_names]
    for line, (a, b) in enumerate(
        zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True)
    ):
        neighbours[a].append((line, b))
        neighbours[b].append((line, a))
    children: list[list[int]] = [[] for _ in network.bus_names]
    reached: dict[int, None] = {}
    roots: list[int] = []
    for start in _starts(case):
        if start in reached:
            continue
        reached[start] = None
        roots.append(start)
        for usable in (network.in_service, np.ones_like(network.in_service)):
            frontier = list(reached)
            for bus in frontier:
                for line, neighbour in neighbours[bus]:
                    if usable[line] and neighbour not in reached:
                        reached[neighbour] = None
                        children[bus].append(neighbour)
                        frontier.append(neighbour)
    return children, roots, list(reached)


def _starts(case: Case) -> Iterator[int]:
    for grid in case.tables_of(GridTable):
        yield case.network.bus(grid.bus)
    yield from range(len(case.network.bus_names))
