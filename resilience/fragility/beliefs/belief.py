"""What a dispatcher believes of outages to come, given what an operator has seen.

`BellBelief` believes in the paper's bell (`bell_day.py`), `StormBelief` in a storm on its track
(`storm_belief.py`), `BlackoutBelief` in a blackout of unknown length (`blackout_belief.py`),
`ScenarioBelief` in scenarios (`scenario_belief.py`); `case_belief` gives a case its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.blackout_belief import BlackoutBelief
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.outages.bell import Bell, case_bell
from resilience.fragility.outages.blackout import case_blackout

if TYPE_CHECKING:
    from resilience.case import Case


class Belief(Protocol):
    """Outages to come, as a dispatcher expects them.

    Attributes:
        daily: what failed may fail again after midnight.
        overnight: outages run on past midnight; otherwise it ends all of them.
        longest_slots: how long an outage may last, slots of the case.
    """

    @property
    def daily(self) -> bool:
        """Whether every day has a hazard of its own."""

    @property
    def overnight(self) -> bool:
        """Whether outages run on past midnight."""

    @property
    def longest_slots(self) -> int:
        """Slots of a long outage."""

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines, slots, n) where lines are down after the present slot, on equally likely paths.

        The same random numbers serve in every slot of an episode, others in every episode.
        """

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines, slots) probability that an outage begins in each slot after the present one."""

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines,) slots after the present one that a line which is down stays so, on average."""


def case_belief(
    case: Case, lines: tuple[str, ...], *, bell: Bell | None = None, seed: int = 0
) -> Belief:
    """What the operator of a case believes: its blackout, its storm, or else its bell.

    Args:
        case: the case.
        lines: that can fail, in the order of what is known of them.
        bell: believed in, whatever the case says.
        seed: of sampled futures.

    Raises:
        CaseError: the case does not say where its lines are.
        UsageError: a setting out of range.
    """
    if bell is None and case.blackout is not None:
        return BlackoutBelief(case_blackout(case), lines, seed)
    if bell is None and case.storm is not None and case.storm.points:
        from resilience.fragility.beliefs.storm_belief import StormBelief
        from resilience.fragility.chain import storm

        return StormBelief.from_storm(storm(case), lines, seed=seed)
    return BellBelief(bell or case_bell(case), case.window.slots_per_day, len(lines), seed)
