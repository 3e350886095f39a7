"""Steps with commitment, ramps, curves, blocks and switches: what they cost, by hand."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import resilience as rs
from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.simulator import Decision, MilpSimulator, NetworkSimulator, Simulator, Step
from resilience.simulation.world import stepper
from resilience.testing import small_case
from tests.stepping import scene

LOAD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}
UNIT = {"p_max_mw": 2.0, "p_min_mw": 0.5, "cost_per_mwh": 1.0, "no_load_cost_per_h": 0.1,
        "start_cost": 0.7, "initial_on": False}  # fmt: skip
GRID = {"import_max_mw": 5.0, "import_cost_per_mwh": 0.0}
RUNNING = UNIT | {"initial_on": True, "initial_hours": 1.0}


def stepped(
    case: Case,
    *,
    physics: Physics = "copperplate",
    power: Floats | None = None,
    down: tuple[str, ...] = (),
    before: tuple[str, ...] = (),
    start: dict[str, list[float]] | None = None,
    **decided: list[float],
) -> tuple[dict[str, float], Step]:
    """One step of a case alone, its first slot, and everything that came of it by name."""
    simulator = MilpSimulator(Microgrid.build(case, physics), case.step_h)
    up, earlier = (
        np.array([[name not in lines] for name in case.network.line_names], bool).reshape(-1, 1)
        for lines in (down, before)
    )
    situation = simulator.microgrid.situation(
        up, lambda name: case.profile(name)[:1], before=earlier
    )
    data = simulator.stacked(simulator.microgrid.data(situation))
    states = {k: np.array(v)[:, None] for k, v in simulator.microgrid.start().items()}
    states |= {k: np.array(v, float)[:, None] for k, v in (start or {}).items()}
    energy = states.pop("ess.energy", np.empty((0, 1)))
    decision = Decision(
        np.zeros_like(energy) if power is None else power,
        **{key: np.array(values, float)[:, None] for key, values in decided.items()},
    )
    step = simulator.step(
        energy, decision, data, situation.island, states.pop("tank.level", None), states
    )
    names = (*simulator.columns, *simulator.decision_columns)
    assert step.decisions is not None
    values = np.concatenate([step.flows, step.decisions])[:, 0]
    found = dict(zip(names, values.tolist(), strict=True))
    return found | {"cost": float(step.cost[0]), "spill": float(step.spill.sum())}, step


def test_plain_cases_step_as_they_do_by_merit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing to commit: the same costs and flows of storage as the arithmetic of `Simulator`."""
    microgrid = Microgrid.build(rs.load_case("ieee33"), "copperplate")
    plain, mixed = Simulator(microgrid, 0.25), MilpSimulator(microgrid, 0.25)
    seen = scene(plain, 12, np.random.default_rng(4))
    assert len(mixed.form.stage.datums) == len(plain.form.stage.datums)
    first = plain.step(*seen.all)
    second = mixed.step(seen.energy, Decision(seen.action), seen.data, seen.island)
    assert_allclose(second.cost, first.cost, atol=1e-7)
    assert_allclose(second.energy, first.energy, atol=1e-7)
    assert_allclose(second.spill.sum(0), first.spill.sum(0), atol=1e-7)


@pytest.mark.parametrize(
    ("demand", "cost"),
    [(1.0, 0.7 + 0.1 + 1.0), (0.5, 0.7 + 0.1 + 0.5), (0.3, 5.0 * 0.3), (0.2, 5.0 * 0.2)],
)
def test_a_unit_is_started_by_merit_where_that_is_cheaper(demand: float, cost: float) -> None:
    """Below its least power it would have to spill, which nobody starts a unit for."""
    case = small_case(load=[LOAD | {"p_max_mw": demand}], generator=[UNIT])
    found, _ = stepped(case)
    assert found["cost"] == pytest.approx(cost, abs=1e-9)
    assert found["generator.on[generator1]"] == (demand >= 0.5)


