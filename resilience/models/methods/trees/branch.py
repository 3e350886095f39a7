r"""Branch and bound over trees: the bound of every node is a cone program with arcs.

A node knows switches that are closed and switches that are open; graphs tell more. A line between
buses that closed lines already join is open, one without which a live bus would reach no source is
closed. What is branched on is the switch whose fraction wastes most,
$\min(z, 1 - z) \sqrt{r \ell}$.
The node of the least bound is next, so that time is spent where the proof is weakest. A node whose
switches are whole is a commitment: its bound stays, and a plan is made of it.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count

import networkx as nx
import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.case_program import CaseProgram
from resilience.models.methods.trees.oriented import OrientedProgram, oriented
from resilience.tolerances import INTEGRALITY_TOLERANCE

MAX_SWITCHES = 600  # switches times slots, beyond which one bound takes too long


@dataclass(order=True)
class TreeNode:
    """A part of all forests.

    Attributes:
        bound: that none of them costs less than, $.
        number: in the order of creation.
        low: (switches, slots) closed for sure.
        high: likewise, may be closed.
        z: (switches, slots) fractions at its relaxation.
        waste: likewise, what is lost where, by square root.
    """

    bound: float
    number: int
    low: Bools = field(compare=False)
    high: Bools = field(compare=False)
    z: Floats = field(compare=False)
    waste: Floats = field(compare=False)


def can_branch(program: CaseProgram) -> bool:
    """Whether all decisions of a program are switches of trees, few enough, with losses."""
    standard, microgrid = program.standard, program.microgrid
    if not (standard.has("line.closed") and standard.has("line.l")) or microgrid.energised:
        return False
    if microgrid.forming_may_fail or not microgrid.network.radial:
        return False
    closed, integer = standard.columns("line.closed"), standard.integer.copy()
    integer[closed] = integer[standard.columns("topology.root")] = False
    integer[: standard.n_states] = False  # the start is known
    return closed.size <= MAX_SWITCHES and not integer.any()


class TreeBranching:
    """The search over forests of a program in MW and $; `seconds` says how many remain.

    `bound`, $, is proven for all forests that were not handed out as commitments.
    """

    def __init__(self, program: CaseProgram, seconds: Callable[[], float]) -> None:
        self.program, self.seconds = program, seconds
        self.relaxation: OrientedProgram = oriented(program)
        self.graphs = [SlotGraph(program, t) for t in range(program.standard.tree.n)]
        self.numbers, self.nodes = count(), list[TreeNode]()
        self.dropped = np.inf  # the least bound of all nodes that were too dear
        network = program.microgrid.network
        self.r = np.maximum(network.r_pu[network.switchable], 0.0)[:, None]

    @property
    def bound(self) -> float:
        """$ that no forest costs less than, but for those handed out."""
        return min(self.dropped, self.nodes[0].bound if self.nodes else np.inf)

    def leaves(self, cutoff: Callable[[], float]) -> Iterator[tuple[float, Bools]]:
        """Commitments, each with its bound, as the search meets them; it ends when all is proven.

        Args:
            cutoff: $ that a better plan has to stay below, as it is now.
        """
        high = self.relaxation.upper[self.relaxation.closed] > 0.5
        self._push(np.zeros(high.shape, bool), high, -np.inf, cutoff())
        while self.nodes and self.seconds() > 0.0:
            if self.nodes[0].bound >= cutoff():
                break
            node = heapq.heappop(self.nodes)
            fraction = np.minimum(node.z, 1.0 - node.z)
            if fraction.max(initial=0.0) <= INTEGRALITY_TOLERANCE:
                closed = node.z > 0.5
                if self._is_forest(closed):
                    yield node.bound, closed
                    continue
                fraction = (closed & ~node.low).astype(float)  # a cycle that nobody feeds
            place = np.unravel_index(np.argmax(fraction * (node.waste + 1e-9)), fraction.shape)
            for value in (False, True):
                low, up = node.low.copy(), node.high.copy()
                low[place], up[place] = value, value
                self._push(low, up, node.bound, cutoff())

    def _is_forest(self, closed: Bools) -> bool:
        columns = ((graph, closed[:, t].copy()) for t, graph in enumerate(self.graphs))
        return all(graph.settle(values, values) for graph, values in columns)

    def _push(self, low: Bools, high: Bools, bound: float, cutoff: float) -> None:
        """Bounds a node, and keeps it if it may hold a better plan.

        Where time ends its solve, the bound of its parent is all that is known.
        """
        for t, graph in enumerate(self.graphs):
            if not graph.settle(low[:, t], high[:, t]):
                return
        relaxation, seconds = self.relaxation, self.seconds()
        z, waste = 0.5 * (low + high.astype(float)), np.ones(low.shape)
        if seconds > 0.0:
            point = relaxation.cones.solve(*relaxation.box(low, high), seconds)
            bound = max(bound, point.bound)
            if point.z is not None:
                z = np.clip(point.z[relaxation.closed], low, high)
                waste = np.sqrt(np.maximum(point.z[relaxation.current], 0.0) * self.r)
        if bound < cutoff:
            heapq.heappush(self.nodes, TreeNode(bound, next(self.numbers), low, high, z, waste))
        else:
            self.dropped = min(self.dropped, bound)


class SlotGraph:
    """What closed and open switches of one slot say of the others."""

    def __init__(self, program: CaseProgram, slot: int) -> None:
        network, situation = program.microgrid.network, program.situation
        forming = program.microgrid.forming
        self.ends = np.stack([network.from_bus, network.to_bus], axis=1)
        self.switched = np.flatnonzero(network.switchable)
        self.up = situation.line_up[:, slot] & (situation.alive[network.from_bus, slot] > 0.5)
        self.alive = np.flatnonzero(situation.alive[:, slot] > 0.5)
        self.roots, self.buses = np.flatnonzero(forming), len(forming)
        separate = program.microgrid.separate_grids
        self.sure = np.flatnonzero(separate if separate.any() else forming & (forming.sum() == 1))

    def settle(self, low: Bools, high: Bools) -> bool:
        """Closes and opens in place whatever follows; False where no forest is left.

        Args:
            low: (switches,) closed for sure.
            high: (switches,) may be closed.
        """
        changed = True
        while changed:
            group = self._joined(low)
            if group is None:
                return False
            ends = group[self.ends[self.switched]]
            loops = (ends[:, 0] == ends[:, 1]) & high & ~low
            high[loops] = False
            needed = self._needed(high)
            if needed is None:
                return False
            new = needed & ~low
            low[new] = True
            changed = bool(new.any())
        return True

    def _joined(self, low: Bools) -> Ints | None:
        """(buses,) groups that closed lines and sure roots make; None if they make a cycle."""
        group = np.arange(self.buses)
        if len(self.sure):
            group[self.sure] = self.sure[0]
        fixed = self.up.copy()
        fixed[self.switched] = False
        for line in [*np.flatnonzero(fixed), *self.switched[low]]:
            near, far = group[self.ends[line]]
            if near == far and not fixed[line]:
                return None
            group[group == far] = near
        return group

    def _needed(self, high: Bools) -> Bools | None:
        """(switches,) those without which some live bus reaches no source; None if one cannot."""
        graph: nx.MultiGraph = nx.MultiGraph()
        graph.add_node(-1)
        graph.add_nodes_from(self.alive.tolist())
        source = set(self.roots.tolist())
        may = self.up.copy()
        may[self.switched] &= high
        for line in np.flatnonzero(may).tolist():
            a, b = (-1 if bus in source else bus for bus in self.ends[line].tolist())
            graph.add_edge(a, b, line=line)
        reached = nx.node_connected_component(graph, -1)
        if any(bus not in reached and bus not in source for bus in self.alive.tolist()):
            return None
        single = nx.Graph(graph)
        single.remove_edges_from(nx.selfloop_edges(single))
        needed = np.zeros(len(self.ends), bool)
        for a, b in nx.bridges(single):
            if graph.number_of_edges(a, b) == 1:
                needed[single.edges[a, b]["line"]] = True
        return needed[self.switched]
