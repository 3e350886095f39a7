r"""Lines: flow from bus $i$ to bus $j$, at three levels of physics.

Copperplate carries power without loss and without voltage, $P$ only. LinDistFlow (Baran & Wu 1989)
neglects losses:

$$ v_j = v_i - 2 (r P + x Q) + \sigma $$

DistFlow is exact for a radial feeder, with the squared current $\ell$; the power that arrives is
$P - r\ell$ and $Q - x\ell$:

$$ v_j = v_i - 2 (r P + x Q) + (r^2 + x^2)\,\ell + \sigma, \qquad \ell\, v_i = P^2 + Q^2 $$

A line that is out carries nothing, $|P|, |Q| \le \overline{F} z$, and leaves the voltages of its
ends free of each other, $|\sigma| \le (\overline{V}^2 - \underline{V}^2)(1 - z)$. The status $z$ is
data; only a switchable line has a binary $z \le$ status, and each change of it costs
`switching_cost`. A rating is a disc, $P^2 + Q^2 \le S^2$, at both ends.

$\overline{F}$ is 1.25 times what the two sides of the line can exchange: it cuts off solutions that
burn energy in the wires, never one that supplies a load.

| symbol | name | unit |
|---|---|---|
| $P, Q$ | `line.p`, `line.q`, at the sending end | MW, Mvar |
| $\ell$ | `line.l`, squared current on a base of 1 MVA | pu |
| $\sigma$ | `line.gap`, voltage difference across an open line | pu² |
| $z$ | `line.closed`, only where switchable | 1 |
| $r, x$ | impedance on a base of 1 MVA | pu |
| $S$ | `rating_mva` | MVA |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels, scatter, stack
from resilience.models.components.base import Injection
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

LOSSLESS = 1e-3  # pu in place of no resistance, in the penalty that closes cones


@dataclass(frozen=True)
class Lines:
    """The lines that can be closed. Arrays are (lines,); powers in MW, impedances in pu (1 MVA).

    Attributes:
        names: of the lines.
        from_bus, to_bus: indices of the buses at their ends.
        r, x: series impedance, pu.
        rating: thermal limit, MVA; infinite without one.
        flow_max: F in the module's docstring, MVA; none of the physics needs it to be tight.
        fallible: lines that data may take out.
        switchable: lines with a binary status.
        closed: status of the switchable lines at the start.
        switching_cost: $ each time a line is opened or closed.
        v_band: lowest and highest voltage of all buses, pu.
        losses: DistFlow; without it LinDistFlow where the stage carries reactive power.
    """

    names: Labels
    from_bus: Ints
    to_bus: Ints
    r: Floats
    x: Floats
    rating: Floats
    flow_max: Floats
    fallible: Bools
    switchable: Bools
    closed: Bools
    switching_cost: Floats
    v_band: tuple[float, float]
    losses: bool

    @property
    def switched(self) -> Ints:
        """Indices of the switchable lines."""
        return np.flatnonzero(self.switchable)

    def emit(self, stage: Stage) -> Injection:
        """Flow out of one end and into the other."""
        status = self._status(stage)
        limit = np.minimum(self.flow_max, self.rating)
        p = self._flow(stage, "line.p", limit, "MW", "active power sent", status)
        if not stage.reactive:
            return Injection(stack([-p, p]), None, np.concatenate([self.from_bus, self.to_bus]))
        q = self._flow(stage, "line.q", limit, "Mvar", "reactive power sent", status)
        p_end, q_end = self._voltages(stage, p, q, status)
        rated = np.flatnonzero(np.isfinite(self.rating))
        stage.disc("line.rating", self.rating[rated], p[rated], q[rated])
        if self.losses:
            stage.disc("line.rating_end", self.rating[rated], p_end[rated], q_end[rated])
        bus = np.concatenate([self.from_bus, self.to_bus])
        return Injection(stack([-p, p_end]), stack([-q, q_end]), bus)

    def _status(self, stage: Stage) -> Affine | None:
        up = stage.data("line.up", self.names, unit="1", about="whether a line can carry power")
        if not len(self.switched):
            return None
        names = [self.names[i] for i in self.switched]
        was, closed = stage.state(
            "line.closed", names, 0.0, up[self.switched], unit="1", about="closed", integer=True
        )
        cost = self.switching_cost[self.switched]
        if cost.any():
            moved = stage.var("line.moved", names, 0.0, 1.0, unit="1", about="switching actions")
            stage.le("line.closing", closed - was, moved)
            stage.le("line.opening", was - closed, moved)
            stage.cost("line.switching", moved, cost)
        return closed

    def _flow(
        self,
        stage: Stage,
        name: str,
        limit: Floats,
        unit: str,
        about: str,
        closed: Affine | None,
    ) -> Affine:
        flow_max = stage["line.up"] * limit
        flow = stage.var(name, self.names, -flow_max, flow_max, unit=unit, about=about)
        if closed is not None:
            stage.switch(f"{name}.switch", flow[self.switched], closed, limit[self.switched])
        return flow

    def _voltages(
        self, stage: Stage, p: Affine, q: Affine, closed: Affine | None
    ) -> tuple[Affine, Affine]:
        v = stage["bus.v_sq"]
        v_i, v_j = v[self.from_bus], v[self.to_bus]
        drop = v_j - v_i + 2.0 * (p * self.r + q * self.x) - self._gap(stage, closed)
        if not self.losses:
            stage.tiebreak(q, self.r)
            stage.eq("line.voltage", _labelled(drop, self.names))
            return p, q
        current_max = np.minimum(2.0 * self.flow_max**2, self.rating**2) / self.v_band[0] ** 2
        limit = stage["line.up"] * current_max
        current = stage.var(
            "line.l", self.names, 0.0, limit, unit="pu", about="squared current (1 MVA)"
        )
        if closed is not None:
            rows = self.switched
            stage.le("line.l.switch", current[rows], closed * current_max[rows])
        impedance = self.r**2 + self.x**2
        stage.eq("line.voltage", _labelled(drop - current * impedance, self.names))
        stage.cone("line.flow", current, _labelled(v_i, self.names), p, q)
        stage.penalty(current * np.where(self.r > 0, self.r, LOSSLESS))
        return p - current * self.r, q - current * self.x

    def _gap(self, stage: Stage, closed: Affine | None) -> Affine:
        free = np.flatnonzero(self.fallible | self.switchable)
        if not len(free):
            return Affine.constant(0.0, len(self.names))
        width = self.v_band[1] ** 2 - self.v_band[0] ** 2
        names = [self.names[i] for i in free]
        gap_max = width - stage["line.up"][free] * width * ~self.switchable[free]
        gap = stage.var(
            "line.gap", names, -gap_max, gap_max, unit="pu²", about="voltage across open line"
        )
        if closed is not None:
            rows = np.searchsorted(free, self.switched)  # of switched lines, among the free
            stage.switch("line.gap.switch", gap[rows], 1.0 - closed, width)
        return scatter(gap, free, len(self.names))

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Line status."""
        rows = [situation.names.index(name) for name in self.names]
        up = situation.line_up[rows].astype(float)
        sure = ~(self.fallible | self.switchable)
        down = np.flatnonzero(sure & (up < 1.0).any(1))
        if len(down):
            raise ValueError(
                f"line {self.names[down[0]]!r} fails in the data, but was built as one that cannot"
            )
        return {"line.up": up}

    def start(self) -> dict[str, Floats]:
        """Status of the switchable lines."""
        return {"line.closed": self.closed[self.switched].astype(float)}


def _labelled(x: Affine, labels: Labels) -> Affine:
    return Affine(x.rows, x.ids, x.values, x.const, labels)
