"""What closes the balance: the economic order, the paper's equations, and blocks, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import RecourseRule, Simulator, Step
from resilience.testing import case_optimum, small_case
from tests.stepping import assert_sound, scene


def one(case: Case, recourse: RecourseRule, *action: float, up: bool = True) -> dict[str, Any]:
    """One step of one member with storage half full, by name."""
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0, recourse)
    lines = len(case.network.line_names)
    situation = simulator.microgrid.situation(np.full((lines, 1), up), lambda _: np.ones(1))
    data = simulator.stacked(simulator.microgrid.data(situation))
    energy = (simulator.low + simulator.high) / 2
    asked = np.array(action, float).reshape(-1, 1)
    step: Step = simulator.step(energy, asked, data, situation.island)
    found = {name: float(x) for name, x in zip(simulator.columns, step.flows[:, 0], strict=True)}
    power = (step.discharge - step.charge)[:, 0]
    found |= {name: float(x) for name, x in zip(simulator.units, power, strict=True)}
    return found | {"cost": float(step.cost[0]), "spill": float(step.spill.sum())}


def islanded(load: float, sun: float = 0.0, **more: Any) -> Case:
    """Two loads (3 to 1), generators of 2 and 1 MW, PV and storage behind a breakpoint."""
    return small_case(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[
            {"bus": "2", "p_max_mw": 0.75 * load, "shed_cost_per_mwh": 2.0},
            {"bus": "2", "p_max_mw": 0.25 * load, "shed_cost_per_mwh": 2.0, "priority": 10.0},
        ],
        generator=[
            {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 0.5},
            {"bus": "2", "p_max_mw": 1.0, "cost_per_mwh": 0.4},
        ],
        pv=[{"bus": "2", "p_max_mw": sun, **more}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 10.0, "degradation_cost_per_mwh": 0.2}],
        grid=[
            {
                "import_max_mw": 5.0,
                "import_cost_per_mwh": 0.3,
                "export_max_mw": 5.0,
                "export_cost_per_mwh": 0.3,
            }
        ],
    )


def test_economic_takes_the_cheapest_first_and_sheds_by_priority() -> None:
    """4 MW of load, 0.5 of sun and 3 of generators: 0.5 MW of the cheap load go without."""
    found = one(islanded(4.0, 0.5), "economic", 0.0, up=False)
    assert found["generator.p[generator2]"] == pytest.approx(1.0)
    assert found["generator.p[generator1]"] == pytest.approx(2.0)
    assert found["load.shed[load1]"] == pytest.approx(0.5)
    assert found["load.shed[load2]"] == 0.0
    assert found["cost"] == pytest.approx(0.4 + 1.0 + 0.5 * 2.0)


def test_the_paper_runs_generators_for_the_load_whatever_the_sun_gives() -> None:
    """Eq. (20): 2.4 MW of load, shared 2 to 1 though the smaller is cheaper; no sun."""
    found = one(islanded(2.4, 1.0), "paper", 0.0, up=False)
    assert found["generator.p[generator1]"] == pytest.approx(1.6)
    assert found["generator.p[generator2]"] == pytest.approx(0.8)
    assert found["pv.p[pv1]"] == pytest.approx(0.0)
    assert found["load.shed[load1]"] == pytest.approx(0.0)
    assert found["cost"] == pytest.approx(1.6 * 0.5 + 0.8 * 0.4)


def test_the_paper_sheds_one_share_of_every_load() -> None:
    """Eq. (21): alpha = (5 - 0.5 - 3 - 0.5 of storage) / 5 = 0.2, of both loads alike."""
    found = one(islanded(5.0, 0.5), "paper", -0.5, up=False)
    assert found["load.shed[load1]"] == pytest.approx(0.2 * 3.75)
    assert found["load.shed[load2]"] == pytest.approx(0.2 * 1.25)
    assert found["ess1"] == pytest.approx(0.5)
    assert found["cost"] == pytest.approx(1.0 + 0.4 + 0.1 + 2.0 * 0.75 + 20.0 * 0.25)


def test_the_paper_sheds_for_charging_because_generators_do_not_rise() -> None:
    """Eq. (20) knows the load alone: charging 0.6 beside 2.4 of load sheds a quarter of it."""
    found = one(islanded(2.4), "paper", 0.6, up=False)
    assert found["generator.p[generator1]"] == pytest.approx(1.6)
    assert found["load.shed[load1]"] == pytest.approx(0.25 * 1.8)
    assert found["load.shed[load2]"] == pytest.approx(0.25 * 0.6)
    assert found["ess1"] == pytest.approx(-0.6)


def test_the_paper_clips_its_share_and_cuts_storage_back() -> None:
    """Below 0: generators cover the load, discharging is cut back. Above 1: charging is."""
    assert one(islanded(2.4), "paper", -0.5, up=False)["ess1"] == pytest.approx(0.0)
    sunny = one(islanded(2.4, 0.3, curtailable=False), "paper", -0.5, up=False)
    assert sunny["spill"] == pytest.approx(0.3)
    case = small_case(
        load=[{"p_max_mw": 0.4, "shed_cost_per_mwh": 2.0}],
        pv=[{"p_max_mw": 0.1}],
        ess=[{"p_max_mw": 1.0, "e_mwh": 10.0}],
    )
    found = one(case, "paper", 1.0)
    assert found["load.shed[load1]"] == pytest.approx(0.4)
    assert found["ess1"] == pytest.approx(-0.1)


def test_the_paper_leaves_everything_to_the_grid_where_there_is_one() -> None:
    """Generators stand still; |P| is priced, so surplus sun is exported at a cost."""
    short = one(islanded(2.4, 0.4), "paper", 0.5)
    assert short["grid.import[grid1]"] == pytest.approx(2.5)
    assert short["generator.p[generator1]"] == 0.0
    assert short["cost"] == pytest.approx(0.3 * 2.5)
    surplus = one(islanded(2.4, 4.0), "paper", 0.0)
    assert surplus["grid.export[grid1]"] == pytest.approx(1.6)
    assert surplus["cost"] == pytest.approx(0.3 * 1.6)
    assert one(islanded(2.4, 4.0), "economic", 0.0)["cost"] == 0.0


def test_the_paper_does_not_know_blocks() -> None:
    load = {"p_max_mw": 1.0, "shed_cost_per_mwh": 2.0, "block": True}
    case = small_case(load=[load], generator=[{"p_max_mw": 1.0}])
    with pytest.raises(rs.UsageError, match="load1 can only be shed whole"):
        Simulator(Microgrid.build(case, "copperplate"), 1.0, "paper")


def blocks(generator: float, *sizes: tuple[float, float], loose: float = 0.0) -> Case:
    """A generator at 1 $/MWh, blocks of (MW, $/MWh), and a load of `loose` MW at 3 $/MWh."""
    load = [{"p_max_mw": mw, "shed_cost_per_mwh": price, "block": True} for mw, price in sizes] + [
        {"p_max_mw": loose, "shed_cost_per_mwh": 3.0}
    ]
    return small_case(
        slots=1,
        load=load,
        generator=[{"p_max_mw": generator, "cost_per_mwh": 1.0}],
        ess=[{"p_max_mw": 1.0, "e_mwh": 10.0}],
    )


def test_a_block_is_shed_whole_and_the_generator_falls_back() -> None:
    """1.5 MW of load on 1.2 MW: the block of 1 goes, and the generator serves 0.5 alone."""
    found = one(blocks(1.2, (1.0, 2.0), (0.5, 4.0)), "economic", 0.0)
    assert found["load.shed[load1]"] == pytest.approx(1.0)
    assert found["load.shed[load2]"] == 0.0
    assert found["generator.p[generator1]"] == pytest.approx(0.5)
    assert found["cost"] == pytest.approx(2.0 + 0.5)


def test_a_block_that_a_dearer_one_makes_needless_is_served() -> None:
    """0.8 MW are missing: the block of 0.5 is not enough, the one of 2 alone is."""
    found = one(blocks(1.7, (0.5, 2.0), (2.0, 3.5)), "economic", 0.0)
    assert found["load.shed[load1]"] == 0.0
    assert found["load.shed[load2]"] == pytest.approx(2.0)
    assert found["generator.p[generator1]"] == pytest.approx(0.5)


def test_a_loose_load_is_shed_before_a_dearer_block_and_served_after_it() -> None:
    """0.6 missing: the 0.5 of loose load are not enough, the block goes, and they are served."""
    found = one(blocks(1.4, (1.5, 4.0), loose=0.5), "economic", 0.0)
    assert found["load.shed[load1]"] == pytest.approx(1.5)
    assert found["load.shed[load2]"] == pytest.approx(0.0)
    assert found["generator.p[generator1]"] == pytest.approx(0.5)


def test_an_overshoot_cuts_discharging_back_and_steps_say_that_blocks_are_heuristic() -> None:
    case = blocks(0.0, (1.5, 4.0))
    found = one(case, "economic", -1.0)
    assert found["load.shed[load1]"] == pytest.approx(1.5)
    assert found["ess1"] == pytest.approx(0.0)
    assert found["spill"] == 0.0
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    assert simulator.heuristic == ("load.shed[load1]",)


def test_blocks_keep_the_balance_and_are_never_better_than_the_optimum() -> None:
    rng = np.random.default_rng(4)
    dearer = 0
    for _ in range(20):
        sizes = [(float(rng.uniform(0.2, 1.0)), float(rng.uniform(2, 9))) for _ in range(4)]
        case = blocks(float(rng.uniform(0.5, 2.5)), *sizes, loose=0.4)
        case = case.replace(ess=[])
        simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
        seen = scene(simulator, 1, rng)
        step = simulator.step(*seen.all)
        assert_sound(simulator, seen, step)
        shed = step.flows[[simulator.columns.index(name) for name in simulator.heuristic], 0]
        demand = np.array([mw for mw, _ in sizes])
        assert np.minimum(shed, demand - shed).max() < 1e-12
        optimum = case_optimum(case).objective
        assert step.cost[0] >= optimum - 1e-7
        dearer += step.cost[0] > optimum + 1e-7
    assert 0 < dearer < 20  # greedy is often right, and not always
