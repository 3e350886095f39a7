"""The hazard-aware fan: a two-stage program over sampled outage paths, solved anew every slot.

The first slot is common to all paths; from the second on, each path knows its own outages, and
where forecasts err its own load and PV. Where they do not, paths that are alike become one of their
common probability; where none has an outage, that is a chain.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.dispatch.distinct_paths import distinct_paths
from resilience.dispatch.end_value import fuel_value, stored_energy_value
from resilience.dispatch.error_paths import ErrorPaths
from resilience.dispatch.memory import Memory
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.window_plan import WindowPlan
from resilience.dispatch.window_program import (
    RISK_NEUTRAL,
    WindowProgram,
    WindowRequest,
    WindowSteps,
    before_of,
    check_stored,
    devices_of,
    fuel_of,
    joined_action,
)
from resilience.fragility.beliefs.belief import Belief, case_belief
from resilience.fragility.outages.bell import Bell
from resilience.models.program.risk import Risk
from resilience.simulation.observation import Action, Observation
from resilience.simulation.setting import Setting


class Stochastic:
    """Two-stage dispatch over sampled outages, conditioned on what is known.

    It remembers since when lines are down, and which have failed, in every scenario.

    Args:
        setting: where it acts.
        belief: in outages to come, or the bell to believe in; that of the setting if omitted.
        paths: sampled futures; fewer than 30 miss rare joint outages.
        steps: of every path; if omitted, half a day, and where there is fuel to keep two.
        risk: what counts besides the mean over the paths.
        seed: of the sampled futures; they have nothing to do with the storms it is judged on.

    Attributes:
        merged: the microgrid, its like devices joined.
        memory: of line failures; to be updated once in every slot.
        value: (units, slots + 1) $ per MWh stored at the start of every slot, and at the end.
        fuel_value: (tanks, slots + 1) $ per m³ likewise, beyond its price.
        errors: of load and PV to come.
        programs: by number of paths, each built when it is first needed; they keep their bases.
    """

    def __init__(
        self,
        setting: Setting,
        belief: Belief | Bell | None = None,
        *,
        paths: int = 30,
        steps: WindowSteps | None = None,
        risk: Risk = RISK_NEUTRAL,
        seed: int = 0,
    ) -> None:
        check_stored(setting.case)
        self.name = "stochastic-cvar" if risk.averse else "stochastic"
        self.setting, self.paths, self.risk, self.seed = setting, paths, risk, seed
        if isinstance(belief, Bell):
            belief = case_belief(setting.case, setting.lines, bell=belief, seed=seed)
        self.belief: Belief = belief or setting.belief(seed)
        self.steps = steps or self._usual_steps()
        self.merged = merged_grid(setting.case)
        self.memory = Memory(setting, daily=self.belief.daily, overnight=self.belief.overnight)
        self.value = stored_energy_value(setting.case, setting.end_value_per_mwh)
        self.fuel_value = fuel_value(setting.case)
        self.errors = ErrorPaths(setting, paths, seed)
        self.programs: dict[int, WindowProgram] = {}
        self._latest: WindowProgram | None = None

    def act(self, observation: Observation) -> Action:
        """The common first slot of every scenario's program: (units, batch) charging power, MW."""
        self.memory.update(observation)
        end = min(observation.t + self.steps.horizon, self.setting.case.slots)
        decisions = []
        for k in range(observation.energy.shape[1]):
            up, probability = self._paths(observation, k)
            request = WindowRequest(
                observation.t,
                observation.energy[:, k],
                up,
                probability,
                observation.forecast_of(k),
                self.value[:, end],
                off=self._off(observation.t, k),
                fuel=fuel_of(observation, k, self.fuel_value[:, end]),
                devices=devices_of(observation, k),
                before=before_of(observation, k),
            )
            self._latest = self._program(len(probability))
            decisions.append(self._latest.decisions(request))
        return joined_action(decisions)

    def latest_plan(self) -> WindowPlan | None:
        """The plan behind its last decision."""
        return None if self._latest is None else self._latest.latest_plan()

    def _usual_steps(self) -> WindowSteps:
        case = self.setting.case
        if not case.tank:
            return WindowSteps()
        return WindowSteps.with_fuel(self.belief.longest_slots, case.step_h)

    def _off(self, t: int, k: int) -> Mapping[str | None, Floats] | None:
        """How load and PV of scenario k may come to be off their forecast, path by path."""
        if self.setting.error_law is None:
            return None
        return self.errors.ahead(int(self.setting.numbers[k]), t, self.steps.horizon)

    def _paths(self, observation: Observation, k: int) -> tuple[Bools, Floats]:
        """(elements of the case, steps, paths) status and (paths,) probability of different paths.

        Their number is one that a program is kept for: the last one may stand there more than once.
        """
        memory, steps = self.memory, self.steps
        history = memory.history(observation, k)
        down = self.belief.paths(history, steps.horizon - 1, self.paths)
        blocks = steps.down(down)
        if self.setting.error_law is not None:  # each path has a load of its own
            up = np.ones((len(observation.line_up), steps.n, self.paths), bool)
            up[:, 0] = observation.line_up[:, [k]]
            up[memory.lines, 1:] = ~blocks
            return up, np.full(self.paths, 1.0 / self.paths)
        distinct = distinct_paths(blocks.reshape(-1, self.paths), as_sampled=True)
        up = np.ones((len(observation.line_up), steps.n, len(distinct.index)), bool)
        up[:, 0] = observation.line_up[:, [k]]
        up[memory.lines, 1:] = ~blocks[:, :, distinct.index]
        return up, distinct.probability

    def _program(self, paths: int) -> WindowProgram:
        if paths not in self.programs:
            self.programs[paths] = WindowProgram(self.merged, self.steps, paths, risk=self.risk)
        return self.programs[paths]
