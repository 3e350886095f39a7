"""Observations by name: what policies may be given to see."""

from __future__ import annotations

from collections.abc import Callable

from resilience.errors import UsageError
from resilience.rl.ground.eyes import Eyes
from resilience.rl.ground.observe import Observer
from resilience.rl.ground.observe_paper import PaperObserver
from resilience.simulation.setting import Setting

OBSERVERS: dict[str, Callable[[Setting], Eyes]] = {"full": Observer, "paper": PaperObserver}


def observer(name: str, setting: Setting) -> Eyes:
    """A fresh observer of this name.

    Raises:
        UsageError: there is none of this name.
    """
    if name not in OBSERVERS:
        raise UsageError(
            f"observation {name!r} is unknown; allowed: {', '.join(OBSERVERS)}",
            hint="full is the default, paper is what the paper's agents see",
        )
    return OBSERVERS[name](setting)
