r"""Weights of the points of a curve, of which at most two neighbours are positive (SOS2).

$$ w_k \ge 0, \qquad \sum_k w_k \le 1, \qquad w_i \, w_j = 0 \quad \text{for } |i - j| > 1 $$

Arguments: w1, w2, ..., plain columns, one per point of the curve.

- Scaled violation: what the weights sum to beyond the best pair of neighbours.
- Exact rewrite, with a binary b_k per segment:  sum_k b_k = 1,  w_k <= b_(k-1) + b_k.
- Relaxation: any weights, so any point of the convex hull of the curve; exact where it is convex
  and minimised.

Source: Beale and Tomlin (1970).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.structures.base import BinaryRows, Mode


class Adjacent(Mode):
    """At most two neighbouring weights are positive."""

    title = "cost curve"
    complaint = "mode elements are in two modes at once"

    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """See the module's docstring."""
        weights = np.array(args)
        pairs = np.array([weights[k : k + 2].sum(0) for k in range(max(len(weights) - 1, 1))])
        return np.maximum(weights.sum(0) - pairs.max(0), 0.0)

    def binaries(
        self, columns: Ints, limits: Sequence[Floats], width: int
    ) -> tuple[int, list[BinaryRows]]:
        """One binary per element and segment between two points, segment by segment."""
        n = columns.shape[1]
        segments = [width + k * n + np.arange(n) for k in range(len(columns) - 1)]
        rows = [BinaryRows(segments, [1.0] * len(segments), np.ones(n), equality=True)]
        for k, weight in enumerate(columns):
            # The first and the last point end one segment, every other one two.
            ending_here = segments[max(k - 1, 0) : k + 1]
            values = [1.0] + [-1.0] * len(ending_here)
            rows.append(BinaryRows([weight, *ending_here], values, np.zeros(n)))
        return n * len(segments), rows

    def idle_columns(self, columns: Ints, values: Floats) -> Ints:
        """All but the two neighbours of greatest weight."""
        first = np.argmax(values[:-1] + values[1:], axis=0)
        place = np.arange(len(columns))[:, None]
        return columns[(place < first) | (place > first + 1)]

    def sides(self, columns: Ints, values: Floats) -> tuple[Ints, Ints]:
        """The weights on either side of the point nearest to the mean of all that are positive.

        That point lies strictly between the outermost two, so neither side is zero now.
        """
        place = np.arange(len(columns))
        positive = np.flatnonzero(values > 0.0)
        mean = float(place @ np.maximum(values, 0.0) / max(np.maximum(values, 0.0).sum(), 1e-300))
        middle = int(np.clip(round(mean), positive[0] + 1, positive[-1] - 1))
        before, behind = columns[:middle], columns[middle + 1 :]
        lighter = values[:middle].sum() <= values[middle + 1 :].sum()
        return (before, behind) if lighter else (behind, before)
