"""Rolling optimisation: the paper's blind window, and one with a terminal value and a reserve."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.end_value import fuel_value, stored_energy_value
from resilience.dispatch.memory import Memory
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.reserve import Reserve, reserve_price
from resilience.dispatch.window_plan import WindowPlan
from resilience.dispatch.window_program import (
    WindowProgram,
    WindowRequest,
    WindowSteps,
    before_of,
    devices_of,
    fuel_of,
    joined_action,
)
from resilience.fragility.beliefs.belief import Belief
from resilience.models.microgrid import Microgrid
from resilience.simulation.observation import Action, Observation
from resilience.simulation.setting import Setting

PAPER_SLOTS = 8


class BlindMPC:
    """The paper's baseline: 8 slots, the present line status throughout, no terminal value.

    It is blind to outages to come and to the end of one that has begun, and drains the storage.

    Args:
        setting: where it acts.
        slots: length of the window.
        value_per_mwh: what energy left at the end of the window is worth, $/MWh.

    Attributes:
        program: the window's, built once; it keeps its basis from one solve to the next.
        value: (units,) $ per MWh left at the end of the window.
        fuel_value: (tanks,) $ per m³, beyond its price, left at the end of the window.
    """

    def __init__(
        self, setting: Setting, slots: int = PAPER_SLOTS, value_per_mwh: float = 0.0
    ) -> None:
        self.name = "mpc-blind"
        self.program = WindowProgram(merged_grid(setting.case), WindowSteps(slots, 0), 1)
        self.value = np.full(len(setting.case.ess), value_per_mwh)
        self.fuel_value = np.zeros(len(setting.case.tank))

    def act(self, observation: Observation) -> Action:
        """The first slot of each scenario's window: (units, batch) charging power, MW."""
        decisions = []
        for k in range(observation.energy.shape[1]):
            up = np.repeat(observation.line_up[:, [k]], self.program.steps.n, axis=1)
            request = WindowRequest(
                observation.t,
                observation.energy[:, k],
                up[:, :, None],
                np.ones(1),
                observation.forecast_of(k),
                self.value,
                fuel=fuel_of(observation, k, self.fuel_value),
                devices=devices_of(observation, k),
                before=before_of(observation, k),
            )
            decisions.append(self.program.decisions(request))
        return joined_action(decisions)

    def latest_plan(self) -> WindowPlan | None:
        """The plan behind its last decision."""
        return self.program.latest_plan()


class MPC:
    """Eight slots and ten hours ahead, with a terminal value and a reserve for the storm.

    Energy at the end is worth what the prices of the case say (`end_value`); while a storm may cut
    a bus off, being short of what its loads would lack is priced (`reserve`). A line that is down
    is expected back after the mean time that its age allows; failures to come are in the reserve
    only. It remembers since when lines are down, and which have failed, in every scenario.

    Args:
        setting: where it acts.
        belief: in outages to come; that of the setting if omitted.
        steps: of the window.

    Attributes:
        memory: of line failures; to be updated once in every slot.
        reserve: its rows and data.
        program: the window's, built once; it keeps its basis from one solve to the next.
        value: (units, slots + 1) $ per MWh stored at the start of every slot, and at the end.
        fuel_value: (tanks, slots + 1) $ per m³ likewise, beyond its price.
        price: $ per MWh short of the reserve while the bus is cut off for certain.
        longest: slots of the longest outage that the belief allows.
    """

    def __init__(
        self, setting: Setting, belief: Belief | None = None, steps: WindowSteps | None = None
    ) -> None:
        self.name, self.setting, self.steps = "mpc", setting, steps or WindowSteps()
        case = setting.case
        self.belief = belief or setting.belief()
        self.memory = Memory(setting, daily=self.belief.daily, overnight=self.belief.overnight)
        self.reserve = Reserve(Microgrid.build(case, "copperplate"), setting.lines)
        self.program = WindowProgram(merged_grid(case), self.steps, 1, self.reserve)
        self.value = stored_energy_value(case, setting.end_value_per_mwh)
        self.fuel_value = fuel_value(case)
        self.price = reserve_price(case)
        self.longest = self.belief.longest_slots

    def act(self, observation: Observation) -> Action:
        """The first slot of each scenario's window: (units, batch) charging power, MW."""
        self.memory.update(observation)
        decisions = []
        for k in range(observation.energy.shape[1]):
            decisions.append(self.program.decisions(self._request(observation, k)))
        return joined_action(decisions)

    def latest_plan(self) -> WindowPlan | None:
        """The plan behind its last decision."""
        return self.program.latest_plan()

    def _request(self, observation: Observation, k: int) -> WindowRequest:
        """What the program is asked in scenario k."""
        steps, history = self.steps, self.memory.history(observation, k)
        up = np.ones((len(observation.line_up), steps.n, 1), bool)
        up[:, 0, 0] = observation.line_up[:, k]
        # What is down comes back once, so a block's first slot speaks for the block.
        slots_left = self.belief.expected_left(history)
        up[self.memory.lines, 1:, 0] = steps.starts[1:] > slots_left[:, None]
        end = min(observation.t + steps.horizon, self.setting.case.slots)
        return WindowRequest(
            observation.t,
            observation.energy[:, k],
            up,
            np.ones(1),
            observation.forecast_of(k),
            self.value[:, end],
            self._reserve(observation, k),
            fuel_of(observation, k, self.fuel_value[:, end]),
            devices_of(observation, k),
            before_of(observation, k),
        )

    def _reserve(self, observation: Observation, k: int) -> tuple[Floats, Floats]:
        """(buses with storage, steps) level and price, for a failure after each step's end."""
        steps, reserve, t = self.steps, self.reserve, observation.t
        chance = self.belief.chances(self.memory.history(observation, k), steps.horizon)
        cut_off = reserve.cut_off(chance)
        price = self.price * np.add.reduceat(cut_off, steps.starts, axis=1)
        slots = steps.horizon + self.longest - 1
        forecast, up = observation.forecast_of(k), observation.line_up[:, k]
        lack = reserve.lack(forecast, t + 1, slots, up)
        level = reserve.level(lack, self.longest)
        return level[:, steps.starts + steps.width - 1], price
