"""Rolling optimisation: the paper's blind window, and one with a terminal value and a reserve."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.end_value import stored_energy_value
from resilience.dispatch.memory import Memory
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.reserve import Reserve, reserve_price
from resilience.dispatch.window_program import WindowProgram, WindowRequest, WindowSteps
from resilience.fragility.beliefs.belief import Belief, case_belief
from resilience.models.microgrid import Microgrid
from resilience.simulation.world import Observation, World

PAPER_SLOTS = 8


class BlindMPC:
    """The paper's baseline: 8 slots, the present line status throughout, no terminal value.

    It is blind to outages to come and to the end of one that has begun, and drains the storage.

    Args:
        world: where it acts.
        slots: length of the window.
        value_per_mwh: what energy left at the end of the window is worth, $/MWh.
    """

    def __init__(self, world: World, slots: int = PAPER_SLOTS, value_per_mwh: float = 0.0) -> None:
        self.name, self.world = "mpc-blind", world
        self.program = WindowProgram(merged_grid(world.microgrid.case), WindowSteps(slots, 0), 1)
        self.value = np.full(len(world.microgrid.case.ess), value_per_mwh)

    def act(self, seen: Observation) -> Floats:
        """The first slot of each scenario's window."""
        found = np.empty_like(seen.energy)
        for k in range(seen.energy.shape[1]):
            up = np.repeat(seen.line_up[:, [k]], self.program.steps.n, axis=1)[:, :, None]
            asked = WindowRequest(
                seen.t, seen.energy[:, k], up, np.ones(1), seen.forecast_of(k), self.value
            )
            found[:, k] = self.program.decide(asked)
        return found


class MPC:
    """Eight slots and ten hours ahead, with a terminal value and a reserve for the storm.

    Energy at the end is worth what the prices of the case say (`value`); while a storm may cut a
    bus off, being short of what its loads would lack is priced (`reserve`). A line that is down is
    expected back after the mean time that its age allows; failures to come are in the reserve
    only.

    Args:
        world: where it acts.
        belief: in outages to come; the case's own if omitted.
        steps: of the window.
    """

    def __init__(
        self, world: World, belief: Belief | None = None, steps: WindowSteps | None = None
    ) -> None:
        self.name, self.world, self.steps = "mpc", world, steps or WindowSteps()
        case, small = world.microgrid.case, merged_grid(world.microgrid.case)
        self.belief = belief or case_belief(case, world.scenarios.lines)
        self.memory = Memory(world, self.belief.daily)
        self.reserve = Reserve(Microgrid.of(case, "copperplate"), world.scenarios.lines)
        self.program = WindowProgram(small, self.steps, 1, self.reserve)
        self.value = stored_energy_value(case, world.end_value_per_mwh)
        self.price = reserve_price(case)
        self.longest = self.belief.longest_slots

    def act(self, seen: Observation) -> Floats:
        """The first slot of each scenario's window."""
        self.memory.update(seen)
        found = np.empty_like(seen.energy)
        for k in range(seen.energy.shape[1]):
            found[:, k] = self.program.decide(self._asked(seen, k))
        return found

    def _asked(self, seen: Observation, k: int) -> WindowRequest:
        steps, memory = self.steps, self.memory
        known = memory.known(seen, k)
        up = np.ones((len(seen.line_up), steps.horizon), bool)
        up[:, 0] = seen.line_up[:, k]
        for line, left in zip(memory.lines, self.belief.expected_left(known), strict=True):
            up[line, 1 : 1 + left] = False
        status = np.minimum.reduceat(up, steps.starts, axis=1)
        end = min(seen.t + steps.horizon, self.world.microgrid.case.slots)
        reserve = self._reserve(seen, k)
        now, forecast = seen.energy[:, k], seen.forecast_of(k)
        value = self.value[:, end]
        return WindowRequest(seen.t, now, status[:, :, None], np.ones(1), forecast, value, reserve)

    def _reserve(self, seen: Observation, k: int) -> tuple[Floats, Floats]:
        """(buses with storage, steps) level and price, for a failure after each step's end."""
        steps, memory, reserve = self.steps, self.memory, self.reserve
        chance = self.belief.chances(memory.known(seen, k), steps.horizon)
        cut_off = reserve.cut_off(chance)
        price = self.price * np.add.reduceat(cut_off, steps.starts, axis=1)
        lack = reserve.lack(seen.forecast_of(k), seen.t + 1, steps.horizon + self.longest)
        level = reserve.level(lack, self.longest)
        ends = np.minimum(steps.starts + steps.width - 1, steps.horizon - 1)
        return level[:, ends], price
