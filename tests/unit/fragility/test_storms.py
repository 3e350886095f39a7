"""Sampled storms against exact probabilities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.fragility.lines.curves import Curve
from resilience.fragility.lines.damage import RUNNING_MAX, Timing, accumulated, failed_by
from resilience.fragility.lines.spans import (
    SpannedLines,
    SpanWind,
    failure_probability,
    joint_probability,
    scores,
    span_speed,
)
from resilience.fragility.outages.failure_clock import FailureClock
from resilience.fragility.outages.repair import Repair
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.storms import Sampling, effective_size, sample_storms
from tests.unit.fragility.spans import WEAK, gusts, passing, poles

COUNTS = (20, 40, 5)
N = 20_000
RATE = Timing("rate", 0.25)


def off(found: Scenarios, values: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """How many standard errors the weighted mean of values (..., scenarios) is off."""
    p = found.probability
    mean = values @ p
    error = np.sqrt((((values - mean[..., None]) * p) ** 2).sum(axis=-1))
    return np.abs(mean - exact) / np.maximum(error, 1e-4)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("shift", [0.0, -1.0])
def test_frequencies_are_probabilities(rho: float, shift: float) -> None:
    lines = poles(COUNTS, rho)
    wind = passing(lines, 33.0)
    found = sample_storms(lines, wind, N, 11, repair=None, sampling=Sampling(shift))
    assert (off(found, found.down.astype(float), failed_by(lines, wind)) < 4.0).all()
    together = found.down[:, -1].all(axis=0).astype(float)
    assert off(found, together[None], np.array([joint_probability(lines, wind)])) < 4.0


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_frequencies_of_a_rate(rho: float) -> None:
    lines = poles(COUNTS, rho)
    wind = passing(lines, 30.0)
    found = sample_storms(lines, wind, N, 12, repair=None, timing=RATE)
    assert (off(found, found.down.astype(float), failed_by(lines, wind, RATE)) < 4.0).all()


def test_importance_sampling_finds_what_is_rare() -> None:
    lines = poles([20], 0.6)
    wind = passing(lines, 21.0)
    exact = failure_probability(lines, wind)
    assert 1e-4 < exact[0] < 3e-3
    spread = []
    for shift in (0.0, -2.0):
        seeds = [estimate(lines, wind, 2000, seed, shift) for seed in range(60)]
        assert np.mean(seeds) == pytest.approx(exact[0], abs=4.0 * np.std(seeds) / np.sqrt(60))
        spread.append(np.std(seeds))
    assert spread[1] < spread[0] / 3.0


def estimate(lines: SpannedLines, wind: SpanWind, n: int, seed: int, shift: float) -> float:
    """Of the first line's chance to fail."""
    found = sample_storms(lines, wind, n, seed, repair=None, sampling=Sampling(shift))
    return float(found.down[0, -1] @ found.probability)


@pytest.mark.parametrize(("n", "shift"), [(1, -2.0), (3, 1.5), (20, -1.0), (20, -2.0)])
def test_few_weighted_scenarios_are_right_on_average(n: int, shift: float) -> None:
    """Weights that are made to add up afterwards are too heavy where lines fail."""
    lines = poles([20], 0.6)
    wind = passing(lines, 28.5)
    exact = failure_probability(lines, wind)[0]
    assert 0.09 < exact < 0.12
    each = [estimate(lines, wind, n, seed, shift) for seed in range(1500)]
    assert np.mean(each) == pytest.approx(exact, abs=4.0 * np.std(each) / np.sqrt(1500))
    if n == 20:
        assert np.std(each) < 0.85 * np.sqrt(exact * (1.0 - exact) / n)


