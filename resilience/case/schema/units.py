"""What tables have in common: a device's name, bus and prices, and how whatever fails does so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from resilience.case.schema.fields import Name, Positive, Table


class DeviceTable(Table):
    """What every device has.

    Attributes:
        buildable: by attribute, what a device has to be for `[[plan.site]]` to build it: free
            between nothing and its limits, and in order; None: nobody builds such devices.
    """

    buildable: ClassVar[Mapping[str, object] | None] = None

    name: Name = Field(description="unique name of the device")
    bus: Name = Field(description="name of its bus")

    @property
    def marginal_cost_per_mwh(self) -> float | None:
        """Cost of one more MWh, of units that can be called on at any time; None of all others."""
        return None

    @property
    def shed_price_per_mwh(self) -> float | None:
        """Price of a MWh that is not served, priority included; None where nothing is served."""
        return None


MAX_MEAN_H = 1e7
"""A thousand years, of the time to a failure: beyond, a number is a slip."""
HoursToFailure = Annotated[
    Positive | None,
    Field(
        le=MAX_MEAN_H,
        description="mean time to failure, h, exponential; absent: it does not fail",
    ),
]
HoursToRepair = Annotated[
    Positive | None,
    Field(description="mean time to repair, h, exponential; absent: not within the horizon"),
]
Availability = Annotated[
    float,
    Field(gt=0, le=1, description="probability that it is in order as the horizon starts"),
]


class FallibleTable(Table):
    """What may be out of order as a line may be, under its name.

    Outages may name it. A table that has the keys `mttf_h`, `mttr_h`, `availability` or
    `start_failure` says how it fails, and scenarios draw that.

    Attributes:
        stands_by: it is in service only while its bus is without the main grid.
    """

    name: Name = Field(description="unique name")

    stands_by: ClassVar[bool] = False

    @property
    def can_fail(self) -> bool:
        """Whether it is drawn when it is out of order."""
        sound = {"mttf_h": None, "start_failure": 0.0, "availability": 1.0}
        return any(getattr(self, key, value) != value for key, value in sound.items())


class UnitTable(DeviceTable, FallibleTable):
    """A device that may be out of order: its component heeds `DeviceFleet.available`."""
