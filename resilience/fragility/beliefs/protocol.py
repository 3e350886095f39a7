"""What a belief in outages to come has to answer, whatever it believes in."""

from __future__ import annotations

from typing import Protocol

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.history import LineHistory


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
