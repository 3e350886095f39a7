"""Rules that need no optimiser: idle, self-consumption, and holding a state of charge."""

from __future__ import annotations

from typing import cast

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.anchors import Actions, Anchors
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


class Idle:
    """Never moves the storage."""

    def __init__(self, setting: Setting) -> None:
        self.name = "idle"

    def act(self, observation: Observation) -> Floats:
        """Nothing."""
        return np.zeros_like(observation.energy)


class Greedy:
    """Serves what PV leaves of the demand of its island, and stores what PV has over.

    See `Actions.serve`.

    Args:
        setting: where it acts.
        generators_first: storage gives only what generators leave, see `Actions.spare`.
    """

    def __init__(self, setting: Setting, generators_first: bool = False) -> None:
        self.name, self.generators_first = "greedy", generators_first
        self.anchors = Anchors(setting.simulator)

    def act(self, observation: Observation) -> Floats:
        """Discharge by the net demand of the island, charge by its surplus."""
        actions = _actions(self.anchors, observation)
        return cast("Floats", actions.spare if self.generators_first else actions.serve)


class Rule:
    """Holds a state of charge while the grid is there; without it, serves what its island's
    generators and PV cannot. The paper's rule has the level 0.5.

    Args:
        setting: where it acts.
        level: state of charge, one for all or (units,) one each.
    """

    def __init__(self, setting: Setting, level: float | Floats = 0.5) -> None:
        self.anchors = Anchors(setting.simulator, level)
        self.name = f"rule-{level:g}" if np.ndim(level) == 0 else "rule-levels"

    def act(self, observation: Observation) -> Floats:
        """Towards the level with a grid; what generators leave without."""
        return cast("Floats", _actions(self.anchors, observation).rule)


def _actions(anchors: Anchors, observation: Observation) -> Actions:
    data, island = observation.data, observation.island
    slot = anchors.plant.storage_slot(data, island)
    needs = anchors.needs(data, island, slot, observation.fuel)
    return anchors.actions(observation.energy, slot, needs)
