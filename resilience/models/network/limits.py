r"""What lines can be asked to carry: limits that no plan of the model ever reaches.

Bounds from multipliers need finite bounds on flows and squared currents, and the rows of switches
need them small. They come from what devices can do, which is linear in the profiles that they
follow, so that the limits of a slot hold for whatever profiles and forecasts it brings.

A line of a tree parts the buses in two. Without losses, what flows from one side A to the other B
is what A feeds in and B takes,

$$ F_{A \to B} = \min\{\textstyle\sum_A \overline{s}^\text{in}_k,
\sum_B \overline{s}^\text{out}_k\} $$

for active and for reactive power alike. With losses power is not conserved, but current is: by
Kirchhoff's law that of the line is the sum of the currents of all devices on either side, and a
device of apparent power $S_k$ at a voltage of at least $\underline{V}_k$ draws at most
$S_k / \underline{V}_k$. So, whatever the impedances are and however much is lost in them,

$$ |I| \le \overline{I} = \min\{\textstyle\sum_A S_k / \underline{V}_k,
\sum_B S_k / \underline{V}_k\}, \qquad \ell = |I|^2, \qquad |P_{ij}|, |Q_{ij}| \le
\overline{V}_i \overline{I} $$

Where lines make cycles, the two sides may be any: the smaller of two sums that make up a total is
at most half of it, and the side without a certain bus has at most the total without that bus.

Every limit is `MARGIN` times what is proven here, so that an answer which comes near it contradicts
the proof: `resilience.models.program.referee` looks. The smaller of two sums is chosen once, at
profiles of 1, which keeps limits linear in the profiles; either sum is a limit at any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from resilience.arrays import Floats, Ints

if TYPE_CHECKING:
    from resilience.case import Network

MARGIN = 1.1
"""Of every auxiliary limit over what is proven; more than a polygon adds to a disc, 1.035."""

Profile = Callable[[str | None], Floats]


@dataclass(frozen=True)
class FlowLimits:
    """What lines can be asked to carry, linear in profiles.

    Attributes:
        profiles: that devices follow; None is constant 1.
        peak: (profiles,) the most that each reaches in the horizon, or may reach.
        forth: (lines, profiles) most sent from the first bus, MVA per unit of every profile.
        back: (lines, profiles) most that arrives there, likewise.
        current: (lines, profiles) most current, pu on 1 MVA; None without losses.
    """

    profiles: tuple[str | None, ...]
    peak: Floats
    forth: Floats
    back: Floats
    current: Floats | None = None

    def values(self, profile: Profile, nodes: int) -> Floats:
        """(profiles, nodes) of the profiles."""
        rows = [np.broadcast_to(profile(name), nodes) for name in self.profiles]
        return np.array(rows, float).reshape(len(self.profiles), nodes)


@dataclass(frozen=True)
class Capacity:
    """What the devices at every bus can do, (buses, profiles), MVA per unit of every profile.

    Attributes:
        supply: fed in at most.
        demand: taken at most.
        apparent: apparent power at most, either way.
    """

    supply: Floats
    demand: Floats
    apparent: Floats


def lossless_limits(network: Network, capacity: Capacity) -> tuple[Floats, Floats]:
    """`forth` and `back` of `FlowLimits` without losses.

    Args:
        network: only lines that can be closed.
        capacity: of the devices.
    """
    supply, demand = _sides(network, capacity.supply), _sides(network, capacity.demand)
    if supply is None or demand is None:
        limit = MARGIN * _widest(capacity.supply, capacity.demand)
        wide = np.tile(limit, (len(network.line_names), 1))
        return wide, wide
    forth, back = _smaller(supply[0], demand[1]), _smaller(supply[1], demand[0])
    return MARGIN * forth, MARGIN * back


def current_limits(network: Network, capacity: Capacity, v_min_pu: Floats) -> Floats:
    """(lines, profiles) `current` of `FlowLimits`.

    Args:
        network: only lines that can be closed.
        capacity: of the devices.
        v_min_pu: (buses,) least voltage of every bus.
    """
    drawn = capacity.apparent / v_min_pu[:, None]
    sides = _sides(network, drawn)
    if sides is not None:
        return MARGIN * _smaller(*sides)
    total = drawn.sum(0)
    apart = total - drawn[drawn.sum(1).argmax()]
    limit = _smaller(0.5 * total[None], apart[None])
    return MARGIN * np.tile(limit, (len(network.line_names), 1))


def _smaller(a: Floats, b: Floats) -> Floats:
    """Row by row the one that is smaller at profiles of 1."""
    return np.where((a.sum(1) <= b.sum(1))[:, None], a, b)


def _widest(supply: Floats, demand: Floats) -> Floats:
    """(profiles,) the most that any two groups of buses can send each other.

    Whichever bus is looked at, it stands on the side that sends or on the one that takes.
    """
    sends = _smaller(np.broadcast_to(supply.sum(0), supply.shape), demand.sum(0) - demand)
    takes = _smaller(supply.sum(0) - supply, np.broadcast_to(demand.sum(0), demand.shape))
    either = np.maximum(sends, takes)
    return either[either.sum(1).argmin()]


def _sides(network: Network, values: Floats) -> tuple[Floats, Floats] | None:
    """(lines, profiles) sums of `values` (buses, profiles) on the side of the first bus of every
    line and on that of its second, within its connected part; None where lines make a cycle.
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(len(network.bus_names)))
    graph.add_edges_from(zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True))
    if graph.number_of_edges() < len(network.line_names) or nx.cycle_basis(graph):
        return None
    below, above = values.copy(), np.zeros_like(values)
    order, parent = _rooted(graph)
    for bus in reversed(order):
        if parent[bus] >= 0:
            below[parent[bus]] += below[bus]
    for component in nx.connected_components(graph):
        members = np.fromiter(component, int)
        above[members] = below[members[parent[members] < 0][0]] - below[members]
    above = np.maximum(above, 0.0)  # a difference of equal sums is rounding
    away = (parent[network.to_bus] == network.from_bus)[:, None]
    child = np.where(away.ravel(), network.to_bus, network.from_bus)
    first, second = (
        np.where(away, above[child], below[child]),
        np.where(away, below[child], above[child]),
    )
    return first, second


def _rooted(graph: nx.Graph) -> tuple[list[int], Ints]:
    order: list[int] = []
    parent = np.full(graph.number_of_nodes(), -1)
    for component in nx.connected_components(graph):
        root = min(component)
        order.append(root)
        for up, down in nx.bfs_edges(graph, root):
            parent[down] = up
            order.append(down)
    return order, parent
