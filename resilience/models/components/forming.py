r"""Which islands are alive where that depends on what is decided: a forming unit has to run.

A cell is a set of buses that lines join which can neither fail nor be switched; an island is made
of cells. A grid connection, or a generator that needs no commitment, forms its island whatever is
decided, and status of lines alone tells which islands are alive. Where a cell has no such unit, but
one that forms only while it runs or while it has energy to give, the cell has a variable $a_c$:
whether it is energised. The cells of an island are energised together, and only if a commodity
that units which form feed in reaches all of them:

$$ |a_c - a_{c'}| \le 1 - z_l, \qquad
\gamma_c + \sum_{l \to c} f_l - \sum_{c \to l} f_l = a_c, \qquad
|f_l| \le N z_l, \quad 0 \le \gamma_c \le N \sum_{i \in c} \phi_i $$

A device in a cell that is not energised stands still, a load there is shed:
$-\underline{P} a_c \le p \le \overline{P} a_c$. Both ways of a storage are zero where their
difference is, since only one of them may be positive.

The $\phi_i$ are 1 where a device forms its island: $u_i$ of a committed generator; of a storage

$$ \delta \phi_i \le e_i - \underline{s} E_i, \qquad
\lambda_i \ge 1 - (e_i - \underline{s} E_i) / \delta, \qquad \phi_i \lambda_i = 0 $$

with $e_i$ at the start of the step: it forms only with energy to give, $\delta$ at least.
A unit that may be out of order forms nothing while it is: $\phi_i$ is bounded by its status, and
for one that would form its island whatever is decided it is that status, `cell.formed`.
So nothing needs a binary of its own, and $a_c$ is continuous: what it bounds is free at 1. A plan
may leave an island dark that could be alive. Power $\underline{p}$ that must be taken is spilled in
the dark, all or nothing:

$$ p \ge \underline{p} - \overline{P} (1 - a_c), \qquad a_c (1 - a_c) = 0 $$

All or nothing it is, too, where shunts or charging make the voltage of the dark zero.

| symbol | name | unit |
|---|---|---|
| $a_c$ | `cell.energised`, at most `cell.alive` (data) | 1 |
| $z_l$ | status of the line, `line.closed` where it is switchable | 1 |
| $f_l, \gamma_c$ | `cell.flow`, `cell.feed` | 1 |
| $\phi_i$ | `generator.on`; `ess.forms` | 1 |
| $\lambda_i$ | `ess.lacks`, what the storage lacks of $\delta$ | 1 |
| $\delta$ | 0.1 % of `e_mwh` | MWh |
| $1 - a_c$ | `cell.pv.dark`, where power must be taken; `cell.bus.dark`, with shunts | 1 |
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.case.profiles import MAX_PU
from resilience.models.algebra import Affine, Labels, replaced, scatter
from resilience.models.components.base import AT_BUS, Injection
from resilience.models.components.fleet import DeviceFleet
from resilience.models.components.line import Lines
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation
from resilience.models.structures import Split


@dataclass(frozen=True)
class Energised:
    """Cells, and what makes them alive.

    Attributes:
        names: of the cells, each called after its first bus.
        cell: (buses,) number of every bus's cell.
        sure: (cells,) whether a unit there forms an island whatever happens and is decided.
        fleets: all devices.
        lines: those between the cells and within; None where there are none.
    """

    names: Labels
    cell: Ints
    sure: Bools
    fleets: tuple[DeviceFleet, ...]
    lines: Lines | None

    @property
    def is_decided(self) -> bool:
        """Whether anything but the status of lines makes an island alive or dead."""
        there = np.zeros(len(self.names), bool)
        for fleet in self.fleets:
            decided = fleet.forming() & ~fleet.forms_surely()
            there[self.cell[fleet.bus[decided]]] = True
        return bool((there & ~self.sure).any())

    @property
    def formed(self) -> Ints:
        """Cells, not sure, where a unit in order forms an island whatever is decided."""
        there = np.zeros(len(self.names), bool)
        for fleet in self.fleets:
            there[self.cell[fleet.bus[fleet.forms_surely() & fleet.may_fail()]]] = True
        return np.flatnonzero(there & ~self.sure)

    def emit(self, stage: Stage) -> None:
        """Declares which cells are energised, before any device."""
        alive = stage.data("cell.alive", self.names, unit="1", about="has a path to a source")
        sure: Affine | Floats = self.sure.astype(float)
        if len(self.formed):
            names = [self.names[k] for k in self.formed]
            formed = stage.data("cell.formed", names, unit="1", about="has a source in order")
            sure = scatter(formed, self.formed, len(self.names), self.names) + sure
        energised = stage.var(
            "cell.energised", self.names, sure, alive, unit="1", about="energised"
        )
        stage.define(AT_BUS, energised[self.cell])

    def limit(self, stage: Stage, fleet: DeviceFleet, fed: Injection) -> None:
        """Holds what a fleet feeds in at zero in the dark, and at its least elsewhere."""
        self._take(stage, fleet, fed)
        rows = np.flatnonzero(~self.sure[self.cell[fleet.bus]])
        if not len(rows):
            return
        alive = stage[AT_BUS][fleet.bus[rows]]
        # What follows a profile may exceed its peak.
        lowest, highest = fleet.power_range()
        feeds, takes = fleet.capacity()
        give = MAX_PU * np.maximum(feeds, highest)[rows]
        take = MAX_PU * np.maximum(takes, -lowest)[rows]
        sides: list[tuple[str, Affine | None]] = [("p", fed.p)]
        if fleet.reactive in stage and fleet.role != "load":  # loads see to theirs
            sides.append(("q", fed.q))
        for side, power in sides:
            if power is None:
                continue
            name = f"cell.{fleet.kind}.{side}"
            if give.any():
                stage.le(f"{name}_upper", power[rows], alive * give)
            if take.any():
                stage.le(f"{name}_lower", -power[rows], alive * take)

    def _take(self, stage: Stage, fleet: DeviceFleet, fed: Injection) -> None:
        """Power that must be taken is, unless the island is dark as a whole."""
        if fleet.forced is None:
            return
        units = np.flatnonzero(fleet.must_take())
        forced_mw, alive = stage[fleet.forced][units], stage[AT_BUS][fleet.bus[units]]
        room_mw = MAX_PU * fleet.power_range()[1][units]
        stage.le(f"cell.{fleet.kind}.taken", forced_mw - (1.0 - alive) * room_mw, fed.p[units])
        self._whole(stage, fleet.kind, self.cell[fleet.bus[units]])

    def _whole(self, stage: Stage, kind: str, cells: Ints) -> None:
        """These cells, of those that are not alive for sure, are energised or dark, not half so."""
        cells = np.unique(cells)
        cells = cells[~self.sure[cells]]
        names, ones = [self.names[k] for k in cells], np.ones(len(cells))
        dark = stage.var(f"cell.{kind}.dark", names, 0.0, 1.0, unit="1", about="is dark")
        lit = stage["cell.energised"][cells]
        stage.eq(f"cell.{kind}.whole", lit + dark, 1.0)
        stage.structure(Split, f"cell.{kind}.whole", (lit, dark), (ones, ones))

    def connect(self, stage: Stage) -> None:
        """Ties the cells of an island to each other and to what forms it, behind all devices."""
        for fleet in self.fleets:
            fleet.emit_forming(stage)
        if "bus.v_sq_min" in stage:
            self._whole(stage, "bus", self.cell)  # half a voltage would dodge its limits
        n, forms = len(self.names), self._forms(stage) + self.sure.astype(float)
        if len(self.formed):
            forms = forms + scatter(stage["cell.formed"], self.formed, n)
        places = np.unique(np.concatenate([np.flatnonzero(self.sure), forms.rows]))
        names = [self.names[k] for k in places]
        feed = stage.var("cell.feed", names, 0.0, float(n), unit="1", about="commodity fed in")
        energised = stage["cell.energised"]
        stage.le("cell.feed.forms", feed, forms[places] * float(n))
        arriving = self._arriving(stage, energised)
        stage.eq("cell.reach", scatter(feed, places, n, self.names) + arriving, energised)

    def _forms(self, stage: Stage) -> Affine:
        """(cells,) how many units there form while they run or have energy."""
        total = Affine.constant(0.0, len(self.names))
        for fleet in self.fleets:
            if fleet.forms is None or fleet.forms not in stage:
                continue
            forms = stage[fleet.forms]
            device = np.array([fleet.names.index(name) for name in forms.labels or ()], np.intp)
            rows = np.flatnonzero(fleet.forming()[device])
            cells = self.cell[fleet.bus[device[rows]]]
            place = sp.csr_array(
                (np.ones(len(rows)), (cells, np.arange(len(rows)))),
                shape=(len(self.names), len(rows)),
            )
            total = total + forms[rows].mapped(place, self.names)
        return total

    def _arriving(self, stage: Stage, energised: Affine) -> Affine:
        """(cells,) commodity that lines bring, the cells at their ends energised alike."""
        n, lines = len(self.names), self.lines
        if lines is None:
            return Affine.constant(0.0, n)
        ends = self.cell[lines.from_bus], self.cell[lines.to_bus]
        between = np.flatnonzero((ends[0] != ends[1]) & (lines.fallible | lines.switchable))
        if not len(between):
            return Affine.constant(0.0, n)
        i, j = ends[0][between], ends[1][between]
        names = [lines.names[k] for k in between]
        status = stage["line.up"][between]
        flow_max = status * float(n)
        flow = stage.var("cell.flow", names, -flow_max, flow_max, unit="1", about="commodity")
        switched = np.flatnonzero(lines.switchable[between])
        if len(switched):
            closed = stage["line.closed"][np.searchsorted(lines.switched, between[switched])]
            stage.switch("cell.flow.switch", flow[switched], closed, float(n))
            status = replaced(status, switched, closed)
        apart = energised[i] - energised[j]
        stage.switch("cell.alike", apart, 1.0 - status, 1.0)
        incidence = sp.csr_array(
            (
                np.repeat([1.0, -1.0], len(between)),
                (np.concatenate([j, i]), np.tile(np.arange(len(between)), 2)),
            ),
            shape=(n, len(between)),
        )
        return flow.mapped(incidence, self.names)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Whether a cell can be energised at all."""
        first = np.unique(self.cell, return_index=True)[1]
        formed = np.zeros((len(self.names), situation.n))
        for fleet in self.fleets:
            units = np.flatnonzero(fleet.forms_surely() & fleet.may_fail())
            works = situation.works([fleet.names[i] for i in units])
            np.maximum.at(formed, self.cell[fleet.bus[units]], works * 1.0)
        return {"cell.alive": situation.alive[first], "cell.formed": formed[self.formed]}

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}


def forming_now(
    fleets: Iterable[DeviceFleet],
    situation: Situation,
    energy: Floats | None = None,
) -> Bools:
    """(buses, nodes) whether a forming unit stands there that is in order and has energy to give.

    Args:
        fleets: all devices.
        situation: says what is in order.
        energy: (units, nodes) MWh in storage; enough in all if omitted.
    """
    forming = np.zeros((len(situation.forming), situation.n), bool)
    for fleet in fleets:
        forms = fleet.forming()[:, None] & situation.works(fleet.names)
        if energy is not None:
            forms = forms & fleet.has_energy(energy)
        device, node = np.nonzero(np.broadcast_to(forms, (len(forms), situation.n)))
        forming[fleet.bus[device], node] = True
    return forming
