"""Learned dispatchers: one strategy among the others, on the same case, simulator and storms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.lazy import lazy_names

if TYPE_CHECKING:
    from resilience.rl.adapters.make import make_env, make_parallel, make_vec
    from resilience.rl.export import export_policy
    from resilience.rl.networks.acting import load_outputs
    from resilience.rl.policy import load_policy
    from resilience.rl.training.run import Run
else:
    __getattr__ = lazy_names(__name__)

__all__ = [
    "Run",
    "export_policy",
    "load_outputs",
    "load_policy",
    "make_env",
    "make_parallel",
    "make_vec",
]


def __dir__() -> list[str]:
    return __all__
