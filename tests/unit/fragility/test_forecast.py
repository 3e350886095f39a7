"""Forecast errors against the closed forms of an autoregressive process."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.errors import UsageError
from resilience.simulation.forecast import ForecastError, Outlook, sample_outlook, sample_profiles
from tests.unit.fragility.storms import feeder

SIGMA = 0.1
N = 4000


@pytest.mark.parametrize(("rho", "step_min"), [(0.0, 15.0), (0.97, 15.0), (0.97, 60.0)])
def test_variance_and_autocorrelation(rho: float, step_min: float) -> None:
    error = ForecastError(SIGMA, rho).errors(2, 40, N, np.random.default_rng(1), step_min)
    # Standard errors of an s.d. and of a correlation from N draws, four times each.
    assert error.std(axis=2) == pytest.approx(SIGMA, rel=4 / np.sqrt(2 * N))
    assert error.mean(axis=2) == pytest.approx(0.0, abs=4 * SIGMA / np.sqrt(N))
    for lag in (1, 8):
        closed = rho ** (lag * step_min / 15.0)
        for first in (0, 20):
            pair = np.corrcoef(error[0, first], error[0, first + lag])[0, 1]
            assert pair == pytest.approx(closed, abs=4 * (1 - closed**2) / np.sqrt(N))
    across = np.corrcoef(error[0, 30], error[1, 30])[0, 1]
    assert across == pytest.approx(0.0, abs=4 / np.sqrt(N))


def test_a_share_of_the_variance_is_common_to_all_profiles() -> None:
    """Two profiles are correlated by that share; the rest of the law stays as it is."""
    error = ForecastError(SIGMA, 0.97, 0.7).errors(3, 30, N, np.random.default_rng(1))
    assert error.std(axis=2) == pytest.approx(SIGMA, rel=4 / np.sqrt(2 * N))
    for slot in (0, 29):
        across = np.asarray(np.corrcoef(error[:, slot]))
        off = across[~np.eye(3, dtype=bool)]
        assert off == pytest.approx(0.7, abs=4 * (1 - 0.7**2) / np.sqrt(N))
    lag = np.corrcoef(error[0, 10], error[0, 18])[0, 1]
    assert lag == pytest.approx(0.97**8, abs=0.02)
    same = ForecastError(SIGMA, 0.5, 1.0).errors(2, 5, 3, np.random.default_rng(2))
    assert np.array_equal(same[0], same[1])


def test_errors_are_relative_and_power_is_never_negative() -> None:
    forecast = np.array([[0.0, 0.5, 1.0]])
    found = ForecastError(0.9, 0.0).sample(forecast, 500, np.random.default_rng(2))
    assert found.shape == (1, 3, 500)
    assert (found[0, 0] == 0).all()
    assert found.min() == 0.0
    assert (found[0, 1] == 0.0).any()
    assert ForecastError(0.0).sample(forecast, 1, np.random.default_rng(2))[:, :, 0] == (
        pytest.approx(forecast)
    )


@pytest.mark.parametrize("common", [0.0, 0.4])
def test_a_seed_repeats_and_more_begins_alike(common: float) -> None:
    def draw(slots: int, n: int) -> np.ndarray:
        return ForecastError(common=common).errors(3, slots, n, np.random.default_rng(3))

    usual = draw(20, 4)
    assert np.array_equal(usual, draw(20, 4))
    assert np.array_equal(usual, draw(30, 6)[:, :20, :4])


def test_profiles_of_a_case() -> None:
    columns = {"price": [1, 0.5, 2, 1], "sun": [0, 0.2, 0.9, 0.3], "town": [0.4, 0.5, 1.0, 0.7]}
    case = feeder(step_min=360.0, columns=columns, profile="town")
    names, found = sample_profiles(case, ForecastError(0.01), 200, np.random.default_rng(4))
    assert names == ("town", "sun")  # not the price
    assert found.mean(axis=2) == pytest.approx(
        np.array([case.profiles[n] for n in names]), abs=0.01
    )
    none = sample_profiles(feeder(), ForecastError(), 3, np.random.default_rng(4))
    assert (none[0], none[1].shape) == ((), (0, 96, 3))


@pytest.mark.parametrize(("sigma", "rho"), [(-0.1, 0.0), (np.nan, 0.0), (0.1, 1.0), (0.1, -0.2)])
def test_settings_out_of_range(sigma: float, rho: float) -> None:
    with pytest.raises(UsageError, match="allowed"):
        ForecastError(sigma, rho)


def test_what_is_expected_fades_to_the_forecast_and_is_true_now() -> None:
    outlook = Outlook(("load",), np.full((1, 4, 2), 0.1), 0.5)
    values, slots = np.array([1.0, 2.0, 4.0]), np.array([1, 2, 3])
    expected = outlook.expected("load", values, slots, 1)
    np.testing.assert_allclose(expected[:, 0], [1.1, 2.0 * 1.05, 4.0 * 1.025])
    np.testing.assert_allclose(outlook.true("load", values, slots)[:, 1], 1.1 * values)
    np.testing.assert_allclose(outlook.expected("price", values, slots, 1)[:, 0], values)


def test_no_forecast_from_the_present_error_is_better() -> None:
    """Regressing what comes true on the present error gives the weights of the forecast."""
    outlook = sample_outlook(rs.load_case("ieee33").replace(slots=24), ForecastError(), 4000, 1)
    now, later = outlook.error[:, 5], outlook.error[:, 13]
    slope = (now * later).sum() / (now * now).sum()
    assert slope == pytest.approx(outlook.correlation**8, abs=0.01)
