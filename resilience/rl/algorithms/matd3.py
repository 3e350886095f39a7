"""`matd3`: an actor per unit, twin critics, delayed actors and smoothed targets (Ackermann et al.,
"Reducing Overestimation Bias in Multi-Agent Domains", 2019, after Fujimoto et al., ICML 2018). All
agents share the system's reward, so the twin critics are shared as well.
"""

from __future__ import annotations

from dataclasses import dataclass

from resilience.rl.algorithms.actor_critic import ActorCritic, ActorCriticSettings, ActorKind


@dataclass(frozen=True)
class Matd3Settings(ActorCriticSettings):
    """Settings of `matd3`: those of `ActorCriticSettings`, agents with smoothed targets."""

    target_noise: float = 0.1
    n_step: int = 1
    actor: ActorKind = "agents"


class Matd3(ActorCritic):
    """The learner; see `ActorCritic`."""

    name = "matd3"
