"""Rare states are defined, not accidental: every one of them worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.errors import UsageError
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import Simulator, Step
from resilience.models.simulator import simulator as simulator_module
from resilience.testing import small_case

LOAD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}
ESS = {"p_max_mw": 1.0, "e_mwh": 4.0}
GRID = {"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}


def stepped(case: Case, action: Any, *up: list[bool]) -> tuple[Simulator, Step]:
    """One hour with storage half full; a row of `up` per line, a column per member."""
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    asked = np.array(action)
    status = np.array(up, bool).reshape(len(up), asked.shape[1])
    situation = simulator.microgrid.situation(status, lambda _: np.ones(asked.shape[1]))
    data = simulator.stacked(simulator.microgrid.data(situation))
    energy = np.broadcast_to((simulator.low + simulator.high) / 2, asked.shape)
    return simulator, simulator.step(energy, asked, data, situation.island)


def flow(found: tuple[Simulator, Step], name: str) -> Any:
    return found[1].flows[found[0].columns.index(name)]


def test_an_island_with_no_source_sheds_and_moves_nothing() -> None:
    case = small_case(
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{**LOAD, "bus": "2"}],
        ess=[{**ESS, "bus": "2", "grid_forming": False}],
        grid=[GRID],
    )
    _, step = stepped(case, [[-1.0, -1.0]], [False, True])
    assert step.cost == pytest.approx([5.0, 0.0])
    assert step.energy[0] == pytest.approx([2.0, 1.0])
    assert step.spill.max() == 0.0


def test_islanded_charging_sheds_first_and_is_cut_back_beyond() -> None:
    """1 MW of charging against 0.6 of sun and 0.4 of load: all is shed, 0.6 goes into storage."""
    pv = {"p_max_mw": 0.6, "curtailable": False}
    case = small_case(load=[{**LOAD, "p_max_mw": 0.4}], ess=[ESS], pv=[pv])
    found = stepped(case, [[2.0, 0.3]])
    assert found[1].charge[0] == pytest.approx([0.6, 0.3])
    assert flow(found, "load.shed[load1]") == pytest.approx([0.4, 0.1])
    assert found[1].spill[0] == pytest.approx([0.0, 0.0])


def test_islanded_charging_without_any_surplus_stops() -> None:
    found = stepped(small_case(load=[LOAD], ess=[ESS]), [[1.0]])
    assert found[1].charge[0] == pytest.approx([0.0])
    assert flow(found, "load.shed[load1]") == pytest.approx([1.0])
    assert found[1].energy[0] == pytest.approx([2.0])


def test_more_discharge_than_load_is_cut_back_pro_rata() -> None:
    """2 and 1 MW offered to 1.5 MW of load: each gives half of its offer."""
    ess = [{**ESS, "p_max_mw": 2.0}, ESS]
    found = stepped(small_case(load=[{**LOAD, "p_max_mw": 1.5}], ess=ess), [[-2.0], [-1.0]])
    assert found[1].discharge[:, 0] == pytest.approx([1.0, 0.5])
    assert found[1].energy[:, 0] == pytest.approx([1.0, 1.5])
    assert found[1].cost == pytest.approx([0.0])


def test_a_surplus_curtails_then_exports_then_cuts_discharging_back() -> None:
    """Exports cost 0.2: sun of 2 MW is curtailed first, 1 MW is exported, then storage gives in."""
    case = small_case(
        load=[{**LOAD, "p_max_mw": 0.5}],
        pv=[{"p_max_mw": 2.0}],
        ess=[{**ESS, "p_max_mw": 2.0}],
        grid=[{**GRID, "export_max_mw": 1.0, "export_cost_per_mwh": 0.2}],
    )
    found = stepped(case, [[0.0, -1.0, -2.0]])
    assert flow(found, "pv.p[pv1]") == pytest.approx([0.5, 0.0, 0.0])
    assert flow(found, "grid.export[grid1]") == pytest.approx([0.0, 0.5, 1.0])
    assert found[1].discharge[0] == pytest.approx([0.0, 1.0, 1.5])
    assert found[1].cost == pytest.approx([0.0, 0.1, 0.2])


def test_an_export_that_pays_takes_the_surplus_of_the_sun() -> None:
    case = small_case(
        load=[{**LOAD, "p_max_mw": 0.5}],
        pv=[{"p_max_mw": 2.0}],
        grid=[{**GRID, "export_max_mw": 1.0, "export_cost_per_mwh": -0.2}],
    )
    found = stepped(case, np.empty((0, 1)))
    assert flow(found, "pv.p[pv1]") == pytest.approx([1.5])
    assert found[1].cost == pytest.approx([-0.2])


def test_power_that_must_be_taken_is_spilled_when_nobody_can() -> None:
    """0.6 MW of sun on 0.4 of load: discharging stops and 0.2 MW are spilled."""
    pv = {"p_max_mw": 0.6, "curtailable": False}
    case = small_case(load=[{**LOAD, "p_max_mw": 0.4}], ess=[ESS], pv=[pv])
    _, step = stepped(case, [[-1.0, 0.2, 0.5]])
    assert step.discharge[0] == pytest.approx([0.0, 0.0, 0.0])
    assert step.spill[0] == pytest.approx([0.2, 0.0, 0.0])
    assert step.charge[0] == pytest.approx([0.0, 0.2, 0.5])
    assert step.cost == pytest.approx([0.0, 0.0, 1.5])  # charging 0.5 sheds 0.3


EARNING = {"import_max_mw": 2.0, "import_cost_per_mwh": -3.0}
EARNING |= {"export_max_mw": 0.9, "export_cost_per_mwh": 1.0}


def test_where_importing_and_exporting_at_once_would_earn_one_of_them_is_closed() -> None:
    """1.6 MW of sun on 0.4 MW of load: 0.9 are exported and 0.3 spilled; by night 0.4 come in."""
    pv = {"p_max_mw": 1.6, "curtailable": False}
    case = small_case(load=[{**LOAD, "p_max_mw": 0.4}], ess=[ESS], pv=[pv], grid=[EARNING])
    found = stepped(case, [[0.0, 0.2, 0.8, -0.5]])
    assert found[1].spill[0] == pytest.approx([0.3, 0.1, 0.0, 0.3])
    assert flow(found, "grid.export[grid1]") == pytest.approx([0.9, 0.9, 0.4, 0.9])
    assert flow(found, "grid.import[grid1]") == pytest.approx([0.0, 0.0, 0.0, 0.0])
    assert flow(found, "pv.p[pv1]") == pytest.approx([1.6] * 4)
    assert found[1].discharge[0] == pytest.approx([0.0] * 4)
    assert found[1].cost == pytest.approx([0.9, 0.9, 0.4, 0.9])
    calm = stepped(
        small_case(load=[{**LOAD, "p_max_mw": 0.4}], ess=[ESS], grid=[EARNING]), [[-0.9, 0.7]]
    )
    assert flow(calm, "grid.export[grid1]") == pytest.approx([0.5, 0.0])
    assert calm[1].discharge[0] == pytest.approx([0.9, 0.0])
    assert calm[1].charge[0] == pytest.approx([0.0, 0.7])
    dark = stepped(small_case(load=[LOAD], ess=[ESS], grid=[EARNING]), [[0.3, -0.2]])
    assert flow(dark, "grid.import[grid1]") == pytest.approx([1.3, 0.8])
    assert dark[1].charge[0] == pytest.approx([0.3, 0.0])
    assert dark[1].discharge[0] == pytest.approx([0.0, 0.2])
    assert dark[1].cost == pytest.approx([-3.9, -2.4])


@pytest.mark.parametrize("connections", [4, 5])
def test_more_than_four_connections_that_would_earn_are_refused(connections: int) -> None:
    """Each at a bus of its own, with a load of its own; 4 are 16 ways to close them."""
    buses = range(1, connections + 1)
    case = small_case(
        buses=connections,
        grid=[{**EARNING, "bus": str(k)} for k in buses],
        load=[{**LOAD, "bus": str(k), "p_max_mw": 0.2 * k} for k in buses],
    )
    if connections == 4:
        _, step = stepped(case, np.empty((0, 1)))
        assert step.cost == pytest.approx([-3.0 * (0.2 + 0.4 + 0.6 + 0.8)])
        return
    with pytest.raises(UsageError, match="5 grid connections earn by importing and exporting"):
        stepped(case, np.empty((0, 1)))


@pytest.mark.parametrize("most", [1, 2])
def test_orders_that_were_forgotten_are_found_again(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three prices of the grid in turn, above and below the generator's; fewer are kept."""
    monkeypatch.setattr(simulator_module, "MAX_ORDERS", most)
    case = small_case(
        slots=3,
        profiles={"price": [0.2, 0.5, 1.0]},
        load=[{**LOAD, "p_max_mw": 1.4}],
        generator=[{"p_max_mw": 0.9, "cost_per_mwh": 2.0}],
        grid=[{"import_max_mw": 1.1, "import_cost_per_mwh": 5.0, "price_profile": "price"}],
    )
    simulator = Simulator(Microgrid.build(case, "copperplate"), 1.0)
    situation = simulator.microgrid.situation(np.ones((0, 3), bool), case.profile)
    data = simulator.stacked(simulator.microgrid.data(situation))
    none = np.empty((0, 1))
    exact = [1.1 * 1.0 + 0.3 * 2.0, 0.9 * 2.0 + 0.5 * 2.5, 0.9 * 2.0 + 0.5 * 5.0]
    for t in (0, 1, 2, 1, 0, 2, 0):
        step = simulator.step(none, none, data[:, [t]], situation.island[:, [t]])
        assert step.cost == pytest.approx([exact[t]])
        assert len(simulator._priced_orders) <= most
        assert len(simulator._orders) <= most


