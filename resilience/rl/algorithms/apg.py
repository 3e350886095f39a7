"""`apg`: the analytic policy gradient. Whole episodes are played through the differentiable
simulator, and what they cost is differentiated by the weights (Xu et al., "Accelerated Policy
Learning with Parallel Differentiable Simulation", ICLR 2022, without the critic, since a day is
short enough to be differentiated whole).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.tape import Tape
from resilience.rl.learning.learner import (
    Progress,
    load_optimiser,
    optimiser_state,
    under_prefix,
    with_prefix,
)
from resilience.rl.learning.starts import mixed_starts
from resilience.rl.networks.nets import Actor, Average, begin_at


@dataclass(frozen=True)
class ApgSettings:
    """Settings of `apg`.

    Attributes:
        batch: episodes per iteration.
        learning_rate: at the beginning; falls to nothing along a cosine.
        hidden: widths of the hidden layers.
        carried_start: share of episodes that start with what an earlier one ended with; the others
            start with a random state of charge.
        clip_norm: largest norm of a gradient.
        average: decay per iteration of the averaged weights, which are those that act.
    """

    batch: int = 128
    learning_rate: float = 6e-3
    hidden: tuple[int, ...] = (128, 128)
    carried_start: float = 0.7
    clip_norm: float = 1.0
    average: float = 0.98


class Apg:
    """The learner.

    Args:
        env: the training ground.
        settings: as above.
        seed: of weights and starts; episodes have the seed of their sampler.
    """

    name = "apg"

    def __init__(self, env: BatchEnv, settings: ApgSettings, seed: int = 0) -> None:
        self.env, self.settings, self.seed = env, settings, seed
        generator = torch.Generator().manual_seed(seed)
        self.actor = Actor(env.size, env.units, settings.hidden, generator).to(env.device)
        begin_at(self.actor, env.band.first_output)
        self.averaged = Average(self.actor, settings.average)
        self.optimiser = torch.optim.Adam(
            self.actor.parameters(), settings.learning_rate, fused=True
        )
        self.ends = env.start(settings.batch)

    def iterate(self, progress: Progress) -> dict[str, float]:
        """One batch of episodes and one step of the weights."""
        tape = self.env.draw(self.settings.batch, progress.iteration)
        rng = np.random.default_rng([self.seed, 3, progress.iteration])
        start = mixed_starts(self.env, self.ends, self.settings.carried_start, rng)
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * progress.cosine
        cost, end = self._play(tape, start)
        self.optimiser.zero_grad()
        loss = cost.mean()
        loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.actor.parameters(), self.settings.clip_norm)
        self.optimiser.step()
        self.averaged.update(self.actor, progress.iteration)
        self.ends = end.detach()
        return {"loss": float(loss.detach()), "gradient_norm": float(norm)}

    def network(self) -> dict[str, Any]:
        """See `Learner.network`."""
        return {"kind": "mlp", "hidden": list(self.settings.hidden)}

    def weights(self) -> dict[str, torch.Tensor]:
        """The averaged weights, which act."""
        return self.averaged.weights

    def state(self) -> dict[str, torch.Tensor]:
        """See `Learner.state`."""
        return {
            **with_prefix("actor", self.actor.state_dict()),
            **with_prefix("averaged", self.averaged.weights),
            **with_prefix("optimiser", optimiser_state(self.optimiser)),
            "ends": self.ends,
        }

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """See `Learner.load_state`."""
        self.actor.load_state_dict(under_prefix("actor", state))
        self.averaged.weights = under_prefix("averaged", state)
        load_optimiser(self.optimiser, under_prefix("optimiser", state))
        self.ends = state["ends"]

    def _play(self, tape: Tape, energy: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(batch,) $ of the episodes less the worth of what is left of more or less than the start,
        and (units, batch) what is left, MWh.
        """
        env = self.env
        cost = env.credit(energy)
        for t in range(tape.slots):
            output = self.actor(env.observe(tape, t, energy))
            step = env.step(tape, t, energy, output)
            cost, energy = cost + step.cost, step.energy
        return cost - env.credit(energy), energy
