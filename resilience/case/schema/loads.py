"""`[[load]]`: what is served, or shed at a price."""

from __future__ import annotations

import math

from pydantic import Field

from resilience.case.schema.fields import Efficiency, NonNegative, Positive
from resilience.case.schema.units import DeviceTable

MAX_COLD_LOAD, MAX_COLD_LOAD_H = 10.0, 168.0
"""Of a surplus and of its time constant: beyond, a number is in percent, or in minutes."""


class LoadTable(DeviceTable):
    """`[[load]]`: a demand that can be shed at a price."""

    p_max_mw: NonNegative = Field(description="peak demand, MW")
    profile: str | None = Field(None, description="profile column; absent: constant at the peak")
    power_factor: Efficiency = Field(1.0, description="cos phi, lagging, constant")
    q_mvar: float | None = Field(
        None,
        description="reactive demand at the peak, Mvar, negative where it is leading; replaces "
        "power_factor. Beside p_max_mw = 0 it stands alone, follows the profile, and is shed at "
        "the same price per Mvarh",
    )
    shed_cost_per_mwh: NonNegative = Field(description="price of unserved energy, per MWh")
    priority: Positive = Field(1.0, le=1e6, description="multiplies the shed price")
    critical: bool = Field(
        False,
        description="true: reports tell its service apart; where no load is marked, those of a "
        "priority above 1 count",
    )
    customers: int | None = Field(
        None, ge=0, le=10_000_000, description="meters behind it; absent: nobody knows"
    )
    block: bool = Field(False, description="true: served whole or not at all")
    cold_load_share: NonNegative = Field(
        0.0,
        le=MAX_COLD_LOAD,
        description="surplus with which it returns after a long interruption, share of the demand "
        "lost, and of the energy lost what it makes up for; 0: none",
    )
    cold_load_h: Positive = Field(
        1.0,
        le=MAX_COLD_LOAD_H,
        description="time constant with which that surplus builds up and decays, h",
    )

    @property
    def shed_price_per_mwh(self) -> float:
        """Price of a MWh that is not served, priority included."""
        return self.shed_cost_per_mwh * self.priority

    @property
    def q_peak_mvar(self) -> float:
        """Reactive demand at the peak, Mvar; negative where it is leading."""
        if self.q_mvar is not None:
            return self.q_mvar
        return self.p_max_mw * math.tan(math.acos(self.power_factor))
