"""Of a network file nothing is missing that is not named, and its totals are those of the file."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case, load_case, new_case_text
from resilience.case.networks.omissions import omission_text
from resilience.case.starter import starter
from tests.unit.case.paper_feeders import PAPER_FEEDERS

CALM = (("slots = 96", "slots = 1"), ("step_min = 15", "step_min = 60"))


def starter_case(network: str, folder: Path, *changes: tuple[str, str]) -> Case:
    text = new_case_text(network)
    for old, new in (*CALM, *changes):
        assert old in text
        text = text.replace(old, new)
    path = folder / "case.toml"
    path.write_text(text)
    return load_case(path)


def left_out(network: str) -> list[str]:
    return omission_text(starter(network).omissions).split("; ")


def file_of(name: str, folder: Path) -> str:
    path = folder / f"{name}.m"
    path.write_text(PAPER_FEEDERS[name].matpower_text())
    return str(path)


def asked_of(case: Case) -> complex:
    """MW and Mvar that the loads of a case ask for."""
    return complex(sum(d.p_max_mw for d in case.load), sum(d.q_peak_mvar for d in case.load))


def asked_in(name: str) -> complex:
    """MW and Mvar of all loads of a network of pandapower, by its own tables."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pandapower import networks

        table = getattr(networks, name)().load
    return complex((table.p_mw * table.scaling).sum(), (table.q_mvar * table.scaling).sum())


NAMED = {
    "case4_dist": ["1 held voltage (gen400), here free within the limits of the bus"],
    "case16am": [""],
    "case16ci": ["1 load bus of one fixed voltage (4), here free from 0.9 to 1.1 pu"],
    "case17me": [""],
    "case18": [""],
}


@pytest.mark.parametrize("name", PAPER_FEEDERS)
def test_what_is_left_out_of_a_matpower_feeder_is_named(name: str, tmp_path: Path) -> None:
    assert left_out(file_of(name, tmp_path)) == NAMED[name]


@pytest.mark.parametrize("name", PAPER_FEEDERS)
def test_a_matpower_feeder_comes_over_with_its_totals(name: str, tmp_path: Path) -> None:
    case, ppc = starter_case(file_of(name, tmp_path), tmp_path), PAPER_FEEDERS[name].ppc()
    base_mva = PAPER_FEEDERS[name].base_mva
    assert asked_of(case) == pytest.approx(complex(*ppc["bus"][:, 2:4].sum(0)), rel=1e-6)
    impedance = ppc["branch"][:, 2:4].sum(0) / base_mva
    network = case.network
    assert [network.r_pu.sum(), network.x_pu.sum()] == pytest.approx(impedance, rel=1e-9)
    assert network.in_service.sum() == ppc["branch"][:, 10].sum()
    units = [*case.grid, *case.generator]
    assert sorted(unit.bus for unit in units) == sorted(f"{bus:g}" for bus in ppc["gen"][:, 0])
    assert network.v_max_pu[network.bus("5" if "5" in network.bus_names else "2")] == 1.1


@pytest.mark.parametrize("name", ["case16ci", "case17me", "case18"])
def test_a_calm_hour_is_that_of_pandapowers_power_flow(name: str, tmp_path: Path) -> None:
    """Of feeders from which nothing is left out; their grids are said to give less than is asked.

    The limits are wide: 17me falls to 0.87 pu, where the file allows 0.9.
    """
    from pandapower.converter.pypower.from_ppc import from_ppc

    wide = ("# v_min_pu = 0.9", "v_min_pu = 0.5"), ("# v_max_pu = 1.1", "v_max_pu = 1.5")
    case = starter_case(file_of(name, tmp_path), tmp_path, *wide)
    plan = rs.solve(case, method="minlp")
    feeder = PAPER_FEEDERS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandapower as pp

        ppc = {"version": 2, "baseMVA": feeder.base_mva, **feeder.ppc()}
        net = from_ppc(ppc, f_hz=50)
        pp.runpp(net, numba=False, tolerance_mva=1e-9)
    assert plan.shed_mwh == pytest.approx(0.0, abs=1e-6)
    branches = (net.res_line, net.res_trafo, net.res_impedance)
    lost = sum(float(found.pl_mw.sum()) for found in branches if len(found))
    assert plan.energy_mwh["losses"] == pytest.approx(lost, rel=1e-5)
    lowest = plan.tables["voltage"].values[:, 0].min()
    np.testing.assert_allclose(lowest, net.res_bus.vm_pu.min(), atol=1e-6)
    if name == "case18":  # by MATPOWER's own power flow
        assert plan.energy_mwh["losses"] == pytest.approx(0.260188, abs=1e-6)
        assert lowest == pytest.approx(1.02677, abs=5e-6)


