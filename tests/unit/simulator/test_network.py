"""Stepping with voltages and ratings: what they cost, by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.simulator import NetworkSimulator, Simulator
from resilience.testing import small_case
from tests.stepping import assert_sound, scene

LOAD = {"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 5.0}
ESS = {"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0}
GRID = {"import_max_mw": 5.0, "import_cost_per_mwh": 1.0}


def two_buses(r: float = 0.1, rating: float | None = None, **devices: Any) -> Case:
    about = [] if rating is None else [{"name": "1-2", "rating_mva": rating}]
    devices = {"load": [LOAD], "ess": [ESS], "grid": [GRID], **devices}
    return small_case(buses=2, lines=[(1, 2, r, 0.0)], line_tables=about, **devices)


def stepped(
    case: Case, physics: Physics, *action: float, sun: tuple[float, ...] = ()
) -> dict[str, Any]:
    simulator = NetworkSimulator(Microgrid.build(case, physics), 1.0)
    n = len(action)
    lines = len(case.network.line_names)
    situation = simulator.microgrid.situation(
        np.ones((lines, n), bool), lambda name: np.array(sun) if name == "sun" else np.ones(n)
    )
    data = simulator.stacked(simulator.microgrid.data(situation))
    energy = np.full((1, n), 2.0)
    step = simulator.step(energy, np.array([action]), data, situation.island)
    found = dict(zip(simulator.columns, step.flows, strict=True))
    more = {"charge": step.charge[0], "discharge": step.discharge[0], "cost": step.cost}
    return {**found, **more, "spill": step.spill.sum(0), "energy": step.energy[0]}


def test_a_low_voltage_sheds_what_the_line_cannot_bring() -> None:
    """v = 1 - 2 * 0.1 * P >= 0.81 lets 0.95 MW through, for load and charging alike."""
    found = stepped(two_buses(), "lindistflow", 0.0, 0.3, -0.4)
    assert found["load.shed[load1]"] == pytest.approx([0.55, 0.85, 0.15], abs=1e-6)
    assert found["charge"] == pytest.approx([0.0, 0.3, 0.0], abs=1e-6)
    assert found["energy"] == pytest.approx([2.0, 2.3, 1.6], abs=1e-6)
    assert found["cost"] == pytest.approx([0.95 + 2.75, 0.95 + 4.25, 0.95 + 0.75], abs=1e-6)


def test_charging_is_cut_back_where_even_shedding_does_not_lift_the_voltage() -> None:
    """r = 0.2: 0.475 MW get through. All load is shed for 0.475 of the 1 MW asked for."""
    found = stepped(two_buses(0.2), "lindistflow", 1.0)
    assert found["charge"] == pytest.approx([0.475], abs=1e-6)
    assert found["load.shed[load1]"] == pytest.approx([1.5], abs=1e-6)


def test_an_angle_sheds_what_the_line_cannot_bring() -> None:
    """x P <= 0.02 rad lets 0.8 MW through."""
    line = (1, 2, 0.0, 0.025, {"angle_max_degree": float(np.degrees(0.02))})
    case = small_case(buses=2, lines=[line], load=[LOAD], ess=[ESS], grid=[GRID])
    found = stepped(case, "lindistflow", 0.0, 0.3, -0.4)
    assert found["load.shed[load1]"] == pytest.approx([0.7, 1.0, 0.3], abs=1e-6)


def test_a_high_voltage_cuts_discharging_back_and_then_spills() -> None:
    """v = 1 + 0.2 P <= 1.21 lets 1.05 MW out; of 2 MW that must be taken 0.5 are used here."""
    case = two_buses(
        load=[{**LOAD, "p_max_mw": 0.5}],
        pv=[{"bus": "2", "p_max_mw": 2.0, "curtailable": False}],
        grid=[{**GRID, "export_max_mw": 5.0}],
    )
    found = stepped(case, "lindistflow", 0.0, -1.0, 0.2)
    assert found["spill"] == pytest.approx([0.45, 0.45, 0.25], abs=1e-6)
    assert found["discharge"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert found["charge"] == pytest.approx([0.0, 0.0, 0.2], abs=1e-6)


@pytest.mark.parametrize("price", [7.0, 5_000.0, 9e5])
def test_the_storage_order_is_worth_more_than_any_price(price: float) -> None:
    """0.95 MW get through, of which charging takes 0.3 whatever shedding of the others costs."""
    case = two_buses(load=[{**LOAD, "shed_cost_per_mwh": price}])
    found = stepped(case, "lindistflow", 0.3, -0.4)
    assert found["charge"] == pytest.approx([0.3, 0.0], abs=1e-6)
    assert found["discharge"] == pytest.approx([0.0, 0.4], abs=1e-6)
    assert found["load.shed[load1]"] == pytest.approx([0.85, 0.15], abs=1e-6)


def must_take(load_mw: float = 0.5) -> Case:
    """Sun of 2 MW that must be taken, storage and a load at bus 2; 1.05 MW get out."""
    return two_buses(
        load=[{**LOAD, "p_max_mw": load_mw}],
        pv=[{"bus": "2", "p_max_mw": 2.0, "curtailable": False, "profile": "sun"}],
        grid=[{**GRID, "export_max_mw": 5.0}],
        profiles={"sun": [0.3, 0.7]},
    )


def test_what_must_be_taken_is_spilled_in_the_member_where_it_comes() -> None:
    """The dark member is supplied; of 2, 0.4 and 1.8 MW of the others 0.45, 0 and 0.25 are lost.

    Power fed in, less what is spilled, is what load, charging and export take.
    """
    found = stepped(must_take(), "lindistflow", -0.2, 0.0, 0.0, 0.0, sun=(0.0, 1.0, 0.2, 0.9))
    sun = np.array([0.0, 2.0, 0.4, 1.8])
    assert found["spill"] == pytest.approx([0.0, 0.45, 0.0, 0.25], abs=1e-6)
    assert found["pv.p[pv1]"] == pytest.approx(sun, abs=1e-6)
    assert found["discharge"] == pytest.approx([0.2, 0.0, 0.0, 0.0], abs=1e-6)
    assert found["grid.import[grid1]"] == pytest.approx([0.3, 0.0, 0.1, 0.0], abs=1e-6)
    assert found["grid.export[grid1]"] == pytest.approx([0.0, 1.05, 0.0, 1.05], abs=1e-6)
    taken = 0.5 - found["load.shed[load1]"] + found["charge"] + found["grid.export[grid1]"]
    fed = found["pv.p[pv1]"] + found["discharge"] + found["grid.import[grid1]"]
    assert fed - found["spill"] == pytest.approx(taken, abs=1e-6)


def test_a_member_is_what_it_is_alone() -> None:
    actions, sun = (0.3, -0.6, 0.0), (0.0, 0.95, 0.4)
    together = stepped(must_take(1.1), "lindistflow", *actions, sun=sun)
    for k, (action, light) in enumerate(zip(actions, sun, strict=True)):
        alone = stepped(must_take(1.1), "lindistflow", action, sun=(light,))
        for name, values in alone.items():
            assert together[name][k] == pytest.approx(values[0], abs=1e-6), name


def test_a_rating_binds_at_copperplate() -> None:
    found = stepped(two_buses(rating=1.0), "copperplate", 0.0, 0.5)
    assert found["load.shed[load1]"] == pytest.approx([0.5, 1.0], abs=1e-6)
    with pytest.raises(rs.UsageError, match="line ratings"):
        Simulator(Microgrid.build(two_buses(rating=1.0), "copperplate"), 1.0)


def test_ieee33_on_its_feeder_sheds_no_less_than_on_a_copper_plate() -> None:
    case = rs.load_case("ieee33")
    wired = NetworkSimulator(Microgrid.build(case, "lindistflow"), 0.25)
    plate = Simulator(Microgrid.build(case, "copperplate"), 0.25)
    assert wired.columns == plate.columns
    assert wired.units == plate.units
    ours = scene(wired, 12, np.random.default_rng(5))
    theirs = scene(plate, 12, np.random.default_rng(5))
    step, free = wired.step(*ours.all), plate.step(*theirs.all)
    assert_sound(wired, ours, step, tolerance=1e-6)
    followed = np.abs(step.charge - step.discharge - free.charge + free.discharge).max(0) < 1e-6
    assert followed.sum() >= 6
    assert (step.cost >= free.cost - 1e-6)[followed].all()


def test_what_the_network_step_cannot_hold_is_refused() -> None:
    with pytest.raises(rs.UsageError, match="not distflow"):
        NetworkSimulator(Microgrid.build(rs.load_case("ieee33"), "distflow"), 0.25)
    with pytest.raises(rs.UsageError, match=r"load\.on") as refused:
        NetworkSimulator(
            Microgrid.build(two_buses(load=[{**LOAD, "block": True}]), "lindistflow"), 1.0
        )
    assert "blocks" in refused.value.hint


def test_gradients_need_the_other_simulator() -> None:
    torch = pytest.importorskip("torch", reason="the extra `learn` is not installed")
    simulator = NetworkSimulator(Microgrid.build(two_buses(), "copperplate"), 1.0)
    energy = torch.full((1, 1), 2.0)
    with pytest.raises(rs.UsageError, match="NumPy"):
        simulator.step(energy, energy, energy, energy)


@pytest.mark.parametrize(("order_mw", "shed_mw"), [(0.0, 0.5), (-0.2, 0.5 - 0.2 + 0.081)])
def test_storage_gives_what_shunts_take_beside_its_order(order_mw: float, shed_mw: float) -> None:
    """0.1 MW at 1 pu are 0.081 MW at the lowest voltage of the band, and cannot be shed."""
    case = small_case(
        buses=2,
        bus_tables={2: {"shunt_p_mw": 0.1}},
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 20.0}],
        load=[{"bus": "2", "p_max_mw": 0.5, "shed_cost_per_mwh": 900.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 2.0, "s_mva": 1.0}],
    )
    simulator = NetworkSimulator(Microgrid.build(case, "lindistflow"), 1.0)
    situation = simulator.microgrid.situation(np.zeros((1, 1), bool), lambda _: np.ones(1))
    data = simulator.stacked(simulator.microgrid.data(situation))
    step = simulator.step(np.full((1, 1), 1.0), np.full((1, 1), order_mw), data, situation.island)
    assert step.discharge[0, 0] == pytest.approx(max(-order_mw, 0.081))
    shed = step.flows[simulator.columns.index("load.shed[load1]"), 0]
    assert shed == pytest.approx(shed_mw)
