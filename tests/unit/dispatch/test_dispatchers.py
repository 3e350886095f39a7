"""Dispatchers on the same storms: the bound holds, rules do what they say, programs are right."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import held_out
from resilience.dispatch.mpc import BlindMPC
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.rules import Greedy, Rule
from resilience.dispatch.stochastic import Stochastic
from resilience.dispatch.window_program import LATER
from resilience.errors import UsageError
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.evaluation.compare import compare
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.models.program.risk import Risk
from resilience.simulation.observation import Observation
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.unit.dispatch import blackouts

VALUE = 0.35
QUICK = sorted(set(DISPATCHERS) - {"sddp", "comb"})
"""Without those whose own tests say the same: one trains first, one is for blackouts alone."""


SPLIT = 52


@pytest.fixture(scope="module")
def world() -> World:
    """A test day up to 15:00 in two storms, which have outages before and after 13:00."""
    day = held_out(rs.load_case("ieee33-tou"), 1)
    storms = sample_bell(day, Bell(), 3, 5)
    down = storms.down[:, :60, 1:]
    assert down[:, :SPLIT].any()
    assert (down[:, SPLIT:] & ~down[:, [SPLIT - 1]]).any()
    centre = None if storms.centre is None else storms.centre[:, 1:]
    return World.build(
        Microgrid.build(day.replace(slots=60), "copperplate"),
        Scenarios(storms.lines, down, np.full(2, 0.5), centre),
        end_value_per_mwh=VALUE,
    )


@pytest.fixture(scope="module")
def runs(world: World) -> Callable[[str], Trajectory]:
    """What a dispatcher does in that world, once for all tests."""
    return cache(lambda name: simulate(world, DISPATCHERS[name](world.setting)))


@pytest.mark.parametrize("name", QUICK)
def test_nobody_beats_the_clairvoyant_bound(
    world: World, runs: Callable[[str], Trajectory], name: str
) -> None:
    bound = clairvoyant(world)
    assert (runs(name).objective(VALUE) >= bound.objective - 1e-6).all()


@pytest.mark.parametrize("name", QUICK)
def test_nobody_sees_the_future(world: World, runs: Callable[[str], Trajectory], name: str) -> None:
    """Storms that differ only from 13:00 on are met alike until then."""
    storms = world.scenarios
    calm = storms.down.copy()
    calm[:, SPLIT:] = False
    other = Scenarios(storms.lines, calm, storms.probability, storms.centre)
    elsewhere = World(world.microgrid, world.simulator, other, VALUE)
    run = simulate(elsewhere, DISPATCHERS[name](elsewhere.setting))
    np.testing.assert_allclose(runs(name).storage[:, :SPLIT], run.storage[:, :SPLIT], atol=1e-7)


def test_the_bound_is_reached_by_its_own_decisions(world: World) -> None:
    bound = clairvoyant(world)
    run = simulate(world, Replay("clairvoyant", bound.charging))
    np.testing.assert_allclose(run.objective(VALUE), bound.objective, rtol=1e-6)


def test_the_rule_reaches_its_level_and_holds_it() -> None:
    calm = held_out(rs.load_case("ieee33"), 1)
    none = Scenarios(("1-2",), np.zeros((1, calm.slots, 1), bool), np.ones(1))
    world = World.build(Microgrid.build(calm, "copperplate"), none)
    run = simulate(world, Rule(world.setting, 0.9))
    size = np.array([unit.e_mwh for unit in calm.ess])
    np.testing.assert_allclose(run.energy[:, 16:, 0] / size[:, None], 0.9, atol=1e-9)
    assert run.storage[:, 20:].max() == pytest.approx(0.0, abs=1e-9)


def test_greedy_serves_the_net_demand_of_its_island() -> None:
    case = small_case(
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}],
        pv=[{"p_max_mw": 1.6, "profile": "sun"}],
        ess=[{"p_max_mw": 2.0, "e_mwh": 4.0, "soc_initial": 0.5}] * 2,
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
        profiles={"sun": [0.0, 1.0]},
    )
    none = Scenarios((), np.zeros((0, 2, 1), bool), np.ones(1))
    world = World.build(Microgrid.build(case, "copperplate"), none)
    run = simulate(world, Greedy(world.setting))
    assert run.storage[:, 0, 0] == pytest.approx([0.5, 0.5])
    assert run.storage[:, 1, 0] == pytest.approx([-0.3, -0.3])
    assert run.cost.sum() == pytest.approx(0.0)


def two_stores(grid: bool) -> World:
    """Half hours with two unequal stores, a generator and sun, with a grid or without."""
    case = small_case(
        slots=4,
        step_min=30.0,
        load=[{"p_max_mw": 1.2, "shed_cost_per_mwh": 5.0, "profile": "demand"}],
        pv=[{"p_max_mw": 2.0, "profile": "sun"}],
        generator=[{"p_max_mw": 0.5, "cost_per_mwh": 2.0}],
        ess=[
            {"p_max_mw": 1.5, "p_min_mw": -0.8, "e_mwh": 4.0, "soc_initial": 0.55}
            | {"efficiency_charge": 0.9, "efficiency_discharge": 0.8},
            {"p_max_mw": 0.5, "p_min_mw": -0.4, "e_mwh": 3.0, "soc_initial": 0.3},
        ],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 1.0}] if grid else [],
        profiles={"demand": [1.0, 0.25, 0.375, 0.5], "sun": [0.05, 0.55, 0.025, 0.3]},
    )
    none = Scenarios((), np.zeros((0, 4, 1), bool), np.ones(1))
    return World.build(Microgrid.build(case, "copperplate"), none)


def test_in_an_island_the_rule_gives_what_generators_cannot_and_takes_what_is_over() -> None:
    """1.1 MW net are 0.6 after the generator, half of 1.2; -0.8 are 0.4 of what they take.

    0.4 MW net leave the generator with 0.1 to spare, and storage still.
    """
    world = two_stores(grid=False)
    for dispatcher in (Rule(world.setting, 0.7), Greedy(world.setting, generators_first=True)):
        run = simulate(world, dispatcher)
        assert run.storage[:, :3, 0].T.tolist() == [
            pytest.approx([0.4, 0.2]),
            pytest.approx([-0.6, -0.2]),
            pytest.approx([0.0, 0.0]),
        ]


def test_demand_that_cannot_be_served_asks_nothing_of_storage() -> None:
    """Of 1.1 MW net 0.3 have to be shed: 0.8 MW are two thirds of the 1.2 that stores can give."""
    world = two_stores(grid=False)
    energy, now = world.start(), world.slot(0)
    cut_off = {**now.data, "load.shed_min": now.data["load.shed_min"] + 0.3}
    seen = Observation(
        0, energy, np.ones((0, 1), bool), now.island, np.array([-1]), world.forecast(0),
        world.simulator.stacked(cut_off),
    )  # fmt: skip
    assert Greedy(world.setting).act(seen)[:, 0] == pytest.approx([-1.6 / 3.0, -0.8 / 3.0])


def test_with_a_grid_the_rule_goes_to_its_level_and_reckons_with_losses() -> None:
    """From 2.2 to 2 MWh: 0.2 * 0.8 / 0.5 h; from 0.9 towards 1.5 MWh by 0.5 MW: three slots."""
    world = two_stores(grid=True)
    run = simulate(world, Rule(world.setting, 0.5))
    assert run.storage[:, :, 0].tolist() == [
        pytest.approx([0.32, 0.0, 0.0, 0.0], abs=1e-9),
        pytest.approx([-0.5, -0.5, -0.2, 0.0], abs=1e-9),
    ]
    assert run.energy[:, -1, 0] == pytest.approx([2.0, 1.5])


def test_every_grid_counts_for_its_own_island() -> None:
    """Each of two stores without a line between them has a grid, and is brought to the level."""
    case = small_case(
        buses=2,
        load=[{"bus": "2", "p_max_mw": 0.4, "shed_cost_per_mwh": 5.0}],
        ess=[
            {"bus": "1", "p_max_mw": 3.0, "e_mwh": 4.0, "soc_initial": 0.3},
            {"bus": "2", "p_max_mw": 3.0, "e_mwh": 5.0, "soc_initial": 0.5},
        ],
        grid=[{"bus": bus, "import_max_mw": 9.0, "import_cost_per_mwh": 1.5} for bus in "12"],
    )
    none = Scenarios((), np.zeros((0, 2, 1), bool), np.ones(1))
    world = World.build(Microgrid.build(case, "copperplate"), none)
    run = simulate(world, Rule(world.setting, 0.7))
    assert run.energy[:, -1, 0] == pytest.approx([2.8, 3.5])


def test_averse_to_risk_is_half_of_the_worst_5_percent(world: World) -> None:
    averse = DISPATCHERS["stochastic-cvar"](world.setting)
    assert isinstance(averse, Stochastic)
    assert (averse.name, averse.risk) == ("stochastic-cvar", Risk(alpha=0.95, weight=0.5))


def test_a_window_as_long_as_the_horizon_is_the_optimum() -> None:
    """MPC that sees everything, and is right about the lines, is the deterministic plan."""
    case = rs.load_case("ieee33").replace(slots=12, outages=())
    none = Scenarios(("1-2",), np.zeros((1, 12, 1), bool), np.ones(1))
    world = World.build(Microgrid.build(case, "copperplate"), none)
    plan = rs.solve(case, "lp", physics="copperplate")
    mpc = BlindMPC(world.setting, slots=12, value_per_mwh=case.terminal_value_per_mwh)
    seen = Observation(
        0, world.microgrid.start()["ess.energy"][:, None], np.ones((37, 1), bool),
        world.situation(0).island, np.array([-1]), world.forecast(0), world.slot(0).stacked,
    )  # fmt: skip
    mpc.act(seen)
    value = mpc.program.solver.model.info.objective
    spent = sum(abs(cost) for cost in plan.costs.values())
    assert value == pytest.approx(plan.objective, abs=12 * LATER * spent)


def test_stochastic_is_near_the_bound_where_rules_are_far() -> None:
    """The time-of-use case on one test day: within 2 % of clairvoyance, rule 0.9 above 8 %."""
    report = compare("ieee33-tou", ["stochastic", "mpc-blind"], days=1, draws=6, seed=3)
    gaps = {name: float(np.mean(cost / report.bound - 1.0))
            for name, cost in report.objective.items()}  # fmt: skip
    assert gaps["stochastic"] < 0.02
    assert gaps["rule-0.9"] > 0.08
    assert gaps["mpc-blind"] > 0.08
    shed = {name: run.shed_mwh.sum() for name, run in report.trajectories.items()}
    assert shed["stochastic"] <= 0.1 * shed["mpc-blind"] + 1e-9


def test_a_comparison_repeats_itself_and_is_saved_whole(tmp_path: Path) -> None:
    first, again = (compare("ieee33-tou", ["rule"], days=1, draws=2, seed=1) for _ in range(2))
    np.testing.assert_array_equal(first.objective["rule"], again.objective["rule"])
    first.save(tmp_path / "report")
    summary = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert summary["episodes"] == 2
    assert {row["method"] for row in summary["methods"]} == {"rule", "rule-0.9", "clairvoyant"}
    frame = first.frame()
    assert frame.loc["clairvoyant", "gap_percent"] == pytest.approx(0.0, abs=1e-4)
    assert frame.loc["rule-0.9", "score"] == pytest.approx(0.0)


def test_test_days_are_the_last_quarter() -> None:
    case = rs.load_case("ieee33")
    assert str(held_out(case, 16).start) == "2016-08-16 00:00:00"
    with pytest.raises(rs.UsageError, match="allowed: 1 to 16"):
        held_out(case, 17)
    with pytest.raises(rs.UsageError, match="unknown"):
        compare(case, ["crystal-ball"])


def test_a_rule_of_any_level_goes_by_its_name() -> None:
    """`rule-0.9` by its name and by its level are the same, and levels beyond 1 are refused."""
    report = rs.compare("ieee33-tou", ["rule-0.7", "rule-0.90"], days=1, draws=2)
    assert report.objective["rule-0.90"] == pytest.approx(report.objective["rule-0.9"])
    assert report.trajectories["rule-0.7"].energy[:, -1].sum() < report.trajectories[
        "rule-0.9"
    ].energy[:, -1].sum()  # fmt: skip
    for name, words in (("rule-90", "probably percent: rule-0.9"), ("rule-x", "rule-LEVEL")):
        with pytest.raises(UsageError, match=words):
            rs.compare("ieee33-tou", [name], days=1, draws=2)


def test_a_case_whose_profiles_stand_in_it_is_compared_over_its_horizon() -> None:
    case = blackouts.dark().replace(blackout=None)
    assert rs.compare(case, ["rule"], draws=2).case.slots == case.slots
