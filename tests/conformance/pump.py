r"""Pumps that can be switched off, a kind of load that the package does not know.

$$ 0 \le s_l \le d_l, \qquad p_l = s_l - d_l, \qquad C = \Delta t \sum_l \lambda_l s_l $$
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resilience.arrays import Floats
from resilience.case import LoadTable
from resilience.models.components import DeviceFleet, Injection, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


class PumpTable(LoadTable):
    """`[[pump]]`: a load."""


@dataclass(frozen=True)
class Pumps(DeviceFleet):
    """All pumps."""

    kind: ClassVar[str] = "pump"
    role: ClassVar[Role] = "load"
    title: ClassVar[str] = "pumps"
    colour: ClassVar[str] = "#56b4e9"
    flows: ClassVar = {"pump.shed": 1.0, "pump.demand": -1.0}

    tables: Sequence[PumpTable]

    @classmethod
    def showcase(cls) -> PumpTable:
        """A pump."""
        return PumpTable(name="pump", bus="1", p_max_mw=1.0, shed_cost_per_mwh=1.0)

    def emit(self, stage: Stage) -> Injection:
        """Demand less what is shed."""
        demand = stage.data("pump.demand", self.names, about="demand")
        cut_off = stage.data("pump.shed_min", self.names, about="demand that cannot be reached")
        shed = stage.var("pump.shed", self.names, cut_off, demand, about="demand shed")
        price = np.array([t.shed_price_per_mwh for t in self.tables])
        stage.cost("pump.shed", shed, price * stage.dt)
        return Injection(shed - demand, None, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Demand, and the part of it in dead islands."""
        demand = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        return {
            "pump.demand": demand,
            "pump.shed_min": demand * (1.0 - situation.alive_at(self.bus)),
        }

    def power_range(self) -> tuple[Floats, Floats]:
        """From the peak, negative, to nothing."""
        peak = np.array([t.p_max_mw for t in self.tables])
        return -peak, np.zeros_like(peak)

    def expected(self) -> tuple[tuple[str | None, float], ...]:
        """The profile and the peak, negative."""
        return tuple((t.profile, -t.p_max_mw) for t in self.tables)