@pytest.mark.parametrize("shift", [-6.0, -1.0, 6.0])
def test_strata_of_the_common_factor(shift: float) -> None:
    """At correlation 1 a line fails where Z is below its score: Z shows, one in each stratum."""
    lines = poles([1], 1.0)
    n = 400
    edges, probability = strata(n, shift)
    for chance in (0.02, 0.5, 0.98):
        speed = 45.0 * np.exp(0.2 * norm.ppf(chance))
        found = sample_storms(lines, gusts([[speed]]), n, 3, repair=None, sampling=Sampling(shift))
        np.testing.assert_allclose(np.sort(found.probability), np.sort(probability), rtol=1e-9)
        assert found.probability.sum() == pytest.approx(1.0, abs=1e-12)
        failed = found.down[0, 0]
        # All strata below the score fail and none above: the one that it lies in may do either.
        heaviest = probability[np.searchsorted(edges, norm.ppf(chance)) - 1]
        assert abs(failed @ found.probability - chance) <= heaviest
        # The order of scenarios says nothing.
        place = np.argsort(np.argsort(found.probability))
        assert abs(np.corrcoef(np.arange(n), place)[0, 1]) < 4.0 / np.sqrt(n)


@pytest.mark.parametrize("shift", [-1.5, -0.4, 0.7, 2.0])
def test_most_values_of_the_common_factor_lie_at_the_shift(shift: float) -> None:
    """A line fails where Z is below its score s: in a share Phi(s - shift) of the scenarios."""
    n = 400
    for score in (-1.2, 0.3, 1.1):
        wind = gusts([[45.0 * np.exp(0.2 * score)]])
        found = sample_storms(poles([1], 1.0), wind, n, 7, repair=None, sampling=Sampling(shift))
        failed = found.down[0, 0]
        assert failed.mean() == pytest.approx(norm.cdf(score - shift), abs=1.01 / n)
        # No finer than the stratum in which the score lies.
        edges, probability = strata(n, shift)
        weight = probability[np.searchsorted(edges, score) - 1]
        assert abs(failed @ found.probability - norm.cdf(score)) <= weight


def strata(n: int, shift: float) -> tuple[Floats, Floats]:
    """(n + 1,) edges of equally likely values around the shift, (n,) what they really weigh."""
    edges = norm.ppf(np.arange(n + 1) / n) + shift
    weights = np.where(edges[1:] < 0.0, *(np.diff(f(edges)) for f in (norm.cdf, mirrored)))
    return edges, weights


def mirrored(z: np.ndarray) -> np.ndarray:
    """The normal distribution function less 1, exact far above 0."""
    return -norm.sf(z)


def test_worth_of_weighted_scenarios() -> None:
    lines = poles([3])
    wind = passing(lines)
    assert effective_size(sample_storms(lines, wind, N, 1)) == pytest.approx(N)
    aimed = sample_storms(lines, wind, N, 1, sampling=Sampling(-1.0))
    assert effective_size(aimed) == pytest.approx(N / np.e, rel=0.1)
    assert f"worth {effective_size(aimed):.0f} of {N}" in aimed.process


@pytest.mark.parametrize("timing", [RUNNING_MAX, RATE], ids=lambda timing: timing.mode)
@pytest.mark.parametrize("rho", [0.0, 0.3, 0.97, 1.0])
def test_a_repaired_line_fails_as_a_new_one(rho: float, timing: Timing) -> None:
    """After a fixed repair the rest of the storm is a storm of its own, given Z."""
    lines = poles([15, 30], rho)
    early = passing(lines, 44.0, slots=24).speed_mps
    late = passing(lines, 38.0, slots=16, seed=1).speed_mps
    start, slots = 24, 40
    score = scores(lines, span_speed(lines, gusts(np.hstack([early, late]))))
    z = np.random.default_rng(2).standard_normal(N)
    e = np.random.default_rng(3).standard_exponential(2 * N)
    line, scenario = np.repeat([0, 1], N), np.tile(np.arange(N), 2)
    clock = FailureClock(lines, score, z, timing)
    found = clock.first(line, scenario, e, start)
    assert (found >= start).all()
    exact = failed_by(lines, gusts(late), timing)
    for k in (0, 1):
        share = (found[line == k, None] <= np.arange(start, slots)).mean(axis=0)
        assert share == pytest.approx(exact[k], abs=4.5 * 0.5 / np.sqrt(N))
    assert (clock.first(line, scenario, e, slots) == slots).all()


