"""Where the main grid is lost: which buses no line that is up joins to a connection in order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Ints
from resilience.case.schema import GridTable
from resilience.models.network.graph import closable
from resilience.models.network.situation import Islands

if TYPE_CHECKING:
    from resilience.case import Case

MAX_STATES = 1 << 22  # of lines at nodes, looked at together


class MainGrid:
    """Connections of a case to the grid outside, and the lines that lead to them.

    Lines that may be closed count as closed.

    Args:
        case: network and connections.
        names: of what can fail, lines and units, in the order of their status.
    """

    def __init__(self, case: Case, names: Sequence[str]) -> None:
        self.names = tuple(names)
        network = closable(case.network)
        place = {name: k for k, name in enumerate(network.line_names)}
        self._rows = [k for k, name in enumerate(names) if name in place]
        self._lines = [place[names[k]] for k in self._rows]
        self._up = np.ones(len(network.line_names), bool)
        ends = np.stack([network.from_bus, network.to_bus])
        self._islands = Islands(ends, np.zeros(len(network.bus_names), bool))
        is_line = set(network.line_names)
        row_of = {name: k for k, name in enumerate(names) if name not in is_line}
        self._grids = [
            (network.bus(grid.bus), row_of.get(grid.name)) for grid in case.tables_of(GridTable)
        ]

    def is_lost(self, buses: Ints, down: Bools) -> Bools:
        """(buses, nodes) whether no path leads from a bus to a connection that is in order.

        Args:
            buses: of the case's network.
            down: (names, nodes) what is out.
        """
        nodes, size = down.shape[1], max(MAX_STATES // max(len(self._up), 1), 1)
        lost = np.ones((len(buses), nodes), bool)
        for first in range(0, nodes, size):
            some = slice(first, first + size)
            lost[:, some] = self._lost(buses, down[:, some])
        return lost

    def _lost(self, buses: Ints, down: Bools) -> Bools:
        states, node = np.unique(np.packbits(down, axis=0), axis=1, return_inverse=True)
        down = np.unpackbits(states, axis=0, count=len(down)).astype(bool)
        up = np.repeat(self._up[:, None], down.shape[1], axis=1)
        up[self._lines] = ~down[self._rows]
        island, _ = self._islands.lookup(up)
        lost = np.ones((len(buses), down.shape[1]), bool)
        for bus, row in self._grids:
            works = True if row is None else ~down[row]
            lost &= ~((island[buses] == island[bus]) & works)
        return lost[:, node.ravel()]
