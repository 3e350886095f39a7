r"""Storms as scenarios: members of an ensemble, a common factor, capacities, failures and repair.

Of every scenario are drawn: the member of the ensemble of winds, the factor $Z$ shared by all
capacities, and for each line and each time it is new one exponential number, which decides the slot
of its failure (`failure_clock.py`), and one uniform number for the length of its repair.
All random numbers are drawn up front, in streams of their own: other crews or other poles meet the
same storms.

A storm that breaks lines is rare where lines are strong. With a `shift` $m$ the values of $Z$ are
cut into $n$ strata at the quantiles of $N(m, 1)$. Each has one scenario; its $Z$ is drawn from
$N(0, 1)$ within the stratum, and its weight is the stratum's probability under $N(0, 1)$. With $m$
below zero capacities are low more often, and estimates are unbiased whatever the number of
scenarios. How many equally likely scenarios they are worth is `effective_size`. Without a shift
scenarios are independent, and more of the same seed begin alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.fragility.lines.damage import RUNNING_MAX, Timing
from resilience.fragility.lines.spans import SpannedLines, WindAtSpans, calm, scores, span_speed
from resilience.fragility.outages.failure_clock import FailureClock
from resilience.fragility.outages.repair import Repair, repair_outcome
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import effective_number


@dataclass(frozen=True)
class Sampling:
    """How storms are drawn.

    Attributes:
        shift: where most values of the common factor lie, in standard deviations; below 0 for rare
            failures of lines whose capacities are correlated.
        refail: a line that was repaired may fail again.

    Raises:
        UsageError: a shift that is out of range.
    """

    shift: float = 0.0
    refail: bool = True

    def __post_init__(self) -> None:
        if not -6.0 <= self.shift <= 6.0:
            raise UsageError(
                f"shift {self.shift} of the common factor; allowed: -6 to 6 standard deviations",
                hint="-1 suits failures of 10 % or fewer at correlations of 0.3 or more, -2 those "
                "below 1 % at 0.6 or more; 0 suits weak correlation",
            )


PLAIN = Sampling()
USUAL_REPAIR = Repair()
TIMING = {
    "running_max": "one strength per storm",
    "rate": "failures at a rate",
    "per_slot": "strength drawn anew in every slot",
}
"""How winds add up over time, in words; see `Timing`."""


def sample_storms(
    lines: SpannedLines,
    winds: WindAtSpans | Sequence[WindAtSpans],
    n: int,
    rng: np.random.Generator | int,
    *,
    repair: Repair | None = USUAL_REPAIR,
    timing: Timing = RUNNING_MAX,
    sampling: Sampling = PLAIN,
    member_probability: ArrayLike | None = None,
) -> Scenarios:
    """`n` outage paths of lines in a storm, with weights.

    Args:
        lines: the lines.
        winds: at the spans, of the storm or of each member of an ensemble; all have the same slots.
        n: how many.
        rng: a generator, or the seed of one.
        repair: how lines are repaired; they stay down if None.
        timing: how winds add up over time, and the length of a slot.
        sampling: how storms are drawn.
        member_probability: (members,) of the winds; all alike if omitted.

    Raises:
        UsageError: no scenario, winds that do not fit each other or the lines, probabilities that
            do not fit the winds.
    """
    members = list(winds) if isinstance(winds, Sequence) else [winds]
    chance = _chances(len(members), member_probability)
    shapes = {np.shape(wind.speed_mps)[-1] for wind in members}
    if n < 1 or len(shapes) != 1:
        raise UsageError(
            f"{n} scenarios of winds of {', '.join(map(str, sorted(shapes)))} slots; allowed: 1 or "
            "more scenarios, winds of the same slots",
            hint="10,000 scenarios show a chance of 1 % to within 0.2 %",
        )
    draws = _Draws(n, len(lines.names), np.random.default_rng(rng), sampling.shift)
    member = np.searchsorted(np.cumsum(chance)[:-1], draws.member, side="right")
    storms = _Storms(lines, members, member, draws.factor, draws, timing)
    probability = draws.probability
    seed = None if isinstance(rng, np.random.Generator) else int(rng)
    courses = f"{len(members)} course{'s' * (len(members) != 1)} of winds"
    process = (
        f"storm, {courses}, correlation {lines.correlation:g}, {TIMING[timing.mode]}, "
        f"{repair}, shift {sampling.shift:g}, worth {effective_number(probability):.0f} of {n}"
    )
    down = storms.outages(repair, sampling.refail)
    return Scenarios(lines.names, down, probability, seed=seed, process=process)


def effective_size(scenarios: Scenarios) -> float:
    """How many equally likely scenarios weighted ones are worth: 1 over the sum of squares."""
    return effective_number(scenarios.probability)


def _chances(members: int, stated: ArrayLike | None) -> Floats:
    """(members,) probability of each wind, all alike where none is stated."""
    weights = np.full(members, 1.0) if stated is None else np.asarray(stated, float)
    if weights.shape != (members,) or members == 0 or not (weights >= 0).all() or not weights.sum():
        raise UsageError(
            f"{weights.size} member probabilities for {members} winds; allowed: one a wind, none "
            "negative, not all 0",
            hint="leave them out where all members are equally likely",
        )
    return weights / weights.sum()


class _Draws:
    """Random numbers of all scenarios, which without a shift do not depend on how many there are.

    Attributes:
        member: (n,) uniform numbers.
        factor: (n,) the common factor.
        probability: (n,) of each scenario.
    """

    def __init__(self, n: int, lines: int, rng: np.random.Generator, shift: float) -> None:
        self.shape = (n, lines)
        member, factor, self._next = rng.spawn(3)
        self.member: Floats = member.random(n)
        self.factor, self.probability = _factor(n, shift, factor)
        self._rounds: list[tuple[Floats, Floats]] = []

    def exponential(self, line: Ints, scenario: Ints, times: Ints) -> Floats:
        """(events,) exponential numbers of the so-many-th failure of lines."""
        return self._of_failure(0, line, scenario, times)

    def uniform(self, line: Ints, scenario: Ints, times: Ints) -> Floats:
        """(events,) uniform numbers of the so-many-th failure of lines."""
        return self._of_failure(1, line, scenario, times)

    def _of_failure(self, kind: int, line: Ints, scenario: Ints, times: Ints) -> Floats:
        while len(self._rounds) <= int(times.max(initial=0)):
            exponential, uniform = self._next.spawn(2)
            draws = exponential.standard_exponential(self.shape), uniform.random(self.shape)
            self._rounds.append(draws)
        drawn: Floats = np.empty(len(line))
        for number in np.flatnonzero(np.bincount(times)).tolist():
            events = times == number
            drawn[events] = self._rounds[number][kind][scenario[events], line[events]]
        return drawn


def _factor(n: int, shift: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """(n,) values of the common factor and their probabilities, of strata in random order."""
    if not shift:
        return rng.standard_normal(n), np.full(n, 1.0 / n)
    # Mirrored where strata would crowd at 1, where numbers are coarse.
    below = ndtr(ndtri(np.arange(n + 1) / n) - abs(shift))
    stratum = rng.permutation(n)
    low, weight = below[stratum], np.diff(below)[stratum]
    z = ndtri(np.clip(low + rng.random(n) * weight, 1e-300, 1.0 - 1e-16))
    return (z if shift < 0.0 else -z), weight


class _Storms:
    """Winds, and the scenarios that each of them befalls.

    Attributes:
        member: (scenarios,) which of the winds each one has.
        place: (scenarios,) its place among the scenarios of that wind.
        clocks: failures of the scenarios of each wind; None where it has none.
        slots: how many the winds have.
    """

    def __init__(
        self,
        lines: SpannedLines,
        winds: Sequence[WindAtSpans],
        member: Ints,
        z: Floats,
        draws: _Draws,
        timing: Timing,
    ) -> None:
        self.lines, self.winds, self.member, self.draws = lines, winds, member, draws
        self.timing, self.place = timing, np.empty(len(z), np.intp)
        self.clocks: list[FailureClock | None] = []
        for k, wind in enumerate(winds):
            scenarios = np.flatnonzero(member == k)
            self.place[scenarios] = np.arange(len(scenarios))
            score = scores(lines, span_speed(lines, wind))
            clock = FailureClock(lines, score, z[scenarios], timing) if len(scenarios) else None
            self.clocks.append(clock)
        self.slots = score.shape[1]

    def fails(self, line: Ints, scenario: Ints, times: Ints, start: int) -> Ints:
        """(events,) slot in which lines that are new at a slot fail."""
        e = self.draws.exponential(line, scenario, times)
        slots = np.empty(len(line), np.intp)
        for k, clock in enumerate(self.clocks):
            events = np.flatnonzero(self.member[scenario] == k)
            if clock is not None and len(events):
                place = self.place[scenario[events]]
                slots[events] = clock.first(line[events], place, e[events], start)
        return slots

    def outages(self, repair: Repair | None, refail: bool) -> Bools:
        """(lines, slots, scenarios) True where a line is down."""
        shape = (len(self.lines.names), len(self.member))
        line, scenario = (index.ravel() for index in np.indices(shape))
        first = self.fails(line, scenario, np.zeros(len(line), np.intp), 0).reshape(shape)
        if repair is None:
            return first[:, None, :] <= np.arange(self.slots)[:, None]

        def length(line: Ints, scenario: Ints, times: Ints) -> Ints:
            u = self.draws.uniform(line, scenario, times)
            return repair.work_slots(u, self.timing.step_h)

        calm_by_wind = np.array(
            [calm(self.lines, wind, repair.wind_limit_mps) for wind in self.winds]
        )

        def can_work(t: int) -> Bools:
            if len(self.winds) == 1:
                return calm_by_wind[0][:, t, None]
            return calm_by_wind[self.member, :, t].T

        return repair_outcome(
            first,
            length,
            can_work,
            self.slots,
            crews=repair.crews,
            order=repair.order(self.lines.names),
            again=self.fails if refail else None,
        ).down