@pytest.mark.parametrize("rho", [0.0, 0.05, 0.3, 0.6, 0.9, 0.99])
def test_interpolation_in_the_common_factor_is_exact_enough(rho: float) -> None:
    lines = poles([20, 90], rho)
    score = scores(lines, span_speed(lines, passing(lines)))
    z = np.random.default_rng(2).standard_normal(400)
    clock = FailureClock(lines, score, z, RUNNING_MAX)
    exact = accumulated(lines, score, z, RUNNING_MAX)
    scenario = np.arange(400)
    for line, slot in ((1, 47), (0, 20), (1, 22)):
        found = np.exp(clock._reader(np.full(400, line), scenario)(slot))
        true = exact[line, slot]
        matters = true > 1e-9
        assert matters.sum() > 100
        assert found[matters] == pytest.approx(true[matters], rel=2e-5)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.9])
def test_table_and_direct_evaluation_find_the_same_failures(rho: float) -> None:
    lines = poles([20, 90], rho)
    score = scores(lines, span_speed(lines, passing(lines, 32.0)))
    rng = np.random.default_rng(2)
    z, e = rng.standard_normal(3000), rng.standard_exponential(6000)
    line, scenario = np.repeat([0, 1], 3000), np.tile(np.arange(3000), 2)
    found = FailureClock(lines, score, z, RUNNING_MAX).first(line, scenario, e, 0)
    assert 0.1 < (found < 48).mean() < 0.9
    for part in np.split(np.arange(3000), 40):
        clock = FailureClock(lines, score, z[part], RUNNING_MAX)
        mine = np.concatenate([part, part + 3000])
        direct = clock.first(line[mine], np.tile(np.arange(75), 2), e[mine], 0)
        assert (direct == found[mine]).all()


def test_a_second_storm_breaks_what_was_repaired_unless_told_otherwise() -> None:
    lines = poles([30], 0.3)
    one = passing(lines, 60.0, slots=40).speed_mps
    wind = gusts(np.hstack([one, np.zeros((30, 8)), one]))
    quick = Repair("fixed", (0.5,))
    found = sample_storms(lines, wind, 500, 3, repair=quick)
    assert (np.diff(found.down[0].astype(int), axis=0, prepend=0) == 1).sum(axis=0).mean() > 1.9
    found = sample_storms(lines, wind, 500, 3, repair=quick, sampling=Sampling(refail=False))
    assert (np.diff(found.down[0].astype(int), axis=0, prepend=0) == 1).sum(axis=0).max() == 1


def test_nobody_works_in_the_wind() -> None:
    lines = poles(COUNTS)
    wind = passing(lines, 45.0)
    found = sample_storms(lines, wind, 2000, 3, repair=Repair("uniform", (0.25, 1.5)))
    ends = (np.diff(found.down.astype(int), axis=1) == -1).any(axis=2)
    for k, counts in enumerate(np.split(np.arange(65), np.cumsum(COUNTS)[:-1])):
        windy = np.asarray((wind.speed_mps[counts] > 20.0).any(axis=0))
        assert windy.sum() > 10
        assert ends[k].any()
        assert not (ends[k] & windy[:-1]).any()


def test_the_wind_along_a_line_breaks_nothing_but_stops_the_work() -> None:
    along = poles([4], bearing_deg=np.zeros(4))
    toward = np.zeros((4, 60))
    toward[:, :20] = 90.0
    found = sample_storms(along, gusts(np.full((4, 60), 55.0), toward), 400, 3)
    assert found.down[0, 0].mean() > 0.5
    slanting = gusts(np.full((4, 60), 55.0), np.full((4, 60), 40.0))
    few = sample_storms(along, slanting, 4000, 3, repair=None)
    exact = failure_probability(along, slanting)
    assert 0.1 < exact[0] < 0.9
    assert off(few, few.down[:, -1].astype(float), exact)[0] < 4.0
    assert (found.down[0, -1] == found.down[0, 20]).all()


