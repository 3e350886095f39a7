"""Comparison statistics against closed forms, SciPy and a linear program."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from resilience.errors import UsageError
from resilience.evaluation.measures import statistics
from resilience.models.program import risk_measures


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


def test_score_is_1_at_the_bound_and_0_at_rule_09():
    found = statistics.score([30, 40, 35, 45], 40.0, 30.0)
    assert found.tolist() == [1, 0, 0.5, -0.5]
    assert np.isnan(statistics.score(40.0, 40.0, 40.0 - 1e-9))


def test_what_is_rounding_grows_with_the_costs():
    """0.1 $ in 1e9 are rounding, 1000 $ are not."""
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


def test_score_and_gap_agree():
    cost, rule09, bound = np.array([33.0, 38.0]), np.array([40.0, 50.0]), np.array([30.0, 36.0])
    room = statistics.gap_to_bound(rule09, bound)
    gap = statistics.gap_to_bound(cost, bound)
    assert statistics.score(cost, rule09, bound) == pytest.approx(1 - gap / room)


def test_gap_is_positive_above_a_bound_that_earns_money():
    assert statistics.gap_to_bound(-8.0, -10.0) == pytest.approx(0.2)
    assert np.isnan(statistics.gap_to_bound(1.0, 0.0))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), sign=st.sampled_from([-1.0, 1.0]))
def test_gap_values_average_to_the_gap_of_the_means_and_vary_as_it_does(seed, sign):
    """Their mean is the quotient; moving the weight of one episode moves both alike."""
    draw = np.random.default_rng(seed)
    bound = sign * draw.uniform(30, 50, (5, 4))
    cost, likely = bound + draw.exponential(5, (5, 4)), draw.dirichlet(np.ones(5))

    def gap(likely):
        means = [likely @ values.mean(1) for values in (cost, bound)]
        return statistics.gap_to_bound(*means)

    values = statistics.gap_values(cost, bound, likely).mean(1)
    assert likely @ values == pytest.approx(gap(likely))
    step = np.full(5, -0.25e-6)
    step[2] = 1e-6
    moved = (gap(likely + step) - gap(likely)) / 1e-6
    assert moved == pytest.approx(step @ values / 1e-6, rel=1e-3, abs=1e-6)


def test_the_gap_of_a_bound_of_nothing_is_none():
    assert np.isnan(statistics.gap_values(np.ones((2, 1)), np.zeros((2, 1)))).all()


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
        (lambda: risk_measures.worst([1, 2], np.array([1.5, -0.5])), "none negative"),
    ],
)
def test_what_cannot_be_compared_is_refused(call, words):
    with pytest.raises(UsageError, match=words):
        call()
