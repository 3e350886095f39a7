"""Large programs: which discs get polygons, and from how many columns on it pays to be clever.

Ratings of lines hardly ever bind: of 93,504 discs of a feeder of 975 buses over 96 slots 184 are
exceeded by anybody. Where there are many, their polygons wait until they are needed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.program.standard import Standard
from resilience.models.structures import Disc
from resilience.tolerances import RELAXATION_TOLERANCE

LONG_COLUMNS = 50_000
"""Of a program: from here on a basis from its nodes is quicker than presolve."""
FEW_DISCS = 10_000
"""Of a structure: as many may have polygons that nobody needs."""


def first_polygons(standard: Standard) -> dict[int, Bools]:
    """By the index of every structure of discs, the elements (n,) with a polygon: all or none."""
    discs = standard.structures_of(Disc).items()
    return {k: np.full(unrolled.n, unrolled.n <= FEW_DISCS) for k, unrolled in discs}


def without_polygon(
    standard: Standard, z: Floats, polygons: Mapping[int, Bools]
) -> dict[int, Bools]:
    """By index, the elements (n,) that z exceeds and that have no polygon yet, where there are."""
    new = {}
    for k, unrolled in standard.structures_of(Disc).items():
        if not polygons[k].all():
            exceeded = (unrolled.violation(z) > RELAXATION_TOLERANCE) & ~polygons[k]
            if exceeded.any():
                new[k] = exceeded
    return new