def test_a_unit_that_is_asked_to_run_runs_and_spills_what_nobody_takes() -> None:
    case = small_case(load=[LOAD | {"p_max_mw": 0.2}], generator=[UNIT])
    found, _ = stepped(case, on=[1.0])
    assert found["generator.p[generator1]"] == pytest.approx(0.5)
    assert found["spill"] == pytest.approx(0.3)
    assert found["cost"] == pytest.approx(0.7 + 0.1 + 0.5)


@pytest.mark.parametrize(
    ("keys", "start", "asked", "runs"),
    [
        ({"min_up_h": 3.0}, {"generator.up_left": [2.0]}, 0.0, True),
        ({"min_up_h": 3.0}, {"generator.up_left": [0.0]}, 0.0, False),
        ({"min_down_h": 3.0, "initial_on": False}, {"generator.down_left": [2.0]}, 1.0, False),
        ({"min_down_h": 3.0, "initial_on": False}, {"generator.down_left": [0.0]}, 1.0, True),
        (
            {"ramp_down_mw_per_h": 0.4, "p_initial_mw": 1.0},
            {"generator.p_before": [1.5]},
            0.0,
            True,
        ),
        (
            {"ramp_down_mw_per_h": 0.4, "p_initial_mw": 1.0},
            {"generator.p_before": [0.9]},
            0.0,
            False,
        ),
    ],
)
def test_minimum_times_and_ramps_mask_a_commitment(
    keys: dict[str, Any], start: dict[str, list[float]], asked: float, runs: bool
) -> None:
    """It may stop from 0.5 + 0.4 MW at most, and neither before nor after its times."""
    case = small_case(load=[LOAD], generator=[RUNNING | keys])
    found, step = stepped(case, start=start, on=[asked])
    assert found["generator.on[generator1]"] == runs
    for name, hours in start.items():
        if name.endswith("left"):
            assert step.states[name][0, 0] == pytest.approx(max(hours[0] - 1.0, 0.0))


def test_a_start_waits_for_its_minimum_time_less_the_slot() -> None:
    case = small_case(load=[LOAD], generator=[UNIT | {"min_up_h": 3.0, "min_down_h": 2.0}])
    _, step = stepped(case, start={"generator.down_left": [0.0]}, on=[1.0])
    assert step.states["generator.up_left"][0, 0] == pytest.approx(2.0)
    assert step.states["generator.on"][0, 0] == 1.0


def test_a_ramp_holds_what_merit_would_ask_for() -> None:
    case = small_case(
        load=[LOAD | {"p_max_mw": 2.0}],
        generator=[{"p_max_mw": 2.0, "cost_per_mwh": 1.0, "ramp_up_mw_per_h": 0.4}],
    )
    found, step = stepped(case, start={"generator.p_before": [0.3]})
    assert found["generator.p[generator1]"] == pytest.approx(0.7)
    assert found["cost"] == pytest.approx(0.7 + 5.0 * 1.3)
    assert step.states["generator.p_before"][0, 0] == pytest.approx(0.7)


def test_ramped_power_that_is_stated_is_given_and_else_what_is_possible() -> None:
    """0.4 MW of 1 MW from the dear unit, so that it is there next slot; 1.5 MW are too many."""
    units = [
        {"p_max_mw": 2.0, "cost_per_mwh": 2.0, "ramp_up_mw_per_h": 0.5},
        {"p_max_mw": 2.0, "cost_per_mwh": 1.0},
    ]
    case = small_case(load=[LOAD], generator=units)
    found, _ = stepped(case, start={"generator.p_before": [0.0]}, ramped_mw=[0.4])
    assert found["cost"] == pytest.approx(0.4 * 2.0 + 0.6)
    found, _ = stepped(case, start={"generator.p_before": [0.0]}, ramped_mw=[1.5])
    assert found["cost"] == pytest.approx(1.0)


