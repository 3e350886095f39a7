"""A plan whose powers stay as they are, while what costs nothing and carries nothing is put right.

The point of an interior-point method lies in the middle of all that are equally good: a storage
that nobody needs forms its island by a fifth, in two modes at once. With the mode held there is
mostly a point with the same powers, currents and stored energy, and a linear program of what
remains finds it, where the whole cone program would have to be solved again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools
from resilience.models.backends.base import NOTHING, OutOfTimeError, Solution
from resilience.models.backends.plain import Plain
from resilience.models.case_program import CaseProgram
from resilience.models.program.referee import row_violations
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Angle, SecondOrder, Structure
from resilience.tolerances import RELAXATION_TOLERANCE


def with_powers_held(
    program: CaseProgram, solution: Solution, vectors: Vectors, seconds: float
) -> Solution:
    """The same plan within other bounds, as far as nothing has to move that costs or flows.

    Args:
        program: what it is a plan of.
        solution: the plan.
        vectors: the numbers, of which bounds may be narrower than those that the plan was found in.
        seconds: that it may take.

    Returns:
        Nothing where there is no such plan.
    """
    standard, z = program.standard, solution.point
    settled = np.clip(z, vectors.lower, vectors.upper)
    free = np.flatnonzero(~weighty_columns(standard, vectors) & (vectors.lower < vectors.upper))
    moved = np.abs(settled - z) > RELAXATION_TOLERANCE * (1.0 + np.abs(z))
    moved &= weighty_columns(standard, vectors)
    if moved.any() or seconds <= 0.0:
        return NOTHING
    settled[free] = 0.0
    a = standard.a.tocsc()[:, free].tocsr()
    rows = np.flatnonzero(np.diff(a.indptr) > 0)
    offset = (standard.a @ settled)[rows]
    remaining = Vectors(
        vectors.cost[free],
        0.0,
        vectors.lower[free],
        vectors.upper[free],
        vectors.row_lower[rows] - offset,
        vectors.row_upper[rows] - offset,
    )
    try:
        answer = Plain(sp.csr_array(a[rows]), remaining).solve(seconds)
    except OutOfTimeError:
        return NOTHING
    if answer is None:
        return NOTHING
    settled[free] = np.clip(answer[0], remaining.lower, remaining.upper)
    if row_violations(standard, settled, vectors).max(initial=0.0) > RELAXATION_TOLERANCE:
        return NOTHING
    return replace(solution, z=settled, objective=float(vectors.cost @ settled + vectors.offset))


def weighty_columns(standard: Standard, vectors: Vectors) -> Bools:
    """(columns,) what costs, is remembered, or flows: stands in a disc, a cone or an angle."""
    weighty = vectors.cost != 0.0
    for _, after in standard.form.stage.states:
        weighty[standard.columns(after.name)] = True
    kinds: tuple[type[Structure], ...] = (SecondOrder, Angle)
    for kind in kinds:
        for unrolled in standard.structures_of(kind).values():
            for matrix in unrolled.matrices:
                weighty[matrix.indices] = True
    return np.asarray(weighty, bool)
