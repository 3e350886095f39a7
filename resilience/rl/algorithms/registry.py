"""Algorithms by name: their settings, and what makes a learner. Their code is imported on use."""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any

from resilience.errors import UsageError

if TYPE_CHECKING:
    from resilience.rl.env import BatchEnv
    from resilience.rl.learner import Learner


@dataclass(frozen=True)
class Algorithm:
    """How a learner is made.

    Attributes:
        module: where it is.
        learner: name of its class there, made from the environment, settings and a seed.
        settings: name of the dataclass of its settings there.
        band: how outputs become MW unless somebody asks for another.
        about: in a few words.
    """

    module: str
    learner: str
    settings: str
    band: str
    about: str

    def make(self, env: BatchEnv, settings: Any, seed: int) -> Learner:
        """A fresh learner."""
        made: Learner = getattr(import_module(self.module), self.learner)(env, settings, seed)
        return made

    def settings_of(self, values: dict[str, Any]) -> Any:
        """The settings with some values of one's own.

        Raises:
            UsageError: a setting that there is not.
        """
        kind = getattr(import_module(self.module), self.settings)
        names = [f.name for f in fields(kind)]
        if unknown := sorted(set(values) - set(names)):
            raise UsageError(
                f"setting {', '.join(unknown)} is unknown; allowed: {', '.join(names)}",
                hint="`resilience train --help` says what they mean",
            )
        return kind(**values)


ALGORITHMS: dict[str, Algorithm] = {
    "apg": Algorithm(
        "resilience.rl.algorithms.apg",
        "Apg",
        "ApgSettings",
        "anchors",
        "gradients through the simulator; the default",
    ),
}


def algorithm(name: str) -> Algorithm:
    """An algorithm by its name.

    Raises:
        UsageError: there is none of this name.
    """
    if name not in ALGORITHMS:
        raise UsageError(
            f"method {name!r} does not learn; allowed: {', '.join(ALGORITHMS)}",
            hint="apg is the default; other methods need no training",
        )
    return ALGORITHMS[name]
