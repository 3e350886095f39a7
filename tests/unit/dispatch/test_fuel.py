"""Dispatchers, the bound and trajectories where generators burn from a tank."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case, TankTable
from resilience.dispatch.mpc import BlindMPC
from resilience.dispatch.registry import factory_of
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.models.simulator import Decision
from resilience.simulation.audit import check_trajectory
from resilience.simulation.observation import Rationed
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import check_dispatcher, small_case

SLOTS = 24
METHODS = ["idle", "rule", "rule-0.9", "greedy", "mpc-blind", "mpc", "stochastic"]
OUTAGE = "1-2@02:00-23:00"
DEMAND = (0.7 + 0.3 * np.sin(np.arange(SLOTS) / 3.0)).tolist()
UNIT = {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 2.0, "tank": "tank1"}
LOAD = {"bus": "2", "profile": "demand"}


def scarce() -> Case:
    """Cut off from 02:00 to 23:00 with fuel for 12 of 48 MWh, and two units of a different thirst,
    of which the thirsty one is cheaper.
    """
    return small_case(
        slots=SLOTS,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        outages=[OUTAGE],
        profiles={"demand": DEMAND},
        terminal_value_per_mwh=0.5,
        tanks=[
            {
                "capacity_m3": 5.0,
                "initial_m3": 2.0,
                "delivery": [{"hour": 12.0, "amount_m3": 1.0}],
            }
        ],
        generator=[
            UNIT | {"fuel_m3_per_mwh": 0.25},
            UNIT | {"fuel_m3_per_mwh": 0.25},
            UNIT | {"cost_per_mwh": 3.0, "fuel_m3_per_mwh": 0.2},
        ],
        load=[
            LOAD | {"p_max_mw": 1.0, "shed_cost_per_mwh": 150.0},
            LOAD | {"p_max_mw": 2.0, "shed_cost_per_mwh": 30.0},
        ],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0, "soc_initial": 1.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 0.3}],
    )


def fuelled(name: str) -> Case:
    """A case of the package whose generators burn from one tank."""
    fuel = {"tank": "tank1", "fuel_m3_per_mwh": 0.25}
    case = rs.load_case(name)
    units = [unit.model_copy(update=fuel) for unit in case.generator]
    return case.replace(tank=[TankTable(name="tank1", capacity_m3=8.0)], generator=units)


def world(physics: Physics = "copperplate") -> World:
    """Outages as the case has them, one that ends at noon, and none."""
    down = np.zeros((1, SLOTS, 3), bool)
    down[0, 2:23, 0] = down[0, 2:12, 1] = True
    scenarios = Scenarios(("1-2",), down, np.array([0.4, 0.4, 0.2]), None)
    return World.build(microgrid_with_fallible_lines(scarce(), scenarios, physics), scenarios)


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_the_bound_is_the_optimum_and_its_decisions_reach_it(physics: Physics) -> None:
    here = world(physics)
    bound = clairvoyant(here)
    plan = rs.solve(scarce(), "lp", physics="copperplate")
    assert bound.objective[0] == pytest.approx(plan.objective, rel=1e-7)
    done = simulate(here, Replay("clairvoyant", bound.decision))
    np.testing.assert_allclose(done.objective(0.5), bound.objective, rtol=1e-7)
    assert done.fuel is not None
    levels = rs.solve(scarce(), "lp", physics="copperplate").tables["fuel"]["tank1"]
    assert levels[-1] == pytest.approx(done.fuel[0, -1, 0], abs=1e-6)
    blind = simulate(here, Replay("blind to fuel", bound.charging))
    assert (blind.objective(0.5)[:2] > 1.9 * bound.objective[:2]).all()


@pytest.mark.parametrize("method", METHODS)
def test_dispatchers_keep_the_rules_of_the_game(method: str) -> None:
    done = check_dispatcher(factory_of(method), world())
    assert done.fuel is not None
    assert done.fuel.min() >= 0.0
    assert done.fuel.max() <= 5.0


def test_a_plan_whose_units_share_in_merit_order_is_simulated_alike() -> None:
    """Law 5 with a tank: the plan's storage and what its burners give, played slot by slot."""
    plan = rs.solve(scarce(), "lp", physics="copperplate")
    power = plan.tables["power"]
    charging = -power["ess1"][None, :, None]
    burners = np.array([power[f"generator{k}"] for k in (1, 2, 3)])[:, :, None]
    here = world().with_scenarios(np.array([0]))
    done = simulate(here, Replay("plan", Decision(charging, burners)))
    assert done.cost.sum() == pytest.approx(plan.operating_cost, rel=1e-6)
    np.testing.assert_allclose(done.energy[:, 1:, 0], plan.tables["energy"].values, atol=1e-6)
    assert done.fuel is not None
    np.testing.assert_allclose(done.fuel[:, 1:, 0], plan.tables["fuel"].values, atol=1e-6)


