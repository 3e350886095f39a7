r"""Radial operation while lines may be switched.

Every live bus hangs on exactly one tree whose root is a grid-forming bus. With a virtual root that
may feed any forming bus, closed lines and used roots make a spanning tree exactly when their number
is the number of live buses and a commodity from the virtual root reaches every one of them (single
commodity flow, Lavorato et al. 2012):

$$ \sum_l z_l + \sum_b \rho_b = \sum_b a_b, \qquad
\gamma_b + \sum_{l \to b} f_l - \sum_{b \to l} f_l = a_b, \qquad
|f_l| \le N z_l, \quad 0 \le \gamma_b \le N \rho_b $$

$N$ is 1.1 times the number of buses, which is all that a root ever feeds.
Where grids may not be paralleled, $\rho_b = 1$ at each of them: a tree has one root.
Where the network need not be radial, $\rho_b = 1$ everywhere, and nothing counts closed lines: they
may make loops.
Where it is decided which islands are alive, $a_b$ is a variable, see `forming`, and so is the
number of fixed lines that are links, `topology.link`.

| symbol | name | unit |
|---|---|---|
| $z_l$ | `line.closed`, or the status of a line that cannot be switched | 1 |
| $\rho_b$ | `topology.root`, for forming buses only | 1 |
| $f_l, \gamma_b$ | `topology.flow`, `topology.feed` | 1 |
| $a_b$ | `topology.alive` (data), whether the bus can reach a forming unit at all | 1 |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels, scatter
from resilience.models.components.base import AT_BUS
from resilience.models.components.line import Lines
from resilience.models.components.loops import parallel
from resilience.models.language.stage import Stage
from resilience.models.network.limits import MARGIN
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class Topology:
    """Spanning forest of the lines that are closed.

    Attributes:
        lines: those that can be closed.
        buses: names.
        forming: (buses,) possible roots.
        roots: (buses,) buses that have to be roots: those of grids that may not feed one tree.
        radial: whether closed lines have to make a forest.
    """

    lines: Lines
    buses: Labels
    forming: Bools
    roots: Bools
    radial: bool = True

    def emit(self, stage: Stage) -> None:
        """Declares roots and the commodity."""
        lines, n = self.lines, len(self.buses)
        commodity_max = MARGIN * n
        alive = self._alive(stage)
        places = np.flatnonzero(self.forming)
        names = [self.buses[i] for i in places]
        root, count = self._roots(stage, alive, names, places) if self.radial else (None, None)
        feed = stage.var(
            "topology.feed", names, 0.0, commodity_max, unit="1", about="commodity fed in"
        )
        flow_max = stage["line.up"] * commodity_max
        flow = stage.var(
            "topology.flow", lines.names, -flow_max, flow_max, unit="1", about="commodity"
        )
        stage.mark_auxiliary("topology.feed")
        # In a loop it may go round: voltages do not tell it where to.
        stage.mark_auxiliary(
            "topology.flow", lines.determined if self.radial else lines.determined & ~lines.in_loop
        )
        closed = stage["line.closed"]
        if root is not None and count is not None:
            stage.eq("topology.tree", closed.sum() + root.sum(), count)
        stage.switch("topology.flow.switch", flow[lines.switched], closed, commodity_max)
        if root is not None:
            stage.le("topology.feed.root", feed, root * commodity_max)
        ends = np.arange(len(lines.names))
        incidence = sp.csr_array(
            (
                np.repeat([1.0, -1.0], len(ends)),
                (np.concatenate([lines.to_bus, lines.from_bus]), np.tile(ends, 2)),
            ),
            shape=(n, len(ends)),
        )
        arriving = flow.mapped(incidence, self.buses)
        stage.eq("topology.reach", scatter(feed, places, n, self.buses) + arriving, alive)

    def _alive(self, stage: Stage) -> Affine:
        """(buses,) whether a bus is alive."""
        if AT_BUS in stage:
            return stage[AT_BUS]
        return stage.data("topology.alive", self.buses, unit="1", about="has a path to a source")

    def _roots(
        self, stage: Stage, alive: Affine, names: list[str], places: Ints
    ) -> tuple[Affine, Affine]:
        """(forming buses,) roots, and (1,) how many switches and roots make a forest."""
        count = self._links(stage, alive)
        root = stage.var(
            "topology.root",
            names,
            self.roots[places].astype(float),
            1.0,
            unit="1",
            about="fed by the virtual root",
            integer=True,
            kind="binary",
        )
        return root, count

    def _links(self, stage: Stage, alive: Affine) -> Affine:
        if AT_BUS not in stage:
            return stage.data(
                "topology.links", ("network",), unit="1", about="links still to choose"
            )
        lines = self.lines
        firm = np.flatnonzero(~lines.fallible & ~lines.switchable)
        count = alive.sum() - alive[lines.from_bus[firm]].sum()
        risky = lines.fallible & ~lines.switchable
        first, second, _ = parallel(lines)
        leads = dict(zip(second.tolist(), first.tolist(), strict=True))  # however many: one link
        firm_pairs = {leads.get(k, k) for k in firm.tolist()}
        members = [k for k in np.flatnonzero(risky) if leads.get(k, k) not in firm_pairs]
        if members:
            links = sorted({leads.get(k, k) for k in members})
            row = np.array([links.index(leads.get(k, k)) for k in members], np.intp)
            names, up = [lines.names[k] for k in links], stage["line.up"][members]
            link = stage.var("topology.link", names, 0.0, 1.0, unit="1", about="joins live buses")
            place = sp.csr_array((np.ones(len(row)), (row, np.arange(len(row)))),
                                 shape=(len(links), len(row)))  # fmt: skip
            there = alive[lines.from_bus[links]]
            stage.le("topology.link.any", link, up.mapped(place, tuple(names)))
            stage.le("topology.link.alive", link, there)
            stage.le("topology.link.up", there[row] - 1.0 + up, link[row])
            count = count - link.sum()
        return count

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Live buses, and how many lines and roots make a spanning tree of them."""
        if not self.radial:
            return {"topology.alive": situation.alive}
        up = self.lines.status(situation)
        settled = up * ~self.lines.switchable[:, None] * situation.alive[self.lines.from_bus]
        first, second, _ = parallel(self.lines)
        for near, far in zip(first, second, strict=True):  # however many, they are one link
            settled[near], settled[far] = np.maximum(settled[near], settled[far]), 0.0
        links = situation.alive.sum(0) - settled.sum(0)
        return {"topology.alive": situation.alive, "topology.links": links[None, :]}

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}
