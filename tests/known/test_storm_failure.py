"""One storm, one probability: 0.205 at Zhanjiang in Rammasun for an element of (45 m/s, 0.20)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import lognorm

from resilience.fragility.lines.curves import Curve
from resilience.fragility.lines.damage import Timing, failed_by, hazard
from resilience.fragility.lines.spans import Series, SpannedLines, SpanWind, failure_probability
from tests.known.zhanjiang import HOURLY_MPS, rammasun

CURVE = Curve(
    "pole", "lognormal", {"median_mps": 45.0, "beta": 0.20}, 60.0, 10.0, "water", "example"
)
ONE = SpannedLines(("a-b",), np.zeros(1, int), (Series(CURVE, np.ones(1)),), correlation=0.0)
STEPS = {"15 min": (1, 0.25, 0.992), "1 h": (4, 1.0, 0.700)}


def wind(speed: np.ndarray) -> SpanWind:
    return SpanWind(speed[None], 60.0, 10.0, "water")


@pytest.mark.parametrize(("every", "step_h", "drawn"), STEPS.values(), ids=list(STEPS))
def test_rammasun_at_zhanjiang(every: int, step_h: float, drawn: float) -> None:
    series = rammasun()[::every]
    assert series.max() == pytest.approx(38.177, abs=0.05)
    assert failure_probability(ONE, wind(series))[0] == pytest.approx(0.205, abs=5e-4)
    h = hazard(ONE, wind(series), Timing(step_h=step_h))[0]
    assert 1.0 - np.prod(1.0 - h) == pytest.approx(0.205, abs=5e-4)
    with pytest.warns(UserWarning, match="draws anew every"):
        per_slot = Timing("per_slot", step_h)
    assert failed_by(ONE, wind(series), per_slot)[0, -1] == pytest.approx(drawn, abs=5e-4)


def test_the_hours_of_rammasun_at_zhanjiang() -> None:
    """The same from the wind of every hour as a table, which holds the hour of the peak."""
    series = np.array(HOURLY_MPS)
    h = hazard(ONE, wind(series), Timing(step_h=1.0))[0]
    assert 1.0 - np.prod(1.0 - h) == pytest.approx(0.205, abs=5e-4)
    assert failure_probability(ONE, wind(series))[0] == pytest.approx(0.205, abs=5e-4)
    with pytest.warns(UserWarning, match="draws anew every"):
        per_slot = Timing("per_slot", 1.0)
    assert failed_by(ONE, wind(series), per_slot)[0, -1] == pytest.approx(0.700, abs=5e-4)


def test_the_table_of_hours_is_that_of_the_equations() -> None:
    np.testing.assert_allclose(rammasun()[::4], HOURLY_MPS, atol=5e-4)


@pytest.mark.parametrize("every", [1, 2, 4, 8])
def test_any_step_that_keeps_the_peak_keeps_the_probability(every: int) -> None:
    hours = np.arange(-96, 97) / 8.0
    series = 38.177 * np.exp(-((hours / 9.0) ** 2))
    stand = np.prod(1.0 - hazard(ONE, wind(series[::every]))[0])
    assert 1.0 - stand == pytest.approx(lognorm(s=0.20, scale=45.0).cdf(38.177), abs=1e-12)
    assert 1.0 - stand == pytest.approx(0.205, abs=6e-4)
