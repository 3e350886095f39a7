r"""Cold load: after an interruption a load returns with a surplus that decays.

What a load went without is remembered as a backlog, and forgotten with the time constant $\tau$. Of
the backlog the share $\sigma$ is made up for while the load is served, so that a load that was cut
off for long comes back with $1 + \sigma$ times its demand, and the surplus decays as
$e^{-t / \tau}$ (the exponential decay of cold load pickup: Ucak and Pahwa, IEEE Transactions on
Power Delivery 9(3), 1994):

$$ b' = \delta b + \tau (1 - \delta) s, \qquad
\rho \left(b - \tau s\right) \le r \le \rho b, \qquad r \ge 0, \qquad
\delta = e^{-\Delta t / \tau}, \quad \rho = \sigma (1 - \delta) / \Delta t $$

$\rho b$ is the mean over the step of the surplus $\sigma b / \tau\, e^{-t / \tau}$, so that what
a load makes up for, $\sigma b$ in all, does not depend on the step. A load stands for many
customers, and shedding a MW of it again spares the surplus of those that had gone cold, of
$\sigma / \tau$ MW per MWh: therefore the lower limit. In a dead island nobody is served, and
$r = 0$ whatever the lower limit, which demand that falls may leave above it. Where that is decided,
see `forming`, an island is dark as a whole or not at all: $a (1 - a) = 0$. What is shed, and paid
for, is the demand $d \ge s$ alone.

| symbol | name | unit |
|---|---|---|
| $b, b'$ | `load.backlog` at the start and end of the step | MWh |
| $r$ | `load.surplus`, at most `load.surplus_max` (data), 0 in a dead island | MW |
| $s$ | `load.shed` | MW |
| $1 - a$ | `load.dark`, where that is decided | 1 |
| $\sigma, \tau$ | `cold_load_share`, `cold_load_h` | 1, h |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.models.algebra import Affine, Labels
from resilience.models.components.base import AT_BUS, Injection
from resilience.models.components.fleet import DeviceFleet
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation
from resilience.models.structures import Split


@dataclass(frozen=True)
class ColdLoads:
    """Those loads of one kind that return with a surplus.

    Attributes:
        loads: all of the kind.
    """

    loads: DeviceFleet

    @property
    def names(self) -> Labels:
        """Names of the loads."""
        return tuple(self.loads.names[k] for k in self.loads.cold)

    @property
    def backlog(self) -> str:
        """Name of the state."""
        return f"{self.loads.kind}.backlog"

    def _array(self, key: str) -> Floats:
        return np.array([getattr(self.loads.tables[k], key) for k in self.loads.cold], float)

    def emit(self, stage: Stage) -> Injection:
        """What is taken beside the demand; loads are emitted."""
        loads, kind, rows = self.loads, self.loads.kind, self.loads.cold
        share, tau_h = self._array("cold_load_share"), self._array("cold_load_h")
        room = loads.surplus_max_mw()[rows]
        keeps = np.exp(-stage.dt / tau_h)
        per_mwh = share * (1.0 - keeps) / stage.dt
        shed = stage[loads.shed][rows]
        now, after = stage.state(
            self.backlog, self.names, 0.0, room / share * tau_h, unit="MWh", about="gone without"
        )
        stage.eq(f"{kind}.cold", after, now * keeps + shed * (tau_h * (1.0 - keeps)))
        limit = stage.data(f"{kind}.surplus_max", self.names, about="surplus limit")
        surplus = stage.var(loads.surplus, self.names, 0.0, limit, about="surplus taken")
        waived = room - limit
        if AT_BUS in stage:
            waived = waived + self._dark(stage) * room
            stage.le(f"{kind}.surplus_energised", surplus, stage[AT_BUS][loads.bus[rows]] * room)
        stage.le(f"{kind}.surplus_least", (now - shed * tau_h) * per_mwh - waived, surplus)
        stage.le(f"{kind}.surplus_most", surplus, now * per_mwh)
        q = surplus * -loads.reactive_per_mw()[rows] if stage.reactive else None
        return Injection(-surplus, q, loads.bus[rows])

    def _dark(self, stage: Stage) -> Affine:
        """(loads,) whether the island of a load is dark by decision, all or nothing."""
        names, ones = self.names, np.ones(len(self.names))
        dark = stage.var(f"{self.loads.kind}.dark", names, 0.0, 1.0, unit="1", about="is dark")
        lit = stage[AT_BUS][self.loads.bus[self.loads.cold]]
        stage.eq(f"{self.loads.kind}.whole", lit + dark, 1.0)
        stage.structure(Split, f"{self.loads.kind}.whole", (lit, dark), (ones, ones))
        return dark

    def data(self, situation: Situation) -> dict[str, Floats]:
        """The limit of the surplus, nothing in a dead island."""
        rows = self.loads.cold
        room = self.loads.surplus_max_mw()[rows, None]
        return {f"{self.loads.kind}.surplus_max": room * situation.alive_at(self.loads.bus[rows])}

    def start(self) -> dict[str, Floats]:
        """Nothing was gone without before the start."""
        return {self.backlog: np.zeros(len(self.loads.cold))}
