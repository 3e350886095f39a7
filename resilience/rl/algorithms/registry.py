"""Algorithms by name: their settings, and what makes a learner. Their code is imported on use."""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from resilience.errors import UsageError

if TYPE_CHECKING:
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.learning.learner import Learner


@dataclass(frozen=True)
class Algorithm:
    """How a learner is made.

    Attributes:
        module: where it is.
        learner: name of its class there, made from the environment, settings and a seed.
        settings: name of the dataclass of its settings there, or of what makes one from `variant`.
        band: how outputs become MW unless somebody asks for another.
        about: in a few words.
        observer: what is observed.
    """

    module: str
    learner: str
    settings: str
    band: str
    about: str
    observer: str = "full"

    def ground(self, settings: Any) -> tuple[str, str]:
        """Names of the band and of the observer; settings may have their own."""
        return getattr(settings, "band", self.band), getattr(settings, "observer", self.observer)

    def make(self, env: BatchEnv, settings: Any, seed: int) -> Learner:
        """A fresh learner."""
        return cast(
            "Learner", getattr(import_module(self.module), self.learner)(env, settings, seed)
        )

    def settings_kind(self, **variant: str) -> Any:
        """The dataclass of its settings, of the variant if it has several.

        Raises:
            UsageError: an unknown variant.
        """
        kind = getattr(import_module(self.module), self.settings)
        return kind if isinstance(kind, type) else kind(**variant)

    def settings_of(self, values: dict[str, Any]) -> Any:
        """The settings with some values of one's own.

        Raises:
            UsageError: a setting that there is not, or a value that it cannot have.
        """
        from pydantic import TypeAdapter, ValidationError

        kind = self.settings_kind(**{k: v for k, v in values.items() if k == "variant"})
        names = [f.name for f in fields(kind)]
        if unknown := sorted(set(values) - set(names)):
            raise UsageError(
                f"setting {', '.join(unknown)} is unknown; allowed: {', '.join(names)}",
                hint="`resilience train --method METHOD --settings` says what they mean",
            )
        try:
            return TypeAdapter(kind).validate_python(values)
        except ValidationError as error:
            mistakes = [
                f"{'.'.join(map(str, e['loc']))} {e['input']!r}: {e['msg']}" for e in error.errors()
            ]
            raise UsageError(
                "settings: " + "; ".join(mistakes),
                hint="`resilience train --method METHOD --settings` has the defaults",
            ) from None


ALGORITHMS: dict[str, Algorithm] = {
    "apg": Algorithm(
        "resilience.rl.algorithms.apg",
        "Apg",
        "ApgSettings",
        "anchors",
        "gradients through the simulator; the default",
    ),
    "maddpg": Algorithm(
        "resilience.rl.algorithms.maddpg",
        "maddpg",
        "settings_kind",
        "anchors",
        "an agent per unit, critics that see all; variant=paper is the paper's",
    ),
    "matd3": Algorithm(
        "resilience.rl.algorithms.matd3",
        "Matd3",
        "Matd3Settings",
        "anchors",
        "agents with twin critics and smoothed targets",
    ),
    "ddpg": Algorithm(
        "resilience.rl.algorithms.ddpg",
        "Ddpg",
        "DdpgSettings",
        "anchors",
        "one agent for all units, one critic",
    ),
    "mappo": Algorithm(
        "resilience.rl.algorithms.mappo",
        "Mappo",
        "MappoSettings",
        "anchors",
        "on-policy, a critic that agents share",
    ),
    "clone": Algorithm(
        "resilience.rl.algorithms.clone",
        "Clone",
        "CloneSettings",
        "anchors",
        "imitates another dispatcher, with noise",
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
