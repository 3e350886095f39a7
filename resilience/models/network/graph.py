"""The feeder as a graph: which buses act as one, which lines are one line, and cycles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import networkx as nx
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from resilience.arrays import Bools, Complexes, Floats, Ints

if TYPE_CHECKING:
    from resilience.case import Network

ROUNDING = 1e-12  # of a product of ratios
Values = TypeVar("Values", Floats, Complexes)


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
    bus_of = joined(network, firm)
    first = np.unique(bus_of, return_index=True)[1]
    remaining = _lines(network, np.flatnonzero(~firm))
    merged = replace(
        remaining,
        bus_names=tuple(network.bus_names[k] for k in first),
        vn_kv=network.vn_kv[first],
        v_min_pu=network.v_min_pu[first],
        v_max_pu=network.v_max_pu[first],
        y_bus_pu=_summed(network.y_bus_pu, bus_of, len(first)),
        from_bus=bus_of[remaining.from_bus],
        to_bus=bus_of[remaining.to_bus],
        aliases={},
    )
    return merged, bus_of


def _summed(values: Complexes, group: Ints, n: int) -> Complexes:
    """(n,) sums of values over groups."""
    total = np.zeros(n, np.complex128)
    np.add.at(total, group, values)
    return total


def joined(network: Network, lines: Bools) -> Ints:
    """(buses,) number of the group of every bus when some `lines` (lines,) join their ends.

    Groups are numbered in the order of their first members.
    """
    n = len(network.bus_names)
    i, j = network.from_bus[lines], network.to_bus[lines]
    graph = sp.coo_array((np.ones(len(i)), (i, j)), shape=(n, n))
    _, group = connected_components(graph, directed=False)
    # Components come in an order of their own: the rank of a first member is the new number.
    _, first, group_of = np.unique(group, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[group_of.ravel()]


def bundle(network: Network, fallible: Bools) -> Network:
    """Joins parallel lines that are always closed into one with the same terminal behaviour.

    Admittances add up; the rating is reached when the first of them reaches its own. Lines without
    impedance carry everything, and share it as their ratings allow: no equation says how. Branches
    with a ratio or charging are joined where they have the same ratio, and charging in proportion
    to their series admittance, so that all of it is shared alike; others stay apart.

    Args:
        network: only lines that can be closed.
        fallible: (lines,) lines that may fail; they stay alone.
    """
    firm = network.in_service & ~network.switchable & ~fallible
    groups: dict[Hashable, list[int]] = {}
    for k in np.flatnonzero(firm).tolist():
        groups.setdefault(_likeness(network, k), []).append(k)
    parallel = [members for members in groups.values() if len(members) > 1]
    if not parallel:
        return network
    r, x, rating = network.r_pu.copy(), network.x_pu.copy(), network.rating_mva.copy()
    y_from, y_to = network.y_from_pu.copy(), network.y_to_pu.copy()
    angle_min, angle_max = network.angle_min_degree.copy(), network.angle_max_degree.copy()
    keep = np.ones(len(r), bool)
    for members in parallel:
        first, z = members[0], r[members] + 1j * x[members]
        joint, rating[first] = _in_parallel(z, rating[members])
        r[first], x[first] = joint.real, joint.imag
        y_from[first], y_to[first] = y_from[members].sum(), y_to[members].sum()
        turned = network.from_bus[members] != network.from_bus[first]
        angle_min[first] = np.where(turned, -angle_max[members], angle_min[members]).max()
        angle_max[first] = np.where(
            turned, -network.angle_min_degree[members], angle_max[members]
        ).min()
        keep[members[1:]] = False
    joined = replace(
        network, r_pu=r, x_pu=x, rating_mva=rating, y_from_pu=y_from, y_to_pu=y_to,
        angle_min_degree=angle_min, angle_max_degree=angle_max,
    )  # fmt: skip
    return _lines(joined, np.flatnonzero(keep))


def _likeness(network: Network, k: int) -> Hashable:
    """What lines have in common that share all they carry as their impedances have it."""
    i, j = int(network.from_bus[k]), int(network.to_bus[k])
    if network.plain[k]:
        return min(i, j), max(i, j)
    z = complex(network.r_pu[k], network.x_pu[k])
    # A share of voltage, so that rounding to 1e-12 tells apart what is worth telling apart.
    shares = [complex(np.round(y * z, 12)) for y in (network.y_from_pu[k], network.y_to_pu[k])]
    return i, j, complex(network.ratio[k]), *shares, None if z else k


def parallel_groups(network: Network) -> list[list[int]]:
    """Indices of the lines between each two buses that are joined at all."""
    groups: dict[tuple[int, int], list[int]] = {}
    for k, ends in enumerate(zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True)):
        groups.setdefault((min(ends), max(ends)), []).append(k)
    return list(groups.values())


def bridges(network: Network) -> Bools:
    """(lines,) lines whose flow the injections determine: those in no cycle of `_joint`."""
    firm = np.flatnonzero(_joint(network))
    graph = nx.MultiGraph()
    graph.add_nodes_from(range(len(network.bus_names)))
    for k in firm:
        graph.add_edge(network.from_bus[k], network.to_bus[k], key=int(k))
    apart = {frozenset(ends) for ends in nx.bridges(nx.Graph(graph))}
    single = np.ones(len(network.line_names), bool)
    for k in firm:
        ends = int(network.from_bus[k]), int(network.to_bus[k])
        single[k] = frozenset(ends) in apart and graph.number_of_edges(*ends) == 1
    return single


def _in_parallel(z: Complexes, rating: Floats) -> tuple[complex, float]:
    """Impedance, pu, and rating, MVA, of lines (n,) side by side."""
    free = z == 0.0
    if free.any():
        return 0j, float(rating[free].sum())
    admittance = 1.0 / z
    total = complex(admittance.sum())
    return 1.0 / total, float((rating * abs(total) / np.abs(admittance)).min())


def _lines(network: Network, keep: Ints) -> Network:
    chosen = {
        key: getattr(network, key)[keep]
        for key in (
            "from_bus",
            "to_bus",
            "r_pu",
            "x_pu",
            "ratio",
            "y_from_pu",
            "y_to_pu",
            "rating_mva",
            "angle_min_degree",
            "angle_max_degree",
            "in_service",
            "switchable",
            "switching_cost",
            "breakpoint",
        )
    }
    names = tuple(network.line_names[k] for k in keep)
    return replace(network, line_names=names, **chosen)


def looped(network: Network) -> Bools:
    """(lines,) lines in a cycle of `_joint`.

    Parallel lines make none, unless one is switchable: what they share follows from impedances.
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(len(network.bus_names)))
    firm = _joint(network)
    graph.add_edges_from(
        zip(network.from_bus[firm].tolist(), network.to_bus[firm].tolist(), strict=True)
    )
    apart = {frozenset(ends) for ends in nx.bridges(graph)}
    pairs = list(map(frozenset, zip(network.from_bus, network.to_bus, strict=True)))
    if not network.radial:
        switched = {pairs[k] for k in np.flatnonzero(network.switchable)}
        apart -= {pair for pair, n in Counter(pairs).items() if n > 1 and pair in switched}
    return firm & np.array([pair not in apart for pair in pairs], bool)