def test_a_case_without_loads_without_storage_or_without_anything_else() -> None:
    nothing = np.empty((0, 2))
    _, step = stepped(small_case(grid=[GRID]), nothing)
    assert step.cost == pytest.approx([0.0, 0.0])
    _, step = stepped(small_case(load=[LOAD], grid=[GRID]), nothing)
    assert step.cost == pytest.approx([1.0, 1.0])
    assert step.energy.shape == (0, 2)
    found = stepped(small_case(ess=[ESS], grid=[GRID]), [[0.5, -0.5]])
    assert found[1].cost == pytest.approx([0.5, 0.0])
    assert found[1].energy[0] == pytest.approx([2.5, 2.0])  # nobody takes what it would give


def test_islands_of_a_mesh_share_while_one_path_is_left() -> None:
    """A triangle: one line down changes nothing, two cut bus 3 off with its load."""
    case = small_case(
        buses=3,
        lines=[(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01), (1, 3, 0.01, 0.01)],
        line_tables=[{"name": f"{i}-{j}", "breakpoint": True} for i, j in ((1, 2), (2, 3), (1, 3))],
        load=[{**LOAD, "bus": "3"}],
        ess=[{**ESS, "bus": "2"}],
        grid=[GRID],
    )
    up = [[True, True, False, False], [True, False, False, True], [True, True, False, False]]
    _, step = stepped(case, [[-0.4] * 4], *up)
    assert step.cost == pytest.approx([0.6, 0.6, 5.0, 3.0])
    assert step.discharge[0] == pytest.approx([0.4, 0.4, 0.0, 0.4])
