"""Gymnasium: one central agent that decides for all storage, alone or for many days at once."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from resilience.case import Case
from resilience.rl.adapters.play import Play


def spaces_of(play: Play) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """What is observed, and an action in [-1, 1] for every unit."""
    low, high = play.bounds
    shape = (len(play.units),)
    return gym.spaces.Box(low, high, dtype=np.float32), gym.spaces.Box(-1.0, 1.0, shape, np.float32)


class DispatchEnv(gym.Env[np.ndarray, np.ndarray]):
    """One day after another; an episode is truncated at midnight, never terminated.

    The last reward holds the worth of the energy that is left, and what is seen after the last slot
    is its storage in the world as it was.

    Args:
        case: the case.
        options: of `Play`.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 as Gymnasium has it
    render_mode = None

    def __init__(self, case: Case, **options: Any) -> None:
        self.play = Play(case, 1, **options)
        self.observation_space, self.action_space = spaces_of(self.play)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """A new day, drawn after the seed where there is one."""
        super().reset(seed=seed)
        return self.play.reset(self.np_random)[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One slot."""
        numbers, reward, is_over, info = self.play.step(np.asarray(action)[None])
        return numbers[0], float(reward[0]), False, is_over, first_of(info)


class DispatchVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many days at once. They end together, and the step that ends them begins new ones:
    `metadata["autoreset_mode"]` is SAME_STEP, with `final_obs` and `final_info`.

    Args:
        case: the case.
        num_envs: days at once.
        options: of `Play`.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012
    render_mode = None

    def __init__(self, case: Case, num_envs: int, **options: Any) -> None:
        self.num_envs = num_envs
        self.play = Play(case, num_envs, **options)
        self.single_observation_space, self.single_action_space = spaces_of(self.play)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """New days. Seeds in a list are one seed together, since all days are drawn at once."""
        if isinstance(seed, list):
            seed = int(np.random.SeedSequence(seed).generate_state(1)[0])
        super().reset(seed=seed)
        return self.play.reset(self.np_random), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One slot of every day."""
        numbers, reward, is_over, info = self.play.step(actions)
        ones = np.ones(self.num_envs, bool)
        infos = masked(info, ones)
        if is_over:
            infos = {"final_obs": numbers, "_final_obs": ones, "final_info": infos}
            infos["_final_info"] = ones
            numbers = self.play.reset(self.np_random)
        return numbers, reward, ~ones, ones & is_over, infos


def first_of(info: dict[str, np.ndarray]) -> dict[str, Any]:
    """What belongs to the first episode: numbers, and arrays for the units."""
    return {name: v[0].item() if v.ndim == 1 else v[0].copy() for name, v in info.items()}


def masked(info: dict[str, np.ndarray], ones: np.ndarray) -> dict[str, Any]:
    """The values, each with the mask of the episodes that have one, as Gymnasium wants it."""
    return info | {f"_{name}": ones for name in info}
