"""A batch of episodes, ready to be played: all that does not depend on what is done.

It is worked out in NumPy, which takes less to begin than torch, and goes to the device slot by slot
when it is asked for there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch

from resilience.models.simulator.arrays import Array
from resilience.models.simulator.closing import ReadyGroup, ReadyOrder
from resilience.models.simulator.prices import Way
from resilience.models.simulator.simulator import ReadySlot, Step
from resilience.rl.ground.bands import BandSlot
from resilience.rl.ground.episodes import Episodes

T = TypeVar("T")
ToTensor = Callable[[np.ndarray], torch.Tensor]


class Now(NamedTuple):
    """A slot of a batch, of NumPy arrays or of tensors.

    Attributes:
        data: (n_data, batch) from `Simulator.stacked`.
        island: (buses, batch) number of the island of every bus.
        ready: what the simulator makes of it.
        band: what the band makes of it.
    """

    data: Array
    island: Array
    ready: ReadySlot
    band: BandSlot


@dataclass(frozen=True)
class Tape:
    """A batch of episodes.

    Attributes:
        episodes: where it comes from.
        observed: (slots, batch, numbers) the observations without storage, on the device.
        plain: slot by slot, in NumPy, while all storage has energy to give.
        tensor: brings an array to the device.
    """

    episodes: Episodes
    observed: torch.Tensor
    plain: list[Now]
    tensor: ToTensor
    _there: dict[int, Now] = field(default_factory=dict, repr=False)

    @property
    def slots(self) -> int:
        """Slots of an episode."""
        return len(self.plain)

    @property
    def n(self) -> int:
        """Episodes in the batch."""
        return self.episodes.n

    def now(self, t: int) -> Now:
        """Slot t on the device."""
        if t not in self._there:
            self._there[t] = as_tensors(self.plain[t], self.tensor)
        return self._there[t]


def as_tensors(value: T, tensor: ToTensor) -> T:
    """The same with a tensor in place of every array."""
    return _with_tensors(value, tensor)


def _with_tensors(value: Any, tensor: ToTensor) -> Any:
    if isinstance(value, np.ndarray):
        return tensor(value)
    if isinstance(value, tuple):
        parts = [_with_tensors(element, tensor) for element in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, ReadyGroup | ReadyOrder | Way):
        names = [f.name for f in fields(value)]
        return replace(value, **{n: _with_tensors(getattr(value, n), tensor) for n in names})
    return value


def step_of_tensors(step: Step, tensor: ToTensor) -> Step:
    """A step of NumPy arrays in tensors."""
    return Step(
        energy=tensor(step.energy),
        cost=tensor(step.cost),
        charge=tensor(step.charge),
        discharge=tensor(step.discharge),
        spill=tensor(step.spill),
        _flows=lambda: tensor(step.flows),
    )
