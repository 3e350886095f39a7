"""Plans: tables, balances, reasons, and what survives a save."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.planning.tables import table_units
from resilience.results import PLAN, replacing

HEAD = """
name = "small"
[time]
start = 2016-07-12T00:00:00
slots = 4
step_min = 60.0
[network]
bus = [{ name = "1", vn_kv = 12.66 }, { name = "2", vn_kv = 12.66 }]
line = [{ from = "1", to = "2", r_ohm = 0.5, x_ohm = 0.3 }]
[[grid]]
bus = "1"
import_max_mw = 5.0
import_cost_per_mwh = 1.0
"""
LOAD = """
[[load]]
name = "town"
bus = "2"
p_max_mw = 2.0
shed_cost_per_mwh = 10.0
"""


def case(tmp_path: Path, text: str) -> rs.Case:
    path = tmp_path / "small.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return rs.load_case(path)


@pytest.fixture(scope="module")
def storm() -> rs.Plan:
    return rs.solve("ieee33", "minlp", outages="1-2@14:00-24:00, 6-26@10:00-24:00")


def test_every_table_has_a_unit_and_a_column_per_label(storm: rs.Plan) -> None:
    assert set(storm.tables) <= set(table_units())
    for table in storm.tables.values():
        assert table.values.shape == (len(table.labels), 96)


def test_energy_is_conserved_and_losses_are_those_of_the_wires(storm: rs.Plan) -> None:
    e = storm.energy_mwh
    assert e["losses"] == pytest.approx(
        e["pv"] + e["generators"] + e["import"] + e["discharge"]
        - (e["demand"] - e["shed"]) - e["charge"] - e["export"]
    )  # fmt: skip
    assert storm.case is not None
    network = storm.case.network
    at = [network.line(name) for name in storm.tables["line_power"].labels]
    p, q = storm.tables["line_power"].values, storm.tables["line_reactive"].values
    v = storm.tables["voltage"].values[network.from_bus[at]]
    loss = network.r_pu[at, None] * (p**2 + q**2) / v**2
    assert e["losses"] == pytest.approx(loss.sum() * 0.25, rel=1e-5)


def test_stored_energy_follows_the_power(storm: rs.Plan) -> None:
    assert storm.case is not None
    for unit in storm.case.ess:
        power, energy = storm.tables["power"][unit.name], storm.tables["energy"][unit.name]
        gain = np.maximum(-power, 0.0) * unit.efficiency_charge
        drain = np.maximum(power, 0.0) / unit.efficiency_discharge
        start = unit.soc_initial * unit.e_mwh
        np.testing.assert_allclose(energy, start + np.cumsum(gain - drain) * 0.25, atol=1e-6)


def test_costs_are_prices_times_energy(storm: rs.Plan) -> None:
    shed = storm.tables["shed"].values.sum() * 0.25
    assert storm.costs["load.shed"] == pytest.approx(1.5 * shed)
    assert storm.shed_mwh == pytest.approx(shed, rel=1e-12)
    assert storm.costs["generator.energy"] == pytest.approx(0.5 * storm.energy_mwh["generators"])
    stored = storm.tables["energy"].values[:, -1].sum()
    assert storm.terminal_credit == pytest.approx(0.35 * stored)
    assert storm.objective == pytest.approx(storm.operating_cost - storm.terminal_credit)


def test_an_island_without_a_forming_unit_is_dead_and_says_so(tmp_path: Path) -> None:
    plan = rs.solve(case(tmp_path, LOAD), "lp", outages="1-2@01:00-03:00")
    assert plan.shed_by_load == {"town": {"no source": pytest.approx(4.0)}}
    np.testing.assert_array_equal(plan.tables["island"]["2"] == 0, [False, True, True, False])


def test_reasons_power_energy_and_block(tmp_path: Path) -> None:
    weak = LOAD + '[[generator]]\nname = "g"\nbus = "2"\np_max_mw = 0.5\ncost_per_mwh = 2.0\n'
    plan = rs.solve(case(tmp_path, weak), "lp", outages="1-2@01:00-03:00")
    assert plan.shed_by_load == {"town": {"power": pytest.approx(3.0)}}
    plan = rs.solve(case(tmp_path, LOAD + store(1.2)), "lp", outages="1-2@01:00-02:00")
    assert plan.shed_by_load == {"town": {"energy": pytest.approx(0.8)}}
    whole = weak.replace("shed_cost_per_mwh", "block = true\nshed_cost_per_mwh")
    plan = rs.solve(case(tmp_path, whole), "milp", outages="1-2@01:00-03:00")
    assert plan.shed_by_load == {"town": {"block": pytest.approx(4.0)}}


def store(e_mwh: float) -> str:
    """A full store at bus 2."""
    store = '[[ess]]\nname = "b"\nbus = "2"\np_max_mw = 2.0\nsoc_initial = 1.0\n'
    return store + f"e_mwh = {e_mwh}\n"


def loads(clinic: list[float], town: list[float]) -> str:
    """A load of 1.5 MW at bus 2 that is dearer to shed than the town, and one that is cheaper."""
    dear = '[[load]]\nname = "clinic"\nbus = "2"\np_max_mw = 1.5\nshed_cost_per_mwh = 30.0\n'
    cheap = '[[load]]\nname = "shop"\nbus = "2"\np_max_mw = 0.25\nshed_cost_per_mwh = 8.0\n'
    columns = f"[profiles.columns]\nclinic = {clinic}\ntown = {town}\n"
    town_load = LOAD.replace("p_max_mw", 'profile = "town"\np_max_mw')
    return town_load + dear + 'profile = "clinic"\n' + cheap + columns


def test_what_is_saved_for_dearer_hours_is_empty_after_them(tmp_path: Path) -> None:
    """Of 2 MWh the clinic takes 0.15 and then 1.5; the town asks in the first hour only, so it gets
    the others then, and the shop nothing.
    """
    text = loads([0.2, 0.1, 1.0, 0.3], [0.9, 1.0, 0.0, 0.8]) + store(2.0)
    plan = rs.solve(case(tmp_path, text), "lp", outages="1-2@01:00-03:00")
    assert plan.shed_by_load == {
        "town": {"saved": pytest.approx(1.65)},
        "shop": {"saved": pytest.approx(0.25), "energy": pytest.approx(0.25)},
    }


def test_an_island_is_dark_as_soon_as_the_store_that_formed_it_is_empty(tmp_path: Path) -> None:
    """The clinic asks in the first hour only, and takes all there is."""
    text = loads([0.2, 1.0, 0.0, 0.3], [0.9, 0.7, 0.4, 0.8]) + store(1.2)
    plan = rs.solve(case(tmp_path, text), "lp", outages="1-2@01:00-03:00")
    assert plan.shed_by_load == {
        "town": {"energy": pytest.approx(1.4), "no source": pytest.approx(0.8)},
        "clinic": {"energy": pytest.approx(0.3)},
        "shop": {"energy": pytest.approx(0.25), "no source": pytest.approx(0.25)},
    }


def test_a_saved_plan_loads_back(storm: rs.Plan, tmp_path: Path) -> None:
    storm.save(tmp_path / "run")
    back = rs.load_plan(tmp_path / "run")
    assert back.summary() == storm.summary()
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["method"] == "minlp"
    for name, table in storm.tables.items():
        assert back.tables[name].labels == table.labels
        np.testing.assert_array_equal(back.tables[name].values, table.values)
    assert back.case is not None
    assert storm.case is not None
    assert back.case.equals(storm.case)


def test_nothing_half_written_stays(tmp_path: Path) -> None:
    def fail() -> None:
        with replacing(tmp_path / "run", PLAN) as folder:
            (folder / "power.csv").write_text("half", encoding="utf-8")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(rs.UsageError, match="holds no result"):
        rs.load_plan(tmp_path)


def test_frames_are_indexed_by_time(storm: rs.Plan) -> None:
    frame = storm.frame("soc")
    assert frame.shape == (96, 5)
    assert str(frame.index[57]) == "2016-08-26 14:15:00"
    with pytest.raises(rs.UsageError, match="no table"):
        storm.frame("weather")


def test_a_plan_is_drawn(storm: rs.Plan, tmp_path: Path) -> None:
    figure = rs.plot_plan(storm, tmp_path / "plan.png")
    assert [axis.get_ylabel().split(",")[0].split("\n")[0] for axis in figure.axes] == [
        "power", "state of", "shed", "voltage", "bus", "lines",
    ]  # fmt: skip
    assert (tmp_path / "plan.png").stat().st_size > 50_000


def test_missing_reactive_power_is_named(tmp_path: Path) -> None:
    lagging = LOAD.replace("shed_cost", "power_factor = 0.9\nshed_cost")
    unit = '[[generator]]\nname = "g"\nbus = "2"\np_max_mw = 5.0\ncost_per_mwh = 2.0\n'
    blind = rs.solve(case(tmp_path, lagging + unit), "lp", outages="1-2@01:00-03:00")
    assert blind.shed_by_load == {"town": {"reactive": pytest.approx(4.0)}}
    able = unit + "q_max_mvar = 3.0\n"
    assert rs.solve(case(tmp_path, lagging + able), "lp", outages="1-2@01:00-03:00").shed_mwh == 0.0
