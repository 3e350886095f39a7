"""What every observation has: blocks of numbers with a name, a unit and a scale, storage first."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


@dataclass(frozen=True)
class ObservationBlock:
    """Some numbers of an observation.

    Attributes:
        name: what they are, with their unit, as `net_demand_mw`.
        labels: which element each is.
        scale: (labels,) what they are divided by.
    """

    name: str
    labels: tuple[str, ...]
    scale: tuple[float, ...]


class Eyes(ABC):
    """What makes observations; one per batch, since it may remember.

    Args:
        setting: where it is.

    Attributes:
        blocks: what an observation holds, in order; storage is the first.
    """

    blocks: tuple[ObservationBlock, ...]

    def __init__(self, setting: Setting) -> None:
        self.setting, simulator = setting, setting.simulator
        self._low = simulator.low
        self._range = np.maximum(simulator.high - simulator.low, 1e-9)

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return sum(len(block.labels) for block in self.blocks)

    @property
    def schema(self) -> str:
        """A digest of what an observation holds: a policy fits no other."""
        text = json.dumps([(b.name, b.labels, b.scale) for b in self.blocks])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def observed(self, observation: Observation) -> np.ndarray:
        """(batch, numbers) an observation in single precision, as in training; once a slot."""
        storage = self.storage(observation.energy.astype(np.float32))
        return np.concatenate([storage, self.world(observation)]).T

    def storage(self, energy: np.ndarray) -> np.ndarray:
        """(units, batch) state of charge within its band, 0 to 1, in the precision of `energy`."""
        low, width = (values.astype(energy.dtype) for values in (self._low, self._range))
        return (energy - low) / width

    @abstractmethod
    def world(self, observation: Observation, out: np.ndarray | None = None) -> np.ndarray:
        """(numbers but those of storage, batch) what the world is like, in single precision; once
        in each slot.

        Args:
            observation: of the slot.
            out: where it is written to; a new array if omitted.
        """
