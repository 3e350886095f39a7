"""What may be known of a world beforehand: everything but what will happen in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import MilpSimulator
from resilience.simulation.slots import Stepper

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.fragility.beliefs.belief import Belief
    from resilience.simulation.forecast import ForecastError

CASE: Literal["case"] = "case"
"""What operators believe in who believe in the case's own process."""
Believed: TypeAlias = "Scenarios | Literal['case'] | None"


@dataclass(frozen=True)
class Setting:
    """What a dispatcher is made from, and all that it may know before the first slot.

    Attributes:
        microgrid: the case at its physics.
        simulator: what steps it; `simulator.limits` says what storage can do.
        lines: names of the lines that can fail, and of the units.
        numbers: (batch,) what the scenarios are called among all of a comparison; see
            `World.index`.
        end_value_per_mwh: credit for energy stored at the end, $ per MWh.
        known_centre: it is told at midnight where the day's hazard is forecast to peak.
        reset_daily: the state of charge starts anew every midnight.
        error_correlation: of forecast errors from one slot to the next; None where there are none.
        error_law: of forecast errors, as operators know it; None: they plan with the forecast.
        ends: slots at whose end the energy left is credited.
        believed: what operators hold of outages to come: scenarios, the case's own process, or None
            where the storms are not the case's and nobody has said what is believed of them.
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
    believed: Believed = CASE
    error_law: ForecastError | None = None

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

    def start_states(self) -> Mapping[str, Floats]:
        """(devices, batch) by name what devices carry at the start, beside energy and fuel."""
        if not isinstance(self.simulator, MilpSimulator):
            return {}
        start = self.microgrid.start()
        return {
            name: np.repeat(start[name][:, None], self.n, axis=1)
            for name in self.simulator.device_states
        }

    def start(self) -> Floats:
        """(units, batch) MWh stored at the start."""
        energy = self.microgrid.start().get("ess.energy", np.empty(0))
        return np.repeat(energy[:, None], self.n, axis=1)

    def belief(self, seed: int = 0) -> Belief:
        """What is believed of outages to come, with sampled futures from a seed of its own.

        Raises:
            CaseError: the case does not say where its lines are.
            UsageError: nobody has said what is believed.
        """
        if self.believed is None:
            raise no_belief()
        if isinstance(self.believed, Scenarios):
            from resilience.fragility.beliefs.scenario_belief import ScenarioBelief

            return ScenarioBelief(self.believed, self.lines, self.case.step_h, seed)
        from resilience.fragility.beliefs.belief import case_belief

        return case_belief(self.case, self.lines, seed=seed)


def no_belief() -> UsageError:
    """What to say where storms are given and nobody has said what is believed of them."""
    return UsageError(
        "the storms are given, and not what operators believe of them; allowed: other scenarios, "
        "`case` for the case's own process, or `same`",
        hint="--believe FILE; `same` tells operators what may happen, but not which of it does",
    )
