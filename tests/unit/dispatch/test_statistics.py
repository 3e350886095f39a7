"""Comparison statistics against closed forms, SciPy and a linear program."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from resilience.errors import UsageError
from resilience.evaluation.measures import statistics
from resilience.models.program import risk_measures


def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def cvar_by_lp(x, alpha: float, p) -> float:
    """Minimum of eta + p.excess / (1 - alpha) with excess >= x - eta, excess >= 0."""
    n = len(x)
    cost = np.concatenate([[1.0], p / (1 - alpha)])
    rows = np.hstack([-np.ones((n, 1)), -np.eye(n)])
    bounds = [(None, None), *[(0, None)] * n]
    return linprog(cost, A_ub=rows, b_ub=-x, bounds=bounds, method="highs").fun


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 25),
    alpha=st.sampled_from([0.0, 0.25, 0.5, 0.9, 0.95]),
)
def test_cvar_is_the_optimum_of_its_linear_program(seed, n, alpha):
    draw = np.random.default_rng(seed)
    x, p = draw.normal(40, 10, n), draw.dirichlet(np.ones(n))
    found = risk_measures.conditional_value_at_risk(x, alpha, p)
    assert found == pytest.approx(cvar_by_lp(x, alpha, p), rel=1e-7)


def test_cvar_by_hand():
    x = np.arange(1.0, 11.0)
    assert risk_measures.conditional_value_at_risk(x, 0.0) == pytest.approx(5.5)
    assert risk_measures.conditional_value_at_risk(x, 0.8) == pytest.approx(9.5)
    assert risk_measures.conditional_value_at_risk(x, 0.75) == pytest.approx((10 + 9 + 4) / 2.5)
    assert risk_measures.conditional_value_at_risk(x, 0.95) == pytest.approx(10)
    assert [risk_measures.value_at_risk(x, a) for a in (0.0, 0.3, 0.9, 0.91)] == [1, 3, 9, 10]


def test_cvar_of_a_normal_variable():
    from scipy.stats import norm

    n = 20000
    x = norm.ppf((np.arange(n) + 0.5) / n)
    closed = norm.pdf(norm.ppf(0.95)) / 0.05
    assert risk_measures.conditional_value_at_risk(x, 0.95) == pytest.approx(closed, rel=1e-3)


def test_equal_weights_are_no_weights_and_impossible_members_do_not_count():
    x = np.array([3.0, 9.0, 1.0, 4.0])
    quarter = np.full(4, 0.25)
    for risk in (risk_measures.value_at_risk, risk_measures.conditional_value_at_risk):
        assert risk(x, 0.6, quarter) == risk(x, 0.6)
        assert risk(x, 0.6, np.array([0.5, 0, 0.25, 0.25])) == pytest.approx(
            risk(x[[0, 0, 2, 3]], 0.6)
        )
    assert risk_measures.worst(x) == 9
    assert risk_measures.worst(x, np.array([0.5, 0, 0.25, 0.25])) == 4


def test_interquartile_mean_leaves_the_outer_quarters_out():
    assert statistics.interquartile_mean([1, 2, 3, 4, 5, 6, 7, 1000]) == 4.5
    assert statistics.interquartile_mean([5]) == 5


def test_interval_of_a_large_sample_is_the_normal_one():
    x = rng().normal(3, 2, 400)
    found = statistics.mean_interval(x, rng(), resamples=4000)
    half = 1.96 * x.std() / np.sqrt(len(x))
    assert (found.low, found.high) == pytest.approx((x.mean() - half, x.mean() + half), abs=0.02)
    assert (found.mean, found.n, found.excludes_zero) == (x.mean(), 400, True)


@pytest.mark.parametrize("method", ["BCa", "percentile"])
def test_interval_is_that_of_scipy(method):
    from scipy.stats import bootstrap

    x = rng().exponential(2, 30)
    found = statistics.mean_interval(x, rng(), method=method, resamples=500)
    oracle = bootstrap((x,), np.mean, method=method, n_resamples=500, rng=rng())
    assert (found.low, found.high) == pytest.approx(tuple(oracle.confidence_interval))


def test_pairs_take_the_storm_out_of_the_comparison():
    storm = rng().normal(100, 30, 24)
    a, b = storm - 1 + rng().normal(0, 0.5, 24), storm
    found = statistics.paired_difference(a, b, rng(), resamples=1000)
    assert found.high < 0
    assert found.mean == pytest.approx((a - b).mean())
    turned = statistics.paired_difference(b, a, rng(), resamples=1000, method="percentile")
    same = statistics.paired_difference(a, b, rng(), resamples=1000, method="percentile")
    assert (turned.low, turned.high) == pytest.approx((-same.high, -same.low))


@pytest.mark.parametrize("method", ["BCa", "percentile"])
def test_strata_take_the_spread_between_draws_out(method):
    draw = np.repeat([0, 1, 2], [4, 6, 10])
    x = 50.0 * draw + rng().normal(0, 1, 20)
    within = statistics.mean_interval(x, rng(), strata=draw, resamples=2000, method=method)
    across = statistics.mean_interval(x, rng(), resamples=2000, method=method)
    assert within.mean == across.mean == x.mean()
    assert within.low < x.mean() < within.high
    spread = np.sqrt(sum(x[draw == k].var() * (draw == k).sum() for k in range(3))) / 20
    assert within.high - within.low == pytest.approx(2 * 1.96 * spread, rel=0.1)
    assert across.high - across.low > 10 * (within.high - within.low)


def test_one_stratum_is_no_strata():
    x = rng().normal(0, 1, 12)
    one = statistics.mean_interval(x, rng(), strata=["a"] * 12, resamples=300)
    assert one == statistics.mean_interval(x, rng(), resamples=300)


def test_methods_that_always_agree_have_an_interval_of_nothing():
    found = statistics.paired_difference([5, 6, 7], [4, 5, 6], rng())
    assert (found.low, found.mean, found.high, found.excludes_zero) == (1, 1, 1, True)
    assert not statistics.paired_difference([5, 6], [5, 6], rng()).excludes_zero


def test_score_is_1_at_the_bound_and_0_at_rule_09():
    found = statistics.score([30, 40, 35, 45], 40.0, 30.0)
    assert found.tolist() == [1, 0, 0.5, -0.5]
    assert np.isnan(statistics.score(40.0, 40.0, 40.0 - 1e-9))


def test_what_is_rounding_grows_with_the_costs():
    """0.1 $ in 1e9 are rounding, 1000 $ are not; 1e-4 $ in 1 $ are not either."""
    near, far = 1e9 + np.array([0.0, 0.1, -0.05]), 1e9 + np.array([0.0, 1e3, -2e3])
    found = statistics.mean_interval(near, rng(), resamples=200)
    assert (found.low, found.high) == (near.mean(), near.mean())
    found = statistics.mean_interval(-near, rng(), resamples=200)
    assert (found.low, found.high) == (-near.mean(), -near.mean())
    found = statistics.mean_interval(far, rng(), resamples=200)
    assert found.low < far.mean() < found.high
    found = statistics.mean_interval(2.0 + np.array([0.0, 1e-4, 3e-4]), rng(), resamples=200)
    assert found.low < found.high
    assert np.isnan(statistics.score(1e9, 1e9 + 0.1, 1e9))
    assert statistics.score(1e9 + 500, 1e9 + 1000, 1e9) == pytest.approx(0.5)
    assert np.isnan(statistics.score(-1e9, -1e9 + 0.1, -1e9))
    assert statistics.score(3.00005, 3.0001, 3.0) == pytest.approx(0.5)
    assert statistics.triviality([1e9 + 0.1], [1e9]).trivial


def test_what_is_rounding_shrinks_with_the_costs():
    """A case in kW and in another currency is told apart as the same one in MW is."""
    cost, rule09, bound = (1e-9 * np.array(v) for v in ([33.0, 38], [40.0, 50], [30.0, 36]))
    assert statistics.score(cost, rule09, bound) == pytest.approx([0.7, 12 / 14])
    assert not statistics.triviality(rule09, bound).trivial
    assert not statistics.triviality([2e-10], [0.0]).trivial
    found = statistics.mean_interval(cost, rng(), resamples=200)
    assert found.low < cost.mean() < found.high


def test_a_difference_by_rounding_is_no_difference():
    cost = 40.0 + np.arange(9.0)
    by_rounding = statistics.paired_difference(cost + 1e-13 * (3 + cost), cost, rng())
    assert by_rounding.low > 0
    assert not by_rounding.excludes_zero
    assert statistics.paired_difference(cost + 1e-6 * (3 + cost), cost, rng()).excludes_zero


def test_score_and_gap_agree():
    cost, rule09, bound = np.array([33.0, 38.0]), np.array([40.0, 50.0]), np.array([30.0, 36.0])
    room = statistics.gap_to_bound(rule09, bound)
    gap = statistics.gap_to_bound(cost, bound)
    assert statistics.score(cost, rule09, bound) == pytest.approx(1 - gap / room)


def test_gap_is_positive_above_a_bound_that_earns_money():
    assert statistics.gap_to_bound(-8.0, -10.0) == pytest.approx(0.2)
    assert np.isnan(statistics.gap_to_bound(1.0, 0.0))


def test_triviality_of_the_measured_cases():
    # ieee33 at the paper's prices and with time of use, 16 test days.
    assert statistics.triviality([39.75], [39.467]).trivial
    tou = statistics.triviality([39.67], [33.879])
    assert not tou.trivial
    assert tou.room_share == pytest.approx(0.171, abs=1e-3)
    assert statistics.triviality([0.0], [0.0]).trivial
    assert not statistics.triviality([3.0], [0.0]).trivial


def test_farmer():
    # Birge and Louveaux: recourse problem -108390, wait and see -115406, mean-value plan -107240.
    p = np.full(3, 1 / 3)
    wait_and_see = np.array([-167_666.6667, -118_600.0, -59_950.0])
    recourse = np.array([-167_000.0, -109_350.0, -48_820.0])
    mean_value = np.array([-148_000.0, -118_600.0, -55_120.0])
    evpi = statistics.value_of_perfect_information(recourse, wait_and_see, p)
    vss = statistics.value_of_stochastic_solution(mean_value, recourse, p)
    assert evpi == pytest.approx(7016, abs=1)
    assert vss == pytest.approx(1150, abs=1)
    assert evpi == statistics.value_of_perfect_information(recourse, wait_and_see)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: risk_measures.value_at_risk([1.0], 1.0), "alpha is 1"),
        (lambda: risk_measures.worst([]), "at least one value"),
        (lambda: risk_measures.worst([1.0, np.nan]), "all finite"),
        (lambda: statistics.paired_difference([1, 2], [1], rng()), "the same episodes"),
        (lambda: statistics.mean_interval([1], rng()), "a stratum has 1 value"),
        (lambda: statistics.mean_interval([1, 2, 3], rng(), strata=[0, 0, 1]), "leave the strata"),
        (lambda: statistics.mean_interval([1, 2, 3], rng(), strata=[0, 0]), "strata have"),
        (lambda: risk_measures.worst([1, 2], np.array([1.5, -0.5])), "none negative"),
    ],
)
def test_what_cannot_be_compared_is_refused(call, words):
    with pytest.raises(UsageError, match=words):
        call()


def test_runs_and_episodes_are_resampled_apart() -> None:
    """Of a run and an episode the lowest sum, 2 + 11, comes up in 1/4 * 1/4 of the resamples: more
    than 2.5 %, as does the highest, 5 + 17.
    """
    values = np.add.outer([2.0, 5.0], [11.0, 17.0])
    interval = statistics.run_interval(values, np.random.default_rng(3))
    assert (interval.mean, interval.low, interval.high) == (17.5, 13.0, 22.0)


def test_a_single_run_varies_with_its_episodes_alone() -> None:
    rng = np.random.default_rng(3)
    for values in (np.array([[3.0, 8.0]]), np.array([[3.0], [8.0]])):
        interval = statistics.run_interval(values, rng)
        assert (interval.mean, interval.low, interval.high) == (5.5, 3.0, 8.0)
    alone = statistics.run_interval(np.array([[3.0]]), rng)
    assert alone.mean == 3.0
    assert np.isnan([alone.low, alone.high]).all()


def test_the_interval_of_many_independent_values_is_that_of_the_textbook() -> None:
    """One run of 400 episodes: mean +- 1.96 s / sqrt(n)."""
    values = np.random.default_rng(5).normal(7.0, 2.0, (1, 400))
    interval = statistics.run_interval(values, np.random.default_rng(3))
    half = 1.96 * values.std() / 20.0
    assert interval.low == pytest.approx(values.mean() - half, abs=0.02)
    assert interval.high == pytest.approx(values.mean() + half, abs=0.02)
