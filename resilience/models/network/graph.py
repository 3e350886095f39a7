"""The feeder as a graph: which buses act as one, what a line can be asked to carry, cycles."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from resilience.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from resilience.case import Network


def closable(network: Network) -> Network:
    """The network without the lines that are open and cannot be switched."""
    keep = network.in_service | network.switchable
    return _lines(network, np.flatnonzero(keep))


def merge(network: Network, fallible: Bools) -> tuple[Network, Ints]:
    """Joins buses whose connection can neither fail, nor be switched, nor hit a rating.

    Args:
        network: only lines that can be closed.
        fallible: (lines,) lines that may fail.

    Returns:
        The smaller network, its buses named after their first member, and for every old bus its
        new index (buses,). For lossless transport without voltages the two are equivalent.
    """
    firm = ~fallible & ~network.switchable & np.isinf(network.rating_mva)
    n = len(network.bus_names)
    i, j = network.from_bus[firm], network.to_bus[firm]
    graph = sp.coo_array((np.ones(len(i)), (i, j)), shape=(n, n))
    _, group = connected_components(graph, directed=False)
    # Groups are numbered in the order of their first members, which name them: components come in
    # an order of their own, and the rank of a first member is the new number of its group.
    _, first, group_of = np.unique(group, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    bus_of = rank[group_of.ravel()]
    first = np.sort(first)
    remaining = _lines(network, np.flatnonzero(~firm))
    merged = replace(
        remaining,
        bus_names=tuple(network.bus_names[k] for k in first),
        vn_kv=network.vn_kv[first],
        v_min_pu=network.v_min_pu[first],
        v_max_pu=network.v_max_pu[first],
        from_bus=bus_of[remaining.from_bus],
        to_bus=bus_of[remaining.to_bus],
        aliases={},
    )
    return merged, bus_of


def bundle(network: Network, fallible: Bools) -> Network:
    """Joins parallel lines that are always closed into one with the same terminal behaviour.

    Admittances add up; the rating is reached when the first of them reaches its own.

    Args:
        network: only lines that can be closed.
        fallible: (lines,) lines that may fail; they stay alone.
    """
    firm = network.in_service & ~network.switchable & ~fallible
    groups: dict[tuple[int, int], list[int]] = {}
    for k in np.flatnonzero(firm):
        ends = sorted((int(network.from_bus[k]), int(network.to_bus[k])))
        groups.setdefault((ends[0], ends[1]), []).append(int(k))
    parallel = [members for members in groups.values() if len(members) > 1]
    if not parallel:
        return network
    r, x, rating = network.r_pu.copy(), network.x_pu.copy(), network.rating_mva.copy()
    keep = np.ones(len(r), bool)
    for members in parallel:
        admittance = 1.0 / (r[members] + 1j * x[members])
        total = admittance.sum()
        rating[members[0]] = (rating[members] * abs(total) / abs(admittance)).min()
        r[members[0]], x[members[0]] = (1.0 / total).real, (1.0 / total).imag
        keep[members[1:]] = False
    joined = replace(network, r_pu=r, x_pu=x, rating_mva=rating)
    return _lines(joined, np.flatnonzero(keep))


def _lines(network: Network, keep: Ints) -> Network:
    chosen = {
        key: getattr(network, key)[keep]
        for key in (
            "from_bus",
            "to_bus",
            "r_pu",
            "x_pu",
            "rating_mva",
            "in_service",
            "switchable",
            "switching_cost",
            "breakpoint",
        )
    }
    names = tuple(network.line_names[k] for k in keep)
    return replace(network, line_names=names, **chosen)


def cycle(network: Network) -> list[str]:
    """Names of the lines of a cycle of closed lines that cannot be switched; empty if none."""
    graph = nx.MultiGraph()
    firm = np.flatnonzero(network.in_service & ~network.switchable)
    for k in firm:
        graph.add_edge(network.from_bus[k], network.to_bus[k], key=network.line_names[k])
    try:
        return [str(edge[2]) for edge in nx.find_cycle(graph)]
    except nx.NetworkXNoCycle:
        return []


def exchange(network: Network, supply: Floats, demand: Floats) -> Floats:
    """(lines,) the most that the two sides of each line can send each other, MVA.

    Args:
        network: only lines that can be closed.
        supply: (buses,) what each bus can feed in at most.
        demand: (buses,) what each bus can take at most.
    """
    limit = np.full(len(network.line_names), _widest(supply, demand))
    graph = nx.Graph()
    graph.add_nodes_from(range(len(network.bus_names)))
    graph.add_edges_from(zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True))
    if graph.number_of_edges() < len(limit) or nx.cycle_basis(graph):
        return limit
    # In a tree a line parts what hangs below its child from everything above it, per component.
    below = np.stack([supply, demand], axis=1)
    above = np.zeros_like(below)
    order, parent = _rooted(graph)
    for bus in reversed(order):
        if parent[bus] >= 0:
            below[parent[bus]] += below[bus]
    for component in nx.connected_components(graph):
        members = np.fromiter(component, int)
        above[members] = below[members[parent[members] < 0][0]] - below[members]
    child = np.where(parent[network.to_bus] == network.from_bus, network.to_bus, network.from_bus)
    into = np.minimum(above[child, 0], below[child, 1])
    out = np.minimum(below[child, 0], above[child, 1])
    return np.maximum(into, out)


def _widest(supply: Floats, demand: Floats) -> float:
    """The most that any two groups of buses can send each other, wherever one bus of them is."""
    total_supply, total_demand = supply.sum(), demand.sum()
    # The bus stands on the side that sends, or on the one that takes.
    sending = np.minimum(total_supply, total_demand - demand)
    taking = np.minimum(total_supply - supply, total_demand)
    return float(np.maximum(sending, taking).min())


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
