"""What learners from a replay share: collecting in lockstep, updates by the global step, targets.

All randomness is drawn from `[seed, stream, number]`, so that no state of a generator is kept.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import deepcopy
from typing import Any, Protocol, cast

import numpy as np
import torch
from torch import nn

from resilience.rl.ground.bands import clipped
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.tape import Tape
from resilience.rl.learning.learner import (
    Progress,
    load_optimiser,
    optimiser_state,
    under_prefix,
    with_prefix,
)
from resilience.rl.learning.replay import ReplayRing, Transitions

COLLECT_STREAM, UPDATE_STREAM = 4, 5


class Schedule(Protocol):
    """What collecting and updating need of an algorithm's settings.

    Attributes:
        environments: episodes played in lockstep.
        batch: rows of an update.
        tau: share by which targets follow.
        update_every: steps of the environments, all counted, per update.
        warm_up: steps with random outputs, before the first update.
        noise: standard deviation of what is added to outputs.
        noise_correlation: of that from one slot to the next.
        replay: rounds of episodes that are kept.
    """

    @property
    def environments(self) -> int:
        """See above."""

    @property
    def batch(self) -> int:
        """See above."""

    @property
    def tau(self) -> float:
        """See above."""

    @property
    def update_every(self) -> int:
        """See above."""

    @property
    def warm_up(self) -> int:
        """See above."""

    @property
    def noise(self) -> float:
        """See above."""

    @property
    def noise_correlation(self) -> float:
        """See above."""

    @property
    def replay(self) -> int:
        """See above."""


def updates_due(before: int, after: int, every: int, warm_up: int) -> int:
    """How many updates fall into the global steps (before, after]: one on every multiple of `every`
    beyond the warm-up. So 38,400 steps, of which 8,000 are warm-up, have 1,267 on multiples of 24.
    """
    return after // every - max(before, min(warm_up, after)) // every


class ReplayLearner(ABC):
    """Plays rounds of episodes in lockstep and updates by the global step.

    Args:
        env: the training ground.
        schedule: settings.
        seed: of weights, starts and noise; episodes have the seed of their sampler.
        heads: rewards of a slot, one for all or one per agent.

    Attributes:
        iterations: rounds that it asks for; None: as many as the budget allows.
        networks: those that learn, by name; `actor` among them.
        targets: slow copies, by name.
        optimisers: by the name of their network.
        steps: of all environments, so far.
        updates: so far.
    """

    name: str
    iterations: int | None = None

    def __init__(self, env: BatchEnv, schedule: Schedule, seed: int, heads: int = 1) -> None:
        self.env, self.schedule, self.seed = env, schedule, seed
        self.generator = torch.Generator().manual_seed(seed)
        self.replay = ReplayRing(env, schedule.replay, schedule.environments, heads)
        self.networks: dict[str, nn.Module] = {}
        self.targets: dict[str, nn.Module] = {}
        self.optimisers: dict[str, torch.optim.Adam] = {}
        self.rounds = self.steps = self.updates = 0
        self.ends = env.start(schedule.environments)

    def learn(self, name: str, network: nn.Module, rate: float) -> None:
        """A network that learns at a rate, with its target."""
        self.networks[name] = network.to(self.env.device)
        self.targets[name] = deepcopy(self.networks[name]).requires_grad_(False)
        self.optimisers[name] = torch.optim.Adam(network.parameters(), rate, fused=True)

    @abstractmethod
    def starts(self, rng: np.random.Generator) -> torch.Tensor:
        """(units, environments) MWh."""

    @abstractmethod
    def update(self, sample: Transitions, rng: np.random.Generator, progress: Progress) -> float:
        """One step of the weights, targets left alone; returns the critics' loss."""

    @abstractmethod
    def sample(self, rng: np.random.Generator) -> Transitions:
        """What an update learns from."""

    def rewards(self, tape: Tape, t: int, step: Any, baseline_cost: torch.Tensor) -> torch.Tensor:
        """(heads, environments) $."""
        return self.env.reward(tape, t, step, baseline_cost)[None]

    def baseline_cost(self, tape: Tape, start: torch.Tensor) -> torch.Tensor:
        """(slots, environments) $ that rewards are relative to."""
        return self.env.baseline_cost(tape, start)

    def iterate(self, progress: Progress) -> dict[str, float]:
        """A round of episodes; the first iteration has the warm-up before it."""
        log = self._round(progress)
        while self.iterations is None and self.steps <= self.schedule.warm_up:
            log = self._round(progress)
        return log

    def _round(self, progress: Progress) -> dict[str, float]:
        env, losses = self.env, list[float]()
        rng = np.random.default_rng([self.seed, COLLECT_STREAM, self.rounds])
        tape = self.replay.open(self.rounds)
        energy = self.starts(rng)
        baseline_cost = self.baseline_cost(tape, energy)
        noise = env.tensor(rng.standard_normal((tape.n, env.units)))
        saved = torch.zeros(tape.n, dtype=env.dtype, device=env.device)
        for t in range(tape.slots):
            noise = self._next(noise, rng)
            with torch.no_grad():
                output = self._output(env.observe(tape, t, energy), noise, rng)
                step = env.step(tape, t, energy, output)
                reward = self.rewards(tape, t, step, baseline_cost)
            self.replay.add(energy, output, reward)
            energy, saved = step.energy, saved + reward.mean(0)
            before, self.steps = self.steps, self.steps + tape.n
            losses += self._updates(before, progress)
        self.ends, self.rounds = energy, self.rounds + 1
        loss = float(np.mean(losses)) if losses else 0.0
        return {"loss": loss, "reward": float(saved.mean()), "updates": float(self.updates)}

    def _updates(self, before: int, progress: Progress) -> list[float]:
        losses, schedule = [], self.schedule
        due = updates_due(before, self.steps, schedule.update_every, schedule.warm_up)
        for _ in range(due):
            rng = np.random.default_rng([self.seed, UPDATE_STREAM, self.updates])
            losses.append(self.update(self.sample(rng), rng, progress))
            self.updates += 1
            self._follow()
        return losses

    def _follow(self) -> None:
        with torch.no_grad():
            for name, network in self.networks.items():
                slow: list[torch.Tensor] = list(self.targets[name].parameters())
                fast: list[torch.Tensor] = list(network.parameters())
                torch._foreach_lerp_(slow, fast, self.schedule.tau)

    def _next(self, noise: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
        """Noise of the next slot, of variance 1 as that before."""
        correlation = self.schedule.noise_correlation
        fresh = self.env.tensor(rng.standard_normal(noise.shape))
        return correlation * noise + (1.0 - correlation**2) ** 0.5 * fresh

    def _output(
        self, observed: torch.Tensor, noise: torch.Tensor, rng: np.random.Generator
    ) -> torch.Tensor:
        """(environments, units) outputs; any in the warm-up, later the actor's with noise."""
        if self.steps < self.schedule.warm_up:
            return self.env.tensor(rng.uniform(-1.0, 1.0, noise.shape))
        return cast(
            "torch.Tensor", clipped(self.networks["actor"](observed) + self.schedule.noise * noise)
        )

    def weights(self) -> dict[str, torch.Tensor]:
        """The actor's weights."""
        return dict(self.networks["actor"].state_dict())

    def state(self) -> dict[str, torch.Tensor]:
        """See `Learner.state`."""
        state = with_prefix("replay", self.replay.state())
        for name, network in self.networks.items():
            state |= with_prefix(f"network.{name}", network.state_dict())
            state |= with_prefix(f"target.{name}", self.targets[name].state_dict())
            state |= with_prefix(f"optimiser.{name}", optimiser_state(self.optimisers[name]))
        counts = torch.tensor([self.rounds, self.steps, self.updates])
        return {**state, "counts": counts, "ends": self.ends}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """See `Learner.load_state`."""
        self.replay.load_state(under_prefix("replay", state))
        for name, network in self.networks.items():
            network.load_state_dict(under_prefix(f"network.{name}", state))
            self.targets[name].load_state_dict(under_prefix(f"target.{name}", state))
            load_optimiser(self.optimisers[name], under_prefix(f"optimiser.{name}", state))
        self.rounds, self.steps, self.updates = state["counts"].tolist()
        self.ends = state["ends"]
