"""Lower bounds that hold whatever a solver's tolerances (Neumaier & Shcherbina 2004).

For any multipliers y (non-negative on <= rows) and any lambda in the second-order cone,

    min over the box  of  c'z + y'(A z - b) - sum_k lambda_k'(G_k z + g_k)

is at most the optimum. The minimum over a box is a sum of one term per column, so the bound is
evaluated, not solved; errors of the solver cost a little sharpness, never validity.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import SecondOrder


def safe_bound(
    a: sp.csr_array,
    v: Vectors,
    rows: Floats,
    slope: Floats | None = None,
    offset: float = 0.0,
) -> float:
    """The bound in $ from multipliers; those of inequalities with the wrong sign count as zero.

    Args:
        a: (rows, columns).
        v: cost, bounds and sides.
        rows: (rows,) multipliers.
        slope: (columns,) share of the cones, see `cone_share`.
        offset: likewise.
    """
    y, worth = _signed(v, rows)
    d = v.cost + a.T @ y
    if slope is not None:
        d = d - slope
    return float(v.offset + _box_minimum(d, v) - worth - offset)


def safe_cut(
    transposed: sp.csr_array, v: Vectors, rows: Floats, link: Ints
) -> tuple[float, Floats]:
    """The same bound as a function alpha + beta @ x of the values x that hold the columns `link`.

    Args:
        transposed: A', (columns, rows).
        v: cost, bounds and right-hand sides; those of `link` do not matter.
        rows: multipliers.
        link: columns that are fixed from outside.
    """
    y, worth = _signed(v, rows)
    d = v.cost + transposed @ y
    beta = d[link]
    d[link] = 0.0
    return float(v.offset + _box_minimum(d, v) - worth), beta


def _box_minimum(d: Floats, v: Vectors) -> float:
    """The minimum of d @ z over the bounds; a column without a price may have no bound."""
    with np.errstate(invalid="ignore"):
        lowest = np.minimum(d * v.lower, d * v.upper)
    return float(np.where(d == 0, 0.0, lowest).sum())


def _signed(v: Vectors, rows: Floats) -> tuple[Floats, float]:
    """Multipliers with the signs that their rows allow, and their product with the rows' sides."""
    y = np.where(np.isneginf(v.row_lower), np.maximum(rows, 0.0), rows)
    y = np.where(np.isposinf(v.row_upper), np.minimum(y, 0.0), y)
    sides = np.where(y > 0, v.row_upper, v.row_lower)
    return y, float(y[y != 0] @ sides[y != 0])


def cone_share(standard: Standard, cones: dict[int, Floats]) -> tuple[Floats, float]:
    """What multipliers (k + 1, n) per structure, moved into the cone, add to the Lagrangian.

    Returns the slope (columns,) and the offset of  sum_k lambda_k'(G_k z + g_k).
    """
    slope, offset = np.zeros(standard.n_columns), 0.0
    unrolled = standard.structures_of(SecondOrder)
    for k, multipliers in cones.items():
        matrices, consts = unrolled[k].structure.second_order(unrolled[k])
        moved = multipliers.copy()
        moved[0] = np.maximum(moved[0], np.linalg.norm(moved[1:], axis=0))
        for m, c, y in zip(matrices, consts, moved, strict=True):
            slope += m.T @ y
            offset += float(c @ y)
    return slope, offset
