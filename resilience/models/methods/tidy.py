"""Among plans of one cost, one that sends little round in circles.

Without losses, reactive power costs nothing, so a linear program lets it circulate as it likes, and
the wires of the real feeder would heat. A second linear program holds everything that costs, is
remembered or has a mode, and makes the sum of `weight * |x|` of the stage's tie-breaks least. What
comes of it is certified anew, and dropped where it holds less than the plan did.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats
from resilience.models.backends.base import Solution, failures_of
from resilience.models.backends.lower import lower
from resilience.models.backends.parted import Linear, optimum
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import broken_facts, worst_violation
from resilience.models.methods.large import (
    LONG_COLUMNS,
    exceeded_discs,
    first_discs,
    is_large,
    with_discs,
)
from resilience.models.program.referee import audit
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Disc, Discs, Mode
from resilience.tolerances import RELAXATION_TOLERANCE

TRIALS: tuple[Discs, ...] = ("outer", "inner")
LONG_TRIALS: tuple[Discs, ...] = ("inner", "outer")
"""Polygons in the order of trial: where one takes long, that first which seldom has to be dropped.
"""


def with_least_circulation(program: CaseProgram, solution: Solution, seconds: float) -> Solution:
    """The same plan, tie-breaks least; as it was where that cannot be had within the ratings.

    Args:
        program: what it is a plan of.
        solution: the plan.
        seconds: that each of two trials may take.
    """
    standard = program.standard
    if not standard.tiebreak.any() or seconds <= 0.0:
        return solution
    polygons = first_discs(standard)
    for discs in LONG_TRIALS if standard.n_columns >= LONG_COLUMNS else TRIALS:
        z = _least_circulation(program, solution.point, discs, polygons, seconds)
        while z is not None and (exceeded := exceeded_discs(standard, z, polygons)):
            polygons = with_discs(polygons, exceeded)
            z = _least_circulation(program, solution.point, discs, polygons, seconds)
        if z is not None and _holds_as_much(program, z, solution.point):
            return replace(solution, z=z)
    return solution


def _holds_as_much(program: CaseProgram, z: Floats, before: Floats) -> bool:
    """Whether z breaks no more facts than the plan before, and the referee sees no difference."""
    standard, vectors = program.standard, program.vectors
    open_before = audit(standard, before, vectors).maximum
    return (
        len(broken_facts(standard, z)) <= len(broken_facts(standard, before))
        and worst_violation(standard, z, Disc) <= RELAXATION_TOLERANCE
        and audit(standard, z, vectors).maximum <= max(open_before, RELAXATION_TOLERANCE)
    )


def _fixed_columns(standard: Standard, v: Vectors) -> Bools:
    """(columns,) what costs, is remembered, has a mode, or cannot move anyway."""
    fixed: Bools = (v.cost != 0.0) | standard.integer | (v.lower >= v.upper)
    for _, after in standard.form.stage.states:
        fixed[standard.columns(after.name)] = True
    for unrolled in standard.structures_of(Mode).values():
        fixed[unrolled.columns] = True
    return fixed


@failures_of("HiGHS")
def _least_circulation(
    program: CaseProgram, z: Floats, discs: Discs, polygons: Mapping[int, Bools], seconds: float
) -> Floats | None:
    """The columns (columns,) with the least sum of weight * |x|; None if there is no point.

    Behind the free columns x of the plan stands t >= |x| for every column with a weight.
    """
    standard, vectors = program.standard, program.vectors
    lowered = lower(standard, integer="none", modes={}, discs=discs, polygons=polygons)
    v = lowered.vectors(vectors)
    fixed = _fixed_columns(standard, vectors)
    free = np.flatnonzero(~fixed)
    weighed = np.flatnonzero(standard.tiebreak[free])
    m = len(weighed)
    settled = lowered.a[:, fixed] @ z[fixed]
    a = sp.hstack([lowered.a[:, free], sp.csr_array((lowered.a.shape[0], m))], format="csr")
    equal = v.row_lower == v.row_upper
    above = np.flatnonzero(~equal & np.isfinite(v.row_upper))
    below = np.flatnonzero(~equal & np.isfinite(v.row_lower))
    x = sp.csr_array((np.ones(m), (np.arange(m), weighed)), shape=(m, len(free)))
    t = sp.eye_array(m)
    absolute = sp.block_array([[x, -t], [-x, -t]])
    answer = optimum(
        Linear(
            np.append(np.zeros(len(free)), standard.tiebreak[free][weighed]),
            sp.vstack([a[above], -a[below], absolute], format="csr"),
            np.concatenate(
                [(v.row_upper - settled)[above], (settled - v.row_lower)[below], np.zeros(2 * m)]
            ),
            a[np.flatnonzero(equal)],
            (v.row_upper - settled)[equal],
            np.append(v.lower[free], np.zeros(m)),
            np.append(v.upper[free], np.full(m, np.inf)),
        ),
        seconds,
        parted=is_large(standard),
    )
    if answer is None:
        return None
    best = z.copy()
    best[free] = np.clip(answer[: len(free)], v.lower[free], v.upper[free])
    return best
