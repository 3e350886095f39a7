"""What weighted scenarios are worth is said wherever a percentage of them is."""

from __future__ import annotations

import numpy as np
import pytest
from rich.console import Console

import resilience as rs
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import effective_number, worth
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.testing.cases import small_case
from resilience.text.scenario_plan import print_scenario_plan

WEIGHTS = np.array([0.6, 0.3, 0.1])  # 1 / (0.36 + 0.09 + 0.01) = 2.174


def test_the_effective_number_is_kishs() -> None:
    assert effective_number(WEIGHTS) == pytest.approx(1.0 / 0.46)
    assert effective_number(np.full(7, 1.0 / 7.0)) == pytest.approx(7.0)
    assert worth(WEIGHTS) == "worth 2.17 of 3 equally likely ones"
    assert worth(np.full(7, 1.0 / 7.0)) == ""
    assert worth(np.ones(1)) == ""


def storms(probability: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Scenarios:
    """Line 1-2 is out in none, one and two of three slots."""
    down = np.zeros((1, 3, 3), bool)
    down[0, 1:2, 1] = down[0, 1:, 2] = True
    return Scenarios(("1-2",), down, probability)


@pytest.mark.parametrize(("probability", "text"), [(WEIGHTS, "worth 2.17 of 3"), (None, "")])
def test_plans_over_weighted_scenarios_say_it(
    probability: np.ndarray[tuple[int], np.dtype[np.float64]] | None,
    text: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    drawn = storms(np.full(3, 1.0 / 3.0) if probability is None else probability)
    case = small_case(
        slots=3, buses=2, lines=[(1, 2, 0.01, 0.02)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        grid=[{"bus": "1", "import_max_mw": 5.0, "import_cost_per_mwh": 40.0}],
        load=[{"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 900.0}],
        ess=[{"bus": "2", "p_max_mw": 0.7, "e_mwh": 1.2, "soc_min": 0.1, "soc_max": 0.9,
              "soc_initial": 0.5, "efficiency_charge": 0.95, "efficiency_discharge": 0.93}],
    )  # fmt: skip
    plan = rs.solve(case, "stochastic", scenarios=drawn)
    assert isinstance(plan, ScenarioPlan)
    print_scenario_plan(plan, Console(width=200))
    shown = [line for line in capsys.readouterr().out.splitlines() if "of shedding" in line]
    assert len(shown) == 1
    assert text in shown[0]
    assert ("worth" in shown[0]) == bool(text)
    assert plan.effective_scenarios == pytest.approx(1.0 / (drawn.probability**2).sum())


def test_comparisons_over_weighted_scenarios_say_it() -> None:
    """A day of ieee33, on which line 5-6 is out for 0, 3 and 5 hours."""
    down = np.zeros((1, 96, 3), bool)
    down[0, 40:52, 1] = down[0, 40:60, 2] = True
    weighted = rs.compare("ieee33", ["idle"], days=1, scenarios=Scenarios(("5-6",), down, WEIGHTS))
    assert "weighted, worth 2.17 of 3 equally likely ones" in weighted.setting
