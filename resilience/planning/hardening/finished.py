"""Finished parts of a choice of what to build, so that an interrupted one goes on where it stopped.

A part is called after a digest of all that it depends on: the case, what may be built, the storms,
the risk, and the code. Whatever is different has another name. A choice that was given up for want
of time is no part. A search that goes on has not learnt what the one before had: its proof may take
another way to the same gap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.digest import code, digest_of
from resilience.parts import load_part, save_part
from resilience.planning.hardening.evaluation import StormOutcomes
from resilience.planning.hardening.search import Choice
from resilience.results import PARTS_FOLDER

WITHOUT_EFFECT = {"description", "path", "source", "rebuild"}
"""Fields of a case that nothing depends on."""
NUMBERS = ("probability", "cost", "shed_mwh", "critical_mwh", "critical_h", "customer_h")
"""What is kept of storms."""


class Finished:
    """Parts in a folder.

    Args:
        folder: that of the result; None: nothing is kept.
        facts: what all parts depend on.

    Attributes:
        read: how many parts were there already.
        count: how many are there now.
    """

    def __init__(self, folder: Path | None, facts: Sequence[object]) -> None:
        self.folder = None if folder is None else folder / PARTS_FOLDER
        self._facts = [] if folder is None else [code(), *facts]
        self.read = self.count = 0

    def sets(
        self, name: str, facts: Sequence[object], make: Callable[[], list[Bools]]
    ) -> list[Bools]:
        """Sets of options (options,), made where they are not there."""
        plain = self._part(name, facts, lambda: [chosen.tolist() for chosen in make()])
        return [np.array(chosen, bool) for chosen in plain]

    def choice(self, budget: float, gap: float, make: Callable[[], Choice]) -> Choice:
        """The choice for a budget; one that is not proven to `gap` is not kept."""

        def plain_choice() -> dict[str, Any]:
            choice = make()
            limit = None if np.isinf(budget) else budget
            return asdict(choice) | {"chosen": choice.chosen.tolist(), "budget": limit}

        plain = self._part(
            "choice", [budget, gap], plain_choice, keep=lambda values: values["gap"] <= gap
        )
        chosen = np.array(plain["chosen"], bool)
        return Choice(**(plain | {"chosen": chosen, "budget": budget}))

    def arrays(
        self, name: str, facts: Sequence[object], make: Callable[[], Sequence[Floats]]
    ) -> tuple[Floats, ...]:
        """Arrays of numbers, in which NaN may stand."""

        def plain_arrays() -> list[list[float | None]]:
            return [
                [None if np.isnan(value) else value for value in array.tolist()] for array in make()
            ]

        plain = self._part(name, facts, plain_arrays)
        return tuple(np.array(values, float) for values in plain)

    def outcomes(self, facts: Sequence[object], make: Callable[[], StormOutcomes]) -> StormOutcomes:
        """What storms cost, but for which storm of a catalogue each is."""

        def arrays() -> list[Floats]:
            storms = make()
            return [getattr(storms, name) for name in NUMBERS]

        probability, *measures = self.arrays("storms", facts, arrays)
        cost, shed_mwh, critical_mwh, critical_h, customer_h = measures
        return StormOutcomes(probability, cost, shed_mwh, critical_mwh, critical_h, customer_h)

    def note(self) -> str:
        """What is there, and how to go on; for whoever interrupts."""
        if self.folder is None:
            return "nothing is kept; with --out the same command would go on"
        return f"{self.count} parts are in {self.folder.parent}; the same command goes on"

    def _part(
        self,
        name: str,
        facts: Sequence[object],
        make: Callable[[], Any],
        keep: Callable[[Any], bool] = lambda _: True,
    ) -> Any:
        """Plain data, read or made."""
        if self.folder is None:
            return make()
        digest = digest_of([*self._facts, name, *facts], WITHOUT_EFFECT)
        path = self.folder / f"{name}-{digest[:24]}.json"
        stored = load_part(path)
        if stored is None:
            stored = make()
            if not keep(stored):
                return stored
            self.folder.mkdir(parents=True, exist_ok=True)
            save_part(path, stored)
        else:
            self.read += 1
        self.count += 1
        return stored
