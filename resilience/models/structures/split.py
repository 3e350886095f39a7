r"""A number as the difference of two parts, only one of which is positive: |x|, max(x, 0), a mode.

$$ 0 \le p \le \overline{p}, \qquad 0 \le n \le \overline{n}, \qquad p \, n = 0 $$

Arguments: p, n (`pos`, `neg`), plain columns. Limits: their upper bounds.

- Scaled violation: min(p, n) / (1 + min of the limits).
- Exact rewrite, with a binary b:  p <= limit_p b,  n <= limit_n (1 - b).
- Relaxation: the bounds alone.

Source: the modes of a storage unit, paper eqs. 2-4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.structures.base import BinaryRows, Mode


class Split(Mode):
    """`pos * neg = 0` with both within [0, limit]."""

    title = "mode"
    complaint = "mode elements are in two modes at once"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        scale = 1.0 + np.minimum(*limits)
        return np.maximum(np.minimum(*args), 0.0) / scale

    def binaries(
        self, columns: Ints, limits: Sequence[Floats], width: int
    ) -> tuple[int, list[BinaryRows]]:
        """One binary per element: whether pos is the one that may be positive."""
        (pos, neg), (up, down) = columns, limits
        n = len(pos)
        b = width + np.arange(n)
        return n, [
            BinaryRows([pos, b], [1.0, -up], np.zeros(n)),
            BinaryRows([neg, b], [1.0, down], down),
        ]

    def idle_columns(self, columns: Ints, values: Floats) -> Ints:
        """The smaller side."""
        return np.where(values[0] >= values[1], columns[1], columns[0])

    def sides(self, columns: Ints, values: Floats) -> tuple[Ints, Ints]:
        """Either column."""
        smaller = int(values[1] <= values[0])
        return columns[[smaller]], columns[[1 - smaller]]
