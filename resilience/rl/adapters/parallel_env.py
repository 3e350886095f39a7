"""PettingZoo: an agent for every storage unit, all deciding at the same time."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from pettingzoo import ParallelEnv

from resilience.case import Case
from resilience.rl.adapters.gym_env import first_of, spaces_of
from resilience.rl.adapters.play import Play

Values = dict[str, Any]


class DispatchParallelEnv(ParallelEnv):  # type: ignore[misc]  # it has no types
    """All agents see the same, each with the mark of its own place at the end, decide for one
    unit each, and are rewarded alike, with what the system saves.

    Args:
        case: the case.
        options: of `Play`.
    """

    metadata = {"name": "resilience_dispatch_v0", "render_modes": []}  # noqa: RUF012

    def __init__(self, case: Case, **options: Any) -> None:
        self.play = Play(case, 1, **options)
        self.possible_agents = list(self.play.units)
        self.agents: list[str] = []
        self.render_mode = None
        low, high = self.play.bounds
        n = len(self.possible_agents)
        low = np.append(low, np.zeros(n, np.float32))
        high = np.append(high, np.ones(n, np.float32))
        self.observation_spaces = {
            agent: gym.spaces.Box(low, high, dtype=np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {
            agent: gym.spaces.Box(-1.0, 1.0, (1,), np.float32) for agent in self.possible_agents
        }
        self.state_space = spaces_of(self.play)[0]
        self._rng = np.random.default_rng()

    def observation_space(self, agent: str) -> gym.spaces.Box:
        """The same object at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gym.spaces.Box:
        """Likewise."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Values, Values]:
        """A new day, drawn after the seed where there is one."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self._state = self.play.reset(self._rng)[0]
        return self._seen(), {agent: {} for agent in self.agents}

    def step(self, actions: Values) -> tuple[Values, Values, Values, Values, Values]:
        """One slot; at its end all agents leave together."""
        action = np.array([np.asarray(actions[agent]).item() for agent in self.possible_agents])
        numbers, reward, is_over, info = self.play.step(action[None])
        self._state, agents = numbers[0], self.agents
        shared, gain = first_of(info), float(reward[0])
        infos = {
            agent: shared
            | {"asked_mw": float(shared["asked_mw"][k]), "done_mw": float(shared["done_mw"][k])}
            for k, agent in enumerate(agents)
        }
        result = (
            self._seen(),
            dict.fromkeys(agents, gain),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, is_over),
            infos,
        )
        self.agents = [] if is_over else agents
        return result

    def state(self) -> np.ndarray:
        """What is observed, without anybody's mark."""
        return self._state

    def _seen(self) -> Values:
        marks = np.eye(len(self.possible_agents), dtype=np.float32)
        return {
            agent: np.concatenate([self._state, marks[self.possible_agents.index(agent)]])
            for agent in self.agents
        }
