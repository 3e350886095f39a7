r"""Photovoltaic plants (paper eq. 1).

$$ 0 \le p_i \le a_i, \qquad p_i = a_i \text{ where it must be taken}, \qquad
p_i^2 + q_i^2 \le S_i^2, \qquad C = \Delta t \sum_i c_i p_i $$

| symbol | name | unit |
|---|---|---|
| $a_i$ | `pv.available` (data): profile times `p_max_mw`, zero in a dead island | MW |
| $p_i$ | `pv.p` | MW |
| $q_i$ | `pv.q`, only with an inverter rating `s_mva` $= S_i$ | Mvar |
| $c_i$ | `cost_per_mwh` | $/MWh |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.components.base import Injection, inverter
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case.schema import PVTable


@dataclass(frozen=True)
class PV:
    """All PV plants; `bus` are indices (plants,)."""

    tables: Sequence[PVTable]
    bus: Ints

    @property
    def names(self) -> Labels:
        """Names in the order of all arrays."""
        return tuple(t.name for t in self.tables)

    @property
    def rated(self) -> Ints:
        """Plants whose inverter has a rating."""
        return np.flatnonzero([t.s_mva is not None for t in self.tables])

    @property
    def s_mva(self) -> Floats:
        """Ratings of the rated plants, in MVA."""
        return np.array([self.tables[i].s_mva for i in self.rated], float)

    def emit(self, stage: Stage) -> Injection:
        """Power up to what the sun gives."""
        available = stage.data("pv.available", self.names, about="power available")
        must = stage.data("pv.must_take", self.names, about="power that cannot be curtailed")
        p = stage.var("pv.p", self.names, must, available, about="power fed in")
        prices = np.array([t.cost_per_mwh for t in self.tables])
        stage.cost("pv.energy", p, prices * stage.dt)
        return Injection(p, inverter(stage, "pv", p, self.s_mva, self.rated), self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Available power, must-take power, and the limits of reactive power."""
        sun = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        alive = situation.alive_at(self.bus)
        available = sun.reshape(alive.shape) * alive
        forced = np.array([not t.curtailable for t in self.tables], float)
        return {
            "pv.available": available,
            "pv.must_take": available * forced[:, None],
            "pv.q_max": self.s_mva[:, None] * alive[self.rated],
        }

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}
