"""Dispatchers, the bound and plans where units are committed and lines switched."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import resilience as rs
from resilience.arrays import Bools, Floats
from resilience.case import Case
from resilience.dispatch.decision_columns import DecisionColumns
from resilience.dispatch.merged_grid import MergedGrid
from resilience.dispatch.registry import factory_of
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.evaluation.compare import evaluate
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.models.simulator import Decision, part_by_part
from resilience.simulation.audit import check_trajectory
from resilience.simulation.causality import check_causality
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import case_optimum, check_dispatcher, small_case

SLOTS = 16
DEMAND = (0.65 + 0.35 * np.sin(np.arange(SLOTS) / 2.0)).tolist()
SUN = np.clip(np.sin(np.arange(SLOTS) / 5.0), 0.0, 1.0).tolist()
OUTAGES = ("1-2@03:00-12:00", "2-3@05:00-09:00")


def feeder(*, ties: bool = False) -> Case:
    """Three buses in a row, or a ring with a tie that is open; one unit for each way of being slow:
    minimum times, ramps, a curve that bends down, and a block among the loads.
    """
    lines = [(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01), *([(3, 1, 0.01, 0.01)] if ties else [])]
    tables: list[dict[str, object]] = [
        {"name": name, "breakpoint": True, "switchable": ties} for name in ("1-2", "2-3")
    ]
    if ties:
        tables.append({"name": "3-1", "switchable": True, "switching_cost": 0.1})
    case = small_case(
        slots=SLOTS,
        buses=3,
        lines=lines,
        line_tables=tables,
        profiles={"load": DEMAND, "sun": SUN},
        outages=OUTAGES,
        terminal_value_per_mwh=0.4,
        load=[
            {"bus": "2", "p_max_mw": 1.4, "profile": "load", "shed_cost_per_mwh": 9.0},
            {"bus": "3", "p_max_mw": 0.9, "profile": "load", "shed_cost_per_mwh": 5.0},
            {"bus": "3", "p_max_mw": 0.4, "shed_cost_per_mwh": 7.0, "block": True},
        ],
        pv=[{"bus": "3", "p_max_mw": 0.6, "profile": "sun"}],
        ess=[
            {"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.5, "soc_initial": 0.5},
            {"bus": "3", "p_max_mw": 0.4, "e_mwh": 1.0, "soc_initial": 0.8, "soc_min": 0.1},
        ],
        generator=[
            {"bus": "2", "p_max_mw": 1.0, "p_min_mw": 0.4, "cost_per_mwh": 1.0, "start_cost": 0.8,
             "no_load_cost_per_h": 0.1, "min_up_h": 3.0, "min_down_h": 2.0, "initial_on": False},
            {"bus": "3", "p_max_mw": 0.8, "cost_per_mwh": 1.5, "ramp_up_mw_per_h": 0.25,
             "ramp_down_mw_per_h": 0.3},
            {"bus": "3", "p_max_mw": 0.5, "cost_curve": [[0.0, 0.0], [0.2, 0.7], [0.5, 1.0]]},
        ],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.5}],
    )  # fmt: skip
    if not ties:
        return case
    open_tie = replace(case.network, in_service=np.array([True, True, False]))
    return replace(case, network=open_tie)


def world(*, ties: bool = False, physics: Physics = "copperplate", parted: bool = False) -> World:
    """Outages as the case has them, and none."""
    down = np.zeros((2, SLOTS, 2), bool)
    down[0, 3:12, 0] = down[1, 5:9, 0] = True
    scenarios = Scenarios(("1-2", "2-3"), down, np.array([0.6, 0.4]), None)
    microgrid = microgrid_with_fallible_lines(feeder(ties=ties), scenarios, physics)
    return World.build(microgrid, scenarios, reset_daily=parted)


def planned(case: Case, physics: Physics) -> tuple[float, Decision, Floats]:
    """Operating cost of the optimal plan, its decisions, and its energy (units, slots)."""
    optimum = case_optimum(case, physics)
    program = optimum.program
    columns = DecisionColumns.of_program(program.standard, MergedGrid.as_it_is(program.microgrid))
    costs = program.standard.cost_terms(optimum.z, program.data)
    decision = columns.decision(optimum.z, slice(None))
    total = float(sum(spent.sum() for spent in costs.values()))
    return total, decision, optimum["ess.energy"]


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_a_plan_simulated_costs_what_it_says(physics: Physics, ties: bool) -> None:
    """Law 5: commitment, switches, ramped power and storage of the optimum, slot by slot."""
    here = world(ties=ties, physics=physics).with_scenarios(np.array([0]))
    cost, decision, energy = planned(feeder(ties=ties), physics)
    rows = part_by_part(lambda values: values[0][:, :, None], [decision])
    done = simulate(here, Replay("plan", rows))
    assert done.cost.sum() == pytest.approx(cost, rel=1e-6)
    assert_allclose(done.energy[:, 1:, 0], energy, atol=1e-6)
    assert decision.on is not None
    assert_allclose(done.decided("generator.on")[:, :, 0], decision.on, atol=1e-6)
    assert 0.0 < decision.on.sum() < decision.on.size
    if ties:
        assert decision.closed is not None
        assert_allclose(done.decided("line.closed")[:, :, 0], decision.closed, atol=1e-6)


@pytest.mark.parametrize("ties", [False, True])
def test_the_bound_is_below_the_optimum_and_what_acts_on_it_above(ties: bool) -> None:
    here = world(ties=ties).with_scenarios(np.array([0]))
    bound = clairvoyant(here)
    least = case_optimum(feeder(ties=ties), "copperplate").objective
    done = simulate(here, Replay("clairvoyant", bound.decision)).objective(0.4)[0]
    assert bound.objective[0] <= least * (1.0 + 1e-9)
    assert least <= done * (1.0 + 1e-7)
    assert done <= 1.1 * least
    assert bound.objective[0] >= 0.9 * least


@pytest.mark.parametrize("method", ["idle", "rule-0.9", "greedy", "mpc-blind", "mpc", "stochastic"])
def test_dispatchers_keep_the_rules_of_the_game(method: str) -> None:
    done = check_dispatcher(factory_of(method), world())
    assert done.decisions is not None


def test_switching_dispatchers_keep_the_rules_and_act_on_nothing_to_come() -> None:
    here = world(ties=True)
    for method in ("rule-0.9", "mpc"):
        check_dispatcher(factory_of(method), here)
    check_causality(here, {"mpc": factory_of("mpc")}, episodes=1, slots=2)


def test_looking_ahead_starts_units_in_time() -> None:
    """Merit alone finds the slow unit off as the outage begins; who looks ahead pays less."""
    here = world().with_scenarios(np.array([0]))
    cost = {
        method: simulate(here, factory_of(method)(here.setting)).objective(0.4)[0]
        for method in ("idle", "rule-0.9", "mpc")
    }
    assert cost["mpc"] < cost["rule-0.9"]
    assert cost["mpc"] < cost["idle"]


class Anything:
    """Decides at random, mostly what cannot be done."""

    name = "anything"

    def __init__(self, setting: Setting, seed: int) -> None:
        self.rng, self.size = np.random.default_rng(seed), setting

    def act(self, observation: Observation) -> Decision:
        states, n = observation.states, observation.energy.shape[1]
        at_random = self.rng.random
        return Decision(
            self.rng.uniform(-2.0, 2.0, observation.energy.shape),
            on=np.round(at_random(states["generator.on"].shape)),
            closed=np.round(at_random((len(states.get("line.closed", ())), n))),
            ramped_mw=at_random(states["generator.p_before"].shape),
        )


def has_loop(ends: list[tuple[int, int]], closed: Bools) -> bool:
    """Whether some closed lines make a loop, by joining sets of buses."""
    of_bus = list(range(4))
    for (i, j), shut in zip(ends, closed, strict=True):
        if shut:
            first, second = of_bus[i], of_bus[j]
            if first == second:
                return True
            of_bus = [first if number == second else number for number in of_bus]
    return False


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ties", [False, True])
def test_whatever_is_decided_every_slot_has_an_outcome(seed: int, ties: bool) -> None:
    """The audit of `simulate` holds every row; minimum times and loops are looked at once more."""
    rng = np.random.default_rng(seed)
    down = rng.random((2, SLOTS, 2)) < 0.4
    scenarios = Scenarios(("1-2", "2-3"), down, np.full(2, 0.5), None)
    microgrid = microgrid_with_fallible_lines(feeder(ties=ties), scenarios, "copperplate")
    here = World.build(microgrid, scenarios)
    done = simulate(here, Anything(here.setting, seed))
    for k in range(2):
        on = [0.0, *done.decided("generator.on")[0, :, k]]
        for t in np.flatnonzero(np.diff(on) > 0.0):  # 3 h from a start on
            stops = np.flatnonzero(np.array(on[t + 1 : t + 4]) < 0.5)
            # Only where an outage began may it have tripped.
            began = down[:, 1:, k] & ~down[:, :-1, k]
            assert not len(stops) or began[:, t : t + 3].any()
        p = done.flow("generator.p")[1, :, k]
        assert (np.diff([0.0, *p]) <= 0.25 + 1e-6).all()
        if ties:
            closed = done.decided("line.closed")[:, :, k] > 0.5
            assert not (closed[:2] & down[:, :, k]).any()
            for of_slot in closed.T:
                assert not has_loop([(1, 2), (2, 3), (3, 1)], of_slot)


def test_an_episode_depends_on_none_before() -> None:
    """Among equal costs a basis chooses: it must not come from whoever was simulated before."""
    here = world(ties=True)
    first = simulate(here, factory_of("rule-0.9")(here.setting))
    simulate(here, Anything(here.setting, 7))
    again = simulate(here, factory_of("rule-0.9")(here.setting))
    assert first.decisions is not None
    assert again.decisions is not None
    assert_allclose(again.decisions, first.decisions, rtol=0, atol=0)


def test_days_begin_anew_where_they_are_reset() -> None:
    case = small_case(
        slots=8, start=feeder().start.replace(hour=20), profiles={"load": [1.0] * 8},
        load=[{"p_max_mw": 1.0, "profile": "load", "shed_cost_per_mwh": 9.0}],
        ess=[{"p_max_mw": 0.5, "e_mwh": 1.0}],
        generator=[{"p_max_mw": 1.0, "p_min_mw": 0.2, "cost_per_mwh": 1.0, "start_cost": 2.0,
                    "initial_on": False, "min_up_h": 3.0}],
    )  # fmt: skip
    calm = Scenarios((), np.zeros((0, 8, 1), bool), np.ones(1))
    here = World.build(microgrid_with_fallible_lines(case, calm, "copperplate"), calm,
                       reset_daily=True)  # fmt: skip
    done = simulate(here, factory_of("idle")(here.setting))
    assert done.decided("generator.start")[0, :, 0].tolist() == [1, 0, 0, 0, 1, 0, 0, 0]
    assert clairvoyant(here).objective[0] <= done.objective(0.0)[0] + 1e-6


def run() -> tuple[World, Trajectory]:
    here = world(ties=True)
    return here, simulate(here, factory_of("rule-0.9")(here.setting))


def test_trajectories_are_kept_and_travel(tmp_path: Path) -> None:
    here, done = run()
    save_trajectory(done, tmp_path / "rule.npz")
    kept = load_trajectory(tmp_path / "rule.npz")
    check_trajectory(here, kept)
    assert kept.decisions is not None
    assert done.decisions is not None
    assert_allclose(kept.decisions, done.decisions, rtol=0, atol=0)
    assert "line.closed[3-1]" in kept.frame(("ess1", "ess2")).columns
    there = pickle.loads(pickle.dumps(here))
    again = simulate(there, factory_of("rule-0.9")(there.setting))
    assert_allclose(again.cost, done.cost, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("name", "broken"),
    [
        ("generator.on[generator1]", "generator"),
        ("generator.p_before[generator2]", "generator"),
        ("generator.up_left[generator1]", "generator.up_left"),
        ("generator.start[generator1]", "generator"),
        ("line.closed[3-1]", "topology|line"),
        ("line.p[1-2]", "balance|line"),
        ("load.on[load3]", "load.block"),
        ("ess.energy[ess1]", "ess.energy|ess.dynamics"),
    ],
)
@pytest.mark.parametrize("share", [1.0, 0.1])
def test_what_cannot_have_been_decided_is_refused(name: str, broken: str, share: float) -> None:
    """Any decision of the fifth slot, moved by a whole or by a part of one."""
    here, done = run()
    assert done.decisions is not None
    changed = done.decisions.copy()
    row = done.decision_columns.index(name)
    changed[row, 4, 0] += share if changed[row, 4, 0] < 0.5 else -share
    with pytest.raises(CertificateError, match=f"{broken}|integrality"):
        check_trajectory(here, replace(done, decisions=changed))


def test_a_trajectory_without_decisions_or_with_foreign_ones_is_none() -> None:
    here, done = run()
    for foreign in (
        replace(done, decisions=None),
        replace(done, decision_columns=done.decision_columns[::-1]),
    ):
        with pytest.raises(CertificateError, match="none of this world"):
            check_trajectory(here, foreign)


def test_a_comparison_says_that_its_bound_is_relaxed() -> None:
    report = evaluate(world(), ["mpc-blind"])
    assert "bound: commitment and switches relaxed" in report.setting
    assert any("by shares" in warning for warning in report.warnings)
    assert report.frame()["gap_percent"].to_numpy(float).min() >= 0.0


def test_sddp_says_that_it_cannot_commit() -> None:
    with pytest.raises(UsageError, match="sddp carries stored energy and fuel alone"):
        factory_of("sddp")(world().setting)


def test_outages_without_a_grid_are_survived_with_commitment() -> None:
    """A unit of 1 MW that has to be started serves 0.5 MW as long as one asks."""
    case = small_case(
        slots=24, load=[{"p_max_mw": 0.5, "shed_cost_per_mwh": 9.0}],
        generator=[{"p_max_mw": 1.0, "p_min_mw": 0.2, "cost_per_mwh": 1.0, "start_cost": 1.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 0.5}],
    )  # fmt: skip
    survival = rs.survive(case, [2, 6], method="idle").frame()
    assert (survival["all_served"] == 1.0).all(), survival


@pytest.mark.parametrize("method", ["rule", "mpc", "mpc-blind", "stochastic"])
@pytest.mark.parametrize("slow", [{"min_up_h": 3.0}, {"ramp_down_mw_per_h": 0.1}])
def test_a_unit_that_may_not_stop_at_once_ends_with_the_horizon(
    method: str, slow: dict[str, float]
) -> None:
    """It is wanted in the last two hours alone, for less time than it would have to stay on."""
    unit = {"p_min_mw": 0.4, "p_max_mw": 0.9, "cost_per_mwh": 0.2, "start_cost": 0.3, **slow}
    case = small_case(
        slots=12,
        profiles={"late": [0.0] * 10 + [1.0] * 2},
        load=[{"p_max_mw": 0.8, "profile": "late", "shed_cost_per_mwh": 9.0}],
        ess=[{"p_max_mw": 0.1, "e_mwh": 0.2, "soc_initial": 0.0}],
        generator=[unit],
    )
    none = Scenarios((), np.zeros((0, 12, 1), bool), np.ones(1))
    world = World.build(microgrid_with_fallible_lines(case, none, "copperplate"), none)
    run = simulate(world, factory_of(method)(world.setting))
    assert run.flow("load.shed").sum() == pytest.approx(0.0, abs=1e-6)
    assert run.objective(0.0)[0] == pytest.approx(2 * 0.8 * 0.2 + 0.3)
