"""Where to begin, and what to fall back on: a topology without search, and any point at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resilience.arrays import Bools, Ints
from resilience.models.backends.base import Solution, Status
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Lowered
from resilience.models.case_program import CaseProgram
from resilience.models.program.standard import Vectors

LEAST = 5.0  # s that a method takes when time is up and it has nothing to show
FIRST = 0.2  # relative gap at which that search stops


def switches(program: CaseProgram) -> bool:
    """Whether the problem has lines whose status it may choose."""
    return program.standard.has("line.closed")


def any_point(program: CaseProgram, lowered: Lowered) -> Solution:
    """A point that holds what is lowered, found soon rather than good; no bound.

    Its status is infeasible where that is proven, which a held topology never can.
    """
    solver = Highs(lowered, time_limit=LEAST, gap=FIRST)
    solver.update(mended(program) if switches(program) else program.vectors)
    found = solver.solve()
    if found.status == "infeasible" and not switches(program):
        return found
    status: Status = "none" if found.z is None else "feasible"
    return replace(found, status=status, bound=-np.inf)


def mended(program: CaseProgram) -> Vectors:
    """Vectors in which every switch is held: closed as at the start, and where that leaves buses
    without a source, one open line after the other is closed until they have one.
    """
    network, situation = program.microgrid.network, program.situation
    switched = np.flatnonzero(network.switchable)
    kept = np.ones(len(network.switchable), bool)
    kept[switched] = program.x0["line.closed"] > 0.5
    rank = np.argsort(1 * network.switchable + ~kept, kind="stable")
    ends = np.stack([network.from_bus, network.to_bus], axis=1)
    patterns, at = np.unique(situation.line_up, axis=1, return_inverse=True)
    status = [_forest(ends, rank[up[rank]], kept, situation.forming)[switched] for up in patterns.T]
    values = np.array(status).T[:, at.ravel()] * situation.alive[network.from_bus[switched]]
    columns = program.standard.columns("line.closed")
    return program.vectors.fixed(columns.ravel(), values.ravel())


def _forest(ends: Ints, order: Ints, kept: Bools, forming: Bools) -> Bools:
    """(lines,) a forest over the lines in `order`: those `kept` where they close no cycle, others
    only where they join to a source what has none.
    """
    group, sourced = np.arange(len(forming)), forming.copy()
    closed = np.zeros(len(ends), bool)
    for line in order:
        one, other = group[ends[line]]
        if one == other or not (kept[line] or not (sourced[one] and sourced[other])):
            continue
        closed[line] = True
        sourced[one] |= sourced[other]
        group[group == other] = one
    return closed
