"""What an algorithm is to the trainer: it iterates, acts, and its state can be kept."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import torch


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        iteration: number of this iteration, from 0.
        iterations: how many there will be.
    """

    iteration: int
    iterations: int

    @property
    def share(self) -> float:
        """Between 0 and 1."""
        return self.iteration / max(self.iterations, 1)

    @property
    def cosine(self) -> float:
        """From 1 at the beginning to 0 at the end, along half a cosine."""
        return 0.5 * (1.0 + math.cos(math.pi * self.share))


class Learner(Protocol):
    """An algorithm at work.

    A run that is interrupted goes on from `state`, so that everything an iteration depends on is
    either there or drawn anew from the seed and the iteration's number.

    Attributes:
        name: as in `train --method`.
    """

    name: str

    def iterate(self, progress: Progress) -> dict[str, float]:
        """Learns from one batch; returns what is logged, by name, `loss` among it."""

    def network(self) -> dict[str, Any]:
        """What `nets.network` makes the network that acts from, as plain data."""

    def weights(self) -> dict[str, torch.Tensor]:
        """Weights of the network that acts, by name."""

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that the next iteration depends on, by name."""

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Goes on from what `state` gave."""


def with_prefix(prefix: str, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """The tensors under names that begin with `prefix.`."""
    return {f"{prefix}.{name}": value for name, value in tensors.items()}


def under_prefix(prefix: str, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Those whose names begin with `prefix.`, without it."""
    start = f"{prefix}."
    return {name[len(start) :]: v for name, v in tensors.items() if name.startswith(start)}


def optimiser_state(optimiser: torch.optim.Adam) -> dict[str, torch.Tensor]:
    """Moments and steps of Adam, by number of the parameter."""
    return {
        f"{number}.{name}": value
        for number, moments in optimiser.state_dict()["state"].items()
        for name, value in moments.items()
    }


def load_optimiser(optimiser: torch.optim.Adam, state: Mapping[str, torch.Tensor]) -> None:
    """Puts back what `optimiser_state` gave."""
    complete = optimiser.state_dict()
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for key, value in state.items():
        number, _, name = key.partition(".")
        moments.setdefault(int(number), {})[name] = value
    complete["state"] = moments
    optimiser.load_state_dict(complete)
