r"""Voltages, and what flows to earth at the buses.

The square of the voltage magnitude at bus $b$ keeps to its band; at a grid connection it is the
grid's own. An island without the grid has no reference: its forming unit may choose any voltage
within the band, so nothing is fixed there.

$$ \underline{V}_b^2 \le v_b \le \overline{V}_b^2, \qquad v_b = V_\text{grid}^2 \text{ at a grid
connection} $$

A shunt of admittance $g_b + \mathrm{j} b_b$, a capacitor or a constant impedance, feeds in

$$ p_b = -g_b v_b, \qquad q_b = b_b v_b $$

Without admittances to earth the voltage of a dead island means nothing. With them it has to be
zero, as nothing feeds them there: both limits are zero then. Where it is decided which islands are
alive, $a_b$ (`resilience.models.components.forming`) is the status of the bus, all or nothing:
$\underline{V}_b^2 a_b \le v_b \le \overline{V}_b^2 a_b$.

| symbol | name | unit |
|---|---|---|
| $v_b$ | `bus.v_sq`, squared voltage magnitude | pu² |
| $\underline{V}_b, \overline{V}_b$ | `v_min_pu`, `v_max_pu` | pu |
| their squares | `bus.v_sq_min`, `bus.v_sq_max` (data), where the dead have none | pu² |
| $\theta_b$ | `bus.angle`, where lines make loops | rad |
| $g_b + \mathrm{j} b_b$ | shunts on a base of 1 MVA | pu |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Complexes, Floats
from resilience.models.algebra import Labels
from resilience.models.components.base import AT_BUS, Injection
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class Buses:
    """Voltage band and shunts of every bus.

    Attributes:
        names: of the buses.
        v_min_pu, v_max_pu: (buses,) the band; equal limits hold a voltage.
        shunt: (buses,) admittance to earth, pu on 1 MVA.
        sure: (buses,) alive whatever is decided; elsewhere decisions tell, or data.
        is_charged: whether anything in the network flows to earth; then the dead have no voltage.
        looped: (buses,) those on a loop of lines, which need an angle.
    """

    names: Labels
    v_min_pu: Floats
    v_max_pu: Floats
    shunt: Complexes
    sure: Bools
    is_charged: bool
    looped: Bools

    def emit(self, stage: Stage) -> Injection | None:
        """Declares the squared voltages; feeds in what shunts do."""
        low, high = self.v_min_pu**2, self.v_max_pu**2
        if self.is_charged:
            self._emit_with_dark(stage, low, high)
        else:
            stage.var("bus.v_sq", self.names, low, high, unit="pu²", about=_ABOUT)
        if self.looped.any():
            names = [self.names[k] for k in np.flatnonzero(self.looped)]
            about = "angle of the voltage, without phase shifts"
            stage.var("bus.angle", names, -ANGLE_MAX, ANGLE_MAX, unit="rad", about=about)
        rows = np.flatnonzero(self.shunt)
        if not len(rows):
            return None
        v, y = stage["bus.v_sq"][rows], self.shunt[rows]
        return Injection(v * -y.real, v * y.imag, rows)

    def _emit_with_dark(self, stage: Stage, low: Floats, high: Floats) -> None:
        lowest, highest = (
            stage.data(f"bus.v_sq_{end}", self.names, unit="pu²", about=f"{words} squared voltage")
            for end, words in (("min", "least"), ("max", "greatest"))
        )
        if AT_BUS not in stage:
            stage.var("bus.v_sq", self.names, lowest, highest, unit="pu²", about=_ABOUT)
            return
        lower = np.where(self.sure, low, 0.0)
        v = stage.var("bus.v_sq", self.names, lower, highest, unit="pu²", about=_ABOUT)
        rows = np.flatnonzero(~self.sure)
        alive = stage[AT_BUS][rows]
        stage.le("bus.dark", v[rows], alive * high[rows])
        stage.le("bus.lit", alive * low[rows], v[rows])

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Both limits, zero in dead islands; none where nothing flows to earth."""
        if not self.is_charged:
            return {}
        low, high = (
            limit[:, None] ** 2 * situation.alive for limit in (self.v_min_pu, self.v_max_pu)
        )
        return {"bus.v_sq_min": low, "bus.v_sq_max": high}

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}


_ABOUT = "squared voltage magnitude"
ANGLE_MAX = 3.2
"""Of a bus, rad; only differences count, and none is beyond a right angle."""
