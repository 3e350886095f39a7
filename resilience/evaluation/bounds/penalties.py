"""The clairvoyant's programs with prices on what it foresees; see `dual_bound.py`."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol, cast

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.memory import Memory
from resilience.dispatch.registry import REFERENCE, factory_of
from resilience.evaluation.clairvoyant import HorizonProgram
from resilience.fragility.beliefs.belief import Belief
from resilience.fragility.beliefs.history import LineHistory
from resilience.models.backends.base import Solution
from resilience.simulation.observation import Observation
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World

RIDGE = 1.0
"""Slots of a line that is neither, so that what was hardly seen says little."""


class TellsNextSlot(Protocol):
    """A belief that is the process itself, and says so of the next slot."""

    def next_down(self, history: LineHistory) -> Floats:
        """(lines,) probability that each line is down in the next slot."""


class PenalisedProgram:
    """The clairvoyant's programs of a world, with penalties.

    Args:
        world: the storms.

    Attributes:
        period: slots after which slopes repeat: a day where every day has a hazard of its own.
        surprise: (lines, slots, scenarios) whether a line is down in the next slot less the
            probability of that; nothing in the last slot.
    """

    def __init__(self, world: World) -> None:
        self.world, self.slots = world, np.arange(world.microgrid.case.slots)
        belief = world.setting.belief()
        self.memory = Memory(world.setting, daily=belief.daily, overnight=belief.overnight)
        window = world.microgrid.case.window
        self.period = window.slots_per_day if belief.daily else len(self.slots)
        self._place = (window.slots_before_start + self.slots) % self.period
        self.surprise = self._surprises(belief)
        self.program = HorizonProgram(world, len(self.slots))
        self.program.solve_calm(self.slots)

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Of slopes: (units and tanks, lines, slots of the period)."""
        return len(self.program.state_columns), len(self.surprise), self.period

    def optimum(self, slopes: Floats) -> Floats:
        """(scenarios,) $, the penalised optimum of each, proven."""
        every = range(self.world.scenarios.n)
        return np.array([self.program.bound(self._solved(slopes, k)) for k in every])

    def value(self, slopes: Floats) -> float:
        """Its mean less what the reference pays, $: that has the same mean, and little noise."""
        probability = self.world.scenarios.probability
        return float(probability @ (self.optimum(slopes) - self.paid(slopes, self.reference)))

    def gradient(self, slopes: Floats) -> Floats:
        """A subgradient of `value` by the slopes; their mean is concave."""
        total, probability = np.zeros(self.shape), self.world.scenarios.probability
        for k in range(self.world.scenarios.n):
            levels = self.program.levels(self._solved(slopes, k)) - _levels(self.reference)[:, :, k]
            total += probability[k] * self._by_period(k, levels)
        return total

    @cached_property
    def reference(self) -> Trajectory:
        """What somebody does who foresees nothing: a battery kept full."""
        return simulate(self.world, factory_of(REFERENCE)(self.world.setting))

    def _solved(self, slopes: Floats, k: int) -> Solution:
        return self.program.solve(self.slots, k, self._prices(slopes, k))

    def worth(self) -> Floats:
        """(units and tanks, slots, scenarios) $ that one more unit saves the clairvoyant."""
        solutions = (self.program.solve(self.slots, k) for k in range(self.world.scenarios.n))
        return np.stack([self.program.worth(solution) for solution in solutions], axis=2)

    def first_slopes(self) -> Floats:
        """What a unit is worth more if a line is down in the next slot, by least squares."""
        worth, slopes = self.worth(), np.zeros(self.shape)
        down = ~self.world.line_up[self.memory.lines]
        weight = np.sqrt(self.world.scenarios.probability * self.world.scenarios.n)
        lines = len(down)
        ridge = np.diag(np.append(np.full(lines, RIDGE), 1e-9))
        for place in range(self.period):
            slots = self.slots[:-1][self._place[:-1] == place]
            if not len(slots):
                continue
            regressors = np.concatenate([down[:, slots + 1], np.ones((1, len(slots), len(weight)))])
            x = (regressors * weight).reshape(lines + 1, -1)
            y = (worth[:, slots] * weight).reshape(len(worth), -1)
            slopes[:, :, place] = np.linalg.solve(x @ x.T + ridge, x @ y.T)[:lines].T
        return slopes

    def paid(self, slopes: Floats, trajectory: Trajectory) -> Floats:
        """(scenarios,) $ of penalties that a trajectory's own decisions pay."""
        every, levels = slopes[:, :, self._place], _levels(trajectory)
        return np.asarray(np.einsum("skt,ktn,stn->n", every, self.surprise, levels, optimize=True))

    def _prices(self, slopes: Floats, k: int) -> Floats:
        """(units and tanks, slots) $ per unit at the end of every slot of scenario k."""
        return np.asarray(
            np.einsum("skt,kt->st", slopes[:, :, self._place], self.surprise[:, :, k])
        )

    def _by_period(self, k: int, levels: Floats) -> Floats:
        """Levels times surprises of scenario k, added up over the slots of one place."""
        total = np.zeros(self.shape)
        for first in range(0, len(self.slots), self.period):
            slots = self.slots[first : first + self.period]
            by_slot = np.einsum("kt,st->skt", self.surprise[:, slots, k], levels[:, slots])
            total[:, :, self._place[slots]] += by_slot
        return total

    def _surprises(self, belief: Belief) -> Floats:
        """What comes next less what was to be expected of it, slot by slot."""
        world, tells = self.world, cast(TellsNextSlot, belief)
        n, lines = world.scenarios.n, self.memory.lines
        surprise = np.zeros((len(lines), len(self.slots), n))
        nothing = np.empty((0, n))
        islands = nothing.astype(np.intp)
        for t in self.slots[:-1].tolist():
            up = world.line_up[:, t]
            observation = Observation(
                t, nothing, up, islands, world.centre(t), world.forecast(t), nothing
            )
            self.memory.update(observation)
            next_down = ~world.line_up[lines, t + 1]
            for k in range(n):
                expected = tells.next_down(self.memory.history(observation, k))
                surprise[:, t, k] = next_down[:, k] - expected
        return surprise


def _levels(trajectory: Trajectory) -> Floats:
    """(units and tanks, slots, scenarios) MWh and m³ at the end of every slot."""
    fuel = [] if trajectory.fuel is None else [trajectory.fuel[:, 1:]]
    return np.concatenate([trajectory.energy[:, 1:], *fuel])
