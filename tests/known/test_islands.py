"""Islands: each balances itself, with its own forming unit, or is dead and says so."""

from typing import Any

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.models.case_program import CaseProgram, status, terminal_cuts
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.network.graph import closable
from resilience.models.program.unroll import unroll
from resilience.testing import small_case
from tests.known.solving import Solved, power, solved

GRID = {"import_max_mw": 10.0, "import_cost_per_mwh": 0.3}
LOAD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}
METHODS_OF = [
    ("lp", "copperplate"),
    ("lp", "lindistflow"),
    ("socp", "distflow"),
    ("minlp", "distflow"),
]


def cut_off(**devices: Any) -> Case:
    """The grid at bus 1, everything else at bus 2, and the line between fails in hours 2 and 3."""
    placed: dict[str, Any] = {
        kind: [{"bus": "2", **t} for t in tables] for kind, tables in devices.items()
    }
    return small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        outages=["1-2@01:00-03:00"],
        grid=[GRID],
        load=[{"bus": "2", **LOAD}],
        **placed,
    )


STORAGE = {"p_max_mw": 1.0, "e_mwh": 4.0, "soc_initial": 1.0, "degradation_cost_per_mwh": 0.4}


@pytest.mark.parametrize(("method", "physics"), METHODS_OF)
def test_an_island_without_forming_unit_is_dead(method: str, physics: Any) -> None:
    """PV, storage and a generator that only follow: all demand is shed, nothing else moves."""
    case = cut_off(
        pv=[{"p_max_mw": 5.0}],
        ess=[STORAGE | {"grid_forming": False, "s_mva": 1.0}],
        generator=[{"p_max_mw": 2.0, "grid_forming": False, "q_max_mvar": 1.0}],
    )
    found = solved(case, method, physics)
    dead = np.array([False, True, True, False])
    assert found["load.shed"][0] == pytest.approx(1.0 * dead, abs=1e-6)
    for name in ("pv.p", "ess.charge", "ess.discharge", "generator.p", "ess.q", "generator.q"):
        if found.problem.standard.has(name):
            assert np.abs(found[name][:, dead]).max() == 0.0
    assert np.abs(found["line.p"][:, dead]).max() == 0.0
    assert found["ess.energy"][0, 1] == pytest.approx(found["ess.energy"][0, 2])


def test_must_take_pv_on_a_dead_island_is_not_taken() -> None:
    case = cut_off(pv=[{"p_max_mw": 0.5, "curtailable": False}])
    found = solved(case, "lp")
    assert found["pv.p"][0] == pytest.approx([0.5, 0, 0, 0.5])
    assert found.objective == pytest.approx(2 * 0.5 * 0.3 + 2 * 1.5)


def test_must_run_units_stop_with_their_island() -> None:
    """A following unit that was on for one hour of at least three is stopped by the fault; what is
    left of its minimum time lapses, its minimum time off (2 h) counts, so it stands to the end.
    """
    unit = {"p_max_mw": 1.0, "p_min_mw": 0.5, "cost_per_mwh": 0.1, "grid_forming": False}
    times = {"min_up_h": 3.0, "min_down_h": 3.0, "initial_on": True, "initial_hours": 1.0}
    ramps = {"ramp_up_mw_per_h": 0.5, "ramp_down_mw_per_h": 0.5, "p_initial_mw": 1.0}
    found = solved(cut_off(generator=[unit | times | ramps]), "milp")
    assert found["generator.on"][0] == pytest.approx([1, 0, 0, 0])
    assert found["generator.p"][0] == pytest.approx([1, 0, 0, 0])
    assert found.objective == pytest.approx(0.1 + 2 * 1.5 + 0.3)


@pytest.mark.parametrize(("min_down_h", "on"), [(1.0, [1, 0, 0, 1]), (3.0, [1, 0, 0, 0])])
def test_a_minimum_time_up_lapses_in_a_dead_island(min_down_h: float, on: list[float]) -> None:
    """Of 8 h it was to run, a fault leaves one. It returns with the line, but for its time off:
    having to run and having to stand at once would leave no plan.
    """
    unit = {"p_max_mw": 1.0, "p_min_mw": 0.5, "cost_per_mwh": 0.1, "grid_forming": False}
    times = {"min_up_h": 8.0, "min_down_h": min_down_h, "initial_on": True, "initial_hours": 1.0}
    found = solved(cut_off(generator=[unit | times]), "milp")
    assert found["generator.on"][0] == pytest.approx(on)


FORMING = [
    ({"ess": [STORAGE]}, True),
    ({"ess": [STORAGE | {"grid_forming": False}]}, False),
    ({"generator": [{"p_max_mw": 1.0, "cost_per_mwh": 0.4}]}, True),
    ({"generator": [{"p_max_mw": 1.0, "cost_per_mwh": 0.4, "grid_forming": False}]}, False),
    ({"pv": [{"p_max_mw": 1.0}]}, False),
    ({"ess": [STORAGE | {"p_max_mw": 0.0, "e_mwh": 1.0}], "pv": [{"p_max_mw": 1.0}]}, False),
    ({"ess": [STORAGE | {"soc_initial": 0.0, "p_max_mw": 0.1}], "pv": [{"p_max_mw": 1.0}]}, True),
]


@pytest.mark.parametrize(("devices", "alive"), FORMING)
def test_storage_and_generators_form_islands_unless_they_say_otherwise(
    devices: dict, alive: bool
) -> None:
    """1 MW is at hand in every one of these islands; whether it can be used is the question."""
    found = solved(cut_off(**devices), "lp")
    assert found["load.shed"][0, 1] == pytest.approx(0.0 if alive else 1.0)
    assert found.problem.situation.alive[1, 1] == alive


