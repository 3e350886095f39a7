"""One slot of whoever steps it: what was observed and decided, as each simulator takes it."""

from __future__ import annotations

from resilience.models.simulator import Decision, MilpSimulator, Step
from resilience.simulation.observation import Observation
from resilience.simulation.slots import Stepper


def stepped(simulator: Stepper, observation: Observation, decision: Decision) -> Step:
    """What a decision leads to.

    Args:
        simulator: what steps it.
        observation: of the slot.
        decision: what is decided; of commitment and switches only where there are some.
    """
    energy, data, island = observation.energy, observation.data, observation.island
    if isinstance(simulator, MilpSimulator):
        return simulator.step(energy, decision, data, island, observation.fuel, observation.states)
    return simulator.step(
        energy, decision.power, data, island, observation.fuel, decision.burner_mw
    )
