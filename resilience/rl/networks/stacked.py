"""Layers of several agents in one kernel: the agents' weights lie behind each other along a first
axis, and one batched product does for all of them. Arrays are (agents, batch, numbers).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional


class StackedLinear(nn.Module):
    """A linear layer per agent.

    Args:
        agents: how many.
        fan_in: numbers in.
        fan_out: numbers out.
        generator: draws the weights, uniform as those of `nn.Linear`; the bias is zero.
    """

    def __init__(self, agents: int, fan_in: int, fan_out: int, generator: torch.Generator) -> None:
        super().__init__()
        limit = fan_in**-0.5
        weight = torch.empty(agents, fan_in, fan_out).uniform_(-limit, limit, generator=generator)
        self.weight = nn.Parameter(weight)
        self.bias = nn.Parameter(torch.zeros(agents, 1, fan_out))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(agents, batch, fan_out)."""
        return torch.baddbmm(self.bias, x, self.weight)


class StackedNorm(nn.Module):
    """LayerNorm with scale and shift per agent.

    Args:
        agents: how many.
        width: numbers.
    """

    def __init__(self, agents: int, width: int) -> None:
        super().__init__()
        self.width = width
        self.weight = nn.Parameter(torch.ones(agents, 1, width))
        self.bias = nn.Parameter(torch.zeros(agents, 1, width))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """As wide as x."""
        return torch.addcmul(self.bias, functional.layer_norm(x, (self.width,)), self.weight)


def stacked_mlp(
    agents: int, sizes: Sequence[int], generator: torch.Generator, *, norm: bool = False
) -> nn.Sequential:
    """Linear layers per agent with ReLU between them.

    Args:
        agents: how many.
        sizes: width of the input, of every hidden layer, of the output.
        generator: draws the weights.
        norm: LayerNorm before every ReLU.
    """
    layers: list[nn.Module] = []
    for k, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        layers.append(StackedLinear(agents, fan_in, fan_out, generator))
        if k < len(sizes) - 2:
            layers += [StackedNorm(agents, fan_out), nn.ReLU()] if norm else [nn.ReLU()]
    return nn.Sequential(*layers)


class StackedGruLayer(nn.Module):
    """A GRU layer per agent (Cho et al., EMNLP 2014, with the reset gate as cuDNN has it).

    Args:
        agents: how many.
        width: numbers in and out.
        generator: draws the weights.
    """

    def __init__(self, agents: int, width: int, generator: torch.Generator) -> None:
        super().__init__()
        self.width = width
        self.of_input = StackedLinear(agents, width, 3 * width, generator)
        self.of_hidden = StackedLinear(agents, width, 3 * width, generator)

    def forward(self, x: torch.Tensor, steps: int) -> torch.Tensor:
        """(agents, steps · batch, width) the hidden state after every step, in their order."""
        gates = self.of_input(x).reshape(len(x), steps, -1, 3 * self.width).unbind(1)
        hidden = x.new_zeros((*gates[0].shape[:-1], self.width))
        every = []
        for gate_inputs in gates:
            from_hidden = self.of_hidden(hidden)
            reset, update = torch.sigmoid(
                gate_inputs[..., : 2 * self.width] + from_hidden[..., : 2 * self.width]
            ).chunk(2, -1)
            fresh = torch.tanh(
                torch.addcmul(
                    gate_inputs[..., 2 * self.width :], reset, from_hidden[..., 2 * self.width :]
                )
            )
            hidden = torch.lerp(fresh, hidden, update)
            every.append(hidden)
        return torch.cat(every, 1)


class StackedGru(nn.Module):
    """The paper's encoder per agent: rows to 32 with ReLU, two GRU layers, 16 numbers with ReLU.

    Args:
        agents: how many.
        rows: of the window, numbers of a slot.
        steps: slots of the window.
        generator: draws the weights.
        width: of the embedding and of the GRU layers.
        features: numbers out.
    """

    def __init__(
        self,
        agents: int,
        rows: int,
        steps: int,
        generator: torch.Generator,
        width: int = 32,
        features: int = 16,
    ) -> None:
        super().__init__()
        self.agents, self.rows, self.steps = agents, rows, steps
        self.embedding = StackedLinear(agents, rows, width, generator)
        self.first = StackedGruLayer(agents, width, generator)
        self.second = StackedGruLayer(agents, width, generator)
        self.last = StackedLinear(agents, width, features, generator)

    def forward(self, window: torch.Tensor) -> torch.Tensor:
        """(agents, batch, features) of the windows (batch, steps · rows) that all agents see."""
        by_step = window.reshape(-1, self.steps, self.rows).transpose(0, 1).flatten(0, 1)
        embedded = torch.relu(self.embedding(by_step.expand(self.agents, -1, -1)))
        hidden = self.second(self.first(embedded, self.steps), self.steps)
        return torch.relu(self.last(hidden[:, -len(window) :]))
