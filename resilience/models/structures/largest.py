r"""A number is the largest of some others, where a smaller one is never worse.

$$ y = \max_k x_k $$

Arguments: y, x1, x2, ..., y being a plain column, or the negative of one: the smallest of the
negatives of the others, where a larger one is never worse.

- Scaled violation: |y - max x|.
- Exact rewrite: the rows  y >= x_k, which the stage holds anyway. Since a smaller y is never worse,
  the optimum does not change; the referee's `settle` lowers y to the maximum afterwards.
- Relaxation: the same rows.

Source: the epigraph form, Boyd and Vandenberghe (2004), section 4.1.3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Floats
from resilience.models.structures.base import Structure


class Largest(Structure):
    """`y = max(x1, x2, ...)`."""

    title = "maximum"
    complaint = "maxima missed"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        y, *xs = args
        return np.abs(y - self.maximum(xs))

    def maximum(self, xs: Sequence[Floats]) -> Floats:
        """(n,) what y has to be."""
        return np.max(xs, axis=0)
