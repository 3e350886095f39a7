"""The bell: heights, chances, and what the step does to them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from resilience.case import load_case
from resilience.errors import UsageError
from resilience.fragility import Bell, case_bell, outages_from


def test_the_height_follows_from_the_target() -> None:
    assert Bell().p_max == pytest.approx(0.152, abs=5e-4)
    assert Bell(sigma_slots=8).p_max == pytest.approx(0.078, abs=5e-4)
    assert Bell(probability=0.0).p_max == 0.0
    assert float(Bell().day_probability(48)) == pytest.approx(0.8, abs=1e-9)


@pytest.mark.parametrize(
    ("height", "sigma", "chance"),
    [(0.1, 4, 0.647), (0.1, 8, 0.875), (0.3, 4, 0.966), (0.3, 8, 0.999), (0.5, 4, 0.998)],
)
def test_the_target_follows_from_the_height(height: float, sigma: float, chance: float) -> None:
    bell = Bell(height=height, sigma_slots=sigma)
    assert float(bell.day_probability(48)) == pytest.approx(chance, abs=5e-4)
    again = Bell(probability=float(bell.day_probability(48)), sigma_slots=sigma)
    assert again.p_max == pytest.approx(height, rel=1e-6)


def test_midnight_cuts_the_bell_unless_it_goes_round() -> None:
    chance = Bell().day_probability(Bell().centre_slots())
    assert chance.mean() == pytest.approx(0.787, abs=5e-4)
    assert chance[0] < 0.6
    assert chance[20:76].min() > 0.79
    assert Bell(wrap=True).day_probability(Bell().centre_slots()) == pytest.approx(0.8, abs=1e-9)


@pytest.mark.parametrize("step_min", [60.0, 30.0, 7.5, 5.0, 1.0])
def test_a_rate_does_not_depend_on_the_step(step_min: float) -> None:
    bell = Bell(rate=True)
    centres = bell.centre_slots()
    usual = bell.day_probability(centres)
    assert bell.day_probability(centres, step_min) == pytest.approx(usual, abs=1e-6)
    assert usual[48] == pytest.approx(0.8, abs=1e-9)
    assert usual == pytest.approx(Bell().day_probability(centres), abs=1e-3)


def test_a_draw_per_slot_does() -> None:
    """The paper's process, halved: 1 - 0.2², not 0.8. The documented exception."""
    assert float(Bell().day_probability(48, 7.5)) == pytest.approx(1 - 0.2**2, abs=1e-6)
    assert float(Bell().day_probability(48, 30.0)) == pytest.approx(1 - 0.2**0.5, abs=1e-3)


@pytest.mark.parametrize("sigma", [0.5, 0.7, 2.0, 20.0])
def test_a_rate_reaches_its_target_at_any_width(sigma: float) -> None:
    bell = Bell(rate=True, sigma_slots=sigma)
    if sigma < 12:
        assert float(bell.day_probability(48)) == pytest.approx(0.8, abs=1e-4)
    assert float(bell.day_probability(48, 60.0)) == pytest.approx(
        float(bell.day_probability(48, 3.0)), abs=1e-3
    )


def test_every_wrong_setting_is_named() -> None:
    with pytest.raises(UsageError) as caught:
        Bell(probability=1.0, sigma_slots=0.0, duration_slots=(5, 4), centres=(96,))
    for words in ("probability 1.0", "sigma_slots 0.0", "duration_slots (5, 4)", "centres (96,)"):
        assert words in str(caught.value)
    with pytest.raises(UsageError, match="cannot be reached"):
        Bell(rate=True, sigma_slots=0.2)


def test_chances_are_chances() -> None:
    chance = Bell(height=0.99, rate=True).slot_probability(np.arange(96), 60.0)
    assert chance.shape == (96, 24)
    assert ((chance >= 0) & (chance < 1)).all()


def test_the_bell_of_a_case() -> None:
    case = load_case("ieee33-long")
    cut = Bell(duration_slots=(24, 48), centres=case.outage.centres, overnight=False)
    assert case_bell(case) == cut
    assert case_bell(load_case("ieee33-wide")).p_max == pytest.approx(0.078, abs=5e-4)
    changed = case_bell(case, sigma_slots=2.0, rate=None)
    assert changed == replace(cut, sigma_slots=2.0)
    drawn = [o for seed in range(5) for o in outages_from("bell", case, seed)]
    assert drawn
    assert all(24 <= o.stop - o.first <= 48 or o.stop == 96 for o in drawn)


def test_a_bell_says_in_words_what_it_is() -> None:
    assert str(Bell()) == (
        "bell of hazard each day, 80 % that a line fails, sigma 60 min, down for 3 to 3.75 h, "
        "further lines up to 45 min apart"
    )
    changes: list[dict[str, Any]] = [
        {"probability": 0.7}, {"height": 0.1}, {"sigma_slots": 5.0}, {"duration_slots": (12, 16)},
        {"duration_law": "lognormal"}, {"shift_slots": 0}, {"shared_shift": True},
        {"common_draw": True}, {"refail": True}, {"wrap": True}, {"overnight": False},
        {"centres": (40,)}, {"centre_error_slots": 2}, {"rate": True},
    ]  # fmt: skip
    assert {key for change in changes for key in change} == {f.name for f in fields(Bell)}
    texts = {str(Bell()), *(str(Bell(**change)) for change in changes)}
    assert len(texts) == 1 + len(changes)
