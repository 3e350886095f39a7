r"""Wind turbines, a kind of device that the package does not know.

$$ 0 \le p_i \le a_i, \qquad C = \Delta t \sum_i c_i p_i $$

| symbol | name | unit |
|---|---|---|
| $a_i$ | `turbine.available` (data): profile times `p_max_mw`, zero in a dead island | MW |
| $p_i$ | `turbine.p` | MW |
| $c_i$ | `cost_per_mwh` | $/MWh |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from resilience.arrays import Floats
from resilience.case import DeviceTable
from resilience.models.components import DeviceFleet, EnergyTerm, Injection, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


class TurbineTable(DeviceTable):
    """`[[turbine]]`: a wind turbine."""

    p_max_mw: float = Field(ge=0, description="output at a profile value of 1, MW")
    profile: str | None = Field(None, description="profile column; absent: constant at the peak")
    cost_per_mwh: float = Field(0.0, description="price of its energy, per MWh")
    grid_forming: bool = Field(False, description="true: can carry an island alone")


@dataclass(frozen=True)
class Turbines(DeviceFleet):
    """All wind turbines."""

    kind: ClassVar[str] = "turbine"
    role: ClassVar[Role] = "weather"
    title: ClassVar[str] = "wind"
    colour: ClassVar[str] = "#009e73"
    flows: ClassVar = {"turbine.p": 1.0}
    limit: ClassVar[str] = "turbine.available"
    fed: ClassVar = EnergyTerm("turbine", "wind")
    curtailed: ClassVar = EnergyTerm("turbine_curtailed", "wind curtailed")

    tables: Sequence[TurbineTable]

    @classmethod
    def showcase(cls) -> TurbineTable:
        """A turbine."""
        return TurbineTable(name="turbine", bus="1", p_max_mw=1.0)

    def emit(self, stage: Stage) -> Injection:
        """Power up to what the wind gives, without reactive power."""
        available = stage.data("turbine.available", self.names, about="power available")
        p = stage.var("turbine.p", self.names, 0.0, available, about="power fed in")
        prices = np.array([t.cost_per_mwh for t in self.tables])
        stage.cost("turbine.energy", p, prices * stage.dt)
        return Injection(p, None, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Available power."""
        wind = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        return {"turbine.available": wind * situation.alive_at(self.bus)}

    def power_range(self) -> tuple[Floats, Floats]:
        """From nothing to the output at a profile of 1."""
        most = np.array([t.p_max_mw for t in self.tables])
        return np.zeros_like(most), most

    def expected(self) -> tuple[tuple[str | None, float], ...]:
        """The wind's profile and the output at its 1."""
        return tuple((t.profile, t.p_max_mw) for t in self.tables)
