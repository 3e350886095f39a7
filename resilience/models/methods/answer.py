"""What every method returns, and the tests that all of them apply to their own relaxations."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import Solution, Status
from resilience.models.case_program import CaseProgram
from resilience.models.program.referee import structure_violations
from resilience.models.program.standard import Standard, Vectors
from resilience.tolerances import PLAN_GAP, RELAXATION_TOLERANCE

LATE = "the time limit ended the search; this is the best plan found"


@dataclass(frozen=True)
class MethodOptions:
    """How long a method may take (s) and at which relative gap it may stop."""

    time_limit: float = 60.0
    gap: float = PLAN_GAP


@dataclass
class MethodResult:
    """A plan in numbers.

    Attributes:
        status: optimal (within the gap asked for) or feasible (the best found in time).
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
    def of(
        cls, program: CaseProgram, found: Solution, bound: float, notes: list[str]
    ) -> MethodResult:
        """The answer that is the point of `found`, tested for what it leaves relaxed.

        A bound that solver tolerances put a hair above the objective is lowered to it.
        """
        if bound - found.objective <= RELAXATION_TOLERANCE * (1.0 + abs(found.objective)):
            bound = min(bound, found.objective)
        return cls(
            status=found.status,
            z=found.point,
            objective=found.objective,
            bound=bound,
            bound_of=program.microgrid.physics,
            relaxed=remains(program.standard, found.point),
            notes=notes,
        )


@dataclass
class Deadline:
    """How much of a time limit, in seconds, is spent and left."""

    limit: float
    began: float = field(default_factory=time.perf_counter)

    @property
    def spent(self) -> float:
        """Seconds since the clock was set."""
        return time.perf_counter() - self.began

    @property
    def left(self) -> float:
        """Seconds left, never negative."""
        return max(self.limit - self.spent, 0.0)


def violated(standard: Standard, z: Floats) -> dict[int, Bools]:
    """For each split and adjacent structure, the elements (n,) that z breaks."""
    found = {}
    for k, structure in enumerate(standard.structures):
        if structure.kind in ("split", "adjacent"):
            broken = structure_violations(structure, z) > RELAXATION_TOLERANCE
            if broken.any():
                found[k] = broken
    return found


def gaps(standard: Standard, z: Floats, kind: str) -> dict[str, Floats]:
    """For each structure of a kind, by how much its elements (n,) fail to hold, scaled."""
    return {s.name: structure_violations(s, z) for s in standard.structures if s.kind == kind}


def widest(standard: Standard, z: Floats, kind: str = "cone") -> float:
    """The largest of all `gaps`; 0 without structures of that kind."""
    found = gaps(standard, z, kind).values()
    return max((float(gap.max(initial=0.0)) for gap in found), default=0.0)


def fractional(standard: Standard, z: Floats) -> Bools:
    """(columns,) integer columns whose value is none."""
    return standard.integer & (np.abs(z - np.round(z)) > RELAXATION_TOLERANCE)


def remains(standard: Standard, z: Floats) -> list[str]:
    """In words, which relaxed facts z breaks; empty if it satisfies the whole model."""
    found = []
    for k, broken in violated(standard, z).items():
        s = standard.structures[k]
        found.append(f"{s.name}: {broken.sum()} of {s.n} mode elements are in two modes at once")
    for kind, how in (("cone", "cones open"), ("disc", "ratings exceeded")):
        for name, wide in gaps(standard, z, kind).items():
            count = (wide > RELAXATION_TOLERANCE).sum()
            if count:
                found.append(f"{name}: {count} of {len(wide)} {how}, by {wide.max():.2g} at most")
    loose = fractional(standard, z)
    if loose.any():
        found.append(f"integrality: {loose.sum()} of {standard.integer.sum()} integers fractional")
    return found


def rounded(program: CaseProgram, z: Floats) -> Vectors:
    """Vectors in which every integer column is held at its value in z."""
    at = np.flatnonzero(program.standard.integer)
    return program.vectors.fixed(at, np.round(z[at]))


def sides(standard: Standard, z: Floats, elements: dict[int, Bools]) -> tuple[Ints, Floats]:
    """Columns to hold at zero so that these elements keep to the mode in which z nearly is.

    Of a split that is its larger side, of a curve the two neighbours of greatest weight.
    """
    columns = [np.empty(0, np.intp)]
    for k, chosen in elements.items():
        at = standard.structures[k].columns[:, chosen]
        weights = z[at]
        if standard.structures[k].kind == "split":
            columns.append(np.where(weights[0] >= weights[1], at[1], at[0]))
        else:
            first = np.argmax(weights[:-1] + weights[1:], axis=0)
            place = np.arange(len(at))[:, None]
            columns.append(at[(place < first) | (place > first + 1)])
    joined = np.concatenate(columns)
    return joined, np.zeros(len(joined))


def gap(objective: float, bound: float) -> float:
    """(objective - bound) / max(|objective|, 0.001 $), never negative; inf without a bound."""
    if not np.isfinite(bound) or not np.isfinite(objective):
        return np.inf
    return float(max(objective - bound, 0.0) / max(abs(objective), 1e-3))
