"""Belief in units that fail, beside whatever is believed of lines; see `outages.units`.

Times to failure and to repair are exponential, so that the present status of a unit is all that
tells of its future, and the lines, which say when a generator stands by and when it is called on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import strata
from resilience.fragility.outages.main_grid import MainGrid
from resilience.fragility.outages.units import STREAM, FailingUnits
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.fragility.beliefs.protocol import Belief

CHANCE_PATHS = 100
"""Sampled futures that the chances of units are taken from."""


class UnitBelief:
    """Belief in lines, and in the units of a case.

    Args:
        of_lines: what is believed of the lines, in their order.
        case: says how its units fail.
        names: of lines and units, in the order of what is known of them.
        seed: of the sampled futures.
    """

    def __init__(self, of_lines: Belief, case: Case, names: tuple[str, ...], seed: int = 0) -> None:
        self.of_lines, self.seed, self.slots = of_lines, seed, case.slots
        is_line = np.array([case.network.has_line(name) for name in names], bool)
        self.line_rows, self.unit_rows = np.flatnonzero(is_line), np.flatnonzero(~is_line)
        self.units = FailingUnits.of_case(case, [names[k] for k in self.unit_rows])
        self.grid = MainGrid(case, [names[k] for k in self.line_rows])
        self._drawn: dict[tuple[int, int], tuple[np.random.Generator, list[Floats]]] = {}

    @property
    def daily(self) -> bool:
        """Whether every day has a hazard of its own."""
        return self.of_lines.daily

    @property
    def overnight(self) -> bool:
        """Whether outages run on past midnight."""
        return self.of_lines.overnight

    @property
    def longest_slots(self) -> int:
        """Slots of a long outage of a line."""
        return self.of_lines.longest_slots

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        """(lines and units, slots, n) where they are down after the present slot."""
        lines = history.of_lines(self.line_rows)
        down = np.zeros((history.n, slots, n), bool)
        down[self.line_rows] = of_lines = self.of_lines.paths(lines, slots, n)
        shape = (len(self.units.names), slots, n)
        is_lost = self.grid.is_lost(self.units.bus, of_lines.reshape(len(of_lines), slots * n))
        was_lost = self.grid.is_lost(self.units.bus, lines.is_down[:, None])
        wide = (len(self.units.names), n)
        hazard = self.units.hazard(is_lost.reshape(shape), np.broadcast_to(was_lost, wide))
        in_order = np.broadcast_to(~history.is_down[self.unit_rows, None], wide)

        def exponential(number: int) -> Floats:
            return self._numbers(history.number, n, number)

        down[self.unit_rows] = self.units.outages(in_order, hazard, exponential)
        return down

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """(lines and units, slots) probability that an outage begins in each slot after this one.

        Of units it is their share of sampled futures.
        """
        chances = np.zeros((history.n, slots))
        chances[self.line_rows] = self.of_lines.chances(history.of_lines(self.line_rows), slots)
        down = self.paths(history, slots, CHANCE_PATHS)[self.unit_rows]
        before = np.repeat(history.is_down[self.unit_rows, None, None], CHANCE_PATHS, axis=2)
        begins = down & ~np.concatenate([before, down[:, :-1]], axis=1)
        chances[self.unit_rows] = begins.mean(axis=2)
        return chances

    def expected_left(self, history: LineHistory) -> Ints:
        """(lines and units,) slots after this one that what is down stays so, on average."""
        remaining = np.zeros(history.n, np.intp)
        remaining[self.line_rows] = self.of_lines.expected_left(history.of_lines(self.line_rows))
        mean = np.minimum(np.ceil(self.units.mean_left - SLOT_TOLERANCE), self.slots)
        is_down = history.is_down[self.unit_rows]
        remaining[self.unit_rows] = np.where(is_down, mean, 0).astype(np.intp)
        return remaining

    def _numbers(self, episode: int, n: int, number: int) -> Floats:
        """(units, n) exponential numbers of the k-th change; those of the first are stratified."""
        if (episode, n) not in self._drawn:
            rng = np.random.default_rng([self.seed, STREAM, n, episode])
            self._drawn[episode, n] = rng, []
        rng, drawn = self._drawn[episode, n]
        while len(drawn) <= number:
            uniform = [strata(n, rng) if len(drawn) < 2 else rng.random(n) for _ in self.unit_rows]
            drawn.append(-np.log1p(-np.array(uniform)))
        return drawn[number]
