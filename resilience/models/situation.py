"""What the world is like at every node: profiles, line status, and which buses still have a source.

Components turn a situation into the data of a problem. Line status is an input; islands follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from resilience.models.algebra import Floats, Ints, Labels

Bools = np.ndarray


@dataclass(frozen=True)
class Situation:
    """Arrays over the nodes of a tree.

    Attributes:
        profile: name (or None for constant 1) to per-unit values, (nodes,).
        names: the lines of the network, in the order of the arrays below.
        ends: (2, lines) bus indices of every line.
        line_up: (lines, nodes) whether a line can carry power: not failed, and closed or closable.
        forming: (buses,) whether a bus has a grid-forming unit.
        n: number of nodes.
    """

    profile: Callable[[str | None], Floats]
    names: Labels
    ends: Ints
    line_up: Bools
    forming: Bools
    n: int

    @cached_property
    def island(self) -> Ints:
        """(buses, nodes) number of the island that each bus belongs to, from 0."""
        buses, packed = len(self.forming), np.packbits(self.line_up, axis=0)
        _, first, at = np.unique(packed, axis=1, return_index=True, return_inverse=True)
        # All patterns side by side in one graph, because a search costs more to begin than to do.
        line, pattern = np.nonzero(self.line_up[:, first])
        i, j = self.ends[:, line] + pattern * buses
        n = buses * len(first)
        graph = sp.coo_array((np.ones(len(i)), (i, j)), shape=(n, n))
        found = connected_components(graph, directed=False)[1].reshape(len(first), buses)
        found = found - found.min(axis=1, keepdims=True, initial=n)
        islands: Ints = found.T[:, at.ravel()].astype(np.intp)
        return islands

    @cached_property
    def alive(self) -> Floats:
        """(buses, nodes) 1 where the island has a forming unit, 0 where it is dead."""
        island = self.island
        has_source = np.zeros((island.max(initial=0) + 1, self.n), bool)
        nodes = np.broadcast_to(np.arange(self.n), island.shape)
        has_source[island[self.forming], nodes[self.forming]] = True
        return has_source[island, nodes].astype(float)

    def alive_at(self, bus: Ints) -> Floats:
        """(devices, nodes) `alive` of the buses where devices stand."""
        return self.alive[bus]
