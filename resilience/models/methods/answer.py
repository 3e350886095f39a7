"""What every method returns, and the tests that all of them apply to their own relaxations."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from resilience.errors import InfeasibleError, SolverError
from resilience.models.algebra import Floats, Ints
from resilience.models.backends.base import Status
from resilience.models.referee import structure_violations
from resilience.models.standard import Standard

CLOSED = 1e-6  # scaled violation below which a relaxed structure counts as holding
Bools = np.ndarray


@dataclass(frozen=True)
class Options:
    """How long a method may take (s) and at which relative gap it may stop."""

    time_limit: float = 60.0
    gap: float = 1e-3


@dataclass
class Answer:
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


@dataclass
class Clock:
    """Seconds left, and seconds spent per phase."""

    limit: float
    began: float = field(default_factory=time.perf_counter)

    @property
    def left(self) -> float:
        """Seconds left, never negative."""
        return max(self.limit - (time.perf_counter() - self.began), 0.0)


def violated(problem: Standard, z: Floats) -> dict[int, Bools]:
    """For each split and adjacent structure, the elements (n,) that z breaks."""
    found = {}
    for k, structure in enumerate(problem.structures):
        if structure.kind in ("split", "adjacent"):
            broken = structure_violations(structure, z) > CLOSED
            if broken.any():
                found[k] = broken
    return found


def open_cones(problem: Standard, z: Floats) -> dict[str, Floats]:
    """For each cone, how far open its elements (n,) are, scaled."""
    return {s.name: structure_violations(s, z) for s in problem.structures if s.kind == "cone"}


def fractional(problem: Standard, z: Floats) -> Bools:
    """(columns,) integer columns whose value is none."""
    found: Bools = problem.integer & (np.abs(z - np.round(z)) > CLOSED)
    return found


def remains(problem: Standard, z: Floats) -> list[str]:
    """In words, which relaxed facts z breaks; empty if it satisfies the whole model."""
    found = []
    for k, broken in violated(problem, z).items():
        s = problem.structures[k]
        found.append(f"{s.name}: {broken.sum()} of {s.n} mode elements are in two modes at once")
    for name, gaps in open_cones(problem, z).items():
        wide = gaps > CLOSED
        if wide.any():
            found.append(
                f"{name}: {wide.sum()} of {len(gaps)} cones open, the widest by {gaps.max():.2g}"
            )
    loose = fractional(problem, z)
    if loose.any():
        found.append(f"integrality: {loose.sum()} of {problem.integer.sum()} integers fractional")
    return found


def sides(problem: Standard, z: Floats, broken: dict[int, Bools]) -> tuple[Ints, Floats]:
    """Columns to fix at zero so that every broken split keeps to its larger side."""
    columns = []
    for k, elements in broken.items():
        structure = problem.structures[k]
        if structure.kind == "split":
            pos, neg = structure.columns[:, elements]
            columns.append(np.where(z[pos] >= z[neg], neg, pos))
    joined = np.concatenate(columns) if columns else np.empty(0, np.intp)
    return joined, np.zeros(len(joined))


def infeasible(names: list[str], what: str) -> InfeasibleError:
    """The error that names what is in conflict."""
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    if not names:
        shown = "no small set of rows could be named"
    return InfeasibleError(
        f"no plan satisfies {what}; in conflict: {shown}",
        hint="make PV curtailable, widen the voltage band, or free a limit of the devices named",
    )


def nothing_found(what: str, limit: float) -> SolverError:
    """The error when time ran out without any plan."""
    return SolverError(
        f"{what} found no plan within {limit:g} s", hint="raise --time-limit or use --method lp"
    )


def gap(objective: float, bound: float) -> float:
    """(objective - bound) / |objective|, never negative; inf without a bound."""
    if not np.isfinite(bound):
        return np.inf
    return float(max(objective - bound, 0.0) / max(abs(objective), 1e-9))
