r"""Diesel generators (paper eq. 5 and the second term of eq. 10), with commitment where needed.

$$ \underline{P} u \le p \le \overline{P} u, \qquad u - u^- = y - w, \qquad y \le u, \qquad
y \le 1 - u^- $$

$$ C = \Delta t \left(c\, p + c^0 u\right) + c^\text{start} y, \qquad
\text{or } C = \Delta t\, f(p) \text{ with a piecewise-linear } f $$

Ramps scale with the step; a start may reach the minimum power, a stop may leave from it:

$$ p - p^- \le R^\uparrow \Delta t + \underline{P} y, \qquad
p^- - p \le R^\downarrow \Delta t + \underline{P} w $$

Minimum up and down times are hours still to wait, a state:

$$ r' = \max\{r - \Delta t,\ (T^\uparrow - \Delta t)\, y,\ 0\}, \qquad r \le T^\uparrow u $$

and alike for standing still with $w$ and $1 - u$. A unit in a dead island stands still, whatever
it was doing. In the slot in which an outage begins in its island it may trip: neither its minimum
up time nor its ramp keep it from going down, or off. What is left of the minimum up time lapses
with a stop: $r - \Delta t - T^\uparrow w$ stands in place of $r - \Delta t$. Without minimum power,
no-load cost or fuel, start cost and minimum times there is no binary. Fuel is in `tank`.

| symbol | name | unit |
|---|---|---|
| $p, p^-$ | `generator.p` now and in the step before | MW |
| $q$ | `generator.q` between `q_min_mvar` and `q_max_mvar`, 0 where it stands still | Mvar |
| $u, u^-$ | `generator.on`, running, and in the step before | 1 |
| $y, w$ | `generator.start`, `generator.stop` | 1 |
| $r$ | `generator.up_left`, `generator.down_left` | h |
| $R^\uparrow, R^\downarrow$ | `ramp_up_mw_per_h`, `ramp_down_mw_per_h` | MW/h |
| $T^\uparrow, T^\downarrow$ | `min_up_h`, `min_down_h` | h |
| $c, c^0, c^\text{start}$ | `cost_per_mwh`, `no_load_cost_per_h`, `start_cost` | $/MWh, $/h, $ |
| $f$ | `cost_curve` | $/h |
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import GeneratorTable
from resilience.models.algebra import Affine, scatter
from resilience.models.components.base import AT_BUS, Injection
from resilience.models.components.fleet import DeviceFleet, EnergyTerm, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

BOUND = "generator.bound"
"""Datum: 1 where what a unit did before binds it, 0 where nothing does."""


@dataclass(frozen=True)
class Generators(DeviceFleet):
    """All generators."""

    kind: ClassVar[str] = "generator"
    role: ClassVar[Role] = "dispatchable"
    title: ClassVar[str] = "generators"
    colour: ClassVar[str] = "#d55e00"
    flows: ClassVar = {"generator.p": 1.0}
    limit: ClassVar[str] = "generator.p_max"
    fed: ClassVar = EnergyTerm("generators", "generators")
    running: ClassVar = "generator.on"
    forms: ClassVar = "generator.on"

    tables: Sequence[GeneratorTable]

    @classmethod
    def showcase(cls) -> GeneratorTable:
        """A unit with commitment and ramps."""
        return GeneratorTable(
            name="generator",
            bus="1",
            p_max_mw=1.0,
            p_min_mw=0.3,
            start_cost=1.0,
            min_up_h=1.0,
            min_down_h=1.0,
            ramp_up_mw_per_h=1.0,
            tank="tank",
            fuel_curve=((0.3, 0.1), (0.6, 0.2), (1.0, 0.4)),
        )

    def power_range(self) -> tuple[Floats, Floats]:
        """From nothing, standing still, to its greatest output."""
        p_max = self._array("p_max_mw")
        return np.zeros_like(p_max), p_max

    def capacity(self) -> tuple[Floats, Floats]:
        """Its greatest output, and reactive power where it has any."""
        supply = self._array("p_max_mw") + np.maximum(self._array("q_max_mvar"), 0.0)
        return supply, np.maximum(-self._array("q_min_mvar"), 0.0)

    def apparent_mva(self) -> Floats:
        """At its greatest active and reactive power."""
        q_min, q_max = self._array("q_min_mvar"), self._array("q_max_mvar")
        return np.hypot(self._array("p_max_mw"), np.maximum(np.abs(q_min), np.abs(q_max)))

    def forms_surely(self) -> Bools:
        """Those that need no commitment: nothing keeps them from running."""
        surely = self.forming()
        surely[self.committed] = False
        return surely

    def merge_key(self, table: GeneratorTable) -> Hashable | None:
        """Its price, tank and fuel; a unit with a curve, ramps or commitment stays alone."""
        ramps = (table.ramp_up_mw_per_h, table.ramp_down_mw_per_h)
        limits = (table.cost_curve, table.fuel_curve, *ramps)
        if any(x is not None for x in limits) or table.needs_commitment:
            return None
        return float(table.cost_per_mwh), table.tank, table.fuel_m3_per_mwh

    def with_spill(self, stage: Stage, fed: Injection) -> Injection:
        """What units that cannot go down at will feed in, less what nobody takes of it.

        A unit that has to run, or to come down slowly, feeds a load bank where an island takes less
        than it must give: it burns for it, so it is never cheaper than to be able to go down.
        """
        units = np.union1d(self.committed, self.ramped)
        if not len(units):
            return fed
        names = [self.names[k] for k in units]
        spilled = stage.var(
            "generator.spilled", names, 0.0, self._array("p_max_mw", units), about="power spilled"
        )
        stage.le("generator.spilled", spilled, stage["generator.p"][units])
        return replace(fed, p=fed.p - scatter(spilled, units, len(self.names), self.names))

    def _array(self, key: str, units: Ints | None = None) -> Floats:
        tables = self.tables if units is None else [self.tables[i] for i in units]
        return np.array([getattr(t, key) for t in tables], float)

    def _where(self, *keys: str) -> Ints:
        return np.flatnonzero([any(getattr(t, k) for k in keys) for t in self.tables])

    @cached_property
    def committed(self) -> Ints:
        """Units that need an on/off decision."""
        return np.flatnonzero([table.needs_commitment for table in self.tables])

    @cached_property
    def ramped(self) -> Ints:
        """Units with a ramp limit."""
        limited = [t.ramp_up_mw_per_h is not None or t.ramp_down_mw_per_h is not None
                   for t in self.tables]  # fmt: skip
        return np.flatnonzero(limited)

    def emit(self, stage: Stage) -> Injection:
        """Power between the limits, at its cost."""
        p_max = stage.data("generator.p_max", self.names, about="power limit")
        p = stage.var("generator.p", self.names, 0.0, p_max, about="power fed in")
        straight = np.flatnonzero([t.cost_curve is None for t in self.tables])
        price = self._array("cost_per_mwh", straight)
        stage.cost("generator.energy", p[straight], price * stage.dt)
        q = self._reactive(stage)
        if len(self.committed):
            self._commitment(stage, p, q)
        self._curves(stage, p)
        if len(self.ramped):
            self._ramps(stage, p)
        return Injection(p, q, self.bus)

    def _curves(self, stage: Stage, p: Affine) -> None:
        for i, table in enumerate(self.tables):
            if table.cost_curve is not None:
                points = np.asarray(table.cost_curve, float).T
                name = f"generator.curve.{table.name}"
                row = np.flatnonzero(self.committed == i)
                total = stage["generator.on"][row] if len(row) else 1.0
                spent = stage.piecewise(name, p[[i]], points[:1], points[1:], "$/h", total)
                stage.cost("generator.energy", spent, stage.dt)

    def _reactive(self, stage: Stage) -> Affine | None:
        if not stage.reactive:
            return None
        limits = [
            stage.data(f"generator.q_{side}", self.names, unit="Mvar", about="reactive limit")
            for side in ("min", "max")
        ]
        return stage.var("generator.q", self.names, *limits, unit="Mvar", about="reactive power")

    def _commitment(self, stage: Stage, p: Affine, q: Affine | None) -> None:
        units = self.committed
        names = [self.names[i] for i in units]
        alive = stage.data("generator.alive", names, unit="1", about="whether its island is alive")
        was, on = stage.state(
            "generator.on", names, 0.0, alive, unit="1", about="running", integer=True
        )
        start = stage.var("generator.start", names, 0.0, 1.0, unit="1", about="starts")
        stop = stage.var("generator.stop", names, 0.0, 1.0, unit="1", about="stops")
        low, high = self._array("p_min_mw", units), self._array("p_max_mw", units)
        stage.le("generator.p_upper", p[units], on * high)
        stage.le("generator.p_lower", on * low, p[units])
        if AT_BUS in stage:
            stage.le("generator.energised", on, stage[AT_BUS][self.bus[units]])
        if q is not None:
            stage.le("generator.q_upper", q[units], on * self._array("q_max_mvar", units))
            stage.le("generator.q_lower", on * self._array("q_min_mvar", units), q[units])
        stage.eq("generator.transition", on - was, start - stop)
        stage.le("generator.start_on", start, on)
        stage.le("generator.start_off", start, 1.0 - was)
        stage.cost("generator.no_load", on, self._array("no_load_cost_per_h", units) * stage.dt)
        stage.cost("generator.start", start, self._array("start_cost", units))
        running = {"up": (on, start), "down": (1.0 - on, stop)}
        for way, (while_, begin) in running.items():
            self._minimum_time(stage, way, while_, begin)

    def _bound(self, stage: Stage) -> Affine:
        """(units,) datum: 1 where what ran before binds, 0 where an outage takes that away."""
        if BOUND in stage:
            return stage[BOUND]
        about = "whether limits on stopping hold"
        return stage.data(BOUND, self.names, unit="1", about=about)

    def _dark(self, stage: Stage, units: Ints) -> Affine:
        """(units,) 1 where the island of a unit that cannot form one is not energised."""
        if AT_BUS not in stage:
            return Affine.constant(0.0, len(units))
        follows = np.array([not self.tables[i].grid_forming for i in units], float)
        return (1.0 - stage[AT_BUS][self.bus[units]]) * follows

    def _minimum_time(self, stage: Stage, way: str, while_: Affine, begin: Affine) -> None:
        units = self._timed(way)
        if not len(units):
            return
        rows = np.searchsorted(self.committed, units)  # of the timed units, among the committed
        hours = self._array(f"min_{way}_h", units)
        name = f"generator.{way}_left"
        now, after = stage.state(
            name, [self.names[i] for i in units], 0.0, hours, unit="h",
            about=f"hours still to stay {'on' if way == 'up' else 'off'}",
        )  # fmt: skip
        zero = Affine.constant(0.0, len(units))
        waived = lapsed = zero
        if way == "up":
            waived = (1.0 - self._bound(stage)[units] + self._dark(stage, units)) * hours
            lapsed = stage["generator.stop"][rows] * hours
        stage.le(f"generator.min_{way}", now, while_[rows] * hours + waived)
        pace = begin[rows] * np.maximum(hours - stage.dt, 0.0)
        stage.largest(name, after, now - lapsed - stage.dt, pace, zero)

    def _timed(self, way: str) -> Ints:
        return self._where(f"min_{way}_h")

    def _ramps(self, stage: Stage, p: Affine) -> None:
        units, dt = self.ramped, stage.dt
        names = [self.names[i] for i in units]
        before, after = stage.state(
            "generator.p_before", names, 0.0, self._array("p_max_mw", units), unit="MW",
            about="power in the step before",
        )  # fmt: skip
        stage.eq("generator.remember", after, p[units])
        limits = [
            np.nan_to_num(self._array(f"ramp_{way}_mw_per_h", units), nan=np.inf) * dt
            for way in ("up", "down")
        ]
        low, high = self._array("p_min_mw", units), self._array("p_max_mw", units)
        up, down = (np.minimum(limit, high) for limit in limits)
        lost = (1.0 - self._bound(stage)[units] + self._dark(stage, units)) * high
        start, stop = self._starts(stage, units)
        stage.le("generator.ramp_up", p[units] - before, start * low + up)
        stage.le("generator.ramp_down", before - p[units], stop * low + down + lost)

    def _starts(self, stage: Stage, units: Ints) -> tuple[Affine, Affine]:
        if not len(self.committed):
            zero = Affine.constant(0.0, len(units))
            return zero, zero
        spread = [
            scatter(stage[f"generator.{word}"], self.committed, len(self.tables))
            for word in ("start", "stop")
        ]
        return spread[0][units], spread[1][units]

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Limits, zero in a dead island, and where what ran before binds."""
        alive = self.available(situation)
        p_max = self._array("p_max_mw")[:, None]
        q_min, q_max = self._array("q_min_mvar"), self._array("q_max_mvar")
        # A unit that stands still has none; the rows of those that may hold them to their limits.
        q_min[self.committed] = np.minimum(q_min[self.committed], 0.0)
        q_max[self.committed] = np.maximum(q_max[self.committed], 0.0)
        return {
            "generator.p_max": p_max * alive,
            "generator.q_min": q_min[:, None] * alive,
            "generator.q_max": q_max[:, None] * alive,
            "generator.alive": alive[self.committed],
            BOUND: alive * ~situation.outage_begins[self.bus],
        }

    def start(self) -> dict[str, Floats]:
        """Running or not, hours still to wait, and power in the step before."""
        on, hours = self._array("initial_on"), self._array("initial_hours")
        states = {
            "generator.on": on[self.committed],
            "generator.p_before": (self._array("p_initial_mw") * on)[self.ramped],
        }
        for way, ours in (("up", on), ("down", 1.0 - on)):
            remaining_h = np.maximum(self._array(f"min_{way}_h") - hours, 0.0) * ours
            states[f"generator.{way}_left"] = remaining_h[self._timed(way)]
        return states
