r"""Lines: flow from bus $i$ to bus $j$, at three levels of physics.

Copperplate carries power without loss and without voltage, $P$ only. LinDistFlow (Baran & Wu 1989)
neglects losses:

$$ v_j = v_i - 2 (r P + x Q) + \sigma $$

DistFlow is exact for a radial feeder, with the squared current $\ell$; the power that arrives is
$P - r\ell$ and $Q - x\ell$:

$$ v_j = v_i - 2 (r P + x Q) + (r^2 + x^2)\,\ell + \sigma, \qquad \ell\, v_i = P^2 + Q^2 $$

Behind a transformer's ratio $a = \tau e^{\mathrm{j} \varphi}$ stands $v_i / \tau^2$ in place of
$v_i$; the shift $\varphi$ matters only where branches are parallel. Charging
$y = g + \mathrm{j} b$ at an end takes $g v$ and feeds in $b v$, with $v$ behind the ratio at the
first end. So $P + g_i v_i / \tau^2$ and $Q - b_i v_i / \tau^2$ leave bus $i$, and what arrives at
bus $j$ is less by $g_j v_j$ and $-b_j v_j$. A line that is out takes its charging with it: in place
of $v$ stands

$$ w = v - \omega, \qquad 0 \le w \le \overline{V}^2 z, \qquad
0 \le \omega \le \overline{V}^2 (1 - z) $$

What parallel lines share, what closes loops, and limits of angles are in
`resilience.models.components.loops`.

A line that is out carries nothing, $|P|, |Q| \le \overline{F} z$, and leaves the voltages of its
ends free of each other, $|\sigma| \le \overline{\sigma} (1 - z)$. The status $z$ is data; only a
switchable line has a binary $z \le$ status, and each change of it costs `switching_cost`; that of
a line that can be strengthened follows from what is built. A rating
is a disc of what leaves or reaches the buses, charging included, at both ends; without voltages,
$|P| \le S$. What is lost between the two buses costs `loss_cost_per_mwh` of the case, besides what
feeding it in costs; without losses, nothing.

$\overline{F}$, $\overline{\ell}$ and $\overline{\sigma}$ are there for solvers: 1.1 times what
devices and the voltage bands of the two ends allow at all (`resilience.models.network.limits`, and
1.1 times the rating where that is less). They follow the profiles of the slot; only in the rows of
a switch they are the most of the horizon.

| symbol | name | unit |
|---|---|---|
| $P, Q$ | `line.p`, `line.q`, into the impedance at the sending end | MW, Mvar |
| $w, \omega$ | `line.from_sq`, `line.to_sq` at charged ends, `line.from_off`, `line.to_off` | pu² |
| $\ell$ | `line.l`, squared current on a base of 1 MVA | pu |
| $\sigma$ | `line.gap`, voltage difference across an open line | pu² |
| $z$ | `line.closed`, only where switchable | 1 |
| $r, x, g, b$ | impedance and charging on a base of 1 MVA | pu |
| $\tau, \varphi$ | magnitude and angle of `ratio` | 1, rad |
| $S$ | `rating_mva` | MVA |
| $\overline{F}$ | `line.forth`, `line.back` (data), by the direction of flow | MVA |
| $\overline{\ell}$ | `line.l_max` (data) | pu |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels, labelled, replaced, scatter, stack
from resilience.models.components.base import Injection
from resilience.models.components.line_data import LineData
from resilience.models.components.loops import close_loops, limit_angles, share
from resilience.models.language.stage import Stage
from resilience.models.network.limits import MARGIN
from resilience.models.network.situation import Situation
from resilience.tolerances import INPUT_TOLERANCE

LOSSLESS = 1e-3  # pu in place of no resistance, in the penalty that closes cones
PRICE_ROOM = 0.01
"""Of the most that a line can be asked for, what every line may carry where prices are sought."""


@dataclass(frozen=True)
class Lines(LineData):
    """The lines that can be closed, in the equations above; see `LineData` for what they hold."""

    @property
    def switched(self) -> Ints:
        """Indices of the switchable lines."""
        return np.flatnonzero(self.switchable)

    @property
    def switched_names(self) -> Labels:
        """Names of the switchable lines."""
        return tuple(self.names[k] for k in self.switched)

    def emit(self, stage: Stage) -> Injection:
        """Flow out of one end and into the other."""
        status = self._status(stage)
        forth, back = (
            stage.data(f"line.{way}", self.names, unit="MVA", about=f"most that can flow {way}")
            for way in ("forth", "back")
        )
        p = self._flow(stage, "line.p", (back, forth), "MW", "active power sent", status)
        if not stage.reactive:
            return Injection(stack([-p, p]), None, np.concatenate([self.from_bus, self.to_bus]))
        q = self._flow(stage, "line.q", (back, forth), "Mvar", "reactive power sent", status)
        v = stage["bus.v_sq"]
        v_i, v_j = v[self.from_bus] * (1.0 / self.tap**2), v[self.to_bus]
        p_end, q_end = self._voltages(stage, p, q, v_i, v_j, status)
        share(self, stage, p, q, v_i)
        close_loops(self, stage, (p, q), (v_i, v_j), status)
        limit_angles(self, stage, (p, q), v_i)
        p_sent, q_sent = self._charged(stage, "from", (p, q), v_i, status)
        p_end, q_end = self._charged(stage, "to", (p_end, q_end), v_j, status)
        if self.losses and self.loss_cost_per_mwh:
            stage.cost("line.losses", p_sent - p_end, self.loss_cost_per_mwh * stage.dt)
        rated = np.isfinite(self.rating)
        self._rate(stage, "line.rating", p_sent, q_sent, rated)
        charged = (self.y_from != 0.0) | (self.y_to != 0.0)
        self._rate(stage, "line.rating_end", p_end, q_end, rated & (self.losses | charged))
        bus = np.concatenate([self.from_bus, self.to_bus])
        return Injection(stack([-p_sent, p_end]), stack([-q_sent, q_end]), bus)

    def _rate(self, stage: Stage, name: str, p: Affine, q: Affine, rated: Bools) -> None:
        rows = np.flatnonzero(rated)
        stage.disc(name, self.rating[rows], p[rows], q[rows])

    def _charged(
        self,
        stage: Stage,
        end: Literal["from", "to"],
        power: tuple[Affine, Affine],
        v_sq: Affine,
        closed: Affine | None,
    ) -> tuple[Affine, Affine]:
        """MW and Mvar that leave the first bus or reach the second, `power` and charging."""
        y = self.y_from if end == "from" else self.y_to
        rows = np.flatnonzero(y)
        if not len(rows):
            return power
        if len(free := rows[(self.fallible | self.switchable)[rows]]):
            v_sq = replaced(v_sq, free, self._while_up(stage, end, v_sq[free], free, closed))
        outward = v_sq[rows] * (1.0 if end == "from" else -1.0)
        n, (p, q) = len(self.names), power
        return (
            p + scatter(outward * y.real[rows], rows, n, self.names),
            q - scatter(outward * y.imag[rows], rows, n, self.names),
        )

    def _while_up(
        self, stage: Stage, end: str, v_sq: Affine, free: Ints, closed: Affine | None
    ) -> Affine:
        """(free lines,) the squared voltage of an end, 0 while the line is open."""
        assert self.v_max is not None
        v_max = self.v_max[self.to_bus] if end == "to" else self.v_max[self.from_bus] / self.tap
        ceiling, names = v_max[free] ** 2, [self.names[k] for k in free]
        up = stage["line.up"][free]
        about = f"squared voltage of the {end} end"
        end_sq = stage.var(f"line.{end}_sq", names, 0.0, up * ceiling, unit="pu²", about=about)
        room = ceiling - up * ceiling * ~self.decided[free]
        off = stage.var(f"line.{end}_off", names, 0.0, room, unit="pu²", about=f"{about}, open")
        stage.eq(f"line.{end}_charged", labelled(end_sq + off - v_sq, tuple(names)))
        if closed is not None:
            rows = np.flatnonzero(self.decided[free])
            on = closed[np.searchsorted(np.flatnonzero(self.decided), free[rows])]
            stage.le(f"line.{end}_sq.switch", end_sq[rows], on * ceiling[rows])
            stage.le(f"line.{end}_off.switch", off[rows], (1.0 - on) * ceiling[rows])
        return end_sq

    def _status(self, stage: Stage) -> Affine | None:
        """(`decided` lines,) their status; None where there are none."""
        up = stage.data("line.up", self.names, unit="1", about="whether a line can carry power")
        closed = self._closed(stage, up) if len(self.switched) else None
        if self.strengthened is None:
            return closed
        stands: Affine = stage["line.stands"]
        if closed is None:
            return stands
        decided = np.flatnonzero(self.decided)
        rows = [
            np.searchsorted(decided, k) for k in (np.flatnonzero(self.strengthened), self.switched)
        ]
        n = len(decided)
        return scatter(stands, rows[0], n) + scatter(closed, rows[1], n)

    def _closed(self, stage: Stage, up: Affine) -> Affine:
        """(switched lines,) whether each is closed."""
        names = self.switched_names
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
        limits: tuple[Affine, Affine],
        unit: str,
        about: str,
        closed: Affine | None,
    ) -> Affine:
        back, forth = limits
        flow = stage.var(name, self.names, -back, forth, unit=unit, about=about)
        # Without voltages the rating is a bound, and no auxiliary one.
        rated = np.isfinite(self.rating) & (self.v_min is None)
        stage.mark_auxiliary(name, self.determined & ~rated)
        if closed is not None:
            rows = np.flatnonzero(self.decided)
            stage.switch(f"{name}.switch", flow[rows], closed, np.maximum(*self.peaks[:2])[rows])
        return flow

    def _voltages(
        self, stage: Stage, p: Affine, q: Affine, v_i: Affine, v_j: Affine, closed: Affine | None
    ) -> tuple[Affine, Affine]:
        drop = v_j - v_i + 2.0 * (p * self.r + q * self.x) - self._gap(stage, closed)
        if not self.losses:
            stage.tiebreak(q, np.abs(self.r))
            stage.eq("line.voltage", labelled(drop, self.names))
            return p, q
        limit = stage.data("line.l_max", self.names, unit="pu", about="most squared current")
        current = stage.var(
            "line.l", self.names, 0.0, limit, unit="pu", about="squared current (1 MVA)"
        )
        stage.mark_auxiliary("line.l")
        if closed is not None:
            rows = np.flatnonzero(self.decided)
            stage.le("line.l.switch", current[rows], closed * self.peaks[2][rows])
        impedance = self.r**2 + self.x**2
        stage.eq("line.voltage", labelled(drop - current * impedance, self.names))
        stage.cone("line.flow", current, labelled(v_i, self.names), p, q)
        stage.penalty(current * np.where(self.r > 0, self.r, LOSSLESS))
        return p - current * self.r, q - current * self.x

    def _gap(self, stage: Stage, closed: Affine | None) -> Affine:
        free = np.flatnonzero(self.fallible | self.switchable)
        if not len(free):
            return Affine.constant(0.0, len(self.names))
        width = self._gap_max()[free]
        names = [self.names[i] for i in free]
        gap_max = width - stage["line.up"][free] * width * ~self.decided[free]
        gap = stage.var(
            "line.gap", names, -gap_max, gap_max, unit="pu²", about="voltage across open line"
        )
        stage.mark_auxiliary("line.gap")
        if closed is not None:
            rows = np.searchsorted(free, np.flatnonzero(self.decided))  # of those, among the free
            stage.switch("line.gap.switch", gap[rows], 1.0 - closed, width[rows])
        return scatter(gap, free, len(self.names))

    def _gap_max(self) -> Floats:
        """(lines,) most that the squared voltages of the two ends can differ by, pu²."""
        assert self.v_min is not None
        assert self.v_max is not None
        low, high = self.v_min**2, self.v_max**2
        if self.may_be_dark:
            low = 0.0 * low
        i, j, square = self.from_bus, self.to_bus, self.tap**2
        return MARGIN * np.maximum(high[j] - low[i] / square, high[i] / square - low[j])

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Line status, and limits of flow.

        Raises:
            ValueError: a line fails that was built as one that cannot, or profiles are above the
                peaks that a switch was built for.
        """
        up = self.status(situation)
        forth, back, l_max = self._limits(self.limits.values(situation.profile, situation.n))
        self._checkpeaks(np.maximum(forth, back).max(1, initial=0.0))
        # Without a voltage no cone ties a current down.
        able = up * situation.alive_at(self.from_bus) if self.may_be_dark else up
        data: dict[str, Floats] = {
            "line.up": up,
            "line.forth": able * forth,
            "line.back": able * back,
        }
        return data | {"line.l_max": able * l_max} if self.losses else data

    def with_room(self, data: Mapping[str, Floats], situation: Situation) -> dict[str, Floats]:
        """What of `data` lets every line that is up carry a little more than devices ask of it.

        Towards buses where nothing can be taken, as at the end of a feeder or behind PV at night,
        lines can be asked to carry nothing at all: what a MWh more would cost there could not be
        told.
        """
        names = "line.forth", "line.back"
        room = PRICE_ROOM * max(float(data[name].max(initial=0.0)) for name in names)
        able = data["line.up"]
        if self.may_be_dark:
            able = able * situation.alive_at(self.from_bus)
        more_mva = able * np.minimum(room, self.rating)[:, None]
        wider = {name: np.maximum(data[name], more_mva) for name in names}
        if self.losses and self.v_min is not None:
            more_pu = more_mva / (self.v_min[self.from_bus] / self.tap)[:, None]
            wider["line.l_max"] = np.maximum(data["line.l_max"], more_pu**2)
        return wider

    def _checkpeaks(self, flow: Floats) -> None:
        peak = np.maximum(*self.peaks[:2])
        beyond = np.flatnonzero(self.decided & (flow > peak * (1.0 + INPUT_TOLERANCE)))
        if len(beyond):
            k = beyond[0]
            raise ValueError(
                f"line {self.names[k]!r} may carry {flow[k]:g} MVA in the data, but its switch was "
                f"built for {peak[k]:g}"
            )

    def status(self, situation: Situation) -> Floats:
        """(lines, nodes) 1 where a line can carry power.

        Raises:
            ValueError: a line fails that was built as one that cannot.
        """
        rows = [situation.names.index(name) for name in self.names]
        up = situation.line_up[rows].astype(float)
        sure = ~(self.fallible | self.switchable)
        down = np.flatnonzero(sure & (up < 1.0).any(1))
        if len(down):
            raise ValueError(
                f"line {self.names[down[0]]!r} fails in the data, but was built as one that cannot"
            )
        return up

    def start(self) -> dict[str, Floats]:
        """Status of the switchable lines."""
        return {"line.closed": self.closed[self.switched].astype(float)}
