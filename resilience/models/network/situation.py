"""What the world is like at every node: profiles, line status, and which buses still have a source.

Components turn a situation into the data of a problem. Line status is an input; islands follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.network.islands import Islands


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
    """

    profile: Callable[[str | None], Floats]
    names: Labels
    ends: Ints
    line_up: Bools
    forming: Bools
    n: int
    islands: Islands | None = None

    @cached_property
    def _islands(self) -> tuple[Ints, Floats]:
        return (self.islands or Islands(self.ends, self.forming)).lookup(self.line_up)

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
