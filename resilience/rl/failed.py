"""Agents that fail: their units do what is left to them, the others go on as before."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from resilience.dispatch.registry import factory_of, is_batched
from resilience.errors import UsageError
from resilience.simulation.observation import (
    Action,
    Dispatcher,
    Observation,
    parts_of,
)
from resilience.simulation.setting import Setting

FALLBACKS = {"idle": "idle", "rule": "rule-0.9"}
"""What a failed unit does, by the name of the dispatcher that decides for it."""


class WithFailed:
    """A dispatcher some of whose units are decided for by another.

    Args:
        setting: where it acts.
        inner: decides for all units.
        outer: decides for those that have failed.
        failed: (units,) which.
    """

    def __init__(
        self, inner: Dispatcher, outer: Dispatcher, failed: np.ndarray, names: Sequence[str]
    ) -> None:
        self.inner, self.outer, self.failed = inner, outer, failed[:, None]
        self.name = f"{inner.name} without {', '.join(names)}"

    def act(self, observation: Observation) -> Action:
        """(units, batch) MW; everything else is decided as the inner one does."""
        inner = parts_of(self.inner.act(observation))
        outer = parts_of(self.outer.act(observation))
        return inner._replace(power=np.where(self.failed, outer.power, inner.power))


class FailedEntry:
    """Makes a dispatcher with failed units; see `with_failed`."""

    def __init__(
        self, factory: Callable[[Setting], Dispatcher], units: tuple[str, ...], fallback: str
    ) -> None:
        self.factory, self.units, self.fallback = factory, units, fallback
        self.batched = is_batched(factory)

    def __call__(self, setting: Setting) -> Dispatcher:
        """A fresh dispatcher.

        Raises:
            UsageError: a unit that there is not.
        """
        names = setting.simulator.units
        if unknown := sorted(set(self.units) - set(names)):
            raise UsageError(
                f"failed agents {', '.join(unknown)} have no storage unit; allowed: "
                f"{', '.join(names)}",
                hint="an agent has the name of its unit",
            )
        failed = np.array([name in self.units for name in names])
        outer = factory_of(FALLBACKS[self.fallback])(setting)
        return WithFailed(self.factory(setting), outer, failed, self.units)


def with_failed(
    factory: str | Callable[[Setting], Dispatcher], units: Sequence[str], fallback: str = "idle"
) -> FailedEntry:
    """A dispatcher whose agents of some units have failed; `compare` takes it under any name.

        rs.compare("ieee33", {"one failed": with_failed("maddpg:RUN", ["ess1"], "rule")})

    Args:
        factory: what makes the dispatcher, or its name, METHOD:RUN among them.
        units: names of the units whose agents have failed.
        fallback: what these units do: idle, or the rule that holds a state of charge of 0.9.

    Raises:
        UsageError: an unknown fallback or dispatcher.
    """
    if fallback not in FALLBACKS:
        raise UsageError(
            f"fallback {fallback!r} is unknown; allowed: {', '.join(FALLBACKS)}",
            hint="idle leaves the storage alone",
        )
    if isinstance(factory, str):
        factory = factory_of(factory)
    assert callable(factory)
    return FailedEntry(factory, tuple(units), fallback)
