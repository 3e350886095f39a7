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
    row_lower: Floats,
    row_upper: Floats,
    rows: Floats,
    slope: Floats | None = None,
    offset: float = 0.0,
) -> float:
    """The bound in $ from multipliers `rows`; `slope` and `offset` add the cones' share.

    Multipliers of inequality rows with the wrong sign are set to zero.
    """
    y, worth = _signed(row_lower, row_upper, rows)
    d = v.cost + a.T @ y
    if slope is not None:
        d = d - slope
    with np.errstate(invalid="ignore"):
        least = np.minimum(d * v.lower, d * v.upper)
    return float(v.offset + np.where(d == 0, 0.0, least).sum() - worth - offset)


def safe_cut(
    transposed: sp.csr_array, v: Vectors, rows: Floats, link: Ints
) -> tuple[float, Floats]:
    """The same bound as a function alpha + beta @ x of the values x that hold the columns `link`.

    Args:
        transposed: A', (columns, rows).
        v: cost, bounds and right-hand sides; those of `link` do not matter.
        rows: multipliers.
        link: columns that stand for what is given from outside.
    """
    y, worth = _signed(v.row_lower, v.row_upper, rows)
    d = v.cost + transposed @ y
    beta = d[link]
    d[link] = 0.0
    with np.errstate(invalid="ignore"):
        least = np.minimum(d * v.lower, d * v.upper)
    return float(v.offset + np.where(d == 0, 0.0, least).sum() - worth), beta


def _signed(row_lower: Floats, row_upper: Floats, rows: Floats) -> tuple[Floats, float]:
    """Multipliers with the signs that their rows allow, and their product with the rows' sides."""
    y = np.where(np.isneginf(row_lower), np.maximum(rows, 0.0), rows)
    y = np.where(np.isposinf(row_upper), np.minimum(y, 0.0), y)
    sides = np.where(y > 0, row_upper, row_lower)
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