@pytest.mark.parametrize("before", [(), ("1-2",)])
def test_a_unit_may_trip_where_an_outage_begins(before: tuple[str, ...]) -> None:
    """Cut off with 0.2 MW of load it may stop within its minimum time, in that slot alone."""
    case = small_case(
        buses=2, lines=[(1, 2, 0.0, 0.0)], line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[LOAD | {"bus": "2", "p_max_mw": 0.2}], grid=[GRID],
        generator=[RUNNING | {"bus": "2", "min_up_h": 9.0}],
    )  # fmt: skip
    found, _ = stepped(
        case, down=("1-2",), before=before, start={"generator.up_left": [5.0]}, on=[0.0]
    )
    assert found["generator.on[generator1]"] == bool(before)
    assert found["spill"] == pytest.approx(0.3 if before else 0.0)
    assert found["load.shed[load1]"] == pytest.approx(0.0 if before else 0.2)


def test_a_curve_that_bends_down_costs_what_its_points_say() -> None:
    """min over p of f(p) + 3 (1.5 - p), by a grid of p: 1.5 MW on the second segment."""
    case = small_case(
        load=[LOAD | {"p_max_mw": 1.5}],
        generator=[{"p_max_mw": 2.0, "cost_curve": [[0.0, 0.0], [1.0, 4.0], [2.0, 5.0]]}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 3.0}],
    )
    p = np.linspace(0.0, 1.5, 15001)
    least = (np.interp(p, [0.0, 1.0, 2.0], [0.0, 4.0, 5.0]) + 3.0 * (1.5 - p)).min()
    assert least == pytest.approx(4.5)
    assert stepped(case)[0]["cost"] == pytest.approx(least, abs=1e-6)


def test_blocks_behind_a_rated_line_are_served_whole_or_not() -> None:
    """0.8 MVA carry the block of 0.7 MW, or a half of 1.4 MW that can be split."""
    case = small_case(
        buses=2, lines=[(1, 2, 0.01, 0.0)], line_tables=[{"name": "1-2", "rating_mva": 0.8}],
        load=[{"bus": "2", "p_max_mw": 0.7, "shed_cost_per_mwh": 6.0, "block": True},
              {"bus": "2", "p_max_mw": 0.9, "shed_cost_per_mwh": 20.0, "block": True}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 1.0}],
    )  # fmt: skip
    microgrid = Microgrid.build(case, "copperplate")
    assert isinstance(stepper(microgrid), MilpSimulator)
    found, _ = stepped(case)
    assert found["cost"] == pytest.approx(0.7 + 20.0 * 0.9)
    assert found["load.on[load1]"] == 1.0
    assert found["load.on[load2]"] == 0.0


RING = [(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01), (3, 1, 0.01, 0.01)]


def ring(cost: float = 0.2) -> Case:
    """Three buses in a ring, two lines closed and the third a tie."""
    tables = [
        {"name": "1-2", "breakpoint": True, "switchable": True, "switching_cost": cost},
        {"name": "2-3", "breakpoint": True, "switchable": True, "switching_cost": cost},
        {"name": "3-1", "switchable": True, "switching_cost": cost},
    ]
    case = small_case(
        buses=3, lines=RING, line_tables=tables, grid=[GRID],
        load=[LOAD | {"bus": "2"}, LOAD | {"bus": "3"}],
    )  # fmt: skip
    open_tie = replace(case.network, in_service=np.array([True, True, False]))
    return replace(case, network=open_tie)


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_a_tie_restores_what_a_failure_cuts_off_and_a_loop_is_never_closed(
    physics: Physics,
) -> None:
    found, _ = stepped(ring(), physics=physics, down=("2-3",))
    assert found["cost"] == pytest.approx(0.2 + 0.2)  # one opened by failing, one closed
    assert found["load.shed[load2]"] == pytest.approx(0.0, abs=1e-7)
    found, _ = stepped(ring(), physics=physics, closed=[1.0, 1.0, 1.0])
    closed = [found[f"line.closed[{name}]"] for name in ("1-2", "2-3", "3-1")]
    assert sum(closed) == 2.0
    found, _ = stepped(ring(), physics=physics, closed=[1.0, 0.0, 1.0])
    assert found["line.closed[3-1]"] == 1.0
    assert found["cost"] == pytest.approx(0.4)


def test_lines_stay_where_nothing_is_shed() -> None:
    found, _ = stepped(ring(0.0))
    closed = [found[f"line.closed[{name}]"] for name in ("1-2", "2-3", "3-1")]
    assert closed == [1.0, 1.0, 0.0]


