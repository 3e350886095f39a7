"""Going on from a policy that another algorithm has trained."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import nn

from resilience.dispatch.registry import POLICY_FILE
from resilience.errors import UsageError
from resilience.rl.checkpoint import check_fits, load
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.observers import observer


def load_start(name: str, actor: nn.Module, about: Mapping[str, Any], env: BatchEnv) -> None:
    """Puts the weights of a trained policy into an actor.

    Args:
        name: METHOD:RUN.
        actor: gets the weights.
        about: what it is, as `Learner.network` says.
        env: where it learns.

    Raises:
        UsageError: no such policy, or one of another case, observation, band or network.
    """
    method, _, run = name.partition(":")
    path = Path(run) / POLICY_FILE
    weights, header = load(path)
    schema = observer(env.observer_name, env.setting).schema
    check_fits(path, header, env.setting.case, schema)
    start_facts = (header.method, header.network, header.config["band"])
    allowed = (method, dict(about), env.band_name)
    if start_facts != allowed:
        raise UsageError(
            f"{path} holds {start_facts}, and the start of this training can be {allowed}; "
            "allowed: the same method, network and band",
            hint="set the same actor, hidden and --band in both trainings",
        )
    actor.load_state_dict(weights)
