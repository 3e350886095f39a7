"""Observations by name: what policies may be given to see."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from resilience.errors import UsageError
from resilience.rl.ground.observe import ObservationBlock, Observer
from resilience.rl.ground.observe_paper import PaperObserver
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting


class Eyes(Protocol):
    """What makes observations; one per batch, since it may remember.

    Attributes:
        blocks: what an observation holds, in order; storage is the first.
    """

    @property
    def blocks(self) -> tuple[ObservationBlock, ...]:
        """See above."""

    @property
    def size(self) -> int:
        """How many numbers an observation has."""

    @property
    def schema(self) -> str:
        """A digest of what an observation holds."""

    def observed(self, observation: Observation) -> np.ndarray:
        """(batch, numbers) an observation in single precision, as in training; once a slot."""

    def storage(self, energy: np.ndarray) -> np.ndarray:
        """(units, batch) what is observed of storage."""

    def world(self, observation: Observation, out: np.ndarray | None = None) -> np.ndarray:
        """(numbers but those of storage, batch) what the world is like, in single precision; once
        in each slot.

        Args:
            observation: of the slot.
            out: where it is written to; a new array if omitted.
        """


OBSERVERS: dict[str, Callable[[Setting], Eyes]] = {"full": Observer, "paper": PaperObserver}


def observer(name: str, setting: Setting) -> Eyes:
    """A fresh observer of this name.

    Raises:
        UsageError: there is none of this name.
    """
    if name not in OBSERVERS:
        raise UsageError(
            f"observation {name!r} is unknown; allowed: {', '.join(OBSERVERS)}",
            hint="full is the default, paper is what the paper's agents see",
        )
    return OBSERVERS[name](setting)
