"""Modes that a two-stage program breaks, by hand, where who consumes is paid for it.

Load of 1 MW at bus 2 over three hours; the grid sells at 14, 11 and -5 $/MWh; the storage is empty,
holds 0.5 MWh, and keeps 80 % either way. In scenario 0, of probability 0.4, the line is down in the
second hour and 30 $ of load are shed; to have charged for that in the first would not pay. In the
third hour 0.625 MW are charged. Charging 1 MW and discharging 0.24 at once would consume 0.76.
"""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.backends.base import OutOfTimeError
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.two_stage.lshaped import DecompositionOptions, out_of_time
from resilience.planning.two_stage.modes import ModeSearch
from resilience.testing import small_case

BY_HAND = np.array([14.0 + 30.0 - 5.0 * 1.625, 14.0 + 11.0 - 5.0 * 1.625])
IN_TWO_MODES = np.array([14.0 + 30.0 - 5.0 * 1.76, 14.0 + 11.0 - 5.0 * 1.76])
CHANCE = np.array([0.4, 0.6])


def paid_to_consume() -> Case:
    return small_case(
        slots=3,
        buses=2,
        lines=[(1, 2, 0.0, 0.0)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 30.0, "bus": "2"}],
        grid=[
            {
                "import_max_mw": 10.0,
                "tariff": [["00:00", 14.0], ["01:00", 11.0], ["02:00", -5.0]],
            }
        ],
        ess=[
            {
                "bus": "2",
                "p_max_mw": 1.0,
                "p_min_mw": -1.0,
                "e_mwh": 0.5,
                "soc_min": 0.0,
                "soc_max": 1.0,
                "soc_initial": 0.0,
                "efficiency_charge": 0.8,
                "efficiency_discharge": 0.8,
            }
        ],
    )


def storms() -> Scenarios:
    down = np.zeros((1, 3, 2), bool)
    down[0, 1, 0] = True
    return Scenarios(("1-2",), down, CHANCE)


def planned(relative_gap: float, algorithm: str = "lshaped") -> ScenarioPlan:
    plan = rs.solve(
        paid_to_consume(),
        "stochastic",
        scenarios=storms(),
        common_slots=1,
        algorithm=algorithm,
        relative_gap=relative_gap,
    )
    assert isinstance(plan, ScenarioPlan)
    return plan


@pytest.mark.parametrize("algorithm", ["lshaped", "extensive"])
def test_no_mode_is_broken_and_what_is_proven_is_the_relaxed_program(algorithm: str) -> None:
    plan = planned(1e-4, algorithm)
    assert plan.relaxed == []
    assert plan.episodes["cost"] == pytest.approx(BY_HAND)
    assert plan.bound == pytest.approx(float(CHANCE @ IN_TWO_MODES))
    assert plan.status == "feasible"


def test_the_first_stage_is_not_searched_anew_where_its_plan_is_near_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def not_called(search: ModeSearch, solution: object) -> None:
        raise AssertionError("searched anew")

    monkeypatch.setattr(ModeSearch, "narrower", not_called)
    plan = planned(0.1)
    assert plan.relaxed == []
    assert plan.episodes["cost"] == pytest.approx(BY_HAND)
    with pytest.raises(AssertionError, match="searched anew"):
        planned(1e-4)


def test_an_error_names_the_limit_and_not_what_is_left_of_it() -> None:
    with pytest.raises(OutOfTimeError, match=r"within 1e-09 s\n"):
        rs.solve(
            paid_to_consume(),
            "stochastic",
            scenarios=storms(),
            algorithm="extensive",
            time_limit=1e-9,
        )
    left = DecompositionOptions(time_limit=2.0, total_time_limit=60.0)
    assert "within 60 s" in str(out_of_time(left))
    assert "within 2 s" in str(out_of_time(DecompositionOptions(time_limit=2.0)))
