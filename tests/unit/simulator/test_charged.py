"""Dispatchers on networks in which something flows to earth: simulated, and judged by the stage."""

from __future__ import annotations

import numpy as np

import resilience as rs
from resilience.evaluation.report import Report
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import NetworkSimulator
from resilience.testing import small_case


def nobody_beats_the_bound(report: Report) -> bool:
    cost = {str(name): float(x) for name, x in report.frame()["cost_per_day"].items()}
    return len(cost) > 1 and all(value >= cost["clairvoyant"] - 1e-6 for value in cost.values())


def test_charging_that_takes_no_power_is_no_source() -> None:
    simulator = NetworkSimulator(Microgrid.build(rs.load_case("ieee14"), "lindistflow"), 0.25)
    kinds = {name.partition("[")[0] for name in simulator.columns}
    assert kinds == {"load.shed", "pv.p", "generator.p", "grid.import", "grid.export"}


def test_the_shipped_mesh_is_compared_with_its_voltages() -> None:
    """Voltages that take no power are no part of a trajectory, and were judged as if they were."""
    report = rs.compare("ieee14", ["rule"], days=1, draws=2, physics="lindistflow")
    assert nobody_beats_the_bound(report)


def test_voltages_are_told_where_something_takes_power() -> None:
    """Iron losses at both ends of one line, a shunt at one of three buses, and none at the rest."""
    case = small_case(
        slots=4,
        buses=4,
        lines=[
            (1, 2, 0.01, 0.02, {"g_us": 20.0, "b_us": 300.0}),
            (2, 3, 0.01, 0.02),
            (3, 4, 0.01, 0.0),
        ],
        bus_tables={3: {"shunt_p_mw": 0.01, "shunt_q_mvar": -0.05}},
        line_tables=[{"name": "2-3", "breakpoint": True}],
        load=[{"bus": "4", "p_max_mw": 0.4, "shed_cost_per_mwh": 100.0}],
        ess=[{"bus": "3", "p_max_mw": 0.5, "s_mva": 0.6, "e_mwh": 1.0, "soc_initial": 0.5}],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 10.0, "q_max_mvar": 2.0}],
    )
    simulator = NetworkSimulator(Microgrid.build(case, "lindistflow"), 1.0)
    voltages = [name for name in simulator.columns if name.startswith("bus.v_sq")]
    assert voltages == ["bus.v_sq[1]", "bus.v_sq[2]", "bus.v_sq[3]"]
    down = np.zeros((1, 4, 2), bool)
    down[0, 1, 0] = True
    storms = rs.Scenarios(("2-3",), down, np.array([0.5, 0.5]))
    report = rs.compare(
        case, ["rule", "mpc"], scenarios=storms, believe="case", physics="lindistflow"
    )
    assert nobody_beats_the_bound(report)
