"""Options of `solve` for plans over scenarios."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.models.program.risk import Risk


class ScenarioOptions(TypedDict, total=False):
    """Options of `solve` for plans over scenarios.

    Attributes:
        scenarios: how many are drawn (200), or the scenarios themselves.
        risk: what is minimised: `"mean"`, or `"cvar:0.95:0.5"`, half the mean and half the mean of
            the worst 5 %.
        common_slots: slots after which every scenario goes its own way; if omitted, each leaves the
            common schedule when its own outage shows.
        algorithm: `"extensive"` or `"lshaped"`; by the number of scenarios if omitted.
    """

    scenarios: int | Scenarios | None
    risk: str | Risk | None
    common_slots: int | None
    algorithm: str | None
