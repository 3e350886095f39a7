"""`ddpg`: one agent for all storage, with a single critic (Lillicrap et al., ICLR 2016); what the
paper compares its agents with.
"""

from __future__ import annotations

from dataclasses import dataclass

from resilience.rl.algorithms.actor_critic import ActorCritic, ActorCriticSettings


@dataclass(frozen=True)
class DdpgSettings(ActorCriticSettings):
    """Settings of `ddpg`: those of `ActorCriticSettings` with one critic and no delay."""

    critics: int = 1
    policy_delay: int = 1
    n_step: int = 1


class Ddpg(ActorCritic):
    """The learner; see `ActorCritic`."""

    name = "ddpg"