def test_a_grid_that_does_not_form_needs_one_that_does() -> None:
    following = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        grid=[GRID | {"grid_forming": False}],
        load=[{"bus": "2", **LOAD}],
        ess=[{"bus": "2", **STORAGE, "p_max_mw": 0.1}],
    )
    assert solved(following, "lp")["load.shed"].sum() == pytest.approx(0.0)
    apart = following.replace(outages="1-2@00:00-01:00")
    assert solved(apart, "lp")["load.shed"].sum() == pytest.approx(0.9)


def test_an_ac_island_needs_reactive_power_for_its_lines() -> None:
    """Every flow takes x l in Mvar. Storage at unity power factor cannot give it; a rating can."""
    lone: dict[str, Any] = {"slots": 1, "buses": 2, "lines": [(1, 2, 0.01, 0.01)]}
    load = [{"bus": "2", **LOAD}]
    without = small_case(**lone, ess=[STORAGE], load=load)
    assert solved(without, "lp")["load.shed"].sum() == pytest.approx(0.0)
    assert solved(without, "minlp")["load.shed"].sum() == pytest.approx(1.0, abs=1e-3)
    rated = small_case(**lone, ess=[STORAGE | {"s_mva": 1.1, "p_min_mw": -1.1}], load=load)
    assert solved(rated, "minlp")["load.shed"].sum() == pytest.approx(0.0, abs=1e-6)


def window(slots: int = 24) -> Case:
    """ieee33 around its storm, half-hour by half-hour of the afternoon."""
    case = load_case("ieee33")
    return case.replace(start=case.start.replace(hour=13), slots=slots)


def imbalance(found: Solved) -> float:
    """Largest |supply - demand - losses| of any island in any slot, MW."""
    problem = found.problem
    p, _ = power(found)
    island = problem.situation.island
    lost = np.zeros_like(p)
    if problem.standard.has("line.l"):
        heat = found["line.l"] * problem.microgrid.network.r_pu[:, None]
        np.add.at(lost, problem.microgrid.network.from_bus, heat)
    worst = 0.0
    for t in range(problem.case.slots):
        net = np.bincount(island[:, t], weights=(p - lost)[:, t])
        worst = max(worst, float(np.abs(net).max()))
    return worst


@pytest.mark.parametrize(("method", "physics"), METHODS_OF)
def test_every_island_balances_itself(method: str, physics: Any) -> None:
    found = solved(window(), method, physics)
    situation = found.problem.situation
    assert situation.island.max() + 1 == 5
    assert situation.island[:, 0].max() == 0
    assert imbalance(found) < 1e-6
    down = found.problem.data["line.up"] < 0.5
    assert down.any()
    assert np.abs(found["line.p"][down]).max() == 0.0


def unmerged(case: Case) -> CaseProgram:
    """Copperplate with every bus and line as its own."""
    network = closable(case.network)
    lines = np.array([case.network.line(name) for name in network.line_names])
    hit = {outage.line for outage in case.outages}
    fallible = network.breakpoint | np.isin(network.line_names, list(hit))
    buses = np.arange(len(network.bus_names))
    grid = Microgrid(case, "copperplate", network, buses, lines, fallible)
    labels = [case.slot_label(t) for t in range(case.slots)]
    standard = unroll([grid.stage(case.step_h)], Tree.chain(labels), terminal_cuts(grid))
    situation = grid.situation(status(case))
    return CaseProgram(grid, standard, situation, grid.data(situation), grid.start())


def loops() -> Case:
    """A ring of four buses with one rated and one fallible line, and a spur that can be rated."""
    return small_case(
        slots=3,
        buses=5,
        lines=[(i, j, 0.01, 0.01) for i, j in ((1, 2), (2, 3), (3, 4), (4, 1), (4, 5))],
        line_tables=[{"name": "2-3", "rating_mva": 0.3}, {"name": "4-1", "breakpoint": True}],
        outages=["4-1@01:00-02:00"],
        grid=[GRID],
        load=[{"bus": b, **LOAD} for b in ("2", "3", "5")],
        ess=[{"bus": "5", **STORAGE, "soc_initial": 0.2}],
        generator=[{"bus": "3", "p_max_mw": 0.5, "cost_per_mwh": 0.6}],
    )


@pytest.mark.parametrize("name", ["ieee33", "window", "loops"])
def test_merging_buses_changes_nothing_at_copperplate(name: str) -> None:
    from resilience.models.methods import METHODS, MethodOptions

    case = {"ieee33": lambda: load_case("ieee33"), "window": window, "loops": loops}[name]()
    merged, whole = solved(case, "lp", "copperplate"), unmerged(case)
    found = METHODS["lp"][0](whole, MethodOptions())
    assert found.objective == pytest.approx(merged.objective, rel=1e-9)
    buses = len(merged.problem.microgrid.network.bus_names)
    assert buses == {"ieee33": 5, "window": 5, "loops": 2}[name]
    assert len(whole.microgrid.network.bus_names) == len(case.network.bus_names)
    merged_supply = merged["load.shed"].sum()
    assert merged_supply == pytest.approx(found.z[whole.standard.columns("load.shed")].sum())


def test_a_merged_bus_is_the_one_its_devices_stand_at() -> None:
    case = load_case("ieee33")
    microgrid = Microgrid.build(case, "copperplate")
    assert microgrid.network.bus_names == ("1", "2", "19", "23", "26")
    assert microgrid.network.bus_names[microgrid.bus_of[case.network.bus("18")]] == "2"
    assert microgrid.network.bus_names[microgrid.bus_of[case.network.bus("33")]] == "26"
