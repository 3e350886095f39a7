r"""What lines of a mesh can be asked to carry, from its circuit: proven, whatever its impedances.

Currents follow from those that devices draw. In the frame of `graph.along_trees` all ratios are 1
but for what is left of them round a loop, $m = 1 + \epsilon$, which drives a current, and takes one
at the first end:

$$ A^\top I = J - N I, \qquad \hat{z} I = A U + e, \qquad |e_l| \le |1 / m_l - 1| |U_i|, \qquad
N_{il} = 1 / m_l^* - 1 $$

So $I = H (J - N I) + D e$ with the transfer matrices of the impedances. What is drawn in an island
sums up to zero, so that any $c_l$ may be taken off a row of H, and

$$ |I| \le W |J| + |D| |e| + W |N| |I|, \qquad W_{lk} = |H_{lk} - c_l| $$

of which the last term is moved to the left. With $c_l$ well chosen W is at most a half where
impedances have one angle. Where angles differ it is more, and with reactances of both signs it may
be many times more. Lines may be out: W and |D| are the most over all sets of lines of loops that
are, as long as these can be counted.

Source: the current divider; I - D Z is the cut projection of the weighted graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components

from resilience.arrays import Bools, Complexes, Floats, Ints
from resilience.models.network.graph import along_trees, bridges, mismatch, parallel_groups
from resilience.models.network.limits import SHORT_PU

if TYPE_CHECKING:
    from resilience.case import Network

MAX_SETS = 256
"""Of lines that are out, which are gone through."""
MAX_WORK = 3e9
"""Operations of dense algebra for all sets: a second or two."""
LEAST_MARGIN = 1e-2
"""By which 1 exceeds what currents of ratios drive by themselves, below which nothing is told."""


@dataclass(frozen=True)
class _Circuit:
    """A network in its frame.

    Attributes:
        first, second: (lines,) buses at the ends.
        y: (lines,) admittances in the frame.
        drawn: (buses,) how much is drawn there, as weights of what matters.
    """

    first: Ints
    second: Ints
    y: Complexes
    drawn: Floats

    def over_sets(self, free: Ints) -> tuple[Floats, Floats] | None:
        """(lines, buses) W and (lines, lines) |D|, the most over all sets of `free` lines out."""
        n, lines = len(self.drawn), len(self.y)
        if 2.0 ** len(free) > MAX_SETS or 2.0 ** len(free) * (n + lines) ** 3 > MAX_WORK:
            return None
        weights, drives = np.zeros((lines, n)), np.zeros((lines, lines))
        for up in _sets(lines, free):
            try:
                w, d = self.transfer(up)
            except np.linalg.LinAlgError:  # an exact resonance
                return None
            weights, drives = np.maximum(weights, w), np.maximum(drives, d)
        return weights, drives

    def transfer(self, up: Bools) -> tuple[Floats, Floats]:
        """(lines, buses) W and (lines, lines) |D| with these lines up; zero rows of others."""
        n, lines = len(self.drawn), len(self.y)
        island = self._islands(up)
        ground = np.unique(island, return_index=True)[1]
        inner = np.setdiff1d(np.arange(n), ground)
        a = np.zeros((lines, n))
        rows = np.arange(lines)
        a[rows, self.first], a[rows, self.second] = 1.0, -1.0
        a[~up] = 0.0
        flows = self.y[:, None] * a[:, inner]
        potentials = np.linalg.solve(a[:, inner].T @ flows, np.eye(len(inner)))
        h = np.zeros((lines, n), np.complex128)
        h[:, inner] = flows @ potentials
        d = np.diag(np.where(up, self.y, 0.0)) - h @ (a.T * self.y)
        beside = island[self.first][:, None] == island[None, :]
        return self._shifted(h, beside & up[:, None]), np.abs(d)

    def _islands(self, up: Bools) -> Ints:
        n = len(self.drawn)
        joined = np.zeros((n, n), bool)
        joined[self.first[up], self.second[up]] = True
        return np.asarray(connected_components(joined, directed=False)[1])

    def _shifted(self, h: Complexes, beside: Bools) -> Floats:
        """(lines, buses) |H - c| with the c of each line that leaves least, of a few."""
        rows = np.arange(len(h))
        weight = np.where(beside, self.drawn, 0.0)
        mean = (h * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-300)
        away = np.abs(np.where(beside, h - mean[:, None], 0.0)).argmax(axis=1)
        across = np.abs(np.where(beside, h - h[rows, away][:, None], 0.0)).argmax(axis=1)
        ends = h[rows, away], h[rows, across]
        middle, largest = 0.5 * (ends[0] + ends[1]), h[rows, weight.argmax(axis=1)]
        choices = [
            np.where(beside, np.abs(h - c[:, None]), 0.0) for c in (*ends, middle, largest, mean)
        ]
        sums = np.array([(choice * self.drawn).sum(axis=1) for choice in choices])
        return np.array(choices)[sums.argmin(axis=0), rows]


def circuit_currents(
    network: Network, may_be_out: Bools, drawn: Floats, v_max_pu: Floats
) -> Floats | None:
    """(lines, profiles) the most current of every line, pu, linear in profiles.

    None where lines can be out in too many ways, where the network is too large, or where ratios
    that do not fit drive more than voltages tell.

    Args:
        network: only lines that can be closed.
        may_be_out: (lines,) lines that can be out.
        drawn: (buses, profiles) most current of all devices at every bus, pu.
        v_max_pu: (buses,) highest voltage.
    """
    scale = np.abs(along_trees(network, network.ratio))
    z: Complexes = (network.r_pu + 1j * network.x_pu) / scale[network.to_bus] ** 2
    z[np.abs(z) < SHORT_PU] = SHORT_PU
    in_frame = drawn * scale[:, None]
    circuit = _Circuit(network.from_bus, network.to_bus, 1.0 / z, in_frame.sum(axis=1))
    transfer = circuit.over_sets(np.flatnonzero(may_be_out & ~bridges(network)))
    if transfer is None:
        return None
    weights, drives = transfer
    round_loop = mismatch(network)
    volts = np.abs(1.0 / round_loop - 1.0) * (v_max_pu / scale)[network.from_bus]
    current = weights @ in_frame
    current[:, 0] += drives @ volts
    sent_back = np.abs(1.0 / round_loop.conj() - 1.0)
    in_all = _with_what_ratios_take(current, weights[:, network.from_bus] * sent_back)
    return None if in_all is None else in_all / scale[network.to_bus][:, None]


def _with_what_ratios_take(current: Floats, again: Floats) -> Floats | None:
    """The least I >= current + again @ I, (lines, profiles); None where there is none.

    Args:
        current: what there is without it.
        again: (lines, lines) by how much the current of one makes that of another more.
    """
    odd = np.flatnonzero(again.any(axis=0))
    if not len(odd):
        return current
    among = again[np.ix_(odd, odd)]
    if np.abs(np.linalg.eigvals(among)).max() > 1.0 - LEAST_MARGIN:
        return None
    inner = np.linalg.solve(np.eye(len(odd)) - among, current[odd])
    return np.asarray(current + again[:, odd] @ inner)


def _sets(lines: int, free: Ints) -> Iterator[Bools]:
    """(lines,) which are up, for every set of those that may be out."""
    for number in range(2 ** len(free)):
        up = np.ones(lines, bool)
        up[free] = [number >> k & 1 == 0 for k in range(len(free))]
        yield up


def shares(network: Network) -> Floats:
    """(lines,) the largest share that a line takes of what it and its parallels carry together.

    Whichever of the others are out: 1, when all are, and more where reactances or resistances of
    both signs stand side by side. Infinite where there are too many of them to tell.
    """
    z: Complexes = network.r_pu + 1j * network.x_pu
    z = np.where(np.abs(z) < SHORT_PU, SHORT_PU, z)
    largest = np.ones(len(z))
    for members in parallel_groups(network):
        if (np.minimum(z[members].real, z[members].imag) >= 0.0).all():
            continue
        if 2 ** len(members) > MAX_SETS:
            largest[members] = np.inf
            continue
        for up in _sets(len(members), np.arange(len(members))):
            y = np.where(up, 1.0 / z[members], 0.0)
            together = max(abs(y.sum()), np.finfo(float).tiny)
            largest[members] = np.maximum(largest[members], np.abs(y) / together)
    return largest
