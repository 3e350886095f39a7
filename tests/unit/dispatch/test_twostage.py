"""Two-stage plans of cases: hand solutions, what information is worth, and what is kept on disk.

Load of 1 MW at bus 2 over two hours; the grid at bus 1 sells at 4 and then at 1 $/MWh; shedding
costs 10; the storage at bus 2 is empty, takes 1 MWh and loses nothing. In scenario 0, of
probability p, the line between them is down in the second hour. With x MWh charged in the first,
scenario 0 costs 4 (1 + x) + 10 (1 - x) = 14 - 6 x, scenario 1 costs 4 (1 + x) + 1 - x = 5 + 3 x.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import resilience as rs
from resilience.case import Case
from resilience.cli import app
from resilience.errors import InfeasibleError, UsageError
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.program.risk import Risk
from resilience.planning.scenarios.methods import solve_scenario_program, wait_and_see
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.scenarios.program import DistinctScenarios, scenario_program
from resilience.simulation.world import microgrid_with_fallible_lines
from resilience.testing import small_case

ALGORITHMS = ("extensive", "lshaped")


def case(**changes: object) -> Case:
    tables = {
        "load": [{"p_max_mw": 1.0, "shed_cost_per_mwh": 10.0, "bus": "2"}],
        "grid": [{"import_max_mw": 10.0, "tariff": [["00:00", 4.0], ["01:00", 1.0]]}],
        "ess": [
            {
                "bus": "2",
                "p_max_mw": 1.0,
                "p_min_mw": -1.0,
                "e_mwh": 1.0,
                "soc_min": 0.0,
                "soc_max": 1.0,
                "soc_initial": 0.0,
                "efficiency_charge": 1.0,
                "efficiency_discharge": 1.0,
            }
        ],
    }
    return small_case(
        buses=2,
        lines=[(1, 2, 0.0, 0.0)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        **(tables | changes),  # type: ignore[arg-type]
    )


def storms(p: float) -> Scenarios:
    down = np.zeros((1, 2, 2), bool)
    down[0, 1, 0] = True
    return Scenarios(("1-2",), down, np.array([p, 1.0 - p]))


def solve(p: float, **options: object) -> ScenarioPlan:
    plan = rs.solve(case(), "stochastic", scenarios=storms(p), **options)  # type: ignore[call-overload]
    assert isinstance(plan, ScenarioPlan)
    assert plan.status == "optimal"
    assert plan.bound <= plan.objective
    assert max(plan.audit.values()) < 1e-9
    return plan


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_likely_outage_is_prepared_for(algorithm: str) -> None:
    """p = 0.4: 8.6 - 0.6 x, so x = 1 and both cost 8. Mean data shows no scarcity: x = 0."""
    plan = solve(0.4, algorithm=algorithm)
    assert plan.objective == pytest.approx(8.0)
    assert plan.bound == pytest.approx(8.0)
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.episodes["cost"] == pytest.approx([8.0, 8.0])
    assert plan.tables["energy"].values[0, 0] == pytest.approx(1.0)
    assert plan.mean_value_cost == pytest.approx(8.6)
    assert plan.value_of_stochastic_solution == pytest.approx(0.6)
    # Known beforehand, scenario 0 costs 8 and scenario 1 costs 5.
    assert plan.clairvoyant_cost == pytest.approx(0.4 * 8.0 + 0.6 * 5.0)
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.value_of_perfect_information == pytest.approx(1.8)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_an_unlikely_outage_is_not(algorithm: str) -> None:
    """p = 0.25: 7.25 + 0.75 x."""
    plan = solve(0.25, algorithm=algorithm)
    assert plan.objective == pytest.approx(7.25)
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.episodes["cost"] == pytest.approx([14.0, 5.0])
    assert plan.episodes["shed_mwh"] == pytest.approx([1.0, 0.0])
    assert plan.expected_shed_mwh == pytest.approx(0.25)
    assert plan.shed_probability == pytest.approx(0.25)
    assert plan.value_of_stochastic_solution == pytest.approx(0.0, abs=1e-9)
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.value_of_perfect_information == pytest.approx(7.25 - (0.25 * 8.0 + 0.75 * 5.0))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("weight", "objective", "charged"), [(0.2, 7.7, 0.0), (0.5, 8.0, 1.0)])
def test_risk_prepares_for_it(
    algorithm: str, weight: float, objective: float, charged: float
) -> None:
    """p = 0.25, alpha = 0.5: CVaR is half of either cost, 9.5 - 1.5 x; it wins beyond a third."""
    plan = solve(0.25, algorithm=algorithm, risk=f"cvar:0.5:{weight}")
    assert plan.objective == pytest.approx(objective)
    assert plan.bound == pytest.approx(objective)
    assert plan.tables["energy"].values[0, 0] == pytest.approx(charged)


def test_scenarios_part_when_they_differ() -> None:
    plan = solve(0.4)
    assert plan.episodes["leaves_slot"].tolist() == [1, 2]
    assert plan.tables["staying"].values[0] == pytest.approx([1.0, 0.6])
    assert plan.common_slots == 2
    assert solve(0.4, common_slots=1).objective == pytest.approx(plan.objective)
    assert solve(0.4, common_slots=1).common_slots == 1
    with pytest.raises(UsageError, match="scenario 0 has an outage of its own from slot 1"):
        rs.solve(case(), "stochastic", scenarios=storms(0.4), common_slots=2)


def test_a_certain_storm_is_the_deterministic_plan() -> None:
    plan = rs.solve(case(), "stochastic", outages="1-2@01:00-02:00")
    known = rs.solve(case(), "lp", outages="1-2@01:00-02:00")
    assert plan.objective == pytest.approx(known.objective)
    assert plan.objective == pytest.approx(8.0)
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.value_of_perfect_information == pytest.approx(0.0, abs=1e-9)


def test_alike_scenarios_are_solved_once() -> None:
    down = np.repeat(storms(0.5).down, 3, axis=2)
    many = Scenarios(("1-2",), down, np.array([0.1, 0.2, 0.1, 0.3, 0.1, 0.2]))
    plan = rs.solve(case(), "stochastic", scenarios=many)
    assert plan.objective == pytest.approx(8.0)
    assert isinstance(plan, rs.ScenarioPlan)
    assert (plan.scenarios, plan.different) == (6, 2)
    assert plan.episodes["leaves_slot"].tolist() == [1, 1, 1, 2, 2, 2]


def test_dispatchers_are_judged_on_the_same_scenarios() -> None:
    """Idle leaves the storage empty: x = 0."""
    plan = rs.solve(case(), "idle", scenarios=storms(0.4))
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.episodes["cost"] == pytest.approx([14.0, 5.0])
    assert plan.objective == pytest.approx(8.6)
    assert plan.bound == pytest.approx(6.2)
    assert plan.tables["staying"].values[0] == pytest.approx([1.0, 0.6])
    choices: tuple[dict[str, Any], ...] = ({"risk": "mean"}, {"physics": "lindistflow"})
    for words in choices:
        with pytest.raises(UsageError):
            rs.solve(case(), "idle", scenarios=storms(0.4), **words)


def test_a_scenario_that_admits_nothing_is_named() -> None:
    """PV that must be taken, 3 MW against a load of 1 MW, in an island that a generator forms."""
    sun = [{"bus": "2", "p_max_mw": 3.0, "curtailable": False}]
    unit = [{"bus": "2", "p_max_mw": 0.4, "cost_per_mwh": 6.0}]
    grid = [{"import_max_mw": 10.0, "export_max_mw": 10.0, "import_cost_per_mwh": 1.0}]
    for algorithm in ALGORITHMS:
        with pytest.raises(InfeasibleError, match="in scenario 0"):
            rs.solve(
                case(pv=sun, grid=grid, generator=unit),
                "stochastic",
                scenarios=storms(0.4),
                algorithm=algorithm,
            )


def test_integers_are_held_in_one_piece_and_said_to_be_relaxed_when_cut() -> None:
    """Half a MW of load cannot be served by a generator that gives 0.8 MW at least: it is shed.

    The first hour costs 2, the second 0.5 with the grid; without it 5, relaxed 0.5 MWh at 6 and a
    quarter of an hour at 0.4, as the unit gives 2 MW at most.
    """
    load = [{"p_max_mw": 0.5, "shed_cost_per_mwh": 10.0, "bus": "2"}]
    unit = {"p_min_mw": 0.8, "p_max_mw": 2.0, "cost_per_mwh": 6.0, "bus": "2"}
    unit |= {"no_load_cost_per_h": 0.4}
    made = case(load=load, generator=[unit], ess=[])
    whole, cut = (
        rs.solve(made, "stochastic", scenarios=storms(0.4), algorithm=name) for name in ALGORITHMS
    )
    assert whole.objective == pytest.approx(2.0 + 0.4 * 5.0 + 0.6 * 0.5)
    assert whole.relaxed == []
    assert cut.objective == pytest.approx(2.0 + 0.4 * (3.0 + 0.25 * 0.4) + 0.6 * 0.5)
    assert cut.relaxed == [
        "integrality: 1 of 4 integers fractional, by 0.25 at most, in 1 of 2 scenarios"
    ]
    assert cut.bound is not None
    assert cut.bound <= whole.objective


@pytest.fixture(scope="module")
def feeder() -> Case:
    return rs.load_case("ieee33-tou").replace(slots=40, outages=())


@pytest.mark.parametrize("risk", [Risk(), Risk(0.8, 0.6)], ids=str)
def test_storms_that_leave_one_by_one(feeder: Case, risk: Risk) -> None:
    """The L-shaped method is the extensive form where scenarios leave in slots of their own."""
    drawn = sample_bell(feeder, Bell(centres=(16, 24, 30), duration_slots=(4, 9)), 12, 3)
    weights = np.random.default_rng(0).random(12)
    scenarios = Scenarios(drawn.lines, drawn.down, weights / weights.sum())
    program = scenario_program(
        microgrid_with_fallible_lines(feeder, scenarios, "copperplate"),
        DistinctScenarios.among(scenarios, feeder),
        risk=risk,
    )
    assert len(set(program.leaves)) > 3
    cut, whole = (
        solve_scenario_program(program, algorithm=name, relative_gap=1e-8)
        for name in ("lshaped", "extensive")
    )
    assert cut.solution.objective == pytest.approx(whole.solution.objective, rel=1e-7)
    assert cut.mean_value_cost == pytest.approx(whole.mean_value_cost, rel=1e-7)
    assert cut.mean_value_cost is not None
    assert cut.mean_value_cost >= cut.stochastic_cost - 1e-9
    assert (
        risk.value(wait_and_see(program), program.distinct.probability) <= cut.solution.bound + 1e-6
    )


def test_lindistflow_costs_no_less_than_copperplate(feeder: Case) -> None:
    scenarios = sample_bell(feeder, Bell(centres=(16, 24, 30)), 3, 1)
    plans = [
        rs.solve(feeder, "stochastic", scenarios=scenarios, physics=physics, algorithm="lshaped")
        for physics in ("copperplate", "lindistflow")
    ]
    assert plans[0].bound is not None
    assert plans[1].objective >= plans[0].bound - 1e-6
    assert plans[1].relaxed == []
    assert max(plans[1].audit.values()) < 1e-6
    with pytest.raises(UsageError, match="cones"):
        rs.solve(feeder, "stochastic", scenarios=scenarios, physics="distflow")


def test_a_plan_comes_back_from_disk(tmp_path: Path) -> None:
    plan = solve(0.4)
    plan.save(tmp_path / "run")
    again = rs.load_scenario_plan(tmp_path / "run")
    assert again.summary() == plan.summary()
    assert again.tables.keys() == plan.tables.keys()
    for name in (*plan.tables, "band_energy", "band_shed", "scenarios", "recourse"):
        assert again.frame(name).equals(plan.frame(name)), name
    assert again.outages is not None
    assert plan.outages is not None
    assert (again.outages.down == plan.outages.down).all()
    assert rs.plot_scenario_plan(again, tmp_path / "plan.png").axes
    with pytest.raises(UsageError, match="another kind of result"):
        rs.load_plan(tmp_path / "run")
    rs.solve(case(), "lp").save(tmp_path / "lp")
    with pytest.raises(UsageError, match="no plan over scenarios"):
        rs.load_scenario_plan(tmp_path / "lp")


def test_bands_are_of_the_scenarios() -> None:
    plan = solve(0.4)
    energy = plan.bands["energy"].values
    assert energy[:, 0] == pytest.approx([1.0, 1.0, 1.0])  # all have charged
    assert energy[:, 1] == pytest.approx([0.0, 0.0, 0.0])  # used in the outage, or sold at the end


@pytest.mark.parametrize("method", ["stochastic", "rule"])
def test_the_command_takes_a_file_of_scenarios(tmp_path: Path, method: str) -> None:
    drawn = sample_bell(rs.load_case("ieee33-tou"), Bell(), 3, 1)
    drawn.save(tmp_path / "storms.csv")
    words = ["solve", "ieee33-tou", "--method", method, "--outages", str(tmp_path / "storms.csv")]
    done = CliRunner().invoke(app, [*words, "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["scenarios"] == 3
    assert answer["bound"] <= answer["objective"] + 1e-9
    text = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "run")]).stdout
    assert "To do until an outage shows" in text
    drawn_again = CliRunner().invoke(app, ["plot", str(tmp_path / "run")])
    assert drawn_again.exit_code == 0
    assert (tmp_path / "run" / "plan.png").stat().st_size > 10_000


def test_given_scenarios_are_not_drawn_again() -> None:
    for words in ({"seed": 1}, {"outages": "bell"}):
        with pytest.raises(UsageError, match="one of the two"):
            rs.solve(case(), "stochastic", scenarios=storms(0.4), **words)
    with pytest.raises(UsageError, match="takes no risk"):
        rs.solve(case(), "lp", risk="mean")


def test_a_plan_that_knew_its_outages_says_so() -> None:
    words = ["solve", "ieee33", "--method", "lp", "--outages"]
    knew = CliRunner().invoke(app, [*words, "6-26@14:00-17:30"]).stdout.splitlines()[-1]
    assert knew == "This plan knew its outages; the operator's plan is --method stochastic."
    calm = CliRunner().invoke(app, [*words, "none"]).stdout
    assert "operator's plan" not in calm
