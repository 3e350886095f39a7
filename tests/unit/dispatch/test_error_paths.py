"""Errors of load and PV on the paths of a fan: closed forms of what a path gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resilience.case import load_case
from resilience.dispatch.error_paths import ErrorPaths
from resilience.dispatch.stochastic import Stochastic
from resilience.evaluation.compare import compare, held_out
from resilience.fragility.draw import sample_case
from resilience.simulation.forecast import ForecastError, lasting_outlook, sample_outlook
from resilience.simulation.setting import Setting
from resilience.simulation.world import World, microgrid_with_fallible_lines

PATHS = 4000


def setting(law: ForecastError | None) -> Setting:
    case = held_out(load_case("ieee33-tou"), 1)
    storms = sample_case(case, 2, 3)
    outlook = None if law is None else sample_outlook(case, law, 2, 5)
    microgrid = microgrid_with_fallible_lines(case, storms, "copperplate")
    return World.build(microgrid, storms, outlook=outlook).setting


def test_a_path_gains_what_the_law_says() -> None:
    """Nothing now, and in slot h a standard deviation of sigma sqrt(1 - rho^2h) of the forecast."""
    law, at = ForecastError(0.1, 0.9, 0.6), setting(ForecastError(0.1, 0.9, 0.6))
    errors = ErrorPaths(at, PATHS, 1)
    off = errors.ahead(0, 40, 30)
    relative = np.array([
        off[name] / np.maximum(at.case.profile(name)[40:70, None], 1e-9) for name in off
        if (at.case.profile(name)[40:70] > 0.01).all()
    ])  # fmt: skip
    assert len(relative) >= 3
    assert not relative[:, 0].any()
    assert np.abs(relative.mean(axis=2)).max() < 1e-12  # antithetic
    for h in (1, 5, 29):
        closed = law.sigma * np.sqrt(1.0 - law.correlation ** (2 * h))
        # Half of the paths are free.
        assert relative[:, h].std(axis=1) == pytest.approx(closed, rel=5 / np.sqrt(PATHS))
        across = np.corrcoef(relative[:, h])[~np.eye(len(relative), dtype=bool)]
        assert across == pytest.approx(0.6, abs=5 * (1 - 0.6**2) / np.sqrt(PATHS / 2))


def test_numbers_stay_with_their_slots_and_their_episode() -> None:
    errors = ErrorPaths(setting(ForecastError(0.1, 0.5)), 6, 1)
    name = errors.names[0]
    early, late = errors.ahead(0, 20, 10)[name], errors.ahead(0, 21, 9)[name]
    # One slot later the first number is known, and what it left has halved.
    profile = errors.case.profile(name)[20:30, None]
    faded = early[1] / profile[1] * 0.5 ** np.arange(9)[:, None]
    np.testing.assert_allclose(early[1:] / profile[1:] - faded, late / profile[1:], atol=1e-12)
    assert not np.allclose(errors.ahead(1, 20, 10)[name], early)


def test_who_expects_no_errors_samples_none() -> None:
    assert ErrorPaths(setting(None), 6, 1).ahead(0, 0, 10) == {}
    case = held_out(load_case("ieee33-tou"), 1)
    storms = sample_case(case, 1, 3)
    microgrid = microgrid_with_fallible_lines(case, storms, "copperplate")
    lasting = World.build(microgrid, storms, outlook=lasting_outlook(case, 0.1, -0.1, 1))
    assert lasting.setting.error_law is None


def test_errors_on_the_paths_change_what_is_done() -> None:
    """Where a tenth more load than forecast is possible, more is held back."""

    class Certain(Stochastic):
        def __init__(self, at: Setting) -> None:
            super().__init__(replace(at, error_law=None))
            self.name = "certain"

    report = compare(
        "ieee33-tou", {"certain": Certain, "stochastic": Stochastic}, days=1, draws=1, seed=5,
        forecast_error="feeder", known_centre=False,
    )  # fmt: skip
    certain, sampled = (report.trajectories[name].energy for name in ("certain", "stochastic"))
    assert np.abs(certain - sampled).max() > 0.01
