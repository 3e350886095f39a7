"""What the world is like at every node: profiles, line status, and which buses still have a source.

Components turn a situation into the data of a program. Line status is an input; islands follow,
looked up by the pattern of lines that are up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Labels


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
        islands: what is known of the network's islands; found anew if omitted.
        forming_now: (buses, nodes) whether a grid-forming unit there is in order and running, and
            has energy to give; wherever `forming` is true if omitted.
        units: names of the units whose status is known; all others are in order.
        unit_up: (units, nodes) False where one of these is out; None where there are none.
        line_up_before: (lines, nodes) `line_up` one slot before; None: no outage begins.
        is_last: (nodes,) whether the horizon ends with the node; None: with none of them.
        final_price_per_mwh: of a storage's lack of energy where the horizon ends; None: it may
            lack none.
    """

    profile: Callable[[str | None], Floats]
    names: Labels
    ends: Ints
    line_up: Bools
    forming: Bools
    n: int
    islands: Islands | None = None
    forming_now: Bools | None = None
    units: Labels = ()
    unit_up: Bools | None = None
    line_up_before: Bools | None = None
    is_last: Bools | None = None
    final_price_per_mwh: float | None = None

    @cached_property
    def _known_islands(self) -> Islands:
        return self.islands or Islands(self.ends, self.forming)

    @cached_property
    def _islands(self) -> tuple[Ints, Floats]:
        island, alive = self._known_islands.lookup(self.line_up)
        if self.forming_now is not None:
            return island, reached(island, self.forming_now).astype(np.float64)
        return island, alive

    @property
    def island(self) -> Ints:
        """(buses, nodes) number of the island that each bus belongs to, from 0."""
        return self._islands[0]

    @property
    def alive(self) -> Floats:
        """(buses, nodes) 1 where the island has a forming unit, 0 where it is dead."""
        return self._islands[1]

    def alive_at(self, bus: Ints) -> Floats:
        """(devices, nodes) `alive` of the buses where devices stand."""
        return self.alive[bus]

    def works(self, names: Sequence[str]) -> Bools:
        """(names, nodes) or (names, 1) False where a unit is out."""
        if self.unit_up is None or not any(name in self.units for name in names):
            return np.ones((len(names), 1), bool)
        always = np.ones((1, self.n), bool)
        place = {name: k for k, name in enumerate(self.units)}
        return np.concatenate([self.unit_up, always])[[place.get(name, -1) for name in names]]

    @cached_property
    def outage_begins(self) -> Bools:
        """(buses, nodes) whether a line fails that belonged to the bus's island a slot before."""
        before = self.line_up_before
        if before is None:
            return np.zeros((len(self.forming), self.n), bool)
        island, _ = self._known_islands.lookup(before)
        is_end = np.zeros(island.shape, bool)
        line, node = np.nonzero(before & ~self.line_up)
        is_end[self.ends[0, line], node] = True
        return reached(island, is_end)


def reached(island: Ints, holds: Bools) -> Bools:
    """(buses, nodes) whether `holds` (buses, nodes) at any bus of the bus's island."""
    nodes = np.broadcast_to(np.arange(island.shape[1]), island.shape)
    in_island = np.zeros((island.max(initial=0) + 1, island.shape[1]), bool)
    in_island[island[holds], nodes[holds]] = True
    return in_island[island, nodes]


MAX_NUMBERS = 1 << 24  # numbers kept per table before it starts anew: 0.3 GB in all


@dataclass
class Islands:
    """Islands of a network, found once per pattern of line status, radial or meshed.

    Attributes:
        ends: (2, lines) bus indices of every line.
        forming: (buses,) whether a bus has a grid-forming unit.
    """

    ends: Ints
    forming: Bools
    _column: dict[int | bytes, int] = field(default_factory=dict, repr=False)
    _island: Ints = field(init=False, repr=False)
    _alive: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._forget()

    @property
    def patterns(self) -> int:
        """How many patterns are known."""
        return len(self._column)

    def lookup(self, line_up: Bools) -> tuple[Ints, Floats]:
        """(buses, nodes) number of every bus's island, from 0, and 1 where that has a source.

        Args:
            line_up: (lines, nodes) whether a line can carry power.
        """
        keys, first, pattern = np.unique(_keys(line_up), return_index=True, return_inverse=True)
        names = keys.tolist()
        new = [k for k, name in enumerate(names) if name not in self._column]
        if new:
            self._learn([names[k] for k in new], line_up[:, first[new]])
            # To learn may have been to forget: then what was known before is learnt, too.
            if any(name not in self._column for name in names):
                self._learn(names, line_up[:, first])
        columns = np.array([self._column[name] for name in names], np.intp)[pattern]
        return self._island[:, columns], self._alive[:, columns]

    def _forget(self) -> None:
        self._column.clear()
        self._island = np.empty((len(self.forming), 0), np.intp)
        self._alive = np.empty((len(self.forming), 0))

    def _learn(self, names: list[int | bytes], line_up: Bools) -> None:
        if self._island.size + line_up.shape[1] * len(self.forming) > MAX_NUMBERS:
            self._forget()
        start = self._island.shape[1]
        self._column.update({name: start + k for k, name in enumerate(names)})
        island = self._search(line_up)
        forming = np.broadcast_to(self.forming[:, None], island.shape)
        self._island = np.concatenate([self._island, island], axis=1)
        self._alive = np.concatenate([self._alive, reached(island, forming) * 1.0], axis=1)

    def _search(self, line_up: Bools) -> Ints:
        """All patterns side by side in one graph: a search costs more to begin than to do."""
        buses, patterns = len(self.forming), line_up.shape[1]
        line, pattern = np.nonzero(line_up)
        i, j = self.ends[:, line] + pattern * buses
        n = buses * patterns
        graph = sp.coo_array((np.ones(len(i)), (i, j)), shape=(n, n))
        number = connected_components(graph, directed=False)[1].reshape(patterns, buses)
        number = number - number.min(axis=1, keepdims=True, initial=n)  # from 0 in every pattern
        return number.T.astype(np.intp)


def _keys(line_up: Bools) -> np.ndarray:
    """(nodes,) one number, or one string of bytes, per pattern."""
    lines = len(line_up)
    if lines <= 64:
        return (np.uint64(1) << np.arange(lines, dtype=np.uint64)) @ line_up.astype(np.uint64)
    packed = np.ascontiguousarray(np.packbits(line_up, axis=0).T)
    return packed.view(np.dtype((np.void, packed.shape[1]))).ravel()