@pytest.fixture(scope="module")
def cigre(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The CIGRE MV network with all of its distributed generation, as a file."""
    path = tmp_path_factory.mktemp("cigre") / "cigre.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandapower as pp
        from pandapower import networks

        pp.to_json(networks.create_cigre_network_mv(with_der="all"), str(path))
    return str(path)


def test_cigre_mv_comes_over_with_all_of_its_generation(cigre: str, tmp_path: Path) -> None:
    """Sizes as the benchmark has them: CIGRE TF C6.04.02, 2014, table 7.7."""
    assert left_out(cigre) == [
        "1 wind turbine of 1.5 MW (WKA 7), here in comments, to be given a profile",
        "2 storages without an energy of 0.8 MW in all (Battery 1, Battery 2), here in comments, "
        "to be given e_mwh",
    ]
    case = starter_case(cigre, tmp_path)
    assert {unit.name for unit in case.pv} == {f"PV {k}" for k in (3, 4, 5, 6, 8, 9, 10, 11)}
    assert sum(unit.p_max_mw for unit in case.pv) == pytest.approx(0.21)
    assert {unit.name: unit.p_max_mw for unit in case.generator} == {
        "Residential fuel cell 1": 0.033,
        "CHP diesel 1": 0.31,
        "Fuel cell 1": 0.212,
        "Residential fuel cell 2": 0.014,
    }
    assert asked_of(case) == pytest.approx(asked_in("create_cigre_network_mv"), rel=1e-9)


def test_what_stands_in_comments_is_right(cigre: str, tmp_path: Path) -> None:
    text = new_case_text(cigre)
    for block in text.split("\n\n"):
        if 'name = "WKA 7"' in block or 'name = "Battery' in block:
            lines = [line for line in block.splitlines() if line.startswith("# ")]
            keys = [line[2:] for line in lines if " = " in line or line.startswith("# [[")]
            text = text.replace(block, "\n".join(keys).replace("e_mwh = 0.0", "e_mwh = 1.2"))
    path = tmp_path / "case.toml"
    path.write_text(text + f"\n[profiles.columns]\nwind = {[0.4] * 96}\n")
    case = load_case(path)
    assert [(unit.name, unit.p_max_mw, unit.profile) for unit in case.pv[-1:]] == [
        ("WKA 7", 1.5, "wind")
    ]
    assert [(unit.name, unit.p_max_mw, unit.e_mwh) for unit in case.ess] == [
        ("Battery 1", 0.6, 1.2),
        ("Battery 2", 0.2, 1.2),
    ]


def test_oberrheins_plants_have_their_size_though_they_stand_still(tmp_path: Path) -> None:
    assert left_out("mv_oberrhein") == [
        "153 sgens at scaling 0 of 22.07 MW in all (Static Generator 0, Static Generator 1, Static "
        "Generator 2, Static Generator 3, Static Generator 4, ...), here kept at its size",
    ]
    case = starter_case("mv_oberrhein", tmp_path)
    assert len(case.pv) == 153
    assert sum(unit.p_max_mw for unit in case.pv) == pytest.approx(22.07, abs=0.005)
    assert asked_of(case) == pytest.approx(asked_in("mv_oberrhein"), rel=1e-9)


def test_the_simple_example_serves_its_load_on_a_calm_day(tmp_path: Path) -> None:
    """1.2 MW and 2.4 Mvar: a grid without a limit of its own gives more Mvar than MW."""
    assert left_out("example_simple") == [
        "1 sgen of unknown type of 2 MW (static generator), here generators that can be called on",
        "1 held voltage (generator), here free within the limits of the bus",
    ]
    case = starter_case("example_simple", tmp_path)
    assert asked_of(case) == pytest.approx(1.2 + 2.4j)
    units = {u.name: (u.p_max_mw, u.q_min_mvar, u.q_max_mvar) for u in case.generator}
    assert units == {"generator": (6.0, -3.0, 3.0), "static generator": (2.0, -0.5, 0.0)}
    assert rs.solve(case, method="lp").shed_mwh == pytest.approx(0.0, abs=1e-9)


def test_simbenchs_urban_grid_comes_over_with_its_storages(tmp_path: Path) -> None:
    """Meinecke et al., Energies 13 (2020) 3290: 139 loads, 134 plants and 101 storages."""
    simbench = pytest.importorskip("simbench", reason="SimBench's data are not at hand")
    path = tmp_path / "urban.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandapower as pp

        net = simbench.get_simbench_net("1-MV-urban--1-sw")
        pp.to_json(net, str(path))
    named = [text.split(" (")[0] for text in left_out(str(path))]
    assert named == [
        "4 open couplers",
        "101 efficiencies of a storage",
        "101 self-discharges of a storage",
    ]
    case = starter_case(str(path), tmp_path)
    assert asked_of(case) == pytest.approx(complex(net.load.p_mw.sum(), net.load.q_mvar.sum()))
    assert (len(case.pv), len(case.generator), len(case.ess)) == (133, 1, 101)
    assert sum(unit.p_max_mw for unit in case.pv) == pytest.approx(16.0228)
    [hydro] = case.generator
    assert hydro.p_max_mw == pytest.approx(2.9)
    assert sum(unit.e_mwh for unit in case.ess) == pytest.approx(12.3717)
    assert sum(unit.p_max_mw for unit in case.ess) == pytest.approx(6.1888)
    assert {(unit.efficiency_charge, unit.efficiency_discharge) for unit in case.ess} == {
        (0.95, 0.95)
    }
