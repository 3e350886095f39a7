r"""Lines: flow from bus $i$ to bus $j$, at three levels of physics.

Copperplate carries power without loss and without voltage, $P$ only. LinDistFlow (Baran & Wu 1989)
neglects losses:

$$ v_j = v_i - 2 (r P + x Q) + \sigma $$

DistFlow is exact for a radial feeder, with the squared current $\ell$; the power that arrives is
$P - r\ell$ and $Q - x\ell$:

$$ v_j = v_i - 2 (r P + x Q) + (r^2 + x^2)\,\ell + \sigma, \qquad \ell\, v_i = P^2 + Q^2 $$

Parallel lines share what they carry as their impedances have it. With one voltage drop, and with
one angle between their ends, $V_i (V_i - V_j)^* = (P + jQ)(r - jx)$ is the same for all of them:

$$ r_1 Q_1 - x_1 P_1 = r_2 Q_2 - x_2 P_2 $$

where both are up (with the other sign on the right if they point in opposite directions).

A line that is out carries nothing, $|P|, |Q| \le \overline{F} z$, and leaves the voltages of its
ends free of each other, $|\sigma| \le \overline{\sigma} (1 - z)$. The status $z$ is data; only a
switchable line has a binary $z \le$ status, and each change of it costs `switching_cost`. A rating
is a disc, $P^2 + Q^2 \le S^2$, at both ends; without voltages, $|P| \le S$.

$\overline{F}$, $\overline{\ell}$ and $\overline{\sigma}$ are there for solvers: 1.1 times what
devices and the voltage bands of the two ends allow at all (`resilience.models.network.limits`, and
1.1 times the rating where that is less). They follow the profiles of the slot; only in the rows of
a switch they are the most of the horizon.

| symbol | name | unit |
|---|---|---|
| $P, Q$ | `line.p`, `line.q`, at the sending end | MW, Mvar |
| $\ell$ | `line.l`, squared current on a base of 1 MVA | pu |
| $\sigma$ | `line.gap`, voltage difference across an open line | pu² |
| $z$ | `line.closed`, only where switchable | 1 |
| $r, x$ | impedance on a base of 1 MVA | pu |
| $S$ | `rating_mva` | MVA |
| $\overline{F}$ | `line.forth`, `line.back` (data), by the direction of flow | MVA |
| $\overline{\ell}$ | `line.l_max` (data) | pu |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels, scatter, stack
from resilience.models.components.base import Injection
from resilience.models.language.stage import Stage
from resilience.models.network.limits import MARGIN, FlowLimits
from resilience.models.network.situation import Situation
from resilience.tolerances import INPUT_TOLERANCE

LOSSLESS = 1e-3  # pu in place of no resistance, in the penalty that closes cones


@dataclass(frozen=True)
class Lines:
    """The lines that can be closed. Arrays are (lines,); powers in MW, impedances in pu (1 MVA).

    Attributes:
        names: of the lines.
        from_bus, to_bus: indices of the buses at their ends.
        r, x: series impedance, pu.
        rating: thermal limit, MVA; infinite without one.
        limits: F in the module's docstring, and what it is made of.
        determined: lines whose flow follows from the injections; elsewhere it may circulate.
        fallible: lines that data may take out.
        switchable: lines with a binary status.
        closed: status of the switchable lines at the start.
        switching_cost: $ each time a line is opened or closed.
        v_min, v_max: (buses,) lowest and highest voltage, pu; None where there are no voltages, and
            a rating is a bound in place of a disc.
        losses: DistFlow; without it LinDistFlow where the stage carries reactive power.
    """

    names: Labels
    from_bus: Ints
    to_bus: Ints
    r: Floats
    x: Floats
    rating: Floats
    limits: FlowLimits
    determined: Bools
    fallible: Bools
    switchable: Bools
    closed: Bools
    switching_cost: Floats
    v_min: Floats | None
    v_max: Floats | None
    losses: bool

    @property
    def switched(self) -> Ints:
        """Indices of the switchable lines."""
        return np.flatnonzero(self.switchable)

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
        p_end, q_end = self._voltages(stage, p, q, status)
        self._shared(stage, p, q)
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
            rows = self.switched
            stage.switch(f"{name}.switch", flow[rows], closed, np.maximum(*self._peaks[:2])[rows])
        return flow

    @property
    def _peaks(self) -> tuple[Floats, Floats, Floats]:
        """(lines,) `forth`, `back` and `l_max` at the peaks of all profiles."""
        forth, back, l_max = self._limits(self.limits.peak[:, None])
        return forth[:, 0], back[:, 0], l_max[:, 0]

    def _limits(self, profiles: Floats) -> tuple[Floats, Floats, Floats]:
        """(lines, nodes) `forth`, `back` and `l_max` of lines that are up, at (profiles, nodes)."""
        limits, rating = self.limits, self.rating[:, None]
        forth, back = limits.forth @ profiles, limits.back @ profiles
        if self.v_min is None:
            rated = np.isfinite(rating)
            return np.where(rated, rating, forth), np.where(rated, rating, back), 0.0 * forth
        forth, back = (np.minimum(flow, MARGIN * rating) for flow in (forth, back))
        if limits.current is None:
            return forth, back, 0.0 * forth
        by_rating = MARGIN * rating / self.v_min[self.from_bus, None]
        return forth, back, np.minimum(limits.current @ profiles, by_rating) ** 2

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
        limit = stage.data("line.l_max", self.names, unit="pu", about="most squared current")
        current = stage.var(
            "line.l", self.names, 0.0, limit, unit="pu", about="squared current (1 MVA)"
        )
        stage.mark_auxiliary("line.l")
        if closed is not None:
            rows = self.switched
            stage.le("line.l.switch", current[rows], closed * self._peaks[2][rows])
        impedance = self.r**2 + self.x**2
        stage.eq("line.voltage", _labelled(drop - current * impedance, self.names))
        stage.cone("line.flow", current, _labelled(v_i, self.names), p, q)
        stage.penalty(current * np.where(self.r > 0, self.r, LOSSLESS))
        return p - current * self.r, q - current * self.x

    def _shared(self, stage: Stage, p: Affine, q: Affine) -> None:
        """Parallel lines that are both up have one angle between their ends."""
        first, second, sign = self.parallel
        if not len(first):
            return
        twist = q * self.r - p * self.x
        limit = 2.0 * np.maximum(*self._peaks[:2]) * (self.r + self.x)
        twist_max = limit[first] + limit[second]
        names = [self.names[k] for k in second]
        up = stage["line.up"]
        free = (2.0 - up[first] - up[second]) * twist_max
        gap = stage.var("line.twist", names, -free, free, unit="pu", about="angle if one is out")
        stage.eq("line.angle", twist[first] - twist[second] * sign - gap)

    @property
    def parallel(self) -> tuple[Ints, Ints, Floats]:
        """Pairs of fixed lines that join two buses, and 1 or -1: whether they point alike."""
        first: dict[tuple[int, int], int] = {}
        pairs = []
        for k in np.flatnonzero(~self.switchable).tolist():
            ends = int(self.from_bus[k]), int(self.to_bus[k])
            lead = first.setdefault((min(ends), max(ends)), k)
            if lead != k:
                pairs.append((lead, k, 1.0 if self.from_bus[lead] == ends[0] else -1.0))
        table = np.array(pairs, float).reshape(len(pairs), 3)
        return table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2]

    def _gap(self, stage: Stage, closed: Affine | None) -> Affine:
        free = np.flatnonzero(self.fallible | self.switchable)
        if not len(free):
            return Affine.constant(0.0, len(self.names))
        width = self._gap_max()[free]
        names = [self.names[i] for i in free]
        gap_max = width - stage["line.up"][free] * width * ~self.switchable[free]
        gap = stage.var(
            "line.gap", names, -gap_max, gap_max, unit="pu²", about="voltage across open line"
        )
        stage.mark_auxiliary("line.gap")
        if closed is not None:
            rows = np.searchsorted(free, self.switched)  # of switched lines, among the free
            stage.switch("line.gap.switch", gap[rows], 1.0 - closed, width[rows])
        return scatter(gap, free, len(self.names))

    def _gap_max(self) -> Floats:
        """(lines,) most that the squared voltages of the two ends can differ by, pu²."""
        assert self.v_min is not None
        assert self.v_max is not None
        low, high = self.v_min**2, self.v_max**2
        i, j = self.from_bus, self.to_bus
        return MARGIN * np.maximum(high[j] - low[i], high[i] - low[j])

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Line status, and limits of flow.

        Raises:
            ValueError: a line fails that was built as one that cannot, or profiles are above the
                peaks that a switch was built for.
        """
        up = self.status(situation)
        forth, back, l_max = self._limits(self.limits.values(situation.profile, situation.n))
        self._check_peaks(np.maximum(forth, back).max(1, initial=0.0))
        data: dict[str, Floats] = {
            "line.up": up,
            "line.forth": up * forth,
            "line.back": up * back,
        }
        return data | {"line.l_max": up * l_max} if self.losses else data

    def _check_peaks(self, flow: Floats) -> None:
        peak = np.maximum(*self._peaks[:2])
        beyond = np.flatnonzero(self.switchable & (flow > peak * (1.0 + INPUT_TOLERANCE)))
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


def _labelled(x: Affine, labels: Labels) -> Affine:
    return Affine(x.rows, x.ids, x.values, x.const, labels)
