"""`clone`: imitation of a dispatcher, whatever it is. The teacher acts in episodes of the training
days; noise on the stored energy shows it states that it would not come to, so that the clone
learns to return from them (Laskey et al., "DART", CoRL 2017). What a clone cannot copy, the
observation does not hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from resilience.dispatch.registry import factory_of
from resilience.models.simulator.arrays import array_ops
from resilience.rl.algorithms.actor_critic import ActorKind
from resilience.rl.ground.env import BatchEnv
from resilience.rl.learning.learner import (
    Progress,
    load_optimiser,
    optimiser_state,
    under_prefix,
    with_prefix,
)
from resilience.rl.learning.replay import ReplayRing
from resilience.rl.learning.starts import mixed_starts
from resilience.rl.networks.nets import Average, network
from resilience.simulation.observation import parts_of

TEACH_STREAM, FIT_STREAM = 8, 9


@dataclass(frozen=True)
class CloneSettings:
    """Settings of `clone`.

    Attributes:
        teacher: name of the dispatcher that is imitated, or METHOD:RUN.
        environments: episodes of a round of demonstrations.
        rounds: of demonstrations, one per iteration until there are so many.
        fits: steps of the weights per iteration.
        batch: rows of a step.
        learning_rate: at the beginning; falls to nothing along a cosine.
        noise: standard deviation of what is added to the stored energy after a slot, as a share of
            a unit's band; the teacher's answer to it is what is learned.
        actor: mlp, one network with an output per unit; or agents, a network per unit that sees the
            state of charge of its own unit alone.
        hidden: widths of the hidden layers.
        average: decay per iteration of the averaged weights, which are those that act.
        carried_start: share of episodes that start with what an earlier one ended with; the others
            start with a random state of charge.
    """

    teacher: str = "rule-0.9"
    environments: int = 16
    rounds: int = 8
    fits: int = 50
    batch: int = 512
    learning_rate: float = 2e-3
    noise: float = 0.02
    actor: ActorKind = "mlp"
    hidden: tuple[int, ...] = (128, 128)
    average: float = 0.9
    carried_start: float = 0.7


class Clone:
    """The learner. What it is punished for is the difference in MW, relative to each unit's
    largest, after the band, so that an output that means the same as the teacher's is as good.

    Args:
        env: the training ground.
        settings: as above.
        seed: of weights, starts and noise; episodes have the seed of their sampler.

    Raises:
        UsageError: no dispatcher of the teacher's name.
    """

    name = "clone"

    def __init__(self, env: BatchEnv, settings: CloneSettings, seed: int = 0) -> None:
        self.env, self.settings, self.seed = env, settings, seed
        self.teacher = factory_of(settings.teacher)
        generator = torch.Generator().manual_seed(seed)
        self.actor = network(self.network(), env.size, env.units, generator).to(env.device)
        self.averaged = Average(self.actor, settings.average)
        self.optimiser = torch.optim.Adam(
            self.actor.parameters(), settings.learning_rate, fused=True
        )
        # Outputs of the replay are the teacher's MW here.
        self.replay = ReplayRing(env, settings.rounds, settings.environments)
        self.rounds, self.ends = 0, env.start(settings.environments)
        self._largest = env.largest_power().T

    def network(self) -> dict[str, Any]:
        """See `Learner.network`."""
        return {"kind": self.settings.actor, "hidden": list(self.settings.hidden)}

    def weights(self) -> dict[str, torch.Tensor]:
        """The averaged weights, which act."""
        return self.averaged.weights

    def iterate(self, progress: Progress) -> dict[str, float]:
        """Demonstrations while there are to be more, and some steps of the weights."""
        if self.rounds < self.settings.rounds:
            self._demonstrate()
        rng = np.random.default_rng([self.seed, FIT_STREAM, progress.iteration])
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * progress.cosine
        losses = [self._fit(rng) for _ in range(self.settings.fits)]
        self.averaged.update(self.actor, progress.iteration)
        return {"loss": float(np.mean(losses)), "rounds": float(self.rounds)}

    def state(self) -> dict[str, torch.Tensor]:
        """See `Learner.state`."""
        return {
            **with_prefix("actor", self.actor.state_dict()),
            **with_prefix("averaged", self.averaged.weights),
            **with_prefix("optimiser", optimiser_state(self.optimiser)),
            **with_prefix("replay", self.replay.state()),
            "rounds": torch.tensor(self.rounds),
            "ends": self.ends,
        }

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """See `Learner.load_state`."""
        self.actor.load_state_dict(under_prefix("actor", state))
        self.averaged.weights = under_prefix("averaged", state)
        load_optimiser(self.optimiser, under_prefix("optimiser", state))
        self.replay.load_state(under_prefix("replay", state))
        self.rounds, self.ends = int(state["rounds"]), state["ends"]

    def _demonstrate(self) -> None:
        """A round of episodes in which the teacher acts and the stored energy is disturbed."""
        env, settings = self.env, self.settings
        rng = np.random.default_rng([self.seed, TEACH_STREAM, self.rounds])
        tape = self.replay.open(self.rounds)
        teacher = self.teacher(tape.episodes.setting)
        energy = mixed_starts(env, self.ends, settings.carried_start, rng)
        low, high = env.tensor(env.simulator.low), env.tensor(env.simulator.high)
        for t in range(tape.slots):
            observed = tape.episodes.observation(t, energy.cpu().numpy().astype(float))
            power = env.tensor(parts_of(teacher.act(observed))[0])
            self.replay.add(energy, power.T, torch.zeros(tape.n, device=env.device))
            after = env.played(tape, t, energy, power).energy
            away = env.tensor(rng.standard_normal(after.shape)) * settings.noise * (high - low)
            energy = (after + away).clamp(low, high)
        self.ends, self.rounds = energy, self.rounds + 1

    def _fit(self, rng: np.random.Generator) -> float:
        """One step of the weights; returns its loss."""
        sample = self.replay.sample(self.settings.batch, rng, 1, 1.0)
        situation = sample.now
        output = self.actor(situation.observed)
        power = self.env.band.power(output.T, situation.energy, situation.slot).T
        simulator, limits = self.env.simulator, situation.slot.storage.power_limits
        take, give = simulator.possible(array_ops(power), situation.energy, limits)
        taught = sample.output.clamp(-give.T, take.T)
        loss = ((power - taught) / self._largest).square().mean()
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        return float(loss.detach())
