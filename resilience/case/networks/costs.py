"""Costs of generation as network files state them: polynomials and piecewise-linear curves.

MATPOWER User's Manual, table B-4: model 2 is a polynomial, highest order first, model 1 points
(MW, $/h). pandapower has the same as `poly_cost` and `pwl_cost`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

PIECES = 4  # straight pieces in place of a parabola

Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class UnitCost:
    """What a unit costs.

    Attributes:
        per_mwh: marginal cost, $/MWh; the mean slope where there is a curve.
        per_h: cost of being on, $/h.
        start: cost of one start, $.
        curve: (MW, $/h) points over the range of the unit; None where it is a straight line.
        is_chords: it stands in place of a polynomial of a higher order.
    """

    per_mwh: float
    per_h: float = 0.0
    start: float = 0.0
    curve: Points | None = None
    is_chords: bool = False


def polynomial_cost(
    coefficients: Sequence[float], p_min_mw: float, p_max_mw: float, start: float = 0.0
) -> UnitCost:
    """The cost of a polynomial in MW, by chords where it is no straight line.

    Args:
        coefficients: highest order first, $/h.
        p_min_mw: least output.
        p_max_mw: greatest output.
        start: cost of one start, $.
    """
    straight = not any(coefficients[:-2])
    if straight or not 0.0 < p_max_mw - p_min_mw < np.inf:
        slope = coefficients[-2] if len(coefficients) > 1 else 0.0
        if not straight:
            slope = float(np.polyval(np.polyder(np.array(coefficients)), max(p_min_mw, 0.0)))
        fixed = coefficients[-1] if len(coefficients) else 0.0
        return UnitCost(float(slope), float(fixed), start, is_chords=not straight)
    p = np.linspace(p_min_mw, p_max_mw, PIECES + 1)
    points = tuple(zip(p.tolist(), np.polyval(coefficients, p).tolist(), strict=True))
    return UnitCost(_mean_slope(points), start=start, curve=points, is_chords=True)


def piecewise_cost(
    points: Points, p_min_mw: float, p_max_mw: float, start: float = 0.0
) -> UnitCost:
    """The cost of points (MW, $/h), its end pieces drawn out to the range of the unit.

    Raises:
        ValueError: fewer than two points, or MW that do not rise.
    """
    if len(points) < 2 or any(b[0] <= a[0] for a, b in pairwise(points)):
        raise ValueError("a piecewise-linear cost needs two points or more, MW rising")
    slopes = [(y2 - y1) / (x2 - x1) for (x1, y1), (x2, y2) in pairwise(points)]
    if max(slopes) - min(slopes) <= 1e-9 * max(map(abs, slopes), default=0.0):
        return UnitCost(slopes[0], points[0][1] - slopes[0] * points[0][0], start)
    (x, y), (x_end, y_end) = points[0], points[-1]
    first, last = min(x, p_min_mw), max(x_end, p_max_mw)
    drawn = (
        (first, y + slopes[0] * (first - x)),
        *points[1:-1],
        (last, y_end + slopes[-1] * (last - x_end)),
    )
    return UnitCost(_mean_slope(drawn), start=start, curve=drawn)


def _mean_slope(points: Points) -> float:
    (x, y), (x_end, y_end) = points[0], points[-1]
    return (y_end - y) / (x_end - x)
