"""Worlds as the source paper has them: its recourse, its deviation of load and PV, its mesh."""

from __future__ import annotations

import pickle
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.dispatch.rules import Idle
from resilience.errors import UsageError
from resilience.evaluation.report import RECOURSE_WARNING
from resilience.evaluation.store import Store
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.simulator.simulator import RecourseRule
from resilience.simulation.forecast import lasting_outlook
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.known.ybus import Pi, power_flow

LOAD_MW, PV_MW, GENERATOR_MW, SLOT_H = 2.4, 0.7, 1.9, 0.5


def island() -> Case:
    """A line to the grid that is down, and beyond it load, PV, a generator and idle storage."""
    return small_case(
        slots=3,
        step_min=60.0 * SLOT_H,
        buses=2,
        lines=[(1, 2, 0.001, 0.002)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={"shape": [0.8, 1.0, 0.9], "light": [0.9, 0.6, 0.5]},
        grid=[
            {
                "import_max_mw": 9.0,
                "export_max_mw": 9.0,
                "import_cost_per_mwh": 0.4,
                "export_cost_per_mwh": 0.3,
            }
        ],
        load=[{"bus": "2", "p_max_mw": LOAD_MW, "shed_cost_per_mwh": 31.0, "profile": "shape"}],
        pv=[{"bus": "2", "p_max_mw": PV_MW, "profile": "light"}],
        ess=[{"bus": "2", "p_max_mw": 0.6, "e_mwh": 1.7, "soc_initial": 0.45}],
        generator=[{"bus": "2", "p_max_mw": GENERATOR_MW, "cost_per_mwh": 0.9}],
    )


def world(
    recourse: RecourseRule = "economic",
    physics: Physics = "copperplate",
    deviation: tuple[float, float] | None = None,
) -> World:
    case = island().replace(outages="1-2@00:00-01:30")
    return World.build(
        Microgrid.build(case, physics),
        Scenarios(("1-2",), np.ones((1, 3, 1), bool), np.ones(1)),
        outlook=lasting_outlook(case, *deviation, 1) if deviation else None,
        recourse=recourse,
    )


def test_generators_of_the_paper_run_for_the_load_whatever_pv_offers() -> None:
    """Loads 1.92, 2.4, 2.16 MW, PV 0.63, 0.42, 0.35: economic 1.29, 1.9, 1.81, paper 1.9 always."""
    cost = {
        recourse: simulate(world(recourse), Idle(world(recourse).setting)).cost[:, 0]
        for recourse in ("economic", "paper")
    }
    shed = 31.0 * (2.4 - 0.42 - 1.9)
    economic = [0.9 * 1.29, 0.9 * 1.9 + shed, 0.9 * 1.81]
    assert cost["economic"] == pytest.approx([SLOT_H * value for value in economic])
    paper = [0.9 * 1.9, 0.9 * 1.9 + shed, 0.9 * 1.9]
    assert cost["paper"] == pytest.approx([SLOT_H * value for value in paper])


def test_a_world_that_travels_keeps_its_recourse() -> None:
    arrived = pickle.loads(pickle.dumps(world("paper")))
    assert arrived.recourse == arrived.simulator.recourse == "paper"


def test_parts_of_one_recourse_are_none_of_the_other(tmp_path: Path) -> None:
    store = Store(tmp_path)
    files = [store.part_file("rule", world(name), None) for name in ("economic", "paper")]
    assert files[0] != files[1]


def test_the_report_says_whose_recourse_it_was() -> None:
    report = rs.evaluate(world("paper"), ["rule"])
    assert RECOURSE_WARNING in report.warnings
    assert "the paper's recourse" in report.setting
    assert report.summary()["recourse"] == "paper"


def test_the_papers_recourse_knows_no_lines() -> None:
    with pytest.raises(UsageError, match=r"'paper' at lindistflow.*'economic'"):
        world("paper", "lindistflow")


def test_load_and_pv_come_off_their_forecast_and_nobody_expects_it() -> None:
    off = world(deviation=(0.15, -0.2))
    slots = np.array([1, 2])
    assert off.profile("shape", slots)[:, 0] == pytest.approx([1.15, 0.9 * 1.15])
    assert off.profile("light", slots)[:, 0] == pytest.approx([0.48, 0.4])
    expected = off.forecast(1)
    assert expected("shape", slots)[:, 0] == pytest.approx([1.15, 0.9])
    assert expected("light", slots)[:, 0] == pytest.approx([0.48, 0.5])


def test_a_profile_of_load_and_pv_cannot_deviate_both_ways() -> None:
    case = island()
    shared = [plant.model_copy(update={"profile": "shape"}) for plant in case.pv]
    with pytest.raises(UsageError, match="pv pv1 of case small follows profile 'shape'"):
        lasting_outlook(case.replace(pv=shared), 0.15, -0.2, 1)
    bare = [load.model_copy(update={"profile": None}) for load in case.load]
    with pytest.raises(UsageError, match="load load1 of case small follows no profile"):
        lasting_outlook(case.replace(load=bare), 0.15, -0.2, 1)


def test_the_mesh_has_the_devices_of_the_radial_feeder() -> None:
    mesh, feeder = rs.load_case("ieee14"), rs.load_case("ieee33")
    for kind in ("ess", "pv", "generator", "load", "grid"):
        stripped = [
            [table.model_copy(update={"bus": ""}) for table in case.devices[kind]]
            for case in (mesh, feeder)
        ]
        assert stripped[0] == stripped[1]
    assert len(mesh.network.line_names) == 20
    assert not np.isfinite(mesh.network.rating_mva).any()


def test_the_cut_set_parts_the_mesh_into_four() -> None:
    """The archive has 0.01938 + j 0.05917 pu on 100 MVA for the first branch."""
    case = rs.load_case("ieee14")
    network = case.network
    cut = set(np.array(network.line_names)[network.breakpoint])
    graph = nx.Graph()
    graph.add_nodes_from(range(14))
    for name, i, j in zip(network.line_names, network.from_bus, network.to_bus, strict=True):
        if name not in cut:
            graph.add_edge(int(i), int(j))
    islands = {frozenset(k + 1 for k in island) for island in nx.connected_components(graph)}
    assert islands == {
        frozenset({1}),
        frozenset({2, 3, 4, 5}),
        frozenset({6, 11, 12, 13}),
        frozenset({7, 8, 9, 10, 14}),
    }
    first = network.line_names.index("1-2")
    assert network.r_pu[first] == pytest.approx(16 * 0.01938 / 100, rel=1e-6)
    assert network.x_pu[first] == pytest.approx(16 * 0.05917 / 100, rel=1e-6)
    charging = 0.5j * 0.0528 * 100 / 16
    assert network.y_from_pu[first] == pytest.approx(charging, rel=1e-6)
    assert network.y_bus_pu[8] == pytest.approx(0.19j * 100 / 16, rel=1e-6)
    taps = dict(zip(network.line_names, network.tap.tolist(), strict=True))
    assert (taps["4-7"], taps["4-9"], taps["5-6"]) == (0.978, 0.969, 0.932)
    assert sum(tap != 1.0 for tap in taps.values()) == 3


def test_the_lowest_voltage_of_the_mesh_is_near_that_of_the_radial_feeder() -> None:
    """By an own power flow, at full load without any local source."""
    lowest = []
    for name in ("ieee14", "ieee33"):
        case = rs.load_case(name)
        network = case.network
        closed = np.flatnonzero(network.in_service)
        branches = [
            Pi(
                int(network.from_bus[k]) + 1,
                int(network.to_bus[k]) + 1,
                network.r_pu[k],
                network.x_pu[k],
                b=2.0 * network.y_from_pu[k].imag,
                tap=network.tap[k],
            )
            for k in closed
        ]
        fed = np.zeros(len(network.bus_names), complex)
        for load in case.load:
            fed[network.bus(load.bus)] -= load.p_max_mw * complex(1.0, np.tan(np.arccos(0.95)))
        shunts = {k + 1: complex(y) for k, y in enumerate(network.y_bus_pu) if y}
        lowest.append(float(np.abs(power_flow(branches, fed.tolist(), shunts).volts).min()))
    assert lowest == pytest.approx([0.917, 0.912], abs=1e-3)
