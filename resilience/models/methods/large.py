"""Large programs: which discs are held, and from how many columns on it pays to be clever.

Ratings of lines hardly ever bind: of 93,504 discs of a feeder of 975 buses over 96 slots 184 are
exceeded by anybody. Where there are many, they wait until a point exceeds them, and every point is
measured against all. Of a feeder that is loaded to its limits many are exceeded at once: there all
of them are held.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.program.referee import auxiliary_columns
from resilience.models.program.standard import Standard
from resilience.models.structures import Disc
from resilience.tolerances import RELAXATION_TOLERANCE

LONG_COLUMNS = 50_000
"""Of a program: from here on a basis from its nodes is quicker than presolve."""
FEW_DISCS = 2_000
"""Of a structure: as many may be held that nobody needs. The polygons of twice 2,736 that nothing
exceeds take two thirds of a linear program's time on 115 buses and 24 slots.
"""
EXCEEDED_SHARE = 0.02
"""Of the discs of a structure: where a point exceeds as many, the next one would exceed others."""


def is_large(standard: Standard) -> bool:
    """Whether a basis from nodes, or from a program before, is quicker than presolve."""
    discs = standard.structures_of(Disc).values()
    return standard.n_columns >= LONG_COLUMNS or any(u.n > FEW_DISCS for u in discs)


def first_discs(standard: Standard) -> dict[int, Bools]:
    """By the index of every structure of discs, the elements (n,) held at first: all or none."""
    discs = standard.structures_of(Disc).items()
    return {k: np.full(unrolled.n, unrolled.n <= FEW_DISCS) for k, unrolled in discs}


def first_bounds(standard: Standard) -> Bools:
    """(columns,) whose bounds are held at first: of many, not those that are there for solvers."""
    boxed = np.ones(standard.n_columns, bool)
    if standard.n_columns >= LONG_COLUMNS:
        for _, columns in auxiliary_columns(standard):
            boxed[columns] = False
    return boxed


def is_loaded(standard: Standard, discs: Mapping[int, Bools]) -> bool:
    """Whether so many ratings bind that all of a large structure are held."""
    structures = standard.structures_of(Disc).items()
    return any(u.n > FEW_DISCS and bool(discs[k].all()) for k, u in structures)


def exceeded_discs(standard: Standard, z: Floats, discs: Mapping[int, Bools]) -> dict[int, Bools]:
    """By index, the elements (n,) to hold from now on, where there are any.

    They are those that z exceeds, or all where those are many.
    """
    new = {}
    for k, unrolled in standard.structures_of(Disc).items():
        if not discs[k].all():
            exceeded = (unrolled.violation(z) > RELAXATION_TOLERANCE) & ~discs[k]
            if exceeded.any():
                new[k] = exceeded | (exceeded.mean() > EXCEEDED_SHARE)
    return new


def with_discs(discs: Mapping[int, Bools], new: Mapping[int, Bools]) -> dict[int, Bools]:
    """Those that are held, and new ones."""
    return {k: elements | new.get(k, False) for k, elements in discs.items()}
