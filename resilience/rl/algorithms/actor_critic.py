"""Deterministic actor and critics on whole observations: what `ddpg`, `matd3` and the tuned
`maddpg` have in common, everything that sets them apart being a setting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import nn

from resilience.rl.ground.bands import clipped
from resilience.rl.ground.env import BatchEnv
from resilience.rl.learning.learner import Progress
from resilience.rl.learning.off_policy import ReplayLearner
from resilience.rl.learning.replay import Situations, Transitions
from resilience.rl.learning.starts import mixed_starts
from resilience.rl.learning.warm_start import load_start
from resilience.rl.networks.nets import network
from resilience.rl.networks.stacked import stacked_mlp

ActorKind = Literal["mlp", "agents"]


@dataclass(frozen=True)
class ActorCriticSettings:
    """Settings of `ddpg`, `matd3` and the tuned `maddpg`.

    Attributes:
        environments: episodes played in lockstep.
        batch: rows of an update.
        actor_rate: learning rate of the actor, falling to nothing along a cosine.
        critic_rate: learning rate of the critics.
        discount: per slot.
        tau: share by which targets follow.
        update_every: steps of the environments, all counted, per update.
        warm_up: steps with random outputs before the first update.
        noise: standard deviation of what is added to outputs.
        noise_correlation: of that from one slot to the next.
        replay: rounds of episodes that are kept.
        n_step: slots whose rewards are summed before the critic's value is taken.
        critics: how many; of several the least value is believed.
        critic_sees: what the critics are told of an action: mw, or the output.
        head_start: updates of the critics before the first of the actor, which would else run into
            a corner that critics who know nothing yet point to.
        policy_delay: updates of the critics per update of the actor.
        target_noise: standard deviation of what is added to the targets' outputs, at most twice it.
        pull: weight of the squared output in the actor's loss, against corners, falling to nothing
            along a cosine; $.
        actor: mlp, one network with an output per unit; or agents, a network per unit that sees the
            state of charge of its own unit alone.
        hidden: widths of the hidden layers.
        carried_start: share of episodes that start with what an earlier one ended with; the others
            start with a random state of charge.
        start: a trained policy with the same actor, as apg:RUN or clone:RUN, to go on from.
    """

    environments: int = 64
    batch: int = 256
    actor_rate: float = 5e-4
    critic_rate: float = 1e-3
    discount: float = 0.998
    tau: float = 0.01
    update_every: int = 64
    warm_up: int = 12288
    noise: float = 0.3
    noise_correlation: float = 0.8
    replay: int = 24
    n_step: int = 8
    critics: int = 2
    critic_sees: Literal["mw", "output"] = "mw"
    head_start: int = 200
    policy_delay: int = 2
    target_noise: float = 0.0
    pull: float = 0.0
    actor: ActorKind = "mlp"
    hidden: tuple[int, ...] = (128, 128)
    carried_start: float = 0.7
    start: str = ""


class ActorCritic(ReplayLearner):
    """The learner.

    Args:
        env: the training ground.
        settings: as above.
        seed: of weights, starts and noise.
    """

    def __init__(self, env: BatchEnv, settings: ActorCriticSettings, seed: int = 0) -> None:
        super().__init__(env, settings, seed)
        self.settings = settings
        actor = network(self.network(), env.size, env.units, self.generator)
        if settings.start:
            load_start(settings.start, actor, self.network(), env)
        sizes = [env.size + env.units, *settings.hidden, 1]
        critic = stacked_mlp(settings.critics, sizes, self.generator)
        self._largest = env.largest_power()
        self.learn("actor", actor, settings.actor_rate)
        self.learn("critic", critic, settings.critic_rate)

    def network(self) -> dict[str, Any]:
        """See `Learner.network`."""
        return {"kind": self.settings.actor, "hidden": list(self.settings.hidden)}

    def weights(self) -> dict[str, torch.Tensor]:
        """The target's weights, which are the actor's averaged."""
        return dict(self.targets["actor"].state_dict())

    def starts(self, rng: np.random.Generator) -> torch.Tensor:
        """What earlier episodes ended with, or anything."""
        return mixed_starts(self.env, self.ends, self.settings.carried_start, rng)

    def sample(self, rng: np.random.Generator) -> Transitions:
        """Rows with what came within `n_step` slots."""
        return self.replay.sample(
            self.settings.batch, rng, self.settings.n_step, self.settings.discount
        )

    def update(self, sample: Transitions, rng: np.random.Generator, progress: Progress) -> float:
        """One step of the critics and, every `policy_delay`, one of the actor."""
        critic, target_value = self.networks["critic"], self.target_value(sample, rng)
        loss = (
            (self._values(critic, sample.now, sample.output) - target_value).square().mean(1).sum()
        )
        self._descend("critic", loss, self.settings.critic_rate)
        turn = self.updates - self.settings.head_start
        if turn >= 0 and turn % self.settings.policy_delay == 0:
            output = self.networks["actor"](sample.now.observed)
            critic.requires_grad_(False)
            value = self._values(critic, sample.now, output)[0].mean()
            critic.requires_grad_(True)
            rate = self.settings.actor_rate * progress.cosine
            pull = self.settings.pull * progress.cosine * output.square().mean()
            self._descend("actor", pull - value, rate)
        return float(loss.detach())

    def target_value(self, sample: Transitions, rng: np.random.Generator) -> torch.Tensor:
        """(1, n) what the critics should have said: rewards, then the least of the targets."""
        with torch.no_grad():
            output = self.targets["actor"](sample.later.observed)
            if self.settings.target_noise:
                noise = self.env.tensor(rng.standard_normal(output.shape)).clamp(-2.0, 2.0)
                output = clipped(output + self.settings.target_noise * noise)
            values = self._values(self.targets["critic"], sample.later, output)
            return sample.rewards + sample.discount * values.amin(0, keepdim=True)

    def _values(
        self, critic: nn.Module, situation: Situations, output: torch.Tensor
    ) -> torch.Tensor:
        """(critics, n) $ to come after outputs (n, units)."""
        if self.settings.critic_sees == "mw":
            power = self.env.band.power(output.T, situation.energy, situation.slot)
            output = (power / self._largest).T
        critic_inputs = torch.cat([situation.observed, output], 1)
        values: torch.Tensor = critic(critic_inputs.expand(self.settings.critics, -1, -1))
        return values[..., 0]

    def _descend(self, name: str, loss: torch.Tensor, rate: float) -> None:
        optimiser = self.optimisers[name]
        for group in optimiser.param_groups:
            group["lr"] = rate
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.networks[name].parameters(), 10.0)
        optimiser.step()
