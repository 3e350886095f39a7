"""Rewrites structures as rows and binaries, for solvers that know nothing else.

split     pos <= limit_0 b, neg <= limit_1 (1 - b), b binary
adjacent  w_k <= b_(k-1) + b_k, sum b = 1, b binary
disc      polygon with `SIDES` sides, around the disc (a relaxation) or within it (a restriction)
cone      left out (a relaxation); rows that touch it can be added with `tangents`
largest   left to the rows y >= x (exact: a smaller y is never worse; see `referee.settle`)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.program.standard import Standard, Unrolled, Vectors

SIDES = 12  # even: opposite sides share a row
Discs = Literal["inner", "outer"]


@dataclass
class Lowered:
    """A mixed-integer linear problem whose first columns are those of the problem lowered.

    Rows behind the problem's own, and binaries behind its columns, have constant bounds.
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
        """The problem's vectors with those of the added rows and columns behind them."""
        extra = self.a.shape[1] - len(vectors.cost)
        rhs, low = self.rhs.copy(), np.where(self.equality, self.rhs, -np.inf)
        within = np.cos(np.pi / SIDES) if self.discs == "inner" else 1.0
        reach = self.rhs[self.disc_rows] * within
        low[self.disc_rows] = -reach - self.disc_shift
        rhs[self.disc_rows] = reach - self.disc_shift
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
    """Grows row by row; columns past `n` are new binaries."""

    n: int
    blocks: list[sp.csr_array]
    rhs: list[Floats]
    equality: list[Bools]

    def add(self, block: sp.sparray, rhs: Floats, equality: bool = False) -> Ints:
        start = sum(len(r) for r in self.rhs)
        self.blocks.append(block.tocsr())
        self.rhs.append(rhs)
        self.equality.append(np.full(len(rhs), equality))
        return start + np.arange(len(rhs))

    def matrix(self) -> sp.csr_array:
        for block in self.blocks:
            block.resize(block.shape[0], self.n)
        return sp.vstack(self.blocks, format="csr")


def lower(
    standard: Standard,
    *,
    integer: Bools | None = None,
    exact: dict[int, Bools] | None = None,
    discs: Discs = "inner",
) -> Lowered:
    """See the module's docstring.

    Args:
        standard: what to rewrite.
        integer: (columns,) columns to hold integer; all of the problem's own if omitted.
        exact: for the index of each split or adjacent structure, which elements (n,) get
            binaries; all elements of all of them if omitted.
        discs: polygon within the disc or around it.
    """
    if exact is None:
        exact = {k: np.ones(s.n, bool) for k, s in enumerate(standard.structures)}
    rows = _Rows(standard.n_columns, [standard.a.copy()], [], [])
    polygons = [(np.empty(0, np.intp), np.empty(0))]
    for k, structure in enumerate(standard.structures):
        if structure.kind == "disc":
            polygons.append(_polygon(rows, structure))
        elif structure.kind in ("split", "adjacent"):
            chosen = np.flatnonzero(exact.get(k, np.zeros(structure.n, bool)))
            if len(chosen):
                (_sides if structure.kind == "split" else _neighbours)(rows, structure, chosen)
    whole = np.zeros(rows.n, bool)
    whole[: standard.n_columns] = standard.integer if integer is None else integer
    whole[standard.n_columns :] = True
    return Lowered(
        standard=standard,
        a=rows.matrix(),
        integer=whole,
        rhs=np.concatenate([np.empty(0), *rows.rhs]),
        equality=np.concatenate([np.empty(0, bool), *rows.equality]),
        disc_rows=np.concatenate([at for at, _ in polygons]),
        disc_shift=np.concatenate([shift for _, shift in polygons]),
        discs=discs,
    )


def _entries(columns: list[Ints], values: list[Floats], width: int) -> sp.csr_array:
    m = len(columns[0])
    rows = np.tile(np.arange(m), len(columns))
    data = np.concatenate([np.broadcast_to(v, (m,)) for v in values])
    return sp.csr_array((data, (rows, np.concatenate(columns))), shape=(m, width))


def _sides(rows: _Rows, split: Unrolled, chosen: Ints) -> None:
    pos, neg = split.columns[:, chosen]
    up, down = (limit[chosen] for limit in split.limits)
    b = rows.n + np.arange(len(chosen))
    rows.n += len(chosen)
    one, zero = np.ones(len(chosen)), np.zeros(len(chosen))
    rows.add(_entries([pos, b], [one, -up], rows.n), zero)
    rows.add(_entries([neg, b], [one, down], rows.n), down)


def _neighbours(rows: _Rows, adjacent: Unrolled, chosen: Ints) -> None:
    weights = adjacent.columns[:, chosen]
    m, one = len(chosen), np.ones(len(chosen))
    segments = [rows.n + i * m + np.arange(m) for i in range(len(weights) - 1)]
    rows.n += m * len(segments)
    rows.add(_entries(segments, [one] * len(segments), rows.n), one, equality=True)
    for i, weight in enumerate(weights):
        around = segments[max(i - 1, 0) : i + 1]
        values = [one] + [-one] * len(around)
        rows.add(_entries([weight, *around], values, rows.n), np.zeros(m))


def _polygon(rows: _Rows, disc: Unrolled) -> tuple[Ints, Floats]:
    """Rows  |normal . x| <= radius, each for two opposite sides, and the constants' share in x."""
    if len(disc.matrices) != 2:
        raise ValueError(f"{disc.name!r} has {len(disc.matrices)} arguments; a polygon needs two")
    (first, second), (c1, c2) = disc.matrices, disc.consts
    angle = 2 * np.pi * np.arange(SIDES // 2) / SIDES
    normal = np.round((np.cos(angle), np.sin(angle)), 15)[:, :, None]  # no coefficients of 6e-17
    block = sp.kron(normal[0], first, format="csr") + sp.kron(normal[1], second, format="csr")
    shift = normal[0] * c1 + normal[1] * c2
    return rows.add(block, np.tile(disc.limits[0], len(angle))), shift.ravel()


def tangents(standard: Standard, z: Floats, tolerance: float = 1e-3) -> tuple[sp.csr_array, Floats]:
    """Rows G z <= h that every cone u v >= sum(x^2) satisfies, touching it nearest to z.

    |(2 x, u - v)| <= u + v is linearised at z; elements that hold with room to spare
    (u v - sum x^2 > tolerance times its scale) are left out.
    """
    blocks, sides = [sp.csr_array((0, standard.n_columns))], [np.empty(0)]
    for cone in standard.structures:
        if cone.kind != "cone":
            continue
        u, v, *xs = cone.values(z)
        square = sum(x**2 for x in xs)
        near = (u * v - square) <= tolerance * (1.0 + square)
        sides_of = [2.0 * x for x in xs] + [u - v]
        length = np.sqrt(sum(s**2 for s in sides_of))
        keep = np.flatnonzero(near & (length > 1e-9))
        scaled = [s[keep] / length[keep] for s in sides_of]
        mu, mv, *mxs = (m[keep] for m in cone.matrices)
        cu, cv, *cxs = (c[keep] for c in cone.consts)
        block = mu.multiply((scaled[-1] - 1)[:, None]) - mv.multiply((scaled[-1] + 1)[:, None])
        rhs = -(scaled[-1] - 1) * cu + (scaled[-1] + 1) * cv
        for s, mx, cx in zip(scaled, mxs, cxs, strict=False):
            block = block + mx.multiply(2.0 * s[:, None])
            rhs = rhs - 2.0 * s * cx
        blocks.append(block.tocsr())
        sides.append(rhs)
    return sp.vstack(blocks, format="csr"), np.concatenate(sides)
