"""The paper's MADDPG-GRU: its networks, its schedule, its rewards, its mask.

An agent per storage unit, with a GRU for the window and an actor of [SoC_n, c_n, v_n] (18 numbers);
its critic sees the states of charge and counters of all, its own v_n (26 numbers with five units),
and the actions of all in MW per unit of their largest, through the action embedding. The paper's
tables and equations leave fourteen things open or contradict each other; what is done here:

1.  eq. (20) lets the critic ascend its loss: it descends;
2.  the state has no flag of the grid, no time, no price: kept, see `observe_paper`;
3.  its own eq. for generators ignores PV and storage: the simulator's recourse decides, which is
    the cheapest; `Simulator(recourse="paper")` has the equation;
4.  its balance has no curtailment: the simulator has;
5.  exports are priced as |P|: the case says so, `ieee33` as the paper;
6.  shedding is energy here, MWh, never a sum of slots' MW;
7.  no state of charge at the start and no worth of it at the end is given: the case's are taken,
    half full in `ieee33`; set `terminal_value_per_mwh` to 0 for none;
8.  its figures of shedding differ between two tables: nothing to do with learning;
9.  its text claims more than its table: likewise;
10. it sheds less when agents fail: `policy.with_failed` lets one see;
11. its case of -15 % PV and +15 % load is a matter of the test, not of training;
12. its computing time is mostly power flow, which is not in this loop;
13. the mask is described as clipping and as rescaling: it is rescaling, `bands.AffineBand`, after
    noise and on the targets' actions too, with efficiencies, which the paper's bounds leave out;
14. not stated at all, chosen here: normal noise on the output (`noise`), outputs at random in the
    warm-up, replay of all rounds, Adam, the worth of the end in the last reward and nothing
    bootstrapped after it, per-unit scales, counters that stay 0 after the peak and are the same for
    all agents, the layer at which the action embedding enters (added to the second layer's output),
    critics that take v_n as it is and do not train the GRU, and in the gradient of an actor the
    present actions of the others, as the paper's J says.

An update falls on every multiple of 24 of the global step after the 8,000th: 1,267 in 38,400 steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import torch
from torch import nn

from resilience.errors import UsageError
from resilience.models.simulator.simulator import Step
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.tape import Tape
from resilience.rl.learning.learner import Progress
from resilience.rl.learning.off_policy import ReplayLearner
from resilience.rl.learning.replay import Situations, Transitions
from resilience.rl.networks.actors import GruActors
from resilience.rl.networks.stacked import StackedLinear, StackedNorm


@dataclass(frozen=True)
class PaperMaddpgSettings:
    """Settings of `maddpg` with `variant=paper`, those of the paper's tables.

    Attributes:
        variant: paper.
        episodes: in all.
        environments: episodes played in lockstep, a divisor of `episodes`; the paper's is 1, which
            is the same but for the moment at which an update is done.
        learning_rate: of actors, critics and GRUs.
        discount: per slot.
        tau: share by which targets follow.
        batch: rows of an update.
        update_every: steps of the environments, all counted, per update.
        warm_up: steps with random outputs, before the first update.
        noise: standard deviation of what is added to outputs; the paper does not say.
        noise_correlation: of that from one slot to the next; the paper does not say.
        band: how outputs become MW.
        observer: what is observed.
    """

    variant: Literal["paper"] = "paper"
    episodes: int = 400
    environments: int = 20
    learning_rate: float = 2.5e-4
    discount: float = 0.99
    tau: float = 1e-3
    batch: int = 128
    update_every: int = 24
    warm_up: int = 8000
    noise: float = 0.1
    noise_correlation: float = 0.0
    band: str = "affine"
    observer: str = "paper"

    @property
    def replay(self) -> int:
        """All rounds are kept."""
        return max(self.episodes // self.environments, 1)


class PaperCritics(nn.Module):
    """A critic per agent: 26-64-64 with LayerNorm, plus the embedded actions, then one number.

    Args:
        units: agents.
        generator: draws the weights.
    """

    def __init__(self, units: int, generator: torch.Generator) -> None:
        super().__init__()
        self.first = StackedLinear(units, 2 * units + 16, 64, generator)
        self.first_norm = StackedNorm(units, 64)
        self.second = StackedLinear(units, 64, 64, generator)
        self.second_norm = StackedNorm(units, 64)
        self.of_actions = StackedLinear(units, units, 64, generator)
        self.last = StackedLinear(units, 64, 1, generator)

    def forward(
        self, states: torch.Tensor, features: torch.Tensor, actions: torch.Tensor
    ) -> torch.Tensor:
        """(units, n) $ to come.

        Args:
            states: (n, 2 units) states of charge and counters.
            features: (units, n, 16) of each agent's GRU.
            actions: (units, n, units) what each critic is told that all agents do.
        """
        critic_inputs = torch.cat([states.expand(len(features), -1, -1), features], -1)
        hidden = torch.relu(self.first_norm(self.first(critic_inputs)))
        hidden = torch.relu(self.second_norm(self.second(hidden)))
        values: torch.Tensor = self.last(hidden + torch.relu(self.of_actions(actions)))
        return values[..., 0]


class PaperMaddpg(ReplayLearner):
    """The learner.

    Args:
        env: the training ground.
        settings: as above.
        seed: of weights, noise and samples.

    Raises:
        UsageError: episodes that the environments do not divide, or other observations.
    """

    name = "maddpg"

    def __init__(self, env: BatchEnv, settings: PaperMaddpgSettings, seed: int = 0) -> None:
        if settings.episodes % settings.environments:
            raise UsageError(
                f"{settings.episodes} episodes in {settings.environments} environments; allowed: a "
                "divisor of the episodes",
                hint="environments=20",
            )
        if env.observer_name != "paper":
            raise UsageError(
                f"the paper's agents see {env.observer_name!r}; allowed: paper",
                hint="its GRU needs the window",
            )
        super().__init__(env, settings, seed, heads=env.units)
        self.settings, units = settings, env.units
        self.iterations = settings.episodes // settings.environments
        self._largest = env.largest_power()
        self._own = torch.eye(units, dtype=torch.bool, device=env.device)[:, None]
        self.learn("actor", GruActors(env.size, units, self.generator), settings.learning_rate)
        self.learn("critic", PaperCritics(units, self.generator), settings.learning_rate)

    def network(self) -> dict[str, Any]:
        """See `Learner.network`."""
        return {"kind": "gru"}

    def starts(self, rng: np.random.Generator) -> torch.Tensor:
        """As the case starts."""
        return self.env.start(self.settings.environments)

    def rewards(self, tape: Tape, t: int, step: Step, baseline_cost: torch.Tensor) -> torch.Tensor:
        """(units, environments) $: eq. (16)."""
        return self.env.agent_rewards(tape, t, step, baseline_cost)

    def baseline_cost(self, tape: Tape, start: torch.Tensor) -> torch.Tensor:
        """None: the paper's rewards are what is paid."""
        return torch.zeros((tape.slots, tape.n), dtype=start.dtype, device=start.device)

    def sample(self, rng: np.random.Generator) -> Transitions:
        """Rows with the next slot."""
        return self.replay.sample(self.settings.batch, rng, 1, self.settings.discount)

    def target_value(self, sample: Transitions) -> torch.Tensor:
        """(units, n) what the critics should have said, eq. (17)."""
        with torch.no_grad():
            actor, later = self.targets["actor"], sample.later
            assert isinstance(actor, GruActors)
            features = actor.features(later.observed)
            actions = self._actions(later, actor.of_features(later.observed, features))
            values = self.targets["critic"](self._states(later), features, self._for_all(actions))
            return sample.rewards + sample.discount * values

    def update(self, sample: Transitions, rng: np.random.Generator, progress: Progress) -> float:
        """Eqs. (18) to (24), all agents at once."""
        actor, critic, now = self.networks["actor"], self.networks["critic"], sample.now
        assert isinstance(actor, GruActors)
        features, states = actor.features(now.observed), self._states(now)
        detached = features.detach()
        done = self._for_all(self._actions(now, sample.output))
        loss = (critic(states, detached, done) - self.target_value(sample)).square().mean(1).sum()
        self._descend("critic", loss)
        actions = self._actions(now, actor.of_features(now.observed, features))
        # Critic n tells agent n alone: what the others do now is given.
        theirs = torch.where(self._own, actions, actions.detach())
        critic.requires_grad_(False)
        value = critic(states, detached, theirs).mean(1).sum()
        critic.requires_grad_(True)
        self._descend("actor", -value)
        return float(loss.detach()) / self.env.units

    def _states(self, situation: Situations) -> torch.Tensor:
        """(n, 2 units) states of charge and counters."""
        return situation.observed[:, : 2 * self.env.units]

    def _for_all(self, actions: torch.Tensor) -> torch.Tensor:
        """(units, n, units) the same actions for every critic."""
        return actions.expand(self.env.units, -1, -1)

    def _actions(self, situation: Situations, output: torch.Tensor) -> torch.Tensor:
        """(n, units) MW per unit of the largest, masked."""
        power = self.env.band.power(output.T, situation.energy, situation.slot)
        return cast("torch.Tensor", (power / self._largest).T)

    def _descend(self, name: str, loss: torch.Tensor) -> None:
        self.optimisers[name].zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimisers[name].step()
