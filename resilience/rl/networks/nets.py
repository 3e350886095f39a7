"""The networks: small, plain, and made from a generator of their own, so that a seed is a seed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import torch
from torch import nn

from resilience.errors import UsageError


def mlp(
    sizes: Sequence[int], generator: torch.Generator, *, norm: bool = False, last_scale: float = 1.0
) -> nn.Sequential:
    """Linear layers with ReLU between them.

    Args:
        sizes: width of the input, of every hidden layer, of the output.
        generator: draws the weights.
        norm: LayerNorm before every ReLU.
        last_scale: what the weights of the last layer are multiplied by.
    """
    layers: list[nn.Module] = []
    for k, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        is_last = k == len(sizes) - 2
        layers.append(linear(fan_in, fan_out, generator, last_scale if is_last else 1.0))
        if not is_last:
            layers += [nn.LayerNorm(fan_out), nn.ReLU()] if norm else [nn.ReLU()]
    return nn.Sequential(*layers)


def linear(fan_in: int, fan_out: int, generator: torch.Generator, scale: float = 1.0) -> nn.Linear:
    """A layer with the usual uniform weights, drawn from a generator; its bias is zero."""
    layer = nn.Linear(fan_in, fan_out)
    limit = scale * fan_in**-0.5
    with torch.no_grad():
        layer.weight.uniform_(-limit, limit, generator=generator)
        layer.bias.zero_()
    return layer


class Actor(nn.Module):
    """From observations (batch, numbers) to outputs (batch, units) in [-1, 1].

    Args:
        inputs: numbers of an observation.
        units: outputs.
        hidden: widths of the hidden layers.
        generator: draws the weights.
    """

    def __init__(
        self, inputs: int, units: int, hidden: Sequence[int], generator: torch.Generator
    ) -> None:
        super().__init__()
        self.body = mlp([inputs, *hidden, units], generator)

    @property
    def is_plain(self) -> bool:
        """Whether it is linear layers with ReLU between them, as `acting.outputs` takes it."""
        return all(isinstance(layer, nn.Linear | nn.ReLU) for layer in self.body)

    def forward(self, observed: torch.Tensor) -> torch.Tensor:
        """Outputs."""
        return torch.tanh(self.body(observed))


def begin_at(actor: nn.Module, output: float) -> None:
    """Lets all outputs of an actor begin near a number in (-1, 1)."""
    with torch.no_grad():
        last = cast("nn.Linear", cast("nn.Sequential", actor.body)[-1])
        last.bias.fill_(math.atanh(output))


class Average:
    """A slow copy of a network: the mean of its weights over recent iterations.

    Args:
        network: what is followed.
        decay: of the past, per iteration.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.decay = decay
        self.weights = {name: value.detach().clone() for name, value in network.named_parameters()}

    def update(self, network: nn.Module, iteration: int) -> None:
        """Moves towards the network; fast at first, while there is no past to keep."""
        decay = min(self.decay, (1.0 + iteration) / (10.0 + iteration))
        with torch.no_grad():
            for name, value in network.named_parameters():
                self.weights[name].lerp_(value, 1.0 - decay)


def network(
    about: Mapping[str, Any],
    inputs: int,
    units: int,
    generator: torch.Generator | None = None,
) -> nn.Module:
    """A network that acts, from what `Learner.network` says of it.

    Args:
        about: its kind and sizes.
        inputs: numbers of an observation.
        units: outputs.
        generator: draws the weights; if omitted they are yet to come.

    Raises:
        UsageError: an unknown kind.
    """
    from resilience.rl.networks.actors import AgentActors, GruActors

    kind, fresh = about["kind"], generator or torch.Generator()
    if kind == "mlp":
        return Actor(inputs, units, about["hidden"], fresh)
    if kind == "agents":
        return AgentActors(inputs, units, about["hidden"], fresh)
    if kind == "gru":
        return GruActors(inputs, units, fresh)
    raise UsageError(
        f"network {kind!r} is unknown; allowed: mlp, agents, gru", hint="train it again"
    )
