"""A plan over few scenarios in all that they stand for: by hand, and by a program of SciPy's.

Load of 1 MW at bus 2; the grid at bus 1 sells at 4 and then at 1 $/MWh, shedding costs 10 $/MWh;
the storage at bus 2 is empty and loses nothing. In a storm the line between is down.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import resilience as rs
from resilience.arrays import Bools, Floats
from resilience.case import Case
from resilience.fragility.outages.reduction import reduced
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import standard_error
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.scenarios.solve import NOT_SIMULATED
from resilience.testing import small_case

SHED, E_MAX = 10.0, 3.0


def case(slots: int = 2, e_mwh: float = 1.0) -> Case:
    return small_case(
        slots=slots,
        buses=2,
        lines=[(1, 2, 0.0, 0.0)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": SHED, "bus": "2"}],
        grid=[{"import_max_mw": 10.0, "tariff": [["00:00", 4.0], ["01:00", 1.0]]}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": e_mwh, "soc_initial": 0.0}],
    )


def storms(p: float) -> Scenarios:
    """The line is down in the second hour, with probability p."""
    down = np.zeros((1, 2, 2), bool)
    down[0, 1, 0] = True
    return Scenarios(("1-2",), down, np.array([p, 1.0 - p]))


def plan_over(few: Scenarios, the_case: Case, **options: object) -> ScenarioPlan:
    plan = rs.solve(the_case, "stochastic", scenarios=few, **options)  # type: ignore[call-overload]
    assert isinstance(plan, ScenarioPlan)
    return plan


def test_a_plan_for_calm_is_judged_in_the_storm() -> None:
    """With x MWh charged a storm costs 4 (1 + x) + 10 (1 - x), calm 4 (1 + x) + 1 - x. At 20 %
    nothing is charged: 14 and 5 $. Over all, at 90 %: 0.9 * 14 + 0.1 * 5, and 0.9 MWh is shed.
    """
    plan = plan_over(replace(storms(0.2), represents=storms(0.9)), case())
    assert plan.objective == pytest.approx(0.2 * 14 + 0.8 * 5)
    assert plan.bound_of == "two-stage program on copperplate, the reduced set"
    over_all = plan.unreduced
    assert over_all is not None
    assert over_all.scenarios == 2
    assert over_all.expected_cost == over_all.objective == pytest.approx(0.9 * 14 + 0.1 * 5)
    assert over_all.expected_shed_mwh == pytest.approx(0.9)
    assert over_all.shed_probability == pytest.approx(0.9)
    # Kish: 1 / 0.82 scenarios; deviations of 0.9 and 8.1 $.
    levels = 1.0 / 0.82
    error = np.sqrt(levels / (levels - 1.0) * (0.81 * 0.9**2 + 0.01 * 8.1**2))
    assert over_all.cost_error == pytest.approx(error)
    assert over_all.shed_error == pytest.approx(error / 9.0)


def test_scenarios_that_stand_for_themselves_have_no_other_cost() -> None:
    plan = plan_over(storms(0.2), case())
    assert plan.unreduced is None
    assert plan.represented is None
    assert "unreduced" not in plan.summary()
    assert plan.bound_of == "two-stage program on copperplate"


def by_scipy(up: Bools, energy: Floats, leaves: int) -> tuple[float, float]:
    """Cost in $ and MWh shed of one storm, stored energy being the plan's until it leaves.

    Hours of import g, charging c, discharging d, shedding s, energy e at the end:
    g + d + s = 1 + c, e' = e + c - d, g = 0 while the line is down.
    """
    n = len(up)
    price = np.where(np.arange(n) == 0, 4.0, 1.0)
    cost = np.concatenate([price, np.zeros(2 * n), np.full(n, SHED), np.zeros(n)])
    eye, zero = np.eye(n), np.zeros((n, n))
    balance = np.hstack([eye, -eye, eye, eye, zero])
    stored = np.hstack([zero, -eye, eye, zero, eye - np.eye(n, k=-1)])
    high = np.concatenate([10.0 * up, np.ones(3 * n), np.full(n, E_MAX)])
    low = np.zeros(5 * n)
    low[4 * n : 4 * n + leaves] = high[4 * n : 4 * n + leaves] = energy[:leaves]
    answer = linprog(
        cost, A_eq=np.vstack([balance, stored]), b_eq=np.repeat([1.0, 0.0], n),
        bounds=np.column_stack([low, high]),
    )  # fmt: skip
    assert answer.status == 0
    return answer.fun, answer.x[3 * n : 4 * n].sum()


@pytest.mark.parametrize("k", [2, 5])
@pytest.mark.parametrize("seed", range(3))
def test_the_cost_over_all_is_that_of_a_program_for_every_storm(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    first, length = rng.integers(0, 10, 40), rng.integers(0, 5, 40)
    hour = np.arange(8)[:, None]
    down = ((hour >= first) & (hour < first + length))[None]
    weight = rng.uniform(1, 2, 40)
    everything = Scenarios(("1-2",), down, weight / weight.sum())
    few = reduced(everything, k)
    plan = plan_over(few, case(8, E_MAX))
    energy, common = plan.tables["energy"].values[0], plan.common_slots
    expected = [
        by_scipy(~path, energy, min(int(path.argmax()) if path.any() else 8, common))
        for path in down[0].T
    ]
    cost, shed = np.array(expected).T
    over_all = plan.unreduced
    assert over_all is not None
    assert over_all.expected_cost == pytest.approx(everything.probability @ cost, abs=1e-6)
    assert over_all.expected_shed_mwh == pytest.approx(everything.probability @ shed, abs=1e-6)
    error = standard_error(cost, everything.probability)
    assert over_all.cost_error == pytest.approx(error, rel=1e-5)


def test_a_schedule_for_the_first_slots_ends_there_for_all() -> None:
    """One common slot: behind it every storm is known, the calm one too."""
    plan = plan_over(replace(storms(0.2), represents=storms(0.9)), case(), common_slots=1)
    assert plan.unreduced is not None
    assert plan.unreduced.expected_cost == pytest.approx(0.9 * 14 + 0.1 * 5)


def test_standard_errors_are_those_of_the_textbook() -> None:
    x = np.random.default_rng(2).normal(size=50)
    found = standard_error(x, np.full(50, 0.02))
    assert found == pytest.approx(x.std(ddof=1) / np.sqrt(50))
    assert np.isnan(standard_error(x[:1], np.ones(1)))


def test_what_is_printed_and_kept_says_what_it_is_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from resilience.text.console import plain_console
    from resilience.text.scenario_plan import print_scenario_plan

    plan = plan_over(replace(storms(0.2), represents=storms(0.9)), case())
    print_scenario_plan(plan, plain_console())
    printed = " ".join(capsys.readouterr().out.split())
    assert "over 2 scenarios that stand for 2" in printed
    assert "(two-stage program on copperplate, the reduced set)" in printed
    assert "over all 2 this plan costs 13.10 ±" in printed
    assert "sheds 0.900 ±" in printed
    plan.save(tmp_path / "plan")
    again = rs.load_scenario_plan(tmp_path / "plan")
    assert again.unreduced == plan.unreduced
    assert again.represented == 2


def test_a_dispatcher_says_that_it_met_the_few_alone() -> None:
    few = replace(storms(0.2), represents=storms(0.9))
    plan = rs.solve(case(), "rule", scenarios=few)
    assert isinstance(plan, ScenarioPlan)
    assert plan.unreduced is None
    assert NOT_SIMULATED in plan.notes
