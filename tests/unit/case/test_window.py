"""Slots, days and midnight: the facts of a horizon that everybody shares."""

from __future__ import annotations

from datetime import datetime

import pytest

from resilience.case.window import Window


def test_days_begin_at_midnight_whenever_the_horizon_does() -> None:
    window = Window(datetime(2024, 1, 1, 22, 30), 96, 15.0)
    assert window.slots_per_day == 96
    assert window.slots_before_start == 90
    assert [window.slot_of_day(t) for t in (0, 5, 6, 101, 102)] == [90, 95, 0, 95, 0]
    assert [window.day_number(t) for t in (0, 5, 6, 101, 102)] == [0, 0, 1, 1, 2]


@pytest.mark.parametrize(
    ("step_min", "minute", "meets"),
    [(15.0, 0, True), (15.0, 45, True), (15.0, 10, False), (7.0, 0, False), (2880.0, 0, False)],
)
def test_whether_slots_meet_midnight(step_min: float, minute: int, meets: bool) -> None:
    assert Window(datetime(2024, 1, 1, 0, minute), 4, step_min).meets_midnight is meets


def test_a_slot_longer_than_a_day_is_a_day() -> None:
    assert Window(datetime(2024, 1, 1), 2, 4320.0).slots_per_day == 1
