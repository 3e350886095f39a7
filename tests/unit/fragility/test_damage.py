"""Failure over time: the step, the common factor, and the three ways to add up a wind."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from resilience.errors import UsageError
from resilience.fragility.lines.damage import Timing, failed_by, first_failure, hazard
from resilience.fragility.lines.spans import failure_probability
from tests.unit.fragility.spans import WEAK, gusts, passing, poles

RATE = Timing("rate", 0.25)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.9, 1.0])
def test_hazards_multiply_to_the_storm_whatever_the_step(rho: float) -> None:
    lines = poles([10, 25], rho)
    wind = passing(lines, slots=96)
    storm = failure_probability(lines, wind)
    halved = gusts(np.repeat(wind.speed_mps, 2, axis=1))
    for one in (wind, halved):
        assert 1.0 - np.prod(1.0 - hazard(lines, one), axis=1) == pytest.approx(storm, abs=1e-10)
        assert first_failure(lines, one).sum(axis=1) == pytest.approx(storm, abs=1e-12)
        assert failed_by(lines, one)[:, -1] == pytest.approx(storm, abs=1e-12)


@pytest.mark.parametrize("rho", [0.0, 0.4])
def test_a_rate_does_not_depend_on_the_step_but_on_the_time(rho: float) -> None:
    lines = poles([10, 25], rho)
    wind = passing(lines, 30.0)
    halved = gusts(np.repeat(wind.speed_mps, 2, axis=1))
    once = failed_by(lines, wind, RATE)
    assert failed_by(lines, halved, Timing("rate", 0.125))[:, 1::2] == pytest.approx(once)
    assert (failed_by(lines, halved, RATE)[:, -1] > 1.2 * once[:, -1]).all()


def test_a_rate_by_hand() -> None:
    chance = WEAK.probability([30.0, 40.0])
    found = failed_by(poles([1], 0.0), gusts([[30.0, 40.0]]), Timing("rate", 0.5, 2.0))
    stand = np.cumprod((1.0 - chance) ** (0.5 / 2.0))
    assert found[0] == pytest.approx(1.0 - stand)


def test_per_slot_warns_and_draws_every_slot() -> None:
    with pytest.warns(UserWarning, match="every 15 min"):
        timing = Timing("per_slot")
    wind = passing(poles([4], 0.0))
    chance = WEAK.probability(wind.speed_mps)
    found = failed_by(poles([4], 0.0), wind, timing)
    assert found[0] == pytest.approx(1.0 - np.cumprod(np.prod(1.0 - chance, axis=0)))
    assert hazard(poles([4], 0.0), wind, timing)[0] == pytest.approx(
        1.0 - np.prod(1.0 - chance, axis=0), abs=1e-9
    )


def test_only_a_new_maximum_is_a_hazard() -> None:
    found = hazard(poles([3]), gusts([[30.0, 35.0, 33.0, 35.0, 36.0, 10.0]] * 3))[0]
    assert (found[[0, 1, 4]] > 0.0).all()
    assert found[[2, 3, 5]] == pytest.approx(0.0, abs=1e-15)


def test_hazards_agree_with_drawn_capacities() -> None:
    """Capacities drawn one by one, as the model is told in words."""
    lines, rho = poles([5, 8], 0.5), 0.5
    wind = passing(lines, 38.0, slots=12)
    rng = np.random.default_rng(3)
    n = 40_000
    z = rng.standard_normal(n)
    own = rng.standard_normal((13, n))
    capacity = 45.0 * np.exp(0.2 * (np.sqrt(rho) * z + np.sqrt(1.0 - rho) * own))
    hit = (wind.speed_mps[:, :, None] >= capacity[:, None]).cumsum(axis=1) > 0
    down = np.stack([hit[:5].any(axis=0), hit[5:].any(axis=0)])
    exact = failed_by(lines, wind)
    band = norm.ppf(1.0 - 1e-4) * np.sqrt(exact * (1.0 - exact) / n) + 1e-4
    assert (np.abs(down.mean(axis=2) - exact) < band).all()


def test_no_timing() -> None:
    with pytest.raises(UsageError, match=r"mode 'max'.*step_h 0.*reference_h -1"):
        Timing("max", 0.0, -1.0)
