"""What every method returns, and the tests that all of them apply to their own relaxations."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import check_range
from resilience.models.backends.base import Solution, Status
from resilience.models.case_program import CaseProgram
from resilience.models.program import gate
from resilience.models.program.referee import tightened
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Angle, Cone, Disc, Mode, Structure
from resilience.tolerances import PLAN_GAP, RELAXATION_TOLERANCE

OUT_OF_TIME = "the time limit ended the search; this is the best plan found"
OUT_OF_ROUNDS = "the search ended after as many rounds as it may take; this is the best plan found"
NOTHING_NEW = "the search found nothing more to try; this is the best plan found"
GRACE_S = 1.0  # beyond the time limit, for a method that has nothing to show yet


@dataclass(frozen=True)
class MethodOptions:
    """How long a method may take and when it may stop.

    Attributes:
        time_limit: seconds.
        gap: relative gap at which it may stop.
        clock: seconds that have passed since some moment; for tests.

    Raises:
        UsageError: a gap or a limit out of range.
    """

    time_limit: float = 60.0
    gap: float = PLAN_GAP
    clock: Callable[[], float] = time.perf_counter

    def __post_init__(self) -> None:
        check_range("relative gap", self.gap, 0.0, 1.0, hint="0.001 is a tenth of a percent")
        check_range("time limit", self.time_limit, 0.0, math.inf, hint="seconds")

    def deadline(self) -> Deadline:
        """The time limit, from now on."""
        return Deadline(self.time_limit, self.clock)


@dataclass
class MethodResult:
    """A plan in numbers.

    Attributes:
        status: optimal (within the gap wanted) or feasible (the best in time).
        z: (columns,) values.
        objective: $ at z.
        bound: proven lower bound in $, -inf where none.
        bound_of: for which model the bound is valid.
        relaxed: facts of the model that z need not satisfy, in words; empty if it satisfies all.
        notes: what else the reader should know.
    """

    status: Status
    z: Floats
    objective: float
    bound: float
    bound_of: str
    relaxed: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def from_solution(
        cls,
        program: CaseProgram,
        solution: Solution,
        bound: float,
        wanted_gap: float,
        reason: str,
        notes: Sequence[str] = (),
    ) -> MethodResult:
        """The point of a solution, tested for what it leaves relaxed, its status from its gap.

        Args:
            program: what it is a point of.
            solution: with a point; what the solver calls it does not matter.
            bound: proven, $.
            wanted_gap: up to which it is optimal.
            reason: why its gap is larger, if it is.
            notes: what else the reader should know.

        Raises:
            CertificateError: the bound lies above the objective by more than rounding.
        """
        reached = gate.gap(solution.objective, bound, gate.cost_scale(program.vectors))
        status = gate.status_of(reached, wanted_gap)
        return cls(
            status=status,
            z=solution.point,
            objective=solution.objective,
            bound=bound,
            bound_of=program.microgrid.physics,
            relaxed=broken_facts(program.standard, solution.point),
            notes=[*notes, *([] if status == "optimal" else [reason])],
        )


@dataclass
class Deadline:
    """How much of a time limit, in seconds, is spent and remains.

    Attributes:
        limit_s: the limit, s.
        clock: what it reads, s.
        began: reading of the clock when it was set, s.
    """

    limit_s: float
    clock: Callable[[], float] = time.perf_counter
    began: float = field(default=np.nan)

    def __post_init__(self) -> None:
        if np.isnan(self.began):
            self.began = self.clock()

    @property
    def spent_s(self) -> float:
        """Seconds since it was set."""
        return self.clock() - self.began

    @property
    def remaining_s(self) -> float:
        """Seconds that remain, never negative: for whatever improves an answer."""
        return max(self.limit_s - self.spent_s, 0.0)

    @property
    def final_s(self) -> float:
        """Seconds to the hard stop, a grace later: for what a method cannot do without."""
        return max(self.limit_s + GRACE_S - self.spent_s, 0.0)

    @property
    def late(self) -> bool:
        """Whether nothing remains."""
        return self.remaining_s <= 0


def broken_modes(standard: Standard, z: Floats) -> dict[int, Bools]:
    """For the index of each structure with modes, the elements (n,) that z breaks, if any."""
    broken, z = {}, tightened(standard, z)
    for k, unrolled in standard.structures_of(Mode).items():
        elements = unrolled.violation(z) > RELAXATION_TOLERANCE
        if elements.any():
            broken[k] = elements
    return broken


def worst_violation(standard: Standard, z: Floats, kind: type[Structure] = Cone) -> float:
    """The largest scaled violation of all structures of a class; 0 without any."""
    unrolled = standard.structures_of(kind).values()
    return max((float(s.violation(z).max(initial=0.0)) for s in unrolled), default=0.0)


def is_off_ac(standard: Standard, z: Floats) -> bool:
    """Whether a cone or an angle is open."""
    widest = max(worst_violation(standard, z, kind) for kind in (Cone, Angle))
    return widest > RELAXATION_TOLERANCE


def fractional(standard: Standard, z: Floats) -> Bools:
    """(columns,) integer columns whose value is none."""
    return standard.integer & (np.abs(z - np.round(z)) > RELAXATION_TOLERANCE)


def broken_facts(standard: Standard, z: Floats) -> list[str]:
    """In words, which relaxed facts z breaks; empty if it satisfies the whole model."""
    facts, z = [], tightened(standard, z)
    for kind in (Mode, Cone, Angle, Disc):
        for unrolled in standard.structures_of(kind).values():
            facts.append(unrolled.structure.shortfall(unrolled.violation(z), RELAXATION_TOLERANCE))
    loose = fractional(standard, z)
    if loose.any():
        off = np.abs(z - np.round(z))[loose].max()
        facts.append(
            f"integrality: {loose.sum()} of {standard.integer.sum()} integers fractional, "
            f"by {off:.2g} at most"
        )
    return [fact for fact in facts if fact]


def with_integers_held(program: CaseProgram, z: Floats) -> Vectors:
    """Vectors in which every integer column is held at its value in z."""
    columns = np.flatnonzero(program.standard.integer)
    return program.vectors.fixed(columns, np.round(z[columns]))


def idle_columns(
    standard: Standard, z: Floats, elements: Mapping[int, Bools]
) -> tuple[Ints, Floats]:
    """Columns to hold, and zeros, so that elements keep to the mode in which z nearly is.

    Args:
        standard: the program.
        z: (columns,) values.
        elements: for the index of each structure with modes, which elements (n,) are meant.
    """
    modes, z = standard.structures_of(Mode), tightened(standard, z)
    columns = [np.empty(0, np.intp)]
    for k, chosen in elements.items():
        places = modes[k].columns[:, chosen]
        columns.append(modes[k].structure.idle_columns(places, z[places]))
    joined = np.concatenate(columns)
    return joined, np.zeros(len(joined))
