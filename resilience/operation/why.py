"""Why a decision is what it is, in sentences: what is out, what may come, what energy is worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from resilience.dispatch.end_value import energy_price, stored_energy_value
from resilience.dispatch.memory import Memory
from resilience.dispatch.window_plan import Planning, WindowPlan
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting

LOOKED_AHEAD_H = 12.0
NOTABLE = 0.005
"""Probability, and MWh, below which nothing is told."""


class Reasons:
    """Says why, in one setting.

    Args:
        setting: where decisions are made.
    """

    def __init__(self, setting: Setting) -> None:
        self.setting, self.case = setting, setting.case
        self.price = energy_price(setting.case)
        self.worth = stored_energy_value(setting.case, setting.end_value_per_mwh)
        self.horizon = max(round(LOOKED_AHEAD_H / setting.case.step_h), 1)

    def of_world(self, observation: Observation, since: Mapping[str, int]) -> list[str]:
        """What is so, whoever decides.

        Args:
            observation: of the slot.
            since: what is out, with the slot in which that was told first.
        """
        t, label = observation.t, self.case.slot_label
        outages = [
            f"{name} is out, since {label(first)}" if first < t else f"{name} is out"
            for name, first in since.items()
        ]
        lines = ["; ".join(outages) if outages else "nothing is out"]
        if len(self.worth):
            lines.append(
                f"a MWh costs {self.price[t]:.4g} $ now, and one in storage is worth "
                f"{self.worth[:, t + 1].max():.4g} $ later by prices alone"
            )
        return lines

    def of_method(self, dispatcher: Any, observation: Observation) -> list[str]:
        """What the method believes and plans; to be asked right after it has decided."""
        lines = []
        belief, memory = (getattr(dispatcher, name, None) for name in ("belief", "memory"))
        if belief is not None and isinstance(memory, Memory):
            chances = belief.chances(memory.history(observation, 0), self.horizon)
            lines += self._likely(chances)
        if isinstance(dispatcher, Planning) and (plan := dispatcher.latest_plan()) is not None:
            lines += self._planned(plan)
        return lines

    def _likely(self, chances: np.ndarray) -> list[str]:
        fails = 1.0 - np.prod(1.0 - chances, axis=1)
        if not len(fails) or fails.max() < NOTABLE:
            return [f"no outage is likely to begin within {LOOKED_AHEAD_H:g} h"]
        ranked = np.argsort(-fails, kind="stable")[:3]
        listed = [f"{self.setting.lines[k]} {fails[k]:.0%}" for k in ranked if fails[k] >= NOTABLE]
        return [f"likely to fail within {LOOKED_AHEAD_H:g} h: {', '.join(listed)}"]

    def _planned(self, plan: WindowPlan) -> list[str]:
        if not len(plan.first):
            return []
        stored = plan.energy_mwh.sum(0)
        fullest, last = int(np.argmax(stored)), int(plan.stop[-1])
        window, hours = self.case.window, (plan.stop - plan.first) * self.case.step_h
        shed = float(plan.shed_mw @ hours)
        end, paths = window.text(window.time(last)), len(plan.probability)
        of_paths = f", mean of {paths} paths" if paths > 1 else ""
        when = window.text(window.time(int(plan.stop[fullest])))
        return [
            f"it plans until {end}{of_paths}: most stored, {stored[fullest]:.2f} MWh, at {when}; "
            + (f"{shed:.2f} MWh shed" if shed >= NOTABLE else "next to nothing shed")
        ]
