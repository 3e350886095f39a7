"""With what an episode of a training starts."""

from __future__ import annotations

import numpy as np
import torch

from resilience.rl.ground.env import BatchEnv


def mixed_starts(
    env: BatchEnv, ends: torch.Tensor, carried: float, rng: np.random.Generator
) -> torch.Tensor:
    """(units, n) MWh: what earlier episodes ended with, `ends`, shuffled, or anything.

    Args:
        env: the training ground.
        ends: (units, n) MWh.
        carried: share of episodes that start with what an earlier one ended with; the others start
            with a random state of charge.
        rng: draws.
    """
    n = ends.shape[1]
    low, high = env.simulator.low, env.simulator.high
    random = env.tensor(low + (high - low) * rng.random((env.units, n)))
    is_carried = torch.as_tensor(rng.random(n) < carried, device=env.device)
    shuffled = ends[:, torch.as_tensor(rng.permutation(n), device=env.device)]
    return torch.where(is_carried, shuffled, random)
