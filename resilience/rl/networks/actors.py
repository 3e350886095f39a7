"""Several agents, one network to act: each output is made by an agent of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import nn

from resilience.rl.ground.observe_paper import WINDOW
from resilience.rl.networks.stacked import StackedGru, stacked_mlp


class AgentActors(nn.Module):
    """An MLP per agent, which sees the state of charge of its own unit and the world.

    Args:
        inputs: numbers of an observation, the units' states of charge first.
        units: agents.
        hidden: widths of the hidden layers.
        generator: draws the weights.
    """

    def __init__(
        self, inputs: int, units: int, hidden: Sequence[int], generator: torch.Generator
    ) -> None:
        super().__init__()
        self.units = units
        self.body = stacked_mlp(units, [1 + inputs - units, *hidden, 1], generator)

    def forward(self, observed: torch.Tensor) -> torch.Tensor:
        """(batch, units) outputs in [-1, 1]."""
        own_state = observed[:, : self.units].T[..., None]
        world = observed[:, self.units :].expand(self.units, -1, -1)
        outputs: torch.Tensor = torch.tanh(self.body(torch.cat([own_state, world], -1)))
        return outputs[..., 0].T


class GruActors(nn.Module):
    """The paper's agents: a GRU each for the window, and an actor of [SoC_n, c_n, v_n].

    Args:
        inputs: numbers of an observation of `PaperObserver`.
        units: agents.
        generator: draws the weights.
    """

    def __init__(self, inputs: int, units: int, generator: torch.Generator) -> None:
        super().__init__()
        self.units = units
        self.encoder = StackedGru(units, (inputs - 2 * units) // WINDOW, WINDOW, generator)
        self.body = stacked_mlp(units, [18, 64, 64, 1], generator, norm=True)

    def features(self, observed: torch.Tensor) -> torch.Tensor:
        """(units, batch, 16) what each agent's GRU makes of the window."""
        return cast("torch.Tensor", self.encoder(observed[:, 2 * self.units :]))

    def of_features(self, observed: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        """(batch, units) outputs in [-1, 1], the features known already."""
        own_state = torch.stack(
            [observed[:, : self.units], observed[:, self.units : 2 * self.units]], -1
        )
        state = torch.cat([own_state.transpose(0, 1), features], -1)
        outputs: torch.Tensor = torch.tanh(self.body(state))
        return outputs[..., 0].T

    def forward(self, observed: torch.Tensor) -> torch.Tensor:
        """(batch, units) outputs in [-1, 1]."""
        return self.of_features(observed, self.features(observed))