def _joint(network: Network) -> Bools:
    """(lines,) lines that may be closed all at once: what can be switched is kept a tree unless
    the network need not be radial.
    """
    return network.in_service & ~network.switchable | (network.switchable & (not network.radial))


def along_trees(network: Network, ratio: Values) -> Values:
    """(buses,) 1 at one bus of each connected part, divided by the ratios of the lines on the way.

    Args:
        network: only lines that can be closed.
        ratio: (lines,) of every line, from its first end to its second.
    """
    scale = np.ones(len(network.bus_names), ratio.dtype)
    graph = nx.Graph()
    graph.add_nodes_from(range(len(scale)))
    for k, ends in enumerate(zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True)):
        graph.add_edge(*ends, line=k)
    for component in nx.connected_components(graph):
        for near, far in nx.bfs_edges(graph, min(component)):
            k = graph.edges[near, far]["line"]
            forth = network.from_bus[k] == near
            scale[far] = scale[near] / ratio[k] if forth else scale[near] * ratio[k]
    return scale


def mismatch(network: Network) -> Complexes:
    """(lines,) ratio of every line over that of the way through a tree beside it; 1 where they fit.

    Its angle is the phase shift that is left in a loop, its magnitude the tap.
    """
    frame = along_trees(network, network.ratio)
    mismatched = network.ratio * frame[network.to_bus] / frame[network.from_bus]
    return np.where(np.abs(mismatched - 1.0) < ROUNDING, 1.0 + 0j, mismatched)


def cycle(network: Network) -> list[str]:
    """Names of the lines of a cycle of closed lines that cannot be switched; empty if none.

    Parallel lines make none: what they share follows from their impedances.
    """
    graph = nx.Graph()
    firm = np.flatnonzero(network.in_service & ~network.switchable)
    for k in firm:
        graph.add_edge(network.from_bus[k], network.to_bus[k], name=network.line_names[k])
    try:
        return [str(graph.edges[edge]["name"]) for edge in nx.find_cycle(graph)]
    except nx.NetworkXNoCycle:
        return []


def sides(buses: int, from_bus: Ints, to_bus: Ints) -> Bools | None:
    """(lines, buses) whether a bus lies behind a line, on the side of its second bus, of its tree.

    None where lines make a cycle.
    """
    graph = nx.Graph()
    graph.add_nodes_from(range(buses))
    ends = list(zip(from_bus.tolist(), to_bus.tolist(), strict=True))
    graph.add_edges_from(ends)
    if not nx.is_forest(graph) or graph.number_of_edges() < len(ends):
        return None
    behind = np.zeros((len(ends), buses), bool)
    for k, (i, j) in enumerate(ends):
        graph.remove_edge(i, j)
        behind[k, list(nx.node_connected_component(graph, j))] = True
        graph.add_edge(i, j)
    return behind
