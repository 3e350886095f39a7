"""Where to begin, and what to fall back on: a topology without search, and any point at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resilience.arrays import Bools, Ints
from resilience.models.backends.base import NOTHING, Solution, Status
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Lowered
from resilience.models.case_program import CaseProgram
from resilience.models.program.standard import Vectors

FALLBACK_GAP = 0.2  # relative gap at which a search for any point stops


def has_switches(program: CaseProgram) -> bool:
    """Whether the problem has lines whose status it may choose."""
    return program.standard.has("line.closed")


def any_point(
    program: CaseProgram, lowered: Lowered, seconds: float, switched: Vectors | None = None
) -> Solution:
    """A point that holds what is lowered, found soon rather than good; no bound.

    Its status is infeasible where that is proven, which a held topology never can.

    Args:
        program: what it is to be a point of.
        lowered: what it has to hold.
        seconds: that the search may take; without any it is not begun.
        switched: vectors with a topology held; that of the start if omitted.
    """
    if seconds <= 0.0:
        return NOTHING
    solver = Highs(lowered, time_limit=seconds, gap=FALLBACK_GAP)
    if switched is None:
        switched = with_switches_held(program) if has_switches(program) else program.vectors
    solver.update(switched)
    solution = solver.solve()
    if solution.status == "infeasible" and not has_switches(program):
        return solution
    status: Status = "none" if solution.z is None else "feasible"
    return replace(solution, status=status, bound=-np.inf)


def with_switches_held(program: CaseProgram) -> Vectors:
    """Vectors in which every switch is held: closed as at the start, and where that leaves buses
    without a source, one open line after the other is closed until they have one.
    """
    network, situation = program.microgrid.network, program.situation
    switched = np.flatnonzero(network.switchable)
    closed = np.ones(len(network.switchable), bool)
    closed[switched] = program.x0["line.closed"] > 0.5
    # Fixed lines first, then switches that are closed, last those that are open.
    order = np.lexsort((~closed, network.switchable))
    ends = np.stack([network.from_bus, network.to_bus], axis=1)
    patterns, pattern = np.unique(situation.line_up, axis=1, return_inverse=True)
    separate = program.microgrid.separate_grids
    status = [
        spanning_forest(ends, order[up[order]], closed, situation.forming, separate)[switched]
        for up in patterns.T
    ]
    alive = situation.alive[network.from_bus[switched]]
    values = np.array(status).T[:, pattern.ravel()] * alive
    if not network.radial:  # what is closed stays so, loop or not
        values = np.maximum(values, closed[switched, None] * situation.line_up[switched] * alive)
    columns = program.standard.columns("line.closed")
    return program.vectors.fixed(columns.ravel(), values.ravel())


def spanning_forest(
    ends: Ints, order: Ints, closed: Bools, forming: Bools, separate: Bools
) -> Bools:
    """(lines,) a forest over the lines in `order`.

    Those that are `closed` join it where they close no cycle, others only where they join to a
    source what has none. No two buses that are `separate` come into one tree.
    """
    group, sourced, has_separate = np.arange(len(forming)), forming.copy(), separate.copy()
    forest = np.zeros(len(ends), bool)
    for line in order:
        near, far = group[ends[line]]
        needed = closed[line] or not (sourced[near] and sourced[far])
        if near == far or not needed or (has_separate[near] and has_separate[far]):
            continue
        forest[line] = True
        sourced[near] |= sourced[far]
        has_separate[near] |= has_separate[far]
        group[group == far] = near
    return forest
