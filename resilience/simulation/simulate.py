"""Episodes: a dispatcher meets every scenario of a world, slot by slot."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from resilience.models.simulator import MilpSimulator
from resilience.simulation.audit import check_trajectory
from resilience.simulation.observation import Dispatcher, Observation, parts_of
from resilience.simulation.stepping import stepped
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World


def simulate(
    world: World, dispatcher: Dispatcher, on_slot: Callable[[], None] | None = None
) -> Trajectory:
    """Runs a dispatcher through all scenarios at once.

    Args:
        world: the storms.
        dispatcher: a fresh one; it may remember what it has observed.
        on_slot: called after every slot.

    Raises:
        CertificateError: what was simulated breaks a limit, a balance or its price.
    """
    case, simulator, n = world.microgrid.case, world.simulator, world.scenarios.n
    if isinstance(simulator, MilpSimulator):
        simulator.restart()
    energy = start = world.start()
    fuel = start_fuel = world.setting.start_fuel()
    states = start_states = world.setting.start_states()
    credited = np.zeros(n)
    trajectory = Trajectory.blank(dispatcher.name, simulator, case, n)
    trajectory.energy[:, 0] = energy
    if trajectory.fuel is not None:
        trajectory.fuel[:, 0] = fuel
    seconds = cpu = 0.0
    ends = set(world.ends.tolist())
    for t in range(case.slots):
        slot, up = world.slot(t, energy), world.line_up[:, t]
        observation = Observation(
            t, energy, up, slot.island, world.centre(t), world.forecast(t), slot.stacked, fuel,
            states, world.line_up_before(t),
        )  # fmt: skip
        began = time.perf_counter(), time.process_time()
        decision = parts_of(dispatcher.act(observation))
        seconds += time.perf_counter() - began[0]
        cpu += time.process_time() - began[1]
        step = stepped(simulator, observation, decision)
        trajectory.record(t, step)
        energy, fuel, states = step.energy, step.fuel, step.states
        if t in ends:
            credited += energy.sum(0)
            if t + 1 < case.slots:
                energy, fuel, states = start, start_fuel, start_states
        trajectory.energy[:, t + 1] = energy
        if trajectory.fuel is not None:
            trajectory.fuel[:, t + 1] = fuel
        if on_slot is not None:
            on_slot()
    done = replace(trajectory, left_mwh=credited, seconds=seconds, cpu_seconds=cpu)
    check_trajectory(world, done)
    return done
