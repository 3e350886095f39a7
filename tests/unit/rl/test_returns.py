"""Returns and advantages against sums by hand."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

from resilience.rl.learning.returns import advantages, n_step_returns, returns_to_go  # noqa: E402

REWARDS = torch.tensor([3.0, -2.0, 7.0], dtype=torch.float64)[:, None]
VALUES = torch.tensor([5.0, 11.0, 13.0], dtype=torch.float64)[:, None]


def column(*values: float):
    return torch.tensor(values, dtype=torch.float64)[:, None]


def test_returns_to_go() -> None:
    expected = column(3.0 + 0.5 * (-2.0 + 0.5 * 7.0), -2.0 + 0.5 * 7.0, 7.0)
    torch.testing.assert_close(returns_to_go(REWARDS, 0.5), expected)


def test_two_steps_and_the_value_after_them_unless_the_episode_is_cut() -> None:
    expected = column(3.0 - 0.5 * 2.0 + 0.25 * 13.0, -2.0 + 0.5 * 7.0, 7.0)
    torch.testing.assert_close(n_step_returns(REWARDS, VALUES, 0.5, 2), expected)


def test_advantages_by_hand() -> None:
    surprise = 3.0 + 0.5 * 11.0 - 5.0, -2.0 + 0.5 * 13.0 - 11.0, 7.0 - 13.0
    fade = 0.5 * 0.8
    second = surprise[1] + fade * surprise[2]
    expected = column(surprise[0] + fade * second, second, surprise[2])
    torch.testing.assert_close(advantages(REWARDS, VALUES, 0.5, 0.8), expected)


def test_advantages_that_trust_the_rewards_are_returns_less_values() -> None:
    expected = returns_to_go(REWARDS, 0.9) - VALUES
    torch.testing.assert_close(advantages(REWARDS, VALUES, 0.9, 1.0), expected)
