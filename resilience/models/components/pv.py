r"""Photovoltaic plants (paper eq. 1).

$$ 0 \le p_i \le a_i, \qquad p_i = a_i \text{ where it must be taken}, \qquad
p_i^2 + q_i^2 \le S_i^2, \qquad C = \Delta t \sum_i c_i p_i $$

| symbol | name | unit |
|---|---|---|
| $a_i$ | `pv.available` (data): profile times `p_max_mw`, zero in a dead island | MW |
| $p_i$ | `pv.p`; not even what must be taken is, where the plan leaves an island dark | MW |
| $q_i$ | `pv.q`, only with an inverter rating `s_mva` $= S_i$; else in proportion to $p_i$ | Mvar |
| $c_i$ | `cost_per_mwh` | $/MWh |
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.schema import PVTable
from resilience.models.components.base import AT_BUS, Injection, inverter
from resilience.models.components.fleet import DeviceFleet, EnergyTerm, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class PV(DeviceFleet):
    """All PV plants."""

    kind: ClassVar[str] = "pv"
    role: ClassVar[Role] = "weather"
    title: ClassVar[str] = "PV"
    colour: ClassVar[str] = "#f0c93a"
    flows: ClassVar = {"pv.p": 1.0}
    limit: ClassVar[str] = "pv.available"
    fed: ClassVar = EnergyTerm("pv", "PV")
    curtailed: ClassVar = EnergyTerm("pv_curtailed", "PV curtailed")
    forced: ClassVar = "pv.must_take"

    tables: Sequence[PVTable]

    @classmethod
    def showcase(cls) -> PVTable:
        """A plant with an inverter rating."""
        return PVTable(name="pv", bus="1", p_max_mw=1.0, s_mva=1.1)

    def power_range(self) -> tuple[Floats, Floats]:
        """From nothing to the output at a profile of 1."""
        p_max = np.array([t.p_max_mw for t in self.tables], float)
        return np.zeros_like(p_max), p_max

    def capacity(self) -> tuple[Floats, Floats]:
        """Reactive power of the inverter either way, beside what the sun gives."""
        rating = np.array([t.s_mva or 0.0 for t in self.tables])
        return rating, rating

    def apparent_mva(self) -> Floats:
        """The inverter's rating."""
        return self.capacity()[0]

    def must_take(self) -> Bools:
        """Plants that cannot be curtailed."""
        return np.array([not t.curtailable for t in self.tables], bool)

    def expected(self) -> tuple[tuple[str | None, float], ...]:
        """The sun's profile and the output at its 1."""
        return tuple((t.profile, t.p_max_mw) for t in self.tables)

    def merge_key(self, table: PVTable) -> Hashable:
        """Whether it can be curtailed, and its price."""
        return table.curtailable, table.cost_per_mwh

    def reactive_per_mw(self) -> Floats:
        """Of plants with a constant ratio, `q_mvar` to `p_max_mw`."""
        return np.array([t.q_mvar / t.p_max_mw if t.q_mvar else 0.0 for t in self.tables])

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
        lower_mw = np.zeros(len(self.tables)) if AT_BUS in stage else must
        p = stage.var("pv.p", self.names, lower_mw, available, about="power fed in")
        prices = np.array([t.cost_per_mwh for t in self.tables])
        stage.cost("pv.energy", p, prices * stage.dt)
        q = inverter(stage, "pv", p, self.s_mva, self.rated)
        ratio = self.reactive_per_mw()
        if stage.reactive and ratio.any():
            q = p * ratio if q is None else q + p * ratio
        return Injection(p, q, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Available power, must-take power, and the limits of reactive power."""
        sun = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        alive = self.available(situation)
        available = sun.reshape(alive.shape) * alive
        return {
            "pv.available": available,
            "pv.must_take": available * self.must_take()[:, None],
            "pv.q_max": self.s_mva[:, None] * alive[self.rated],
        }