def test_batches_are_stepped_as_each_alone() -> None:
    microgrid = Microgrid.build(rs.load_case("ieee33-commitment"), "copperplate")
    simulator, rng = MilpSimulator(microgrid, 0.25), np.random.default_rng(8)
    seen = scene(simulator, 5, rng)
    start = simulator.microgrid.start()
    states = {k: np.repeat(start[k][:, None], 5, axis=1) for k in simulator.device_states}
    on = np.round(rng.random((5, 5)))

    def cost(members: list[int]) -> Floats:
        energy, action, data, island = seen.of(*members)
        some = {k: v[:, members] for k, v in states.items()}
        decision = Decision(action, on=on[:, members])
        return np.asarray(simulator.step(energy, decision, data, island, None, some).cost)

    together = cost([0, 1, 2, 3, 4])
    assert_allclose(together, [cost([k])[0] for k in range(5)], atol=1e-7)


def test_what_is_chosen_follows_from_what_a_case_needs() -> None:
    def chosen(name: str, physics: Physics = "copperplate") -> type:
        return type(stepper(Microgrid.build(rs.load_case(name), physics)))

    assert chosen("ieee33") is Simulator
    assert chosen("ieee33", "lindistflow") is NetworkSimulator
    assert chosen("ieee33-commitment") is MilpSimulator
    assert chosen("ieee33-commitment", "lindistflow") is MilpSimulator
    blocks = small_case(load=[LOAD | {"block": True}], grid=[GRID])
    assert type(stepper(Microgrid.build(blocks, "copperplate"))) is Simulator


def test_what_nobody_can_step_is_said() -> None:
    case = rs.load_case("ieee33-commitment")
    with pytest.raises(rs.UsageError, match="not distflow"):
        MilpSimulator(Microgrid.build(case, "distflow"), 0.25)
    with pytest.raises(rs.UsageError, match="allowed there: 'economic'"):
        stepper(Microgrid.build(case, "copperplate"), "paper")
    tank = {"tank": "tank1", "fuel_m3_per_mwh": 0.2}
    burning = small_case(
        tanks=[{"capacity_m3": 1.0}], load=[LOAD],
        generator=[UNIT | tank, RUNNING | tank | {"min_up_h": 2.0},
                   UNIT | tank | {"ramp_down_mw_per_h": 1.0}],
    )  # fmt: skip
    with pytest.raises(rs.UsageError, match="does not step generator2, generator3"):
        stepper(Microgrid.build(burning, "copperplate"))
    simulator = MilpSimulator(Microgrid.build(case, "copperplate"), 0.25)
    seen = scene(simulator, 1, np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"no generator\.on"):
        simulator.step(seen.energy, Decision(seen.action), seen.data, seen.island)


def test_it_travels_to_other_processes() -> None:
    simulator = MilpSimulator(Microgrid.build(ring(), "copperplate"), 1.0)
    assert pickle.loads(pickle.dumps(simulator)).decision_columns == simulator.decision_columns


def test_fuel_of_a_committed_unit_counts_its_idling() -> None:
    """0.2 m³ an hour to run and 0.25 per MWh: 1 m³ lasts for two hours of 1 MW and 0.1 m³."""
    case = small_case(
        tanks=[{"capacity_m3": 1.0}], load=[LOAD], generator=[
            UNIT | {"tank": "tank1", "fuel_m3_per_mwh": 0.25, "fuel_no_load_m3_per_h": 0.2}],
    )  # fmt: skip
    _, step = stepped(case)
    assert step.fuel is not None
    assert step.fuel[0, 0] == pytest.approx(0.55)
    found, step = stepped(case, start={"tank.level": [0.325]})
    assert found["generator.p[generator1]"] == pytest.approx(0.5)
    assert step.fuel is not None
    assert step.fuel[0, 0] == pytest.approx(0.0, abs=1e-9)
    found, _ = stepped(case, start={"tank.level": [0.3]}, on=[1.0])  # not even for its least
    assert found["generator.on[generator1]"] == 0.0
