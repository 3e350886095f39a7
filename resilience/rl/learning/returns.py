"""What a decision led to: n-step returns, generalised advantages, and where an episode is cut.

Rewards are (slots, ...) with the slots first. The reward of the last slot holds the worth of the
energy left, as `BatchEnv.cost` has it: nothing comes after an episode, so that nothing is
bootstrapped there, and a value there would count that energy twice.
"""

from __future__ import annotations

import torch


def returns_to_go(rewards: torch.Tensor, discount: float) -> torch.Tensor:
    """(slots, ...) discounted sums of all that comes."""
    total = torch.zeros_like(rewards[0])
    sums = []
    for reward in rewards.flip(0):
        total = reward + discount * total
        sums.append(total)
    return torch.stack(sums[::-1])


def n_step_returns(
    rewards: torch.Tensor, values: torch.Tensor, discount: float, steps: int
) -> torch.Tensor:
    """(slots, ...) the sum of the next `steps` rewards and the value after them.

    Args:
        rewards: (slots, ...).
        values: (slots, ...) of the states in which the slots begin.
        discount: per slot.
        steps: 1 or more; near the end of the episode as many as are left, with no value after them.
    """
    slots = len(rewards)
    returns = []
    for t in range(slots):
        last = min(t + steps, slots)
        total = torch.zeros_like(rewards[0])
        if last < slots:
            total = values[last]
        for k in range(last - 1, t - 1, -1):
            total = rewards[k] + discount * total
        returns.append(total)
    return torch.stack(returns)


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, discount: float, decay: float
) -> torch.Tensor:
    """(slots, ...) generalised advantage estimates (Schulman et al., ICLR 2016, eq. 16).

    Args:
        rewards: (slots, ...).
        values: (slots, ...) of the states in which the slots begin.
        discount: per slot.
        decay: their lambda: 0 trusts the values, 1 the rewards.
    """
    after = torch.cat([values[1:], torch.zeros_like(values[:1])])
    surprise = rewards + discount * after - values
    return returns_to_go(surprise, discount * decay)
