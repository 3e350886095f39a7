"""The official checks of environments, on any case: what `resilience env CASE --check` runs."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from resilience.case import Case
from resilience.extras import need
from resilience.rl.adapters.make import make_env, make_parallel, make_vec

CYCLES = 200  # slots that PettingZoo's checks play


@dataclass(frozen=True)
class Check:
    """How an official check went.

    Attributes:
        name: of the check, with its package.
        verdict: passed, failed or skipped.
        reason: why it failed or was skipped.
    """

    name: str
    verdict: str
    reason: str = ""


def check_environments(case: Case, cycles: int = CYCLES, **options: Any) -> list[Check]:
    """Runs all checks on the environments of a case.

    Args:
        case: the case.
        cycles: slots that PettingZoo's checks play.
        options: of the environments.

    Raises:
        UsageError: Gymnasium or PettingZoo is not installed, or the case cannot be played.
    """
    need("gym", "checking environments", "gymnasium", "pettingzoo")
    make_env(case, **options)
    return list(_results(_checks(case, cycles, options)))


def _results(checks: dict[str, Callable[[], None]]) -> Iterator[Check]:
    for name, check in checks.items():
        package = name.partition(":")[0]
        if find_spec(package) is None:
            yield Check(name, "skipped", f"{package} is not installed")
            continue
        try:
            # A check that only warns has found something; alone that prints tells nobody.
            with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
                warnings.simplefilter("error")
                _let_pass()
                check()
        except Exception as error:
            yield Check(name, "failed", f"{type(error).__name__}: {error}")
        else:
            yield Check(name, "passed")


def _let_pass() -> None:
    """Advice that does not apply: spaces without bounds where none are known, no registered spec,
    and what packages warn of in others.
    """
    for text in (".*minimum value is -infinity.*", ".*maximum value is infinity.*", ".*env.spec.*"):
        warnings.filterwarnings("ignore", text)
    for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
        warnings.simplefilter("ignore", kind)


def _checks(case: Case, cycles: int, options: dict[str, Any]) -> dict[str, Callable[[], None]]:
    def single() -> None:
        from gymnasium.utils.env_checker import check_env

        check_env(make_env(case, **options), skip_render_check=True)

    def baselines() -> None:
        from stable_baselines3.common.env_checker import check_env

        check_env(make_env(case, **options), skip_render_check=True)

    def api() -> None:
        from pettingzoo.test import parallel_api_test

        parallel_api_test(make_parallel(case, **options), num_cycles=cycles)

    def seeds() -> None:
        from pettingzoo.test import parallel_seed_test

        parallel_seed_test(lambda: make_parallel(case, **options), num_cycles=cycles)

    return {
        "gymnasium: check_env": single,
        "gymnasium: vector steps as single": lambda: vector_as_single(case, options),
        "pettingzoo: parallel_api_test": api,
        "pettingzoo: parallel_seed_test": seeds,
        "stable_baselines3: check_env": baselines,
    }


def vector_as_single(case: Case, options: dict[str, Any]) -> None:
    """A vector of one day is the single environment, and its spaces hold what it gives; Gymnasium
    has no check of its own for vectors.

    Raises:
        AssertionError: it is not.
    """
    from gymnasium.vector import AutoresetMode

    alone, many = make_env(case, **options), make_vec(case, 1, **options)
    assert isinstance(many.metadata["autoreset_mode"], AutoresetMode)
    numbers, wide = alone.reset(seed=7)[0], many.reset(seed=7)[0]
    assert np.array_equal(numbers, wide[0])
    rng = np.random.default_rng(8)
    is_over = False
    while not is_over:
        action = rng.uniform(-1.0, 1.0, many.action_space.shape).astype(np.float32)
        numbers, reward, _, is_over, _ = alone.step(action[0])
        wide, rewards, ended, truncated, info = many.step(action)
        assert wide in many.observation_space
        assert rewards[0] == reward
        assert truncated[0] == is_over
        assert not ended.any()
        last = info["final_obs"] if is_over else wide
        assert np.array_equal(last[0], numbers)
