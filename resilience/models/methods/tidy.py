"""Among plans of one cost, one that sends little round in circles.

Without losses, reactive power costs nothing, so a linear program lets it circulate as it likes, and
the wires of the real feeder would heat. A second linear program holds everything that costs or is
remembered, and makes the sum of `weight * |x|` of the stage's tie-breaks least.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.optimize import linprog

from resilience.arrays import Bools, Floats
from resilience.models.backends.base import Solution
from resilience.models.backends.lower import Discs, lower
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import widest
from resilience.models.program.standard import Standard, Vectors
from resilience.tolerances import RELAXATION_TOLERANCE

WAYS: tuple[Discs, ...] = ("outer", "inner")


def tidied(program: CaseProgram, found: Solution) -> Solution:
    """The same plan, tie-breaks least; as it was where that cannot be had within the ratings."""
    standard = program.standard
    if not standard.tiebreak.any():
        return found
    for discs in WAYS:
        z = _least(standard, program.vectors, found.point, discs)
        if z is not None and widest(standard, z, "disc") <= RELAXATION_TOLERANCE:
            return replace(found, z=z)
    return found


def _held(standard: Standard, v: Vectors) -> Bools:
    """(columns,) what costs, is remembered, or cannot move anyway."""
    hold: Bools = (v.cost != 0.0) | standard.integer | (v.lower >= v.upper)
    for _, after in standard.forms[0].stage.states:
        hold[standard.columns(after.name)] = True
    return hold


def _least(standard: Standard, vectors: Vectors, z: Floats, discs: Discs) -> Floats | None:
    lowered = lower(standard, integer=standard.integer & False, exact={}, discs=discs)
    v = lowered.vectors(vectors)
    hold = _held(standard, vectors)
    free = np.flatnonzero(~hold)
    weighed = np.flatnonzero(standard.tiebreak[free])
    m = len(weighed)
    known = lowered.a[:, hold] @ z[hold]
    a = sp.hstack([lowered.a[:, free], sp.csr_array((lowered.a.shape[0], m))], format="csr")
    equal = v.row_lower == v.row_upper
    upper = np.flatnonzero(~equal & np.isfinite(v.row_upper))
    lower_ = np.flatnonzero(~equal & np.isfinite(v.row_lower))
    pick = sp.csr_array((np.ones(m), (np.arange(m), weighed)), shape=(m, len(free)))
    size = sp.eye_array(m)
    around = sp.block_array([[pick, -size], [-pick, -size]])
    answer = linprog(
        np.append(np.zeros(len(free)), standard.tiebreak[free][weighed]),
        A_ub=sp.vstack([a[upper], -a[lower_], around], format="csr"),
        b_ub=np.concatenate(
            [(v.row_upper - known)[upper], (known - v.row_lower)[lower_], np.zeros(2 * m)]
        ),
        A_eq=a[np.flatnonzero(equal)],
        b_eq=(v.row_upper - known)[equal],
        bounds=np.column_stack(
            [np.append(v.lower[free], np.zeros(m)), np.append(v.upper[free], np.full(m, np.inf))]
        ),
        method="highs",
    )
    if answer.x is None:
        return None
    best = z.copy()
    best[free] = np.clip(answer.x[: len(free)], v.lower[free], v.upper[free])
    return best
