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

That is for trees, and for ties of which none closes a loop. What goes round in a loop is in
`resilience.models.network.circuit`.

Whatever flows to earth at a bus, shunts and charging, is a device of the size $|y| \overline{V}^2$,
and of the current $|y| \overline{V}$. A ratio $a$ makes currents larger by $|a|$ and voltages
smaller. So currents are summed in one frame, in which all ratios are 1: every bus has a scale
$\kappa$ with $\kappa_i = |a| \kappa_j$ for every line, and its currents count times $\kappa$.
Where parallel branches have different ratios no frame fits, and the product of all ratios is taken
instead; besides, a current circulates in them, by what their voltages differ.

Every limit is `MARGIN` times what is proven here, so that an answer which comes near it contradicts
the proof: `resilience.models.program.referee` looks. The smaller of two sums is chosen once, at
profiles of 1, which keeps limits linear in the profiles; either sum is a limit at any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints
from resilience.models.network.graph import along_trees, parallel_groups

if TYPE_CHECKING:
    from resilience.case import Network

MARGIN = 1.1
"""Of every auxiliary limit over what is proven; more than a polygon adds to a disc, 1.035."""

LOOP_ROOM = 2.0
"""Of a line in a loop over what devices draw in all, where its circuit does not tell."""

SHORT_PU = 1e-6
"""In place of an impedance of zero, in what circulates."""

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
        proven: whether no plan can reach them, or whether they are audited alone.
    """

    profiles: tuple[str | None, ...]
    peak: Floats
    forth: Floats
    back: Floats
    current: Floats | None = None
    proven: bool = True

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
        return wide, wide.copy()
    forth, back = _smaller(supply[0], demand[1]), _smaller(supply[1], demand[0])
    return MARGIN * forth, MARGIN * back


def current_limits(
    network: Network, capacity: Capacity, v_min_pu: Floats, earth: Floats | float = 0.0
) -> Floats:
    """(lines, profiles) `current` of `FlowLimits`.

    Args:
        network: only lines that can be closed.
        capacity: of the devices.
        v_min_pu: (buses,) least voltage of every bus.
        earth: (buses, 1) most current of all admittances to earth at every bus, pu.
    """
    drawn = capacity.apparent / v_min_pu[:, None]
    drawn[:, :1] += earth
    scale, widest = _scales(network)
    drawn = drawn * scale[:, None]
    behind = widest / scale[network.to_bus][:, None]  # a ratio from the frame to that of the line
    sides = _sides(network, drawn)
    if sides is not None:
        return MARGIN * _smaller(*sides) * behind
    total = drawn.sum(0)
    apart = total - drawn[drawn.sum(1).argmax()]
    limit = _smaller(0.5 * total[None], apart[None])
    return MARGIN * np.tile(limit, (len(network.line_names), 1)) * behind


def admittances(network: Network) -> tuple[Floats, Floats]:
    """(buses,) what of its admittances to earth feeds in, and what takes, at 1 pu: MVA.

    Those of lines that are open are among them; nothing is set off against anything else.
    """
    n, lines = len(network.bus_names), network
    bus = np.concatenate([np.arange(n), lines.from_bus, lines.to_bus])
    y = np.concatenate([lines.y_bus_pu, lines.y_from_pu / lines.tap**2, lines.y_to_pu])
    feeds, takes = np.zeros((2, n))
    np.add.at(feeds, bus, np.maximum(np.maximum(-y.real, y.imag), 0.0))
    np.add.at(takes, bus, np.maximum(np.maximum(y.real, -y.imag), 0.0))
    return feeds, takes


def circulation(network: Network, v_max_pu: Floats) -> Floats:
    """(lines,) shorted current, pu, that different ratios of parallel branches drive round in them.

    That of two is their difference in voltage over both impedances. Of more, each drives at shorted
    that into every other, as long as resistances and reactances have one sign; where they have
    not, or the branches do not point alike, it is what a short circuit would let through.
    """
    current = np.zeros(len(network.line_names))
    z, v_max = network.r_pu + 1j * network.x_pu, v_max_pu
    i, shorted = network.from_bus, short_circuit(network, v_max_pu)
    for members in parallel_groups(network):
        if len(set(network.ratio[members].tolist())) == 1:
            continue
        alike = len(set(i[members].tolist())) == 1
        if alike and (network.r_pu[members] >= 0).all() and (network.x_pu[members] >= 0).all():
            for p, k in permutations(members, 2):
                apart = v_max[i[p]] * abs(1.0 / network.ratio[p] - 1.0 / network.ratio[k])
                current[p] += apart / max(abs(z[p] + z[k]), SHORT_PU)
        else:
            current[members] = shorted[members]
    return MARGIN * current


def short_circuit(network: Network, v_max_pu: Floats) -> Floats:
    """(lines,) the current, pu, that no line exceeds whatever the others do: both voltages over z.

    Args:
        network: its impedances.
        v_max_pu: (buses,) highest voltage.
    """
    volts = v_max_pu[network.from_bus] / network.tap + v_max_pu[network.to_bus]
    return np.asarray(volts / np.maximum(np.hypot(network.r_pu, network.x_pu), SHORT_PU))


def with_loops(
    network: Network, loops: Bools, mismatched: Complexes, v_max_pu: Floats
) -> tuple[Floats, Floats]:
    """(lines,) factor of what lines can be asked to carry, and current besides, pu, in loops.

    What is known is proven by its circuit (`resilience.models.network.circuit`). Elsewhere, where
    lines can be out in too many ways: of impedances of one angle no line carries more than all
    devices draw; where angles differ some goes round: there is room for twice as much, and the
    referee looks whether it is enough. Ratios that do not fit drive at most their voltage over the
    impedance of their own line.

    Args:
        network: only lines that can be closed.
        loops: (lines,) those in a cycle.
        mismatched: (lines,) ratio that is left of each round its loop.
        v_max_pu: (buses,) highest voltage.
    """
    volts = v_max_pu[network.from_bus] * np.abs(1.0 - mismatched) / network.tap
    z = np.maximum(np.hypot(network.r_pu, network.x_pu), SHORT_PU)
    driven = float((volts / z)[loops].sum())
    return np.where(loops, LOOP_ROOM, 1.0), np.where(loops, MARGIN * driven, 0.0)


def _scales(network: Network) -> tuple[Floats, float]:
    """(buses,) scale of every bus, and 1; or ones and the product of all ratios if none fits."""
    tap = network.tap
    if (tap == 1.0).all():
        return np.ones(len(network.bus_names)), 1.0
    scale = along_trees(network, tap)
    fits = np.isclose(scale[network.from_bus], tap * scale[network.to_bus], rtol=1e-9)
    if fits.all():
        return scale, 1.0
    return np.ones(len(scale)), float(np.maximum(tap, 1.0 / tap).prod())


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