def test_the_rule_gives_from_storage_what_generators_cannot_for_want_of_fuel() -> None:
    """With all fuel that they could burn, generators leave nothing to storage; without, the rule
    has given all of its 4 MWh before the outage ends.
    """
    here = world().with_scenarios(np.array([0]))
    done = simulate(here, factory_of("rule-0.9")(here.setting))
    assert done.fuel is not None
    empty = int(np.argmax(done.fuel[0, :, 0] < 1e-9))
    assert 2 < empty < 12
    assert done.energy[0, empty - 1, 0] > 3.0
    assert done.energy[0, 22, 0] < 1e-9


def test_a_window_keeps_fuel_that_is_worth_more_behind_it() -> None:
    """An hour ahead sheds the other load at 30 rather than burn fuel of 200 $ per m³, 50 a MWh."""
    here = world().with_scenarios(np.array([0]))
    levels = []
    for worth in (0.0, 200.0):
        blind = BlindMPC(here.setting, slots=1)
        blind.fuel_value[:] = worth
        done = simulate(here, blind)
        assert done.fuel is not None
        levels.append(done.fuel[0, 8, 0])
    assert levels[0] < 1e-9
    assert levels[1] > 1.0


def test_the_referee_of_trajectories_finds_fuel_that_was_never_there() -> None:
    here = world()
    done = simulate(here, factory_of("idle")(here.setting))
    assert done.fuel is not None
    start, later = done.fuel[:, :1], done.fuel[:, 1:]
    changed = [
        (done.fuel + 0.1, "start"),
        (np.concatenate([start, later + 0.1], axis=1), r"tank\.(level|dynamics)"),
        (np.concatenate([start, later * 0.0], axis=1), r"tank\.level"),
        (None, "nothing of fuel"),
    ]
    for fuel, words in changed:
        with pytest.raises(CertificateError, match=words):
            check_trajectory(here, replace(done, fuel=fuel))


def test_trajectories_are_saved_with_their_fuel_and_shown_with_it(tmp_path: Path) -> None:
    here = world()
    done = simulate(here, factory_of("idle")(here.setting))
    save_trajectory(done, tmp_path / "idle.npz")
    again = load_trajectory(tmp_path / "idle.npz")
    assert done.fuel is not None
    np.testing.assert_array_equal(again.fuel, done.fuel)
    frame = done.frame(["ess1"], ["tank1"])
    np.testing.assert_array_equal(frame.loc[1, "fuel[tank1]"], done.fuel[0, :-1, 1])


def test_tanks_are_as_at_the_start_where_days_begin_anew() -> None:
    case = small_case(
        slots=48,
        start=scarce().start,
        tanks=[{"capacity_m3": 4.0, "initial_m3": 3.0}],
        generator=[UNIT | {"bus": "1", "fuel_m3_per_mwh": 0.25}],
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
        ess=[{"p_max_mw": 0.5, "e_mwh": 1.0}],
    )
    nothing = Scenarios((), np.zeros((0, 48, 1), bool), np.ones(1), None)
    grid = microgrid_with_fallible_lines(case, nothing, "copperplate")
    here = World.build(grid, nothing, reset_daily=True)
    done = simulate(here, factory_of("idle")(here.setting))
    assert done.fuel is not None
    np.testing.assert_allclose(done.fuel[0, [0, 12, 23, 24, 36], 0], [3.0, 0.0, 0.0, 3.0, 0.0])
    bound = clairvoyant(here).objective
    assert (done.objective(0.0) >= bound - 1e-9).all()


def test_an_action_may_say_less_than_there_is() -> None:
    class Half:
        name = "half"

        def act(self, observation: rs.Observation) -> Rationed:
            return Rationed(np.zeros_like(observation.energy), np.full((3, 1), 0.1))

    here = world().with_scenarios(np.array([0]))
    done = simulate(here, Half())
    assert done.flow("generator.p").max() <= 0.1 + 1e-12
    assert done.fuel is not None
    assert done.fuel[0, -1, 0] > 1.0


def test_who_knows_no_fuel_refuses_by_name() -> None:
    from resilience.rl.ground.env import BatchEnv
    from resilience.rl.ground.episodes import EpisodeSampler

    setting = world().setting
    with pytest.raises(UsageError, match="has the tanks tank1; allowed: none"):
        factory_of("sddp")(setting)
    with pytest.raises(UsageError, match="know no fuel, but there are the tanks tank1"):
        BatchEnv(EpisodeSampler(fuelled("ieee33-tou")))
