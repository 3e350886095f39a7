"""Which days are trained on: never those of tests."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="learners need torch")

import resilience as rs  # noqa: E402
from resilience.case.days import held_out, training  # noqa: E402
from resilience.case.profiles import read_profile_file  # noqa: E402
from resilience.rl.ground import episodes  # noqa: E402
from resilience.rl.training.trainer import LogRow, Training, TrainingOptions  # noqa: E402
from resilience.testing import small_case  # noqa: E402


def weights(case: rs.Case) -> dict[str, Any]:
    """What two iterations and a validation make of a network."""
    rows: list[LogRow] = []
    options = TrainingOptions(
        iterations=2, validations=1, forecast_error="ar1", settings={"batch": 6}
    )
    made = Training(case, options)
    made.run(lambda row, _: rows.append(row), lambda: None)
    assert len(rows) == 1
    assert math.isfinite(rows[0].cost_per_day)
    return {name: value.clone() for name, value in made.learner.weights().items()}


def test_training_does_not_change_where_test_days_are_blotted_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(episodes, "VALIDATION_STORMS", 1)
    monkeypatch.setattr(episodes, "VALIDATION_DAYS", 2)
    monkeypatch.setattr(episodes, "STORMS", 30)
    case = rs.load_case("ieee33-tou").replace(slots=4)
    before = weights(case)
    file = read_profile_file(Path(case.source["profiles"]["file"]))
    days = len(file.times) // 96
    first = (days - math.ceil(days / 4)) * 96
    for name in case.profiles:
        if not name.startswith("tariff"):
            blotted = file.column(name).copy()
            blotted[first:] = np.nan
            monkeypatch.setitem(file._numbers, name, blotted)
    with pytest.raises(rs.CaseError):
        held_out(case, 1)
    after = weights(case)
    assert before.keys() == after.keys()
    for name, value in before.items():
        assert torch.isfinite(value).all()
        assert torch.equal(value, after[name])


def test_training_days_end_where_test_days_may_begin() -> None:
    """46 of 62 days; the largest test is the last 16."""
    case = rs.load_case("ieee33-tou")
    assert training(case).slots == 46 * 96
    assert training(case).window.time(46 * 96) == held_out(case, 16).start


def hourly(slots: int) -> rs.Case:
    """A load on a grid."""
    return small_case(
        slots=slots,
        load=[{"p_max_mw": 1.3, "shed_cost_per_mwh": 5.0}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.15}],
    )


def test_a_case_without_a_file_trains_on_what_precedes_its_last_quarter() -> None:
    assert training(hourly(5 * 24)).slots == 3 * 24
    with pytest.raises(rs.UsageError, match="allowed: a day or more before it"):
        training(hourly(24))


def test_a_storm_keeps_its_horizon_and_forgets_the_outages_to_plan_for() -> None:
    case = rs.load_case("ieee33_koinu")
    assert training(case).slots == case.slots
    assert training(case).start == case.start
    assert training(case).outages == ()


def test_an_episode_longer_than_the_training_days_is_refused() -> None:
    with pytest.raises(rs.UsageError, match="allowed: up to 38, the days for training"):
        episodes.EpisodeSampler(rs.load_case("ieee33-tou"), days=39, storms=2)
