"""Rewrites structures as rows and binaries, for solvers that know nothing else.

Each class says how (`resilience.models.structures`): modes get binaries where they are wanted, a
disc becomes a polygon around it (a relaxation) or within it (a restriction), a cone is left out (a
relaxation; rows that touch it can be added with `tangents`), and a maximum is left to its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.base import refuse_unknown
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import (
    Adjacent,
    Angle,
    Cone,
    Disc,
    Discs,
    Largest,
    Mode,
    Split,
    Structure,
    UnrolledStructure,
)
from resilience.models.structures.base import BinaryRows
from resilience.models.structures.disc import APOTHEM

Integers = Literal["all", "none"]


@dataclass(frozen=True)
class Lowered:
    """A mixed-integer linear program whose first columns are those of the program lowered.

    Rows behind the program's own, and binaries behind its columns, have constant bounds.

    Attributes:
        standard: what was lowered.
        a: (rows, columns) of all rows and columns.
        integer: (columns,) which are held integer.
        rhs: (added rows,) right-hand sides; of a polygon its radius.
        equality: (added rows,) whether they are equations.
        disc_rows: which of the added rows are sides of polygons.
        disc_shift: (sides,) share of the constants in what a side bounds.
        discs: whether polygons lie within their discs or around them.
    """

    standard: Standard
    a: sp.csr_array
    integer: Bools
    rhs: Floats
    equality: Bools
    disc_rows: Ints
    disc_shift: Floats
    discs: Discs = "inner"

    def vectors(self, vectors: Vectors) -> Vectors:
        """The program's vectors with those of the added rows and columns behind them."""
        extra = self.a.shape[1] - len(vectors.cost)
        rhs, low = self.rhs.copy(), np.where(self.equality, self.rhs, -np.inf)
        apothem = self.rhs[self.disc_rows] * (APOTHEM if self.discs == "inner" else 1.0)
        low[self.disc_rows] = -apothem - self.disc_shift
        rhs[self.disc_rows] = apothem - self.disc_shift
        return Vectors(
            np.append(vectors.cost, np.zeros(extra)),
            vectors.offset,
            np.append(vectors.lower, np.zeros(extra)),
            np.append(vectors.upper, np.ones(extra)),
            np.append(vectors.row_lower, low),
            np.append(vectors.row_upper, rhs),
        )


@dataclass
class _Rows:
    """Grows row by row; columns past the program's own are new binaries."""

    width: int
    blocks: list[sp.csr_array]
    rhs: list[Floats] = field(default_factory=list)
    equality: list[Bools] = field(default_factory=list)
    disc_rows: list[Ints] = field(default_factory=list)
    disc_shift: list[Floats] = field(default_factory=list)

    def add(self, block: sp.csr_array, rhs: Floats, equality: bool = False) -> Ints:
        """Adds rows; returns their numbers among the added ones."""
        start = sum(len(r) for r in self.rhs)
        self.blocks.append(block)
        self.rhs.append(rhs)
        self.equality.append(np.full(len(rhs), equality))
        return start + np.arange(len(rhs))

    def matrix(self) -> sp.csr_array:
        for block in self.blocks:
            block.resize(block.shape[0], self.width)
        return sp.vstack(self.blocks, format="csr")


def lower(
    standard: Standard,
    *,
    integer: Integers = "all",
    modes: Mapping[int, Bools] | None = None,
    discs: Discs = "inner",
    polygons: Mapping[int, Bools] | None = None,
) -> Lowered:
    """See the module's docstring.

    Args:
        standard: what to rewrite.
        integer: which of the program's own integers to hold: "all" or "none".
        modes: for the index of each structure with modes, which elements (n,) get binaries; all
            elements of all of them if omitted.
        discs: polygon within the disc or around it.
        polygons: for the index of each structure of discs, which elements (n,) get their polygons,
            the others being left out; all elements of all of them if omitted.

    Raises:
        UsageError: a structure is of a class that nobody has said how to rewrite.
    """
    refuse_unknown(standard, "a linear program", _REWRITES)
    rows = _Rows(standard.n_columns, [standard.a.copy()])
    for k, unrolled in enumerate(standard.structures):
        choice = polygons if isinstance(unrolled.structure, Disc) else modes
        default = np.full(unrolled.n, choice is None)
        chosen = default if choice is None else choice.get(k, default)
        _REWRITES[type(unrolled.structure)](rows, unrolled, np.flatnonzero(chosen))
    held_integer = np.ones(rows.width, bool)
    held_integer[: standard.n_columns] = standard.integer & (integer == "all")
    return Lowered(
        standard=standard,
        a=rows.matrix(),
        integer=held_integer,
        rhs=np.concatenate([np.empty(0), *rows.rhs]),
        equality=np.concatenate([np.empty(0, bool), *rows.equality]),
        disc_rows=np.concatenate([np.empty(0, np.intp), *rows.disc_rows]),
        disc_shift=np.concatenate([np.empty(0), *rows.disc_shift]),
        discs=discs,
    )


def _modes(rows: _Rows, unrolled: UnrolledStructure[Mode], chosen: Ints) -> None:
    if not len(chosen):
        return
    limits = [limit[chosen] for limit in unrolled.limits]
    binaries, blocks = unrolled.structure.binaries(unrolled.columns[:, chosen], limits, rows.width)
    rows.width += binaries
    for block in blocks:
        rows.add(_matrix(block, rows.width), block.right, block.equality)


def _matrix(block: BinaryRows, width: int) -> sp.csr_array:
    n = len(block.right)
    rows = np.tile(np.arange(n), len(block.columns))
    data = np.concatenate([np.broadcast_to(value, (n,)) for value in block.values])
    return sp.csr_array((data, (rows, np.concatenate(block.columns))), shape=(n, width))


def _polygon(rows: _Rows, unrolled: UnrolledStructure[Disc], chosen: Ints) -> None:
    if len(chosen) < unrolled.n:
        unrolled = unrolled.elements(chosen)
    block, radius, shift = unrolled.structure.polygon(unrolled)
    rows.disc_rows.append(rows.add(block, radius))
    rows.disc_shift.append(shift)


def _nothing(rows: _Rows, unrolled: UnrolledStructure[Structure], chosen: Ints) -> None:
    """A cone or an angle is relaxed to nothing; the rows of a maximum are the stage's own."""


_REWRITES: dict[type[Structure], Callable[[_Rows, UnrolledStructure[Any], Ints], None]] = {
    Split: _modes,
    Adjacent: _modes,
    Disc: _polygon,
    Angle: _nothing,
    Cone: _nothing,
    Largest: _nothing,
}


def tangents(standard: Standard, z: Floats, tolerance: float = 1e-3) -> tuple[sp.csr_array, Floats]:
    """Rows G z <= h that every cone u v >= sum(x^2) satisfies, touching it nearest to z.

    Elements that hold with room to spare (u v - sum x^2 > tolerance times its scale) are left out.
    A negative tolerance leaves only those that z breaks.
    """
    blocks, sides = [sp.csr_array((0, standard.n_columns))], [np.empty(0)]
    for unrolled in standard.structures_of(Cone).values():
        cone = unrolled.structure
        tight = unrolled.elements(cone.nearly_tight(unrolled, z, tolerance))
        block, right = cone.tangents(tight, z)
        blocks.append(block)
        sides.append(right)
    return sp.vstack(blocks, format="csr"), np.concatenate(sides)
