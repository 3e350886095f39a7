r"""The product of two numbers is a sum of squares: the branch flow equation.

$$ u \, v = \sum_k x_k^2, \qquad u, v \ge 0 $$

Arguments: u, v, x1, x2, ...

- Scaled violation: |u v - sum x^2| / (1 + sum x^2).
- Exact rewrite: none in linear or conic programs; a quadratic equation.
- Relaxation:  u v >= sum x^2, the same as  |(2 x, u - v)| <= u + v. Linear programs leave it out,
  or take rows that touch it:  with s = (2 x, u - v) at a point,  s / |s| . (2 x, u - v) <= u + v.

Source: Baran and Wu (1989), relaxed by Farivar and Low (2013); the rows follow from the inequality
of Cauchy and Schwarz.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.structures.base import SecondOrder, Structure, UnrolledStructure

APEX_LENGTH = 1e-9  # of (2 x, u - v), below which the cone has no tangent of its own


class Cone(SecondOrder):
    """`u * v = sum(x^2)`."""

    title = "cone"
    complaint = "cones open"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        u, v, *xs = args
        square = sum((x**2 for x in xs), np.zeros(len(u)))
        return np.abs(u * v - square) / (1.0 + square)

    def bound_arguments(self, moving: Sequence[Bools], args: Sequence[Floats]) -> Bools:
        """Elements in which something moves; 0 v = sum(x^2) leaves v free."""
        u, v, *xs = moving
        return np.any([u, v & (args[0] != 0.0), *xs], axis=0)

    def second_order(
        self, unrolled: UnrolledStructure[Structure]
    ) -> tuple[list[sp.csr_array], list[Floats]]:
        """u + v, 2 x1, 2 x2, ..., u - v."""
        (mu, mv, *mxs), (cu, cv, *cxs) = unrolled.matrices, unrolled.consts
        matrices = [mu + mv, *[2.0 * m for m in mxs], mu - mv]
        return matrices, [cu + cv, *[2.0 * c for c in cxs], cu - cv]

    def nearly_tight(
        self, unrolled: UnrolledStructure[Structure], z: Floats, tolerance: float
    ) -> Ints:
        """Elements with a tangent at z, and no more room than `tolerance` times their scale."""
        u, v, *xs = unrolled.values(z)
        square = sum((x**2 for x in xs), np.zeros(len(u)))
        length = np.sqrt(sum(((2.0 * x) ** 2 for x in xs), np.zeros(len(u))) + (u - v) ** 2)
        tight = u * v - square <= tolerance * (1.0 + square)
        return np.flatnonzero(tight & (length > APEX_LENGTH))

    def tangents(
        self, unrolled: UnrolledStructure[Structure], z: Floats
    ) -> tuple[sp.csr_array, Floats]:
        """See the module's docstring; for elements whose (2 x, u - v) is not zero at z."""
        u, v, *xs = unrolled.values(z)
        sides = [2.0 * x for x in xs] + [u - v]
        length = np.sqrt(sum((s**2 for s in sides), np.zeros(len(u))))
        *normals, across = [s / length for s in sides]
        (mu, mv, *mxs), (cu, cv, *cxs) = unrolled.matrices, unrolled.consts
        block = mu.multiply((across - 1)[:, None]) - mv.multiply((across + 1)[:, None])
        right = -(across - 1) * cu + (across + 1) * cv
        for normal, mx, cx in zip(normals, mxs, cxs, strict=True):
            block = block + mx.multiply(2.0 * normal[:, None])
            right = right - 2.0 * normal * cx
        return block.tocsr(), right
