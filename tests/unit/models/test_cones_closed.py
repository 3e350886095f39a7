"""Prices on losses that close cones: which of the points counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from resilience.models.backends.base import NOTHING, Solution
from resilience.models.case_program import horizon
from resilience.models.methods import conic
from resilience.testing import small_case


def at_width(width: float) -> Solution:
    """A point whose cones are as wide open as its first value."""
    return Solution("optimal", np.array([width, 3.0]), 7.5, 2.5)


@pytest.mark.parametrize(
    ("first", "trials", "width", "prices"),
    [
        (0.5, [at_width(0.7), at_width(0.6)], 0.5, [1e-3, 1e-2]),
        (0.5, [at_width(0.3), at_width(0.4)], 0.3, [1e-3, 1e-2]),
        (0.5, [NOTHING, at_width(0.4)], 0.4, [1e-3, 1e-2]),
        (0.5, [at_width(2e-7)], 2e-7, [1e-3]),
        (3e-7, [], 3e-7, []),
    ],
)
def test_the_point_whose_cones_are_least_open_counts(
    monkeypatch: pytest.MonkeyPatch,
    first: float,
    trials: list[Solution],
    width: float,
    prices: list[float],
) -> None:
    asked: list[tuple[float, float]] = []

    def relaxation(*_: Any, seconds: float, penalty: float) -> Solution:
        asked.append((penalty, seconds))
        return trials[len(asked) - 1]

    monkeypatch.setattr(conic, "relaxation", relaxation)
    monkeypatch.setattr(conic, "worst_violation", lambda _, z: z[0])
    program = horizon(small_case(grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 3.0}]))
    found = conic.with_cones_closed(program, at_width(first), program.vectors, lambda: 1.5)
    assert found.point[0] == width
    assert asked == [(price, 1.5) for price in prices]
