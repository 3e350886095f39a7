"""What may be known of a world beforehand: everything but what will happen in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.microgrid import Microgrid
from resilience.simulation.slots import Stepper

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class Setting:
    """What a dispatcher is made from, and all that it may know before the first slot.

    Attributes:
        microgrid: the case at its physics.
        simulator: what steps it; `simulator.limits` says what storage can do.
        lines: names of the lines that can fail.
        numbers: (batch,) what the scenarios are called among all of a comparison; see
            `World.index`.
        end_value_per_mwh: credit for energy stored at the end, $ per MWh.
        known_centre: it is told at midnight where the day's hazard is forecast to peak.
        reset_daily: the state of charge starts anew every midnight.
        error_correlation: of forecast errors from one slot to the next; None where there are none.
        ends: slots at whose end the energy left is credited.
    """

    microgrid: Microgrid
    simulator: Stepper
    lines: tuple[str, ...]
    numbers: Ints
    end_value_per_mwh: float
    known_centre: bool
    reset_daily: bool
    error_correlation: float | None
    ends: Ints

    @property
    def case(self) -> Case:
        """The case, over the horizon of the world."""
        return self.microgrid.case

    @property
    def n(self) -> int:
        """Scenarios that are decided for at once."""
        return len(self.numbers)

    def start_fuel(self) -> Floats | None:
        """(tanks, batch) m³ in every tank at the start; None without tanks."""
        if self.microgrid.tanks is None:
            return None
        return np.repeat(self.microgrid.start()["tank.level"][:, None], self.n, axis=1)

    def start(self) -> Floats:
        """(units, batch) MWh stored at the start."""
        energy = self.microgrid.start().get("ess.energy", np.empty(0))
        return np.repeat(energy[:, None], self.n, axis=1)
