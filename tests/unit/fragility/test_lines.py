"""Lines in series with correlated capacities: limits, published values, other quadratures."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from resilience.errors import UsageError
from resilience.fragility.lines.curves import CURVES, Curve, hardened
from resilience.fragility.lines.spans import (
    Series,
    SpannedLines,
    failure_probability,
    joint_probability,
    log_standing,
    poles_in_series,
    scores,
)
from tests.unit.fragility.spans import WEAK, gusts, passing, poles

P = 0.05
AT_P = float(WEAK.speed(P))
SERIES = {  # n: {correlation: probability}, elements of 0.05 each
    20: {0.0: 0.642, 0.3: 0.445, 0.6: 0.290, 0.9: 0.137},
    50: {0.0: 0.923, 0.3: 0.633, 0.6: 0.392, 0.9: 0.165},
}


def at_p(lines: SpannedLines) -> np.ndarray:
    return failure_probability(lines, gusts(np.full((len(lines.span_line), 1), AT_P)))


@pytest.mark.parametrize(("n", "rho"), [(n, rho) for n in SERIES for rho in SERIES[n]])
def test_published_values(n: int, rho: float) -> None:
    assert at_p(poles([n], rho))[0] == pytest.approx(SERIES[n][rho], abs=6e-4)


@pytest.mark.parametrize(("rho", "chance"), [(0.0, 0.169), (0.3, 0.199), (0.6, 0.162)])
def test_four_lines_at_once(rho: float, chance: float) -> None:
    lines = poles([20, 20, 20, 20], rho)
    wind = gusts(np.full((80, 1), AT_P))
    assert joint_probability(lines, wind) == pytest.approx(chance, abs=6e-4)
    assert joint_probability(lines, wind, ["2-3"]) == pytest.approx(at_p(lines)[1])


def test_correlation_0_is_the_product_and_1_the_largest() -> None:
    wind = passing(poles([7, 12, 1]))
    chance = WEAK.probability(wind.speed_mps.max(axis=1))
    parts = np.split(chance, [7, 19])
    found = failure_probability(poles([7, 12, 1], 0.0), wind)
    assert found == pytest.approx([1.0 - np.prod(1.0 - part) for part in parts], abs=1e-13)
    found = failure_probability(poles([7, 12, 1], 1.0), wind)
    assert found == pytest.approx([part.max() for part in parts], abs=1e-13)
    assert joint_probability(poles([7, 12, 1], 1.0), wind) == pytest.approx(found.min())
    assert at_p(poles([20], 1.0))[0] == pytest.approx(P)


@pytest.mark.parametrize("rho", [0.02, 0.3, 0.6, 0.9, 0.99, 0.999])
def test_another_quadrature_agrees(rho: float) -> None:
    lines = poles([30], rho)
    wind = passing(lines, 36.0)
    score = norm.ppf(WEAK.probability(wind.speed_mps.max(axis=1)))

    def failing(z: float) -> float:
        stand = norm.logcdf((np.sqrt(rho) * z - score) / np.sqrt(1.0 - rho)).sum()
        return float(-np.expm1(stand) * norm.pdf(z))

    steep = np.linspace(-8.0, 8.0, 65)
    exact = sum(quad(failing, a, b, epsabs=1e-13, limit=200)[0] for a, b in pairwise(steep))
    assert failure_probability(lines, wind)[0] == pytest.approx(exact, rel=1e-8)


def test_two_elements_are_a_bivariate_normal() -> None:
    rho, speed = 0.55, np.array([30.0, 36.0])
    score = norm.ppf(WEAK.probability(speed))
    both_stand = multivariate_normal([0, 0], [[1, rho], [rho, 1]]).cdf(-score)
    found = failure_probability(poles([2], rho), gusts(speed[:, None]))
    assert found[0] == pytest.approx(1.0 - both_stand, abs=1e-7)
    one_each = joint_probability(poles([1, 1], rho), gusts(speed[:, None]))
    both_fail = multivariate_normal([0, 0], [[1, rho], [rho, 1]]).cdf(score)
    assert one_each == pytest.approx(both_fail, abs=1e-7)


def test_tiny_probabilities_keep_their_digits() -> None:
    speed = float(WEAK.speed(1e-14))
    found = failure_probability(poles([3], 0.0), gusts(np.full((3, 1), speed)))
    assert found[0] == pytest.approx(3e-14, rel=1e-9)


def test_poles_conductors_and_hardening_in_series() -> None:
    span_line = np.array([0, 0, 1, 1, 1])
    wind = gusts(np.full((5, 1), 38.0))
    lines = poles_in_series(
        ["a", "b"], span_line, pole=WEAK, conductor=hardened(WEAK, 1.2), correlation=0.0
    )
    pole, cond = WEAK.probability(38.0), WEAK.probability(38.0 / 1.2)
    expected = [1.0 - (1.0 - cond) ** n * (1.0 - pole) ** n for n in (2, 3)]
    assert failure_probability(lines, wind) == pytest.approx(expected)
    lines = poles_in_series(
        ["a", "b"], span_line, pole=WEAK, hardened_by={"b": 1.2}, correlation=0.0
    )
    expected = [1.0 - (1.0 - pole) ** 2, 1.0 - (1.0 - cond) ** 3]
    assert failure_probability(lines, wind) == pytest.approx(expected)


def test_counts_are_exponents_and_a_line_without_poles_stands() -> None:
    lines = SpannedLines(("a", "b"), np.zeros(2, int), (Series(WEAK, np.array([3.0, 0.0])),), 0.4)
    found = failure_probability(lines, gusts([[38.0], [90.0]]))
    assert found == pytest.approx([failure_probability(poles([3], 0.4), gusts([[38.0]] * 3))[0], 0])


def test_a_wind_below_the_critical_speed_and_above_collapse() -> None:
    sharp = Curve(
        "sharp", "piecewise", {"v_crit_mps": 30.0, "v_collapse_mps": 60.0}, 3, 10, "land", ""
    )
    lines = poles([2, 2, 2], 0.5, sharp)
    found = failure_probability(lines, gusts([[20.0], [29.0], [20.0], [61.0], [20.0], [45.0]]))
    assert found == pytest.approx([0.0, 1.0, 0.5])


@pytest.mark.parametrize("toward", [0.0, 180.0])
def test_only_the_wind_across_a_span_counts(toward: float) -> None:
    lines = poles([1, 1, 1], 0.0, bearing_deg=np.array([0.0, 90.0, 60.0]))
    wind = gusts(np.full((3, 1), 50.0), np.full((3, 1), toward))
    expected = WEAK.probability([0.0, 50.0, 50.0 * np.sin(np.radians(60.0))])
    assert failure_probability(lines, wind) == pytest.approx(expected, abs=1e-12)
    with pytest.raises(UsageError, match="the wind has no direction"):
        failure_probability(lines, gusts(np.full((3, 1), 50.0)))


def test_directions_that_are_no_numbers_or_too_few_are_refused() -> None:
    bearing = np.array([0.0, 90.0])
    lines, speed = poles([1, 1], 0.0, bearing_deg=bearing), np.full((2, 3), 50.0)
    with pytest.raises(UsageError, match="directions that are no numbers"):
        failure_probability(lines, gusts(speed, np.full((2, 3), np.nan)))
    with pytest.raises(UsageError, match=r"directions of shape \(3, 2\); allowed: \(2, 3\)"):
        failure_probability(lines, gusts(speed, np.zeros((3, 2))))
    with pytest.raises(UsageError, match="bearings; allowed: 2 numbers"):
        poles([1, 1], 0.0, bearing_deg=bearing * np.nan)


def test_another_wind_than_the_curve_wants_is_refused() -> None:
    lines = poles([2])
    wind = replace(gusts([[30.0, -1.0]] * 3), averaging_s=60.0, exposure="water")
    with pytest.raises(UsageError) as caught:
        failure_probability(lines, wind)
    assert "60 s mean at 10 m over water; curve 'weak' wants a 3 s mean" in str(caught.value)
    assert "(3, 2); allowed: (2, slots)" in str(caught.value)
    assert "negative" in str(caught.value)
    assert "restated" in caught.value.hint


def test_no_lines() -> None:
    with pytest.raises(UsageError, match=r"correlation 1\.5.*unknown line.*bearings.*counts"):
        SpannedLines(("a",), np.array([0, 1]), (Series(WEAK, np.ones(3)),), 1.5, np.zeros(3))
    with pytest.raises(UsageError, match="hardened line c; allowed: a, b"):
        poles_in_series(["a", "b"], np.array([0, 1]), hardened_by={"c": 2.0})
    with pytest.raises(UsageError, match="line c; allowed"):
        joint_probability(poles([1]), gusts([[30.0]]), ["c"])
    assert poles_in_series(["a"], np.array([0])).series[0].curve is CURVES["pole"]


@pytest.mark.parametrize("correlation", [-0.1, 1.1, float("nan")])
def test_a_correlation_lies_between_0_and_1(correlation: float) -> None:
    with pytest.raises(UsageError, match=r"correlation (-0.1|1.1|nan); allowed: 0 to 1"):
        poles([2, 3], correlation)


def test_at_correlation_1_the_weakest_element_of_a_line_decides() -> None:
    """Three poles in 36 m/s, one in 41; a line of two in 38: Z below the score of the worst."""
    lines = poles([4, 2], 1.0)
    score = scores(lines, np.array([36.0, 36.0, 41.0, 36.0, 38.0, 38.0]))
    worst = np.log(np.array([41.0, 38.0]) / 45.0) / 0.2
    z = np.array([worst[0] - 0.01, worst[0] + 0.01, worst[1] - 0.01, worst[1] + 0.01])
    found = log_standing(lines, score, z)
    assert np.isneginf(found).tolist() == [[True, False, True, True], [False, False, True, False]]
    assert (found[np.isfinite(found)] == 0.0).all()
