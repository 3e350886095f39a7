"""`maddpg`: a deterministic actor per unit, critics that see all (Lowe et al., NeurIPS 2017).

`variant=paper` is the paper's MADDPG-GRU with its schedule; `variant=tuned` has a shared reward and
so shared critics, twins of them, n-step returns, the band of anchors, rewards against the rule, and
critics that are told MW. Each of these is a setting, so that an ablation is `--set`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from resilience.errors import UsageError
from resilience.rl.algorithms.actor_critic import ActorCritic, ActorCriticSettings, ActorKind
from resilience.rl.algorithms.maddpg_paper import PaperMaddpg, PaperMaddpgSettings
from resilience.rl.ground.env import BatchEnv

Variant = Literal["tuned", "paper"]
VARIANTS: tuple[Variant, ...] = get_args(Variant)


@dataclass(frozen=True)
class TunedMaddpgSettings(ActorCriticSettings):
    """Settings of `maddpg` with `variant=tuned`: those of `ActorCriticSettings`.

    Attributes:
        variant: tuned.
    """

    variant: Literal["tuned"] = "tuned"
    actor: ActorKind = "agents"


class Maddpg(ActorCritic):
    """The tuned learner; see `ActorCritic`."""

    name = "maddpg"


def maddpg(
    env: BatchEnv, settings: TunedMaddpgSettings | PaperMaddpgSettings, seed: int = 0
) -> Maddpg | PaperMaddpg:
    """The learner of the variant that the settings are of."""
    if isinstance(settings, PaperMaddpgSettings):
        return PaperMaddpg(env, settings, seed)
    return Maddpg(env, settings, seed)


def settings_kind(variant: str = "tuned") -> type[TunedMaddpgSettings | PaperMaddpgSettings]:
    """The dataclass of the settings of a variant.

    Raises:
        UsageError: there is none of this name.
    """
    if variant not in VARIANTS:
        raise UsageError(
            f"variant {variant!r} of maddpg is unknown; allowed: {', '.join(VARIANTS)}",
            hint="tuned is the default",
        )
    return PaperMaddpgSettings if variant == "paper" else TunedMaddpgSettings
