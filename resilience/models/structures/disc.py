r"""The length of a vector is bounded: ratings of inverters and lines.

$$ \sqrt{\sum_k x_k^2} \le r $$

Arguments: x1, x2, ... Limits: the radius r.

- Scaled violation: the excess of the length over r, divided by 1 + r.
- Exact rewrite: a second-order cone. Linear programs hold a polygon with `SIDES` sides instead,
  normal_k . x <= r cos(pi / SIDES) within the disc (a restriction) or <= r around it (a
  relaxation), and if need be rows  x0 / |x0| . x <= r  that touch it at a point x0.
- Relaxation: none but these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.structures.base import SecondOrder, Structure, UnrolledStructure

SIDES = 12  # even: opposite sides share a row
APOTHEM = float(
    np.cos(np.pi / SIDES)
)  # distance of a side from the centre, the vertices being at 1
Discs = Literal["inner", "outer"]
"""Whether polygons lie within their discs or around them."""


class Disc(SecondOrder):
    """`|(x1, x2, ...)| <= radius`."""

    title = "disc"
    complaint = "ratings exceeded"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        (radius,) = limits
        length = np.sqrt(sum(np.square(args)))
        return np.maximum(length - radius, 0.0) / (1.0 + radius)

    def second_order(
        self, unrolled: UnrolledStructure[Structure]
    ) -> tuple[list[sp.csr_array], list[Floats]]:
        """The radius, x1, x2, ..."""
        none = sp.csr_array(unrolled.matrices[0].shape)
        return [none, *unrolled.matrices], [unrolled.limits[0], *unrolled.consts]

    def tangents(
        self, unrolled: UnrolledStructure[Structure], z: Floats
    ) -> tuple[sp.csr_array, Floats]:
        """See the module's docstring; for elements that are not zero at z."""
        values = np.array(unrolled.values(z))
        normals = values / np.linalg.norm(values, axis=0)
        block = sum(m.multiply(n[:, None]) for m, n in zip(unrolled.matrices, normals, strict=True))
        shift = sum(c * n for c, n in zip(unrolled.consts, normals, strict=True))
        return sp.csr_array(block), unrolled.limits[0] - shift

    def polygon(
        self, unrolled: UnrolledStructure[Structure]
    ) -> tuple[sp.csr_array, Floats, Floats]:
        """Rows  -r <= normal . x <= r, each for two opposite sides.

        Returns:
            Matrix, radius and the share of the constants in  normal . x, one per row.

        Raises:
            ValueError: there are not two arguments.
        """
        if len(unrolled.matrices) != 2:
            raise ValueError(
                f"{self.name!r} has {len(unrolled.matrices)} arguments; a polygon needs two"
            )
        (first, second), (c1, c2) = unrolled.matrices, unrolled.consts
        angle = 2 * np.pi * np.arange(SIDES // 2) / SIDES
        # Rounded, so that an axis has no coefficient of 6e-17 beside its own.
        normal = np.round((np.cos(angle), np.sin(angle)), 15)[:, :, None]
        block = sp.kron(normal[0], first, format="csr") + sp.kron(normal[1], second, format="csr")
        shift = normal[0] * c1 + normal[1] * c2
        return sp.csr_array(block), np.tile(unrolled.limits[0], len(angle)), shift.ravel()
