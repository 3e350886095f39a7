"""What is learnt of days: mixtures, noise, and that test days stay unseen."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import held_out
from resilience.dispatch.sddp.days import Days, fitted_climate, past_days
from resilience.testing import small_case

RNG = np.random.default_rng(4)
SLOTS = 24
WORK, OFF, SUN = RNG.uniform(0.2, 1.0, (3, SLOTS))


def week() -> Days:
    """Seven days that are exact mixtures; the last two are off."""
    off = np.arange(7) >= 5
    scale = np.array([1.0, 0.9, 1.1, 1.0, 1.0, 1.0, 1.0])
    load = np.where(off[:, None], OFF, WORK) * scale[:, None]
    sun = SUN * np.array([0.2, 1.5, 1.0, 1.3, 1.0, 0.9, 1.1])[:, None]
    return Days(("load", "sun"), np.array([5.0, -2.0]), np.stack([load, sun], axis=1), off)


def test_a_mixture_is_recognised_whole_and_in_part() -> None:
    days = week()
    climate = fitted_climate(days, 1)
    np.testing.assert_allclose(climate.levels[1], [0.9, 0.0, 1.5], atol=1e-9)
    np.testing.assert_allclose(climate.levels[6], [0.0, 1.0, 1.1], atol=1e-9)
    np.testing.assert_allclose(climate.noise, 1.0, atol=1e-9)
    late = np.arange(15, SLOTS)
    mixed = np.stack([0.3 * WORK + 0.5 * OFF, 0.7 * SUN])
    np.testing.assert_allclose(climate.fitted(mixed[:, late], late), [0.3, 0.5, 0.7], atol=1e-9)


def test_without_loads_the_sun_alone_is_a_level() -> None:
    days = week()
    sun = Days(days.names[1:], days.size[1:], days.values[:, 1:], days.off)
    climate = fitted_climate(sun, 2)
    assert climate.basis.shape == (1, 1, SLOTS)
    np.testing.assert_allclose(climate.levels[:, 0], [0.2, 1.5, 1.0, 1.3, 1.0, 0.9, 1.1])


def test_what_sun_and_load_cancel_is_part_of_the_load() -> None:
    """A profile of as much sun as load has a mean day at work and one off, and none of the sun."""
    days = week()
    both = Days(("load", "both"), np.array([5.0, 0.0]), days.values, days.off)
    basis = fitted_climate(both, 1).basis
    means = days.values[:5].mean(axis=0), days.values[5:].mean(axis=0)
    np.testing.assert_allclose(basis, means)


def test_more_outcomes_than_days_leave_some_without_noise() -> None:
    days = week()
    rough = days.values * np.random.default_rng(0).uniform(0.8, 1.2, days.values.shape)
    noise = fitted_climate(Days(days.names, days.size, rough, days.off), 9).noise
    assert (noise[7:] == 1.0).all()
    assert (noise[:7] != 1.0).all()


def test_noise_keeps_the_mean_of_every_slot() -> None:
    days = week()
    rough = days.values * np.random.default_rng(0).uniform(0.8, 1.2, days.values.shape)
    noisy = Days(days.names, days.size, rough, days.off)
    climate = fitted_climate(noisy, 7)
    at = 9
    fit = np.array([[climate.profile(n, at, w) for n in days.names] for w in range(7)])
    order = np.argsort(
        (rough[:, :, at] - climate.levels @ climate.basis[:, :, at]) @ days.size, kind="stable"
    )
    said = np.einsum("wpl,wl->wp", fit, climate.levels[order])
    np.testing.assert_allclose(said, rough[order, :, at], rtol=1e-9)


def test_noise_goes_from_light_to_heavy_net_load() -> None:
    case = rs.load_case("ieee33-tou")
    climate = fitted_climate(past_days(case), 3)
    mean = climate.levels.mean(axis=0)
    net = np.einsum("l,lps,wps,p->ws", mean, climate.basis, climate.noise, climate.size)
    assert (np.diff(net, axis=0) > 0.0).all()


def test_nothing_is_learnt_from_test_days() -> None:
    case = rs.load_case("ieee33-tou")
    days = past_days(case)
    assert len(days.values) == 46
    first = held_out(case, 16).start
    assert str(first.date()) == "2016-08-16"
    assert days.off[:10].tolist() == [day in (1, 2, 8, 9) for day in range(10)]  # from Friday on
    again = past_days(held_out(case, 16))
    np.testing.assert_array_equal(days.values, again.values)


def test_a_case_without_a_file_is_its_own_climate() -> None:
    case = small_case(
        slots=6,
        step_min=240.0,
        load=[{"p_max_mw": 2.0, "shed_cost_per_mwh": 5.0, "profile": "demand"}],
        grid=[{"import_max_mw": 3.0, "import_cost_per_mwh": 1.0}],
        profiles={"demand": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]},
    )
    days = past_days(case)
    np.testing.assert_allclose(days.values[0, 0], case.profile("demand"))
    assert fitted_climate(days, 2).levels.tolist() == [pytest.approx([1.0])]
    assert (case.window.day_number(7), case.window.slot_of_day(7)) == (1, 1)


def test_a_slot_that_a_day_does_not_know_is_the_mean_of_the_others() -> None:
    """From 08:00 on in slots of 4 h: the first day has no slots 0 and 1, the last no slot 5."""
    demand = [0.35, 0.55, 0.9, 0.6, 0.2, 0.3, 0.4, 0.65, 0.8, 0.7, 0.28, 0.34, 0.46, 0.58, 0.96]
    case = small_case(
        start=datetime(2016, 7, 12, 8),
        slots=len(demand),
        step_min=240.0,
        load=[{"p_max_mw": 2.0, "shed_cost_per_mwh": 5.0, "profile": "demand"}],
        grid=[{"import_max_mw": 3.0, "import_cost_per_mwh": 1.5}],
        profiles={"demand": demand},
    )
    values = past_days(case).values[:, 0]
    np.testing.assert_allclose(values[0], [0.24, 0.32, 0.35, 0.55, 0.9, 0.6])
    np.testing.assert_allclose(values[1], [0.2, 0.3, 0.4, 0.65, 0.8, 0.7])
    np.testing.assert_allclose(values[2], [0.28, 0.34, 0.46, 0.58, 0.96, 0.65])
