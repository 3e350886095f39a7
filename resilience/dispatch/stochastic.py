"""The hazard-aware fan: a two-stage program over sampled outage paths, solved anew every slot.

The first slot is common to all paths; from the second on, each path knows its own outages. Paths
that are alike become one of their common probability; where none has an outage, that is a chain.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.dispatch.end_value import stored_energy_value
from resilience.dispatch.memory import Memory
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.window_program import (
    MEAN,
    WindowProgram,
    WindowRequest,
    WindowSteps,
    check_storage,
)
from resilience.fragility.beliefs.belief import Belief, case_belief
from resilience.fragility.outages.bell import Bell
from resilience.models.program.risk import Risk
from resilience.simulation.world import Observation, World


class Stochastic:
    """Two-stage dispatch over sampled outages, conditioned on what is known.

    Args:
        world: where it acts.
        belief: in outages to come, or the bell to believe in; the case's own if omitted.
        paths: sampled futures; fewer than 30 miss rare joint outages.
        steps: of every path.
        risk: what counts besides the mean over the paths.
        seed: of the sampled futures; they have nothing to do with the storms it is judged on.
    """

    def __init__(
        self,
        world: World,
        belief: Belief | Bell | None = None,
        *,
        paths: int = 30,
        steps: WindowSteps | None = None,
        risk: Risk = MEAN,
        seed: int = 0,
    ) -> None:
        check_storage(world.microgrid.case)
        self.name = "stochastic-cvar" if risk.averse else "stochastic"
        self.world, self.paths, self.risk, self.seed = world, paths, risk, seed
        self.steps = steps or WindowSteps()
        if belief is None or isinstance(belief, Bell):
            lines = world.scenarios.lines
            belief = case_belief(world.microgrid.case, lines, bell=belief, seed=seed)
        self.belief: Belief = belief
        self.small = merged_grid(world.microgrid.case)
        self.memory = Memory(world, self.belief.daily)
        self.value = stored_energy_value(world.microgrid.case, world.end_value_per_mwh)
        self.programs: dict[int, WindowProgram] = {}

    def act(self, seen: Observation) -> Floats:
        """The common first slot of every scenario's program."""
        self.memory.update(seen)
        found = np.empty_like(seen.energy)
        for k in range(seen.energy.shape[1]):
            up, share = self._paths(seen, k)
            program = self._program(len(share))
            end = min(seen.t + self.steps.horizon, self.world.microgrid.case.slots)
            now, forecast = seen.energy[:, k], seen.forecast_of(k)
            asked = WindowRequest(seen.t, now, up, share, forecast, self.value[:, end])
            found[:, k] = program.decide(asked)
        return found

    def _paths(self, seen: Observation, k: int) -> tuple[Bools, Floats]:
        """(lines of the case, steps, paths) status and (paths,) probability of different paths.

        Their number is one that a program is kept for: the last one may stand there more than once.
        """
        memory, steps = self.memory, self.steps
        down = self.belief.paths(memory.known(seen, k), steps.horizon - 1, self.paths)
        blocks = np.logical_or.reduceat(down, steps.starts[1:] - 1, axis=1)
        flat = blocks.reshape(-1, self.paths)
        _, first, count = np.unique(flat, axis=1, return_index=True, return_counts=True)
        order = np.argsort(first)
        first, count = first[order], count[order]
        size = self._size(len(first))
        fill = np.minimum(np.arange(size), len(first) - 1)
        share = np.where(np.arange(size) < len(first), count[fill], 0) / self.paths
        up = np.ones((len(seen.line_up), steps.n, size), bool)
        up[:, 0] = seen.line_up[:, [k]]
        up[memory.lines, 1:] = ~blocks[:, :, first[fill]]
        return up, share

    def _size(self, n: int) -> int:
        """Paths of the smallest program that holds n: 1, or a share of all of them."""
        kept = [1, *(int(np.ceil(self.paths * part)) for part in (0.25, 0.5, 0.75, 1.0))]
        return next(size for size in kept if size >= n)

    def _program(self, paths: int) -> WindowProgram:
        if paths not in self.programs:
            self.programs[paths] = WindowProgram(self.small, self.steps, paths, risk=self.risk)
        return self.programs[paths]
