"""Dispatchers and episodes: everybody faces the same storms, and sees what an operator sees."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from resilience.fragility.scenarios import Scenarios
from resilience.models.algebra import Floats, Ints
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import Simulator
from resilience.models.situation import Situation

Bools = np.ndarray


@dataclass(frozen=True)
class Observation:
    """What an operator sees at the start of a slot, for a batch of scenarios.

    Attributes:
        t: the slot.
        energy: (units, batch) stored energy, MWh.
        line_up: (lines of the case, batch) which lines are up now; a failure is seen in its slot.
        island: (buses of the merged graph, batch) number of each bus's island.
        centre: (batch,) slot of the day at which today's hazard peaks, -1 where unknown.
    """

    t: int
    energy: Floats
    line_up: Bools
    island: Ints
    centre: Ints


class Dispatcher(Protocol):
    """Decides the storage power; the rest of the island follows by recourse."""

    name: str

    def act(self, seen: Observation) -> Floats:
        """(units, batch) charging power in MW, negative when discharging."""


@dataclass(frozen=True)
class World:
    """The microgrid, its simulator, and the storms of an evaluation."""

    grid: Microgrid
    simulator: Simulator
    scenarios: Scenarios

    @classmethod
    def of(cls, grid: Microgrid, scenarios: Scenarios) -> World:
        """The world of a microgrid with copperplate physics."""
        return cls(grid, Simulator(grid, grid.case.step_h), scenarios)

    @cached_property
    def line_up(self) -> Bools:
        """(lines of the case, slots, scenarios) False where a line is down."""
        return self.scenarios.line_up(self.grid.case.network.line_names)

    def situation(self, t: int) -> Situation:
        """Slot t in every scenario: the scenarios are the nodes."""
        case, n = self.grid.case, self.scenarios.n
        return self.grid.situation(
            self.line_up[:, t], lambda name: np.full(n, case.profile(name)[t])
        )


@dataclass(frozen=True)
class Trajectory:
    """What a dispatcher did in every scenario.

    Attributes:
        cost: (slots, scenarios) $.
        energy: (units, slots + 1, scenarios) MWh, the start included.
        storage: (units, slots, scenarios) MW fed in, discharging positive.
        flows: (columns, slots, scenarios) MW, see `Simulator.columns`.
        seconds: for all decisions.
    """

    name: str
    cost: Floats
    energy: Floats
    storage: Floats
    flows: Floats
    columns: tuple[str, ...]
    step_h: float
    seconds: float = field(compare=False)

    def flow(self, kind: str) -> Floats:
        """(devices, slots, scenarios) the flows of one kind, as `load.shed`."""
        at = [k for k, name in enumerate(self.columns) if name.startswith(kind + "[")]
        return self.flows[at]

    @property
    def shed_mwh(self) -> Floats:
        """(scenarios,) energy not served."""
        found: Floats = self.flow("load.shed").sum((0, 1)) * self.step_h
        return found

    def objective(self, value_per_mwh: float) -> Floats:
        """(scenarios,) $: cost less what the energy left at the end is worth."""
        found: Floats = self.cost.sum(0) - value_per_mwh * self.energy[:, -1].sum(0)
        return found


def simulate(world: World, dispatcher: Dispatcher) -> Trajectory:
    """Runs a dispatcher through all scenarios at once."""
    case, simulator, n = world.grid.case, world.simulator, world.scenarios.n
    start = world.grid.start()["ess.energy"] if case.ess else np.empty(0)
    energy = np.repeat(start[:, None], n, axis=1)
    per_day = max(round(24.0 / case.step_h), 1)
    energies, powers, flows, costs = [energy], [], [], []
    seconds = 0.0
    for t in range(case.slots):
        situation = world.situation(t)
        centre = _centre(world, t // per_day)
        seen = Observation(t, energy, world.line_up[:, t], situation.island, centre)
        began = time.perf_counter()
        action = dispatcher.act(seen)
        seconds += time.perf_counter() - began
        data = simulator.stacked(world.grid.data(situation))
        step = simulator.step(energy, action, data, situation.island)
        energy = step.energy
        energies.append(energy)
        powers.append(step.discharge - step.charge)
        flows.append(step.flows)
        costs.append(step.cost)
    return Trajectory(
        dispatcher.name,
        np.array(costs),
        np.stack(energies, axis=1),
        np.stack(powers, axis=1),
        np.stack(flows, axis=1),
        simulator.columns,
        case.step_h,
        seconds,
    )


def _centre(world: World, day: int) -> Ints:
    centre = world.scenarios.centre
    if centre is None or day >= len(centre):
        return np.full(world.scenarios.n, -1)
    found: Ints = centre[day]
    return found
