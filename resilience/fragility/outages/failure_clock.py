r"""When a line fails next, given the storm's common factor and one random number.

Given $Z$, a line's chance to stand until slot $t$ is $e^{-\Lambda(t \mid Z)}$, the product over all
of its poles, so one exponential number $E$ decides for them all: the line fails in the first slot
with $\Lambda(t \mid Z) \ge E$. $\ln \Lambda$ is smooth in $Z$; it is tabulated and interpolated
with six points, to within 1e-5 of $\Lambda$, far below what any number of draws could show. Few
scenarios are evaluated directly, and so are repaired lines, which are as new: in mode
`running_max` their maximum starts again.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from resilience.arrays import Bools, Floats, Ints
from resilience.fragility.lines.damage import Timing, accumulated
from resilience.fragility.lines.spans import SpannedLines, worst_score

# The error is of the order of the step to the number of points. Over correlations of 0.05 to 0.99
# and scores of -5 to 2, six points at steps of 0.4 leave 5e-6 of the hazard. Four leave 7e-5, or
# need half the step, and so a table twice as large; six at steps of 0.8 leave 2e-4.
POINTS = 6
NODE_STEP = 0.4
MIN_TABLE_SCENARIOS = 100  # a table for fewer costs more than it saves
MIN_LOG_HAZARD, MAX_LOG_HAZARD = -80.0, 80.0  # e^-80 never happens, e^80 always does


class FailureClock:
    """Failures of lines in one storm; `slots` stands for never.

    Args:
        lines: the lines.
        score: (elements, slots) see `lines.scores`.
        z: (scenarios,) the common factor.
        timing: how slots add up.

    Attributes:
        nodes: (nodes,) values of Z at which the log of the hazard is tabulated.
        base: (scenarios,) first of the six nodes between which a scenario's Z is interpolated.
        weight: (6, scenarios) of the values at these.
    """

    def __init__(self, lines: SpannedLines, score: Floats, z: Floats, timing: Timing) -> None:
        self.lines, self.score, self.timing, self.z = lines, score, timing, z
        self.slots = score.shape[1]
        # At correlation 0 nothing depends on Z.
        factor = z if lines.correlation else np.zeros_like(z)
        self.nodes, step = _nodes_around(factor, lines.correlation)
        place = (factor - self.nodes[0]) / step
        self.base = np.floor(place).astype(np.intp) - (POINTS // 2 - 1)
        self.weight = _lagrange(place - self.base)

    def first(self, line: Ints, scenario: Ints, e: Floats, start: int) -> Ints:
        """(events,) slot in which lines that are new at slot `start` fail.

        Args:
            line: (events,) which line.
            scenario: (events,) in which scenario.
            e: (events,) exponential random numbers of mean 1.
            start: first slot in which the lines can fail.
        """
        slots = np.full(len(line), self.slots)
        if start >= self.slots:
            return slots
        if self.lines.correlation == 1.0:
            return self._comonotone(line, scenario, start)
        many = len(self.z) >= MIN_TABLE_SCENARIOS
        if start == 0 and (many or self.timing.mode != "running_max"):
            return self._search(line, scenario, np.log(e))
        if self.timing.mode != "running_max":
            spent = self._reader(line, scenario)(start - 1)
            return np.maximum(self._search(line, scenario, np.log(e + np.exp(spent))), start)
        may = np.flatnonzero(self._upper_hazard(line, scenario, start) >= e)
        for k in np.unique(line[may]).tolist():
            events = may[line[may] == k]
            slots[events] = self._restarted(k, self.z[scenario[events]], e[events], start)
        return slots

    @cached_property
    def cumulative(self) -> Floats:
        """(lines, slots, nodes) log of the hazard up to and with a slot."""
        return self._log(accumulated(self.lines, self._audible, self.nodes, self.timing))

    @cached_property
    def _worst(self) -> Floats:
        """(lines, slots) highest score of any element of a line, from a slot on."""
        score = worst_score(self.lines, self.score)
        return np.maximum.accumulate(score[:, ::-1], axis=1)[:, ::-1]

    def _upper_hazard(self, line: Ints, scenario: Ints, start: int) -> Floats:
        """(events,) no less than the hazard from a slot on: as if all elements met the highest
        score of any. Most events are below it and need no table of their own.
        """
        rho, count = self.lines.correlation, self.lines.incidence.sum(axis=1)
        away = np.sqrt(rho) * self.z[scenario] - self._worst[line, start]
        return -count[line] * log_ndtr(away / np.sqrt(1.0 - rho))

    @cached_property
    def _audible(self) -> Floats:
        """Scores; -inf where an element fails with less than 1e-15 in every storm drawn."""
        rho = self.lines.correlation
        lowest = np.sqrt(rho) * self.nodes[0] - 8.0 * np.sqrt(1.0 - rho)
        return np.where(self.score < lowest, -np.inf, self.score)

    @staticmethod
    def _log(hazard: Floats) -> Floats:
        """Log of a hazard, within bounds that still mean never and always."""
        with np.errstate(divide="ignore"):
            return np.clip(np.log(hazard), MIN_LOG_HAZARD, MAX_LOG_HAZARD)

    def _reader(self, line: Ints, scenario: Ints) -> Callable[[Ints | int], Floats]:
        """A function of slots: (events,) log of the hazard up to and with a slot, interpolated."""
        flat, nodes = self.cumulative.ravel(), self.cumulative.shape[-1]
        first = line * (self.slots * nodes) + self.base[scenario]
        weight = self.weight[:, scenario]

        def read(slot: Ints | int) -> Floats:
            place = first + slot * nodes
            log_hazard: Floats = flat.take(place) * weight[0]
            for k in range(1, POINTS):
                log_hazard += flat.take(place + k) * weight[k]
            return log_hazard

        return read

    def _search(self, line: Ints, scenario: Ints, log_e: Floats) -> Ints:
        """(events,) first slot in which the cumulative hazard reaches e, by bisection."""
        slots = np.full(len(line), self.slots)
        hit = np.flatnonzero(self._reader(line, scenario)(self.slots - 1) >= log_e)
        read, goal = self._reader(line[hit], scenario[hit]), log_e[hit]
        slots[hit] = first_true(lambda slot: read(slot) >= goal, len(hit), self.slots - 1)
        return slots

    def _restarted(self, line: int, z: Floats, e: Floats, start: int) -> Ints:
        """(events,) slot in which a line that is new at slot `start` fails, without a table."""
        on_line = self.lines.element_line == line
        peak = np.maximum.accumulate(self.score[on_line, start:], axis=1)
        count = self.lines.incidence[[line]].toarray()[0, on_line]
        rho = self.lines.correlation

        def reached(slot: Ints) -> Bools:
            stand = log_ndtr((np.sqrt(rho) * z - peak[:, slot]) / np.sqrt(1.0 - rho))
            return -(count @ stand) >= e

        return start + first_true(reached, len(z), peak.shape[1])

    def _comonotone(self, line: Ints, scenario: Ints, start: int) -> Ints:
        """(events,) at correlation 1, the first slot whose worst score reaches Z."""
        reached = worst_score(self.lines, self.score)[line, start:] >= self.z[scenario, None]
        return np.where(reached.any(axis=1), start + reached.argmax(axis=1), self.slots)


def first_true(test: Callable[[Ints], Bools], events: int, end: int) -> Ints:
    """(events,) first slot before `end` that passes a test, as all later ones do; else `end`."""
    low, high = np.zeros(events, np.intp), np.full(events, end)
    while (low < high).any():
        middle = (low + high) // 2
        passed = (low < high) & test(np.minimum(middle, end - 1))
        low, high = (
            np.where(passed | (low >= high), low, middle + 1),
            np.where(passed, middle, high),
        )
    return low


def _nodes_around(z: Floats, correlation: float) -> tuple[Floats, float]:
    """Nodes that hold all of z with room for six points around each, and their distance."""
    # An element's conditional score is kappa Z plus a constant, and ln of the hazard bends where
    # that moves by about 1: nodes lie closer where kappa is above 1.
    kappa = float(np.sqrt(correlation / (1.0 - correlation))) if correlation < 1.0 else 0.0
    step = NODE_STEP / max(kappa, 1.0)
    low, high = float(z.min()), float(z.max())
    count = int(np.ceil((high - low) / step)) + POINTS
    return low + step * (np.arange(count, dtype=float) - (POINTS // 2 - 1)), step


def _lagrange(x: Floats) -> Floats:
    """(6, events) weights of the values at 0 to 5, for places x between 2 and 3."""
    nodes = np.arange(POINTS, dtype=float)
    away = x - nodes[:, None]
    weights: Floats = np.ones((POINTS, len(x)))
    for k in range(POINTS):
        for j in range(POINTS):
            if j != k:
                weights[k] *= away[j] / (nodes[k] - nodes[j])
    return weights