def test_few_crews_are_slower_and_meet_the_same_storms() -> None:
    lines = poles(COUNTS * 3, 0.3)
    wind = passing(lines, 50.0, slots=160)
    many, few = (
        sample_storms(lines, wind, 500, 8, repair=Repair("lognormal", (4.0, 0.5), crews=crews))
        for crews in (None, 2)
    )
    assert (few.down.any(axis=1) == many.down.any(axis=1)).all()
    first = [found.down.argmax(axis=1) for found in (many, few)]
    assert (first[0] == first[1]).all()
    assert few.down.sum() > 1.2 * many.down.sum()


def test_more_scenarios_and_other_crews_begin_alike() -> None:
    lines = poles(COUNTS)
    wind = passing(lines, 45.0)
    some, more = (sample_storms(lines, wind, n, 8, repair=Repair(crews=1)) for n in (300, 700))
    assert (more.down[:, :, :300] == some.down).all()
    again = sample_storms(lines, wind, 300, np.random.default_rng(8), repair=Repair(crews=1))
    assert (again.down == some.down).all()
    assert (some.seed, again.seed) == (8, None)


def test_members_of_an_ensemble() -> None:
    lines = poles(COUNTS)
    winds = [passing(lines, peak, seed=k) for k, peak in enumerate((25.0, 33.0, 42.0))]
    chance = np.array([0.5, 0.3, 0.2])
    exact = sum(c * failed_by(lines, wind) for c, wind in zip(chance, winds, strict=True))
    found = sample_storms(lines, winds, N, 5, repair=None, member_probability=5 * chance)
    assert (off(found, found.down.astype(float), exact) < 4.0).all()
    # With repair every member is what it is alone: the calm of its own wind.
    alone = sample_storms(lines, winds[2], 300, 5, repair=Repair(crews=2))
    among = sample_storms(
        lines, winds, 300, 5, repair=Repair(crews=2), member_probability=[0.0, 0.0, 1.0]
    )
    assert (alone.down == among.down).all()


def test_a_wind_that_breaks_nothing_and_one_that_breaks_all() -> None:
    sharp = Curve(
        "sharp", "piecewise", {"v_crit_mps": 30.0, "v_collapse_mps": 60.0}, 3, 10, "land", ""
    )
    for rho in (0.0, 0.5, 1.0):
        lines = poles([3, 3], rho, sharp)
        wind = gusts(np.repeat([[10.0] * 8, [10.0] * 4 + [61.0] * 4], 3, axis=0))
        found = sample_storms(lines, wind, 200, 1)
        assert not found.down[0].any()
        assert not found.down[1, :4].any()
        assert found.down[1, 4:].all()


def test_scenarios_are_scenarios(tmp_path: Path) -> None:
    lines = poles(COUNTS)
    found = sample_storms(lines, passing(lines), 50, 1, sampling=Sampling(-0.5))
    assert found.lines == lines.names
    found.save(tmp_path / "storms.npz")
    assert "shift -0.5" in found.process
    assert found.probability.sum() == pytest.approx(1.0)


def test_no_storm() -> None:
    lines = poles([2])
    calm = gusts(np.zeros((2, 8)))
    with pytest.raises(UsageError, match="0 scenarios"):
        sample_storms(lines, calm, 0, 1)
    with pytest.raises(UsageError, match="winds of 4, 8 slots"):
        sample_storms(lines, [calm, gusts(np.zeros((2, 4)))], 5, 1)
    with pytest.raises(UsageError, match="2 member probabilities for 1 winds"):
        sample_storms(lines, calm, 5, 1, member_probability=[0.5, 0.5])
    with pytest.raises(UsageError, match="0 member probabilities for 0 winds"):
        sample_storms(lines, [], 5, 1)
    with pytest.raises(UsageError, match="shift -9"):
        Sampling(-9.0)
    assert WEAK.probability(0.0) == 0.0
