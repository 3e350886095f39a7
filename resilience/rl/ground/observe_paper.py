"""What the paper's agents see: a state of charge, a counter, and a window of PV and load.

An agent's state is [SoC_n, c_n, v] with v what its GRU makes of the window (eqs. 9 to 13). What the
paper leaves open, and what is done here:

- *scales*: the state of charge is 0 to 1 within its band, the counter 1 for a whole day, and the
  rows of the window are per unit of each device's largest power;
- *the counter after the peak* is 0; it is 0 too where the peak is unknown, since the paper's agents
  always know it;
- *the counter of an agent*: the paper does not say which breakpoint an agent belongs to. The
  forecast is of the first breakpoint's peak, the others being shifted by up to 45 minutes that
  nobody can know, so all agents have the same counter;
- *the window* holds the present slot as it is and seven predictions, one row per device;
- *what is not seen*: whether there is a grid, since when an outage lasts, the time of day, prices.
  An agent cannot tell an outage from normal operation. That is the paper's, and it is kept.
"""

from __future__ import annotations

import numpy as np

from resilience.models.components import in_roles
from resilience.rl.ground.eyes import Eyes, ObservationBlock
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting

WINDOW = 8  # slots, the present one among them


class PaperObserver(Eyes):
    """Makes the paper's observations: states of charge, counters, then the window slot by slot.

    Args:
        setting: where it is.

    Attributes:
        blocks: what an observation holds, in order.
        rows: of the window, one per PV plant and per load.
    """

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        simulator = setting.simulator
        fleets = list(setting.microgrid.fleets.values())
        profiles: list[str | None] = []
        labels: list[str] = []
        for role in ("weather", "load"):
            for fleet in in_roles(fleets, role):
                expected = fleet.expected()
                profiles += [name for name, _ in expected]
                labels += fleet.names[: len(expected)]
        self.rows = len(labels)
        self._rows_of = [
            (name, np.flatnonzero([name == followed for followed in profiles]))
            for name in dict.fromkeys(profiles)
        ]
        units, per_day = simulator.units, float(setting.case.window.slots_per_day)
        window = tuple(f"{label}+{k}" for k in range(WINDOW) for label in labels)
        self.blocks = (
            ObservationBlock("soc_of_band", units, (1.0,) * len(units)),
            ObservationBlock("slots_to_peak", units, (per_day,) * len(units)),
            ObservationBlock("power_pu", window, (1.0,) * len(window)),
        )

    def world(self, observation: Observation, out: np.ndarray | None = None) -> np.ndarray:
        """(numbers but those of storage, batch) counters and window of a slot, in single precision;
        once in each slot.

        Args:
            observation: of the slot.
            out: where it is written to; a new array if omitted.
        """
        window = self.setting.case.window
        slots = observation.t + np.arange(WINDOW)
        now = window.slot_of_day(observation.t)
        peak = observation.centre * 15.0 / window.step_min
        counter = np.where(observation.centre >= 0, np.maximum(peak - now, 0.0), 0.0)
        units = len(self.setting.simulator.units)
        world = out
        if world is None:
            world = np.empty((units + WINDOW * self.rows, len(counter)), np.float32)
        world[:units] = counter / window.slots_per_day
        rows = world[units:].reshape(WINDOW, self.rows, -1)
        for name, of_name in self._rows_of:
            rows[:, of_name] = observation.forecast(name, slots)[:, None]
        return world
