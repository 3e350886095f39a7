"""`mappo`: clipped policy gradient with a critic that all agents share (Yu et al., "The Surprising
Effectiveness of PPO in Cooperative, Multi-Agent Games", NeurIPS 2022, after Schulman et al., 2017).

On-policy: a round of whole episodes, generalised advantages, a few passes over it. An agent's
output is normal around its actor's; what is beyond [-1, 1] is cut by the environment, not in the
density.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from resilience.rl.algorithms.actor_critic import ActorKind
from resilience.rl.ground.bands import clipped
from resilience.rl.ground.env import BatchEnv
from resilience.rl.learning.learner import (
    Progress,
    load_optimiser,
    optimiser_state,
    under_prefix,
    with_prefix,
)
from resilience.rl.learning.returns import advantages
from resilience.rl.learning.starts import mixed_starts
from resilience.rl.learning.warm_start import load_start
from resilience.rl.networks.nets import mlp, network

COLLECT_STREAM, SHUFFLE_STREAM = 6, 7
HALF_LOG_2PI = 0.5 * float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class MappoSettings:
    """Settings of `mappo`.

    Attributes:
        environments: episodes of a round.
        passes: over the round.
        batch: rows of a step of the weights.
        actor_rate: learning rate of the actors, falling to nothing along a cosine.
        critic_rate: learning rate of the critic.
        discount: per slot.
        decay: of the advantages: 0 trusts the critic, 1 the rewards.
        clip: how far a density may move within a round, relative.
        spread: standard deviation of outputs at the beginning.
        entropy: weight of the outputs' entropy, which keeps them spread.
        actor: mlp, one network with an output per unit; or agents, a network per unit that sees the
            state of charge of its own unit alone.
        hidden: widths of the hidden layers.
        clip_norm: largest norm of a gradient.
        carried_start: share of episodes that start with what an earlier one ended with; the others
            start with a random state of charge.
        start: a trained policy with the same actor, as apg:RUN or clone:RUN, to go on from.
    """

    environments: int = 64
    passes: int = 4
    batch: int = 512
    actor_rate: float = 1e-3
    critic_rate: float = 1e-3
    discount: float = 0.998
    decay: float = 0.95
    clip: float = 0.2
    spread: float = 0.4
    entropy: float = 0.0
    actor: ActorKind = "agents"
    hidden: tuple[int, ...] = (128, 128)
    clip_norm: float = 0.5
    carried_start: float = 0.7
    start: str = ""


class Lived(NamedTuple):
    """Rows of a round: slots and episodes along the first axis.

    Attributes:
        observed: (n, numbers) observations.
        output: (n, units) before they were cut.
        log_density: (n, units) of these outputs, when they were made.
        advantage: (n,) $ more than the critic expected.
        worth: (n,) $ what the critic should have said.
    """

    observed: torch.Tensor
    output: torch.Tensor
    log_density: torch.Tensor
    advantage: torch.Tensor
    worth: torch.Tensor


class Spread(nn.Module):
    """Standard deviations of the outputs, whatever is observed.

    Args:
        units: outputs.
        beginning: of all of them.
    """

    def __init__(self, units: int, beginning: float) -> None:
        super().__init__()
        self.logarithm = nn.Parameter(torch.full((units,), float(np.log(beginning))))

    def log_density(self, middle: torch.Tensor, output: torch.Tensor) -> torch.Tensor:
        """(n, units) of outputs around their middle."""
        away = (output - middle) * (-self.logarithm).exp()
        return -0.5 * away.square() - self.logarithm - HALF_LOG_2PI


class Mappo:
    """The learner.

    Args:
        env: the training ground.
        settings: as above.
        seed: of weights, starts and outputs; episodes have the seed of their sampler.
    """

    name = "mappo"

    def __init__(self, env: BatchEnv, settings: MappoSettings, seed: int = 0) -> None:
        self.env, self.settings, self.seed = env, settings, seed
        generator = torch.Generator().manual_seed(seed)
        self.actor = network(self.network(), env.size, env.units, generator).to(env.device)
        if settings.start:
            load_start(settings.start, self.actor, self.network(), env)
        self.spread = Spread(env.units, settings.spread).to(env.device)
        self.critic = mlp([env.size, *settings.hidden, 1], generator).to(env.device)
        acting = [*self.actor.parameters(), *self.spread.parameters()]
        self.optimisers = {
            "actor": torch.optim.Adam(acting, settings.actor_rate, fused=True),
            "critic": torch.optim.Adam(self.critic.parameters(), settings.critic_rate, fused=True),
        }
        self.rounds, self.ends = 0, env.start(settings.environments)

    def network(self) -> dict[str, Any]:
        """See `Learner.network`."""
        return {"kind": self.settings.actor, "hidden": list(self.settings.hidden)}

    def weights(self) -> dict[str, torch.Tensor]:
        """The actors' weights: outputs without spread."""
        return dict(self.actor.state_dict())

    def state(self) -> dict[str, torch.Tensor]:
        """See `Learner.state`."""
        state = {"rounds": torch.tensor(self.rounds), "ends": self.ends}
        for name, module in self._modules():
            state |= with_prefix(name, module.state_dict())
        for name, optimiser in self.optimisers.items():
            state |= with_prefix(f"optimiser.{name}", optimiser_state(optimiser))
        return state

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """See `Learner.load_state`."""
        self.rounds, self.ends = int(state["rounds"]), state["ends"]
        for name, module in self._modules():
            module.load_state_dict(under_prefix(name, state))
        for name, optimiser in self.optimisers.items():
            load_optimiser(optimiser, under_prefix(f"optimiser.{name}", state))

    def _modules(self) -> list[tuple[str, nn.Module]]:
        return [("actor", self.actor), ("spread", self.spread), ("critic", self.critic)]

    def iterate(self, progress: Progress) -> dict[str, float]:
        """A round of episodes and some passes over it."""
        lived, saved = self._play()
        rng = np.random.default_rng([self.seed, SHUFFLE_STREAM, self.rounds])
        for group in self.optimisers["actor"].param_groups:
            group["lr"] = self.settings.actor_rate * progress.cosine
        losses = [self._learn(minibatch) for minibatch in self._parts(lived, rng)]
        self.rounds += 1
        spread = float(self.spread.logarithm.detach().exp().mean())
        return {"loss": float(np.mean(losses)), "reward": saved, "spread": spread}

    def _play(self) -> tuple[Lived, float]:
        """A round, and what it saved per episode, $."""
        env, settings = self.env, self.settings
        rng = np.random.default_rng([self.seed, COLLECT_STREAM, self.rounds])
        tape = env.draw(settings.environments, self.rounds)
        energy = mixed_starts(env, self.ends, settings.carried_start, rng)
        baseline_cost = env.baseline_cost(tape, energy)
        observed, outputs, rewards = [], [], []
        with torch.no_grad():
            deviation = self.spread.logarithm.exp()
            for t in range(tape.slots):
                observed.append(env.observe(tape, t, energy))
                noise = env.tensor(rng.standard_normal((tape.n, env.units)))
                outputs.append(self.actor(observed[-1]) + deviation * noise)
                step = env.step(tape, t, energy, clipped(outputs[-1]))
                rewards.append(env.reward(tape, t, step, baseline_cost))
                energy = step.energy
            self.ends = energy
            return self._lived(torch.stack(observed), torch.stack(outputs), torch.stack(rewards))

    def _lived(
        self, observed: torch.Tensor, output: torch.Tensor, rewards: torch.Tensor
    ) -> tuple[Lived, float]:
        values = self.critic(observed)[..., 0]
        advantage = advantages(rewards, values, self.settings.discount, self.settings.decay)
        log_density = self.spread.log_density(
            self.actor(observed.flatten(0, 1)), output.flatten(0, 1)
        )
        worth = (advantage + values).flatten()
        scaled = (advantage - advantage.mean()) / (advantage.std() + 1e-6)
        flat = observed.flatten(0, 1), output.flatten(0, 1), log_density, scaled.flatten(), worth
        return Lived(*flat), float(rewards.sum(0).mean())

    def _parts(self, lived: Lived, rng: np.random.Generator) -> Iterator[Lived]:
        """Every pass over the round, in shuffled parts."""
        n, size = len(lived.worth), min(self.settings.batch, len(lived.worth))
        for _ in range(self.settings.passes):
            order = torch.as_tensor(rng.permutation(n), device=self.env.device)
            for k in range(n // size):
                rows = order[k * size : (k + 1) * size]
                yield Lived(*(values[rows] for values in lived))

    def _learn(self, minibatch: Lived) -> float:
        """One step of the actors and one of the critic; returns the critic's loss."""
        log_density = self.spread.log_density(self.actor(minibatch.observed), minibatch.output)
        ratio = (log_density - minibatch.log_density).exp()
        within = ratio.clamp(1.0 - self.settings.clip, 1.0 + self.settings.clip)
        gain = torch.minimum(
            ratio * minibatch.advantage[:, None], within * minibatch.advantage[:, None]
        )
        entropy = self.spread.logarithm.sum()
        acting = [*self.actor.parameters(), *self.spread.parameters()]
        actor_loss = -gain.sum(1).mean() - self.settings.entropy * entropy
        self._descend("actor", actor_loss, acting)
        loss = (self.critic(minibatch.observed)[:, 0] - minibatch.worth).square().mean()
        self._descend("critic", loss, list(self.critic.parameters()))
        return float(loss.detach())

    def _descend(self, name: str, loss: torch.Tensor, weights: list[nn.Parameter]) -> None:
        self.optimisers[name].zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(weights, self.settings.clip_norm)
        self.optimisers[name].step()
