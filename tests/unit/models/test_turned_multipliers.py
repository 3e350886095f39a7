"""Multipliers of cones whose cost at a far bound is turned into one at a near bound."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from resilience.models.backends.clarabel import ConeProgram, SecondOrderRows
from resilience.models.program.dual_bound import safe_bound
from resilience.models.program.standard import Vectors

FAR = 1e4
P = 0.6
"""What flows: u v >= P^2, with u in 0..FAR and v in 0.9..1.1, and 2 u to be paid."""


def rotated(n: int, scale: float = 1.0) -> SecondOrderRows:
    """u v >= x^2 of n triples of columns u, v, x; u on a scale of its own."""
    eye, none = sp.eye_array(n), sp.csr_array((n, n))
    u = sp.csr_array(sp.hstack([scale**2 * eye, none, none]))
    v = sp.csr_array(sp.hstack([none, eye, none]))
    x = sp.csr_array(sp.hstack([none, none, 2.0 * scale * eye]))
    zeros = np.zeros(n)
    return SecondOrderRows([sp.csr_array(u + v), x, sp.csr_array(u - v)], [zeros] * 3)


def numbers(n: int) -> Vectors:
    ones = np.ones(n)
    return Vectors(
        cost=np.concatenate([2.0 * ones, 0.0 * ones, 0.0 * ones]),
        offset=0.0,
        lower=np.concatenate([0.0 * ones, 0.9 * ones, P * ones]),
        upper=np.concatenate([FAR * ones, 1.1 * ones, P * ones + 1e-3]),
        row_lower=np.empty(0),
        row_upper=np.empty(0),
    )


def bound(cone: SecondOrderRows, y: np.ndarray, v: Vectors) -> float:
    slope = sum(m.T @ part for m, part in zip(cone.matrices, y, strict=True))
    return safe_bound(sp.csr_array((0, len(v.cost))), v, np.empty(0), slope)


def multipliers(n: int) -> np.ndarray:
    """Of the optimum u = P^2 / 1.1: alpha = 2 of u, beta alpha = (2 P alpha / 2 1.1)^2."""
    alpha = np.full(n, 2.0)
    across = -alpha * P / 1.1
    beta = across**2 / alpha
    return np.stack([0.5 * (alpha + beta), across, 0.5 * (alpha - beta)])


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_a_rounding_at_a_far_bound_costs_next_to_nothing(scale: float) -> None:
    """1e-6 of 2 $ beside a bound of 1e4 were 0.02 $ of 0.65, and are 1e-6 $."""
    n, v = 3, numbers(3)
    cone, optimum = rotated(n, scale), 3 * 2.0 * P**2 / 1.1
    exact = multipliers(n) / np.array([[1.0], [scale], [1.0]])
    alpha, beta = (exact[0] + exact[2]) / scale**2, exact[0] - exact[2]
    exact = np.stack([0.5 * (alpha + beta), exact[1], 0.5 * (alpha - beta)])
    assert bound(cone, exact, v) == pytest.approx(optimum, rel=1e-9)
    off = exact * (1.0 + 1e-6)
    assert bound(cone, off, v) < optimum - 0.05
    slope = sum(m.T @ part for m, part in zip(cone.matrices, off, strict=True))
    turned = cone.turned(off, v.cost - slope)
    assert optimum - 1e-5 < bound(cone, turned, v) <= optimum + 1e-9


def test_turned_multipliers_stay_in_the_cone_whatever_they_are_turned_by() -> None:
    rng = np.random.default_rng(3)
    n = 200
    cone, x = rotated(n, 3.0), rng.normal(size=n)
    last = rng.normal(size=n)
    y = np.stack([np.hypot(x, last) + rng.choice([0.0, 1e-9, 1.0], n), x, last])
    y[:, :5] = 0.0
    for size in (1e-9, 1e-2, 1e3):
        turned = cone.turned(y, size * rng.normal(size=3 * n))
        room = turned[0] - np.hypot(turned[1], turned[2])
        assert room.min() >= -1e-12
        assert np.isfinite(turned).all()
        assert turned[1] == pytest.approx(x * (np.arange(n) >= 5))


def test_what_costs_nothing_too_little_stays_as_it_is() -> None:
    cone, y = rotated(2), multipliers(2)
    np.testing.assert_allclose(cone.turned(y, np.full(6, 1e-3)), y, atol=1e-15)


def test_discs_have_no_column_to_turn() -> None:
    """Their t is a number, and u and v have the column of the last x in common."""
    none = sp.csr_array((1, 2))
    x, y = sp.csr_array(np.array([[1.0, 0.0]])), sp.csr_array(np.array([[0.0, 1.0]]))
    disc = SecondOrderRows([none, x, y], [np.ones(1), np.zeros(1), np.zeros(1)])
    given = np.array([[5.0], [3.0], [4.0]])
    turned = disc.turned(given, np.array([-1.0, -1.0]))
    np.testing.assert_array_equal(turned, given)


@pytest.mark.parametrize("far", [10.0, 1e4, 1e7])
def test_a_solve_proves_its_optimum_however_far_the_bounds_are(far: float) -> None:
    v = numbers(20)
    v.upper[:20] = far
    program = ConeProgram(
        sp.csr_array((0, 60)), v, (rotated(20),), np.ones(60, bool), {"tol_gap_rel": 1e-6}
    )
    point = program.solve(v.lower, v.upper, np.inf)
    assert point.bound == pytest.approx(20 * 2.0 * P**2 / 1.1, rel=3e-6)
    assert point.bound <= 20 * 2.0 * P**2 / 1.1 + 1e-9
