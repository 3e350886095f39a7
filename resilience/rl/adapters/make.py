"""The adapters by what is wanted; their packages are imported when one is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from resilience.case import Case, load_case
from resilience.extras import need

if TYPE_CHECKING:
    from resilience.rl.adapters.gym_env import DispatchEnv, DispatchVectorEnv
    from resilience.rl.adapters.parallel_env import DispatchParallelEnv


def make_env(case: Case | str | Path = "ieee33", **options: Any) -> DispatchEnv:
    """A Gymnasium `Env` in which one agent decides for all storage.

    Args:
        case: a case, its file, or the name of an installed one.
        options: of `resilience.rl.adapters.play.Play`: band_name, baseline, days, forecast_error,
            known_centre, random_start.

    Raises:
        UsageError: Gymnasium is not installed, or the case cannot be played.
    """
    need("gym", "a Gymnasium environment", "gymnasium")
    from resilience.rl.adapters.gym_env import DispatchEnv

    return DispatchEnv(_case(case), **options)


def make_vec(
    case: Case | str | Path = "ieee33", num_envs: int = 64, **options: Any
) -> DispatchVectorEnv:
    """A Gymnasium `VectorEnv` of as many days, which resets in the step that ends them.

    Args:
        case: as for `make_env`.
        num_envs: days at once.
        options: likewise.

    Raises:
        UsageError: as there.
    """
    need("gym", "a Gymnasium environment", "gymnasium")
    from resilience.rl.adapters.gym_env import DispatchVectorEnv

    return DispatchVectorEnv(_case(case), num_envs, **options)


def make_parallel(case: Case | str | Path = "ieee33", **options: Any) -> DispatchParallelEnv:
    """A PettingZoo `ParallelEnv` with an agent for every storage unit.

    Args:
        case: as for `make_env`.
        options: likewise.

    Raises:
        UsageError: as there.
    """
    need("gym", "a PettingZoo environment", "gymnasium", "pettingzoo")
    from resilience.rl.adapters.parallel_env import DispatchParallelEnv

    return DispatchParallelEnv(_case(case), **options)


def _case(case: Case | str | Path) -> Case:
    return case if isinstance(case, Case) else load_case(case)
