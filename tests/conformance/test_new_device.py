"""A device is one file plus its table: everybody else takes to it as soon as it is registered.

Three buses in a row: 2 MW of load at bus 1 beside a grid of 0.5 MW, a turbine of 5 MW at bus 3, for
four hours. The wires carry the 1.5 MW that the grid lacks, so nothing is shed.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

import resilience as rs
from resilience.case import (
    Case,
    DeviceKind,
    DeviceTable,
    case_schema,
    case_text,
    load_case,
    register_device,
    unregister_device,
)
from resilience.dispatch.rules import Idle
from resilience.errors import CaseError, UsageError
from resilience.evaluation.compare import evaluate
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.components import fleet_class
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import Simulator
from resilience.models.symbols import symbol_table
from resilience.planning.ac_check import ac_check_plan
from resilience.planning.plan import load_plan
from resilience.simulation.powers import powers
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.conformance import turbine
from tests.conformance.pump import PumpTable

TURBINE = DeviceKind("turbine", turbine.TurbineTable, "tests.conformance.turbine:Turbines")
PUMP = DeviceKind("pump", PumpTable, "tests.conformance.pump:Pumps")
LOAD = {"p_max_mw": 2.0, "shed_cost_per_mwh": 100.0}
GRID = {"import_max_mw": 0.5, "import_cost_per_mwh": 10.0, "name": "grid1"}
METHODS = ("lp", "milp", "socp", "minlp")


@pytest.fixture(autouse=True)
def _registered() -> Iterator[None]:
    register_device(TURBINE)
    register_device(PUMP)
    yield
    unregister_device("turbine")
    unregister_device("pump")


def windy(**more: Sequence[Mapping[str, Any]]) -> Case:
    devices: dict[str, Any] = {
        "load": [LOAD],
        "grid": [GRID],
        "turbine": [{"bus": "3", "p_max_mw": 5.0, "profile": "wind"}],
        **more,
    }
    return small_case(
        slots=4,
        buses=3,
        lines=[(1, 2, 0.002, 0.002), (2, 3, 0.002, 0.002)],
        profiles={"wind": [1.0, 0.8, 0.9, 1.0]},
        **devices,
    )


def planned(case: Case, method: str) -> rs.Plan:
    plan = rs.solve(case, method=method)
    assert isinstance(plan, rs.Plan)
    return plan


@pytest.mark.parametrize("method", METHODS)
def test_what_it_can_serve_is_not_shed(method: str) -> None:
    plan = planned(windy(), method)
    energy = plan.energy_mwh
    assert plan.shed_mwh == pytest.approx(0.0, abs=1e-5)
    assert plan.objective == pytest.approx(0.0, abs=1e-3)
    assert plan.bound == pytest.approx(plan.objective, abs=1e-3)
    assert -1e-6 <= energy["losses"] <= 0.1
    assert energy["turbine"] + energy["import"] == pytest.approx(8.0 + energy["losses"])
    assert energy["turbine"] + energy["turbine_curtailed"] == pytest.approx(5.0 * 3.7)
    assert max(plan.audit.values()) < 1e-5


def test_it_stands_in_the_tables_of_a_plan_and_in_its_files(tmp_path: Path) -> None:
    plan = planned(windy(), "lp")
    assert plan.tables["power"]["turbine1"].sum() == pytest.approx(plan.energy_mwh["turbine"])
    offered = plan.tables["turbine_available"]["turbine1"]
    np.testing.assert_allclose(offered, [5.0, 4.0, 4.5, 5.0])
    again = load_plan(plan.save(tmp_path / "plan"))
    assert again.tables.keys() == plan.tables.keys()
    assert again.case is not None
    assert again.case.equals(windy())


def test_the_reports_name_it(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    from resilience.text.plan import print_case, print_plan

    console = Console(width=120)
    print_plan(planned(windy(), "lp"), console)
    print_case(windy(), console)
    printed = capsys.readouterr().out
    assert "wind curtailed" in printed
    assert "turbine1@3" in printed


def test_it_is_drawn_in_a_colour_of_its_own() -> None:
    figure = rs.plot_plan(planned(windy(), "lp"))
    areas = figure.axes[0].collections
    colour_of = {str(a.get_label()): to_hex(np.asarray(a.get_facecolor())[0]) for a in areas}
    named = [colour for label, colour in colour_of.items() if not label.startswith("_")]
    assert colour_of["wind"] == turbine.Turbines.colour
    assert named.count(colour_of["wind"]) == 1


def test_the_wires_can_carry_it() -> None:
    checked = ac_check_plan(planned(windy(), "minlp"))
    assert checked.ok
    assert checked.loss_mwh > 0.0


def test_it_can_carry_an_island_alone() -> None:
    forming = {"bus": "3", "p_max_mw": 5.0, "grid_forming": True}
    plan = planned(windy(turbine=[forming], grid=[]), "lp")
    assert plan.shed_mwh == pytest.approx(0.0, abs=1e-6)
    checked = ac_check_plan(plan)
    assert not checked.not_converged
    assert checked.root is not None
    assert checked.root.name == "turbine1"


@pytest.mark.parametrize("methods", [["greedy", "rule"], ["mpc", "stochastic"]])
def test_dispatchers_use_it_and_are_judged(methods: list[str]) -> None:
    """The clairvoyant bound is among the trajectories; every one closes its balance."""
    case = windy(ess=[{"p_max_mw": 1.0, "e_mwh": 2.0}])
    report = evaluate(
        World.build(Microgrid.build(case, "copperplate"), calm(case)), methods, ac=True
    )
    for trajectory in report.trajectories.values():
        fed = powers(report.world, trajectory)
        np.testing.assert_allclose(sum(power.sum(0) for power in fed.values()), 0.0, atol=1e-6)
        assert trajectory.shed_mwh.max() == pytest.approx(0.0, abs=1e-6)
        assert fed["turbine"].sum() > 6.0
    assert report.certificates is not None
    assert all(checked.loss_mwh(np.ones(1)) > 0.0 for checked in report.certificates.values())
    figure = rs.plot_storm(report, methods[0])
    assert "wind" in figure.axes[0].get_legend_handles_labels()[1]


def test_the_network_simulator_steps_it() -> None:
    case = windy(ess=[{"p_max_mw": 1.0, "e_mwh": 2.0}])
    world = World.build(Microgrid.build(case, "lindistflow"), calm(case))
    trajectory = simulate(world, Idle(world.setting))
    assert trajectory.shed_mwh.max() == pytest.approx(0.0, abs=1e-6)
    assert trajectory.flow("turbine.p").sum() > 6.0


def calm(case: Case) -> Scenarios:
    """One scenario in which nothing fails."""
    return Scenarios(("1-2",), np.zeros((1, case.slots, 1), bool), np.ones(1))


def test_a_plan_over_scenarios_has_it(tmp_path: Path) -> None:
    down = np.zeros((1, 4, 2), bool)
    down[0, 2:, 1] = True
    Scenarios(("1-2",), down, np.full(2, 0.5)).save(tmp_path / "storms.csv")
    plan = rs.solve(windy(), method="stochastic", outages=tmp_path / "storms.csv")
    assert isinstance(plan, rs.ScenarioPlan)
    assert plan.expected_shed_mwh == pytest.approx(0.5 * 2 * 1.5, abs=1e-6)
    assert "turbine1" in plan.tables["power"].labels
    assert rs.plot_scenario_plan(plan) is not None


def test_a_case_with_it_is_read_changed_and_written(tmp_path: Path) -> None:
    case = windy()
    path = tmp_path / "windy.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert load_case(path).equals(case)
    (bigger,) = (t.model_copy(update={"p_max_mw": 7.0}) for t in case.devices["turbine"])
    changed = case.replace(turbine=[bigger])
    assert changed.devices["turbine"] == (bigger,)
    child = tmp_path / "child.toml"
    child.write_text('extends = "windy.toml"\n[[turbine]]\nname = "turbine1"\np_max_mw = 6.0\n')
    (merged,) = load_case(child).devices["turbine"]
    assert (merged.bus, getattr(merged, "p_max_mw")) == ("3", 6.0)  # noqa: B009


def test_its_defaults_and_mistakes_are_its_tables_own(tmp_path: Path) -> None:
    text = case_text(windy()).replace("p_max_mw = 5.0\n", "")
    path = tmp_path / "windy.toml"
    path.write_text(text + "\n[defaults.turbine]\np_max_mw = 4.0\n", encoding="utf-8")
    assert load_case(path).devices["turbine"][0].model_dump()["p_max_mw"] == 4.0
    path.write_text(text + "\n[defaults.turbine]\np_mx_mw = 4.0\n", encoding="utf-8")
    with pytest.raises(CaseError, match="did you mean p_max_mw"):
        load_case(path)


def test_the_schema_and_the_reference_pages_have_it() -> None:
    assert "turbine" in case_schema()["properties"]
    assert "turbine" in case_schema()["$defs"]["DefaultsTable"]["properties"]
    assert {"turbine.p", "turbine.available"} <= {row["name"] for row in symbol_table()}
    pages = dict(reference_hook().pages())
    assert "$a_i$ | `turbine.available`" in pages["reference/components/turbine.md"]
    assert "`[[turbine]]`" in pages["reference/case.md"]


def reference_hook() -> ModuleType:
    path = Path(__file__).parents[2] / "docs" / "hooks" / "reference.py"
    spec = importlib.util.spec_from_file_location("reference_hook", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("method", ["lp", "minlp"])
def test_a_new_load_is_served_or_shed_like_any_other(method: str) -> None:
    pumps = [{"bus": "2", "p_max_mw": 4.0, "shed_cost_per_mwh": 5.0}]
    plan = planned(windy(pump=pumps), method)
    assert plan.energy_mwh["demand"] == pytest.approx(24.0)
    assert plan.shed_by_load.keys() == {"pump1"}
    assert plan.shed_by_load["pump1"].keys() == {"price"}
    # Shedding a pump is cheaper than the grid: pumps get what is left of the wind.
    losses = plan.energy_mwh["losses"]
    assert plan.shed_mwh == pytest.approx(24.0 - 5.0 * 3.7 + losses, abs=1e-4)
    assert ac_check_plan(plan).slots == 4


def test_a_new_load_counts_where_dispatchers_are_judged() -> None:
    pumps = [{"bus": "2", "p_max_mw": 4.0, "shed_cost_per_mwh": 5.0, "critical": True}]
    case = windy(pump=pumps, ess=[{"p_max_mw": 1.0, "e_mwh": 2.0}])
    report = evaluate(World.build(Microgrid.build(case, "copperplate"), calm(case)), ["greedy"])
    measures = report.measures["greedy"]
    assert measures.has_critical
    assert measures.daily_shed_mwh.sum() == pytest.approx(
        report.trajectories["greedy"].shed_mwh.sum()
    )
    assert measures.daily_shed_mwh.sum() > 4.0


def test_what_nobody_could_handle_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match=r"\[\[turbine\]\] already means something"):
        register_device(TURBINE)
    with pytest.raises(UsageError, match=r"\[\[network\]\] already means something"):
        register_device(DeviceKind("network", DeviceTable, "tests.conformance.pump:Pumps"))
    with pytest.raises(UsageError, match="allowed: module:Class"):
        register_device(DeviceKind("wind", DeviceTable, "pump.Pumps"))
    with pytest.raises(UsageError, match="no kind of device is called 'wind'"):
        unregister_device("wind")
    unregister_device("pump")
    register_device(DeviceKind("pump", DeviceTable, "tests.conformance.pump:Pumps"))
    with pytest.raises(UsageError, match=r"DeviceTable of .* is no LoadTable"):
        fleet_class("pump")
    monkeypatch.setattr(turbine.Turbines, "curtailed", None)
    with pytest.raises(UsageError, match="Turbines has the role 'weather', but no curtailed"):
        fleet_class("turbine")
    unregister_device("pump")
    register_device(DeviceKind("pump", PumpTable, "tests.conformance.turbine:Turbines"))
    with pytest.raises(UsageError, match="allowed: a DeviceFleet of the kind 'pump'"):
        fleet_class("pump")


def test_the_papers_recourse_refuses_what_it_has_no_equation_for() -> None:
    microgrid = Microgrid.build(windy(), "copperplate")
    with pytest.raises(UsageError, match=r"the paper's recourse does not know turbine\.p"):
        Simulator(microgrid, 1.0, "paper")
