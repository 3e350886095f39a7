"""Devices of pandapower networks: what a case has of them, against pandapower's own power flow."""

from __future__ import annotations

import json
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.case import load_case
from resilience.case.networks.feeder import Feeder, make_network
from resilience.case.networks.omissions import omission_text
from resilience.case.networks.pandapower_devices import devices
from resilience.case.networks.read import read_feeder
from resilience.case.schema import NetworkTable
from resilience.case.starter import starter
from resilience.case.starter.devices import device_tables


def rich_net(pp: Any) -> Any:
    """A net with a device of every kind, no two of one size."""
    net = pp.create_empty_network(f_hz=60.0)
    a, b, c, d = (pp.create_bus(net, 20.0, name=name) for name in "abcd")
    net.bus["min_vm_pu"], net.bus["max_vm_pu"] = [1.02, 0.94, 1.0, np.nan], [1.02, 1.06, 1.0, 1.07]
    pp.create_ext_grid(net, a, vm_pu=1.02, max_p_mw=0.3, min_p_mw=-4.0, max_q_mvar=0.2)
    for start, stop in ((a, b), (b, c), (c, d)):
        pp.create_line_from_parameters(
            net, start, stop, 1.7, r_ohm_per_km=0.3, x_ohm_per_km=0.2, c_nf_per_km=210.0,
            max_i_ka=0.3, name="line",
        )  # fmt: skip
    pp.create_switch(net, a, d, et="b", closed=False)
    pp.create_load(net, b, 0.9, 0.4, scaling=0.5, name="town")
    pp.create_load(net, c, 0.7, -0.35, name="leading")
    pp.create_load(net, c, 0.0, 0.25, name="reactor")
    pp.create_load(net, d, -0.45, -0.15, name="feeding")
    pp.create_load(net, d, 0.8, 0.3, scaling=0.0, name="idle")
    pp.create_load(net, b, 0.22, 0.11, const_z_p_percent=40.0, name="zip")
    pp.create_asymmetric_load(net, b, p_a_mw=0.02, p_b_mw=0.03, p_c_mw=0.05, q_b_mvar=0.01)
    pp.create_ward(net, c, ps_mw=0.13, qs_mvar=0.04, pz_mw=0.03, qz_mvar=0.04, name="ward")
    pp.create_motor(
        net, d, pn_mech_mw=0.36, cos_phi=0.8, efficiency_percent=90.0, loading_percent=70.0,
        scaling=0.5, name="pump",
    )  # fmt: skip
    pp.create_shunt(net, c, q_mvar=-0.6, p_mw=0.02, step=2)
    pp.create_sgen(net, b, 0.5, 0.1, type="PV", name="roofs")
    pp.create_sgen(net, b, 0.31, 0.0, type="WP", name="hill")
    pp.create_sgen(net, c, 0.17, -0.05, type="CHP diesel", name="plant", scaling=0.0)
    pp.create_sgen(net, c, -0.06, 0.02, name="taking")
    pp.create_sgen(net, d, 0.23, 0.0, type="", name="what")
    pp.create_gen(net, c, 0.6, vm_pu=1.01, sn_mva=1.0, name="diesel")
    pp.create_gen(net, d, 0.0, sn_mva=0.4, min_q_mvar=-0.12, max_q_mvar=0.16, name="spare")
    pp.create_storage(
        net, b, 0.2, max_e_mwh=1.6, min_e_mwh=0.4, soc_percent=55.0, max_p_mw=0.5, min_p_mw=-0.4,
        sn_mva=0.55, name="battery",
    )  # fmt: skip
    pp.create_poly_cost(net, 0, "ext_grid", cp1_eur_per_mw=31.0)
    pp.create_poly_cost(net, 0, "gen", cp1_eur_per_mw=75.0, cp0_eur=6.0)
    pp.create_pwl_cost(net, 1, "gen", [[0.0, 0.3, 50.0], [0.3, 0.4, 90.0]])
    pp.create_poly_cost(net, 0, "load", cp1_eur_per_mw=9.0)
    return net


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any, Any]:
    path = tmp_path_factory.mktemp("rich") / "rich.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import pandapower as pp

        net = rich_net(pp)
        pp.to_json(net, str(path))
    return path, net, pp


def feeder_of(path: Path) -> Feeder:
    return read_feeder(NetworkTable(file=str(path)))


def test_constant_powers_are_those_of_pandapowers_power_flow(rich: tuple[Path, Any, Any]) -> None:
    """Of all that takes a power which does not depend on the voltage; 60 % of `zip` does not."""
    path, net, pp = rich
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        flat = pp.pandapowerNet(net)
        flat.load.loc[flat.load.name == "zip", "const_z_p_percent"] = 0.0
        flat.load.loc[flat.load.name == "zip", "p_mw"] *= 0.6
        flat.ward[["pz_mw", "qz_mvar"]] = 0.0
        pp.runpp(flat, numba=False)
    taken = sum(
        complex(flat[f"res_{kind}"].p_mw.sum(), flat[f"res_{kind}"].q_mvar.sum())
        for kind in ("load", "asymmetric_load", "ward", "motor")
    )
    fed = next(s for s in flat.sgen.index if flat.sgen.name[s] == "taking")
    taken -= complex(flat.res_sgen.p_mw[fed], flat.res_sgen.q_mvar[fed])
    ours = sum(complex(load.p_mw, load.q_mvar) for load in feeder_of(path).load)
    assert ours == pytest.approx(taken, rel=1e-9)


def test_what_is_left_out_is_named(rich: tuple[Path, Any, Any]) -> None:
    omissions = starter(str(rich[0])).omissions
    assert omission_text(omissions).split("; ") == [
        "1 open coupler (a-d)",
        "1 motor of 0.14 MW (pump), here constant power",
        "1 impedance in a load of 0.088 MVA (zip), here a shunt of its bus, never shed",
        "1 asymmetric load of 0.1 MW (asymmetric_load1), here summed up",
        "1 load at scaling 0 of 0.8 MW (idle)",
        "1 sgen at scaling 0 of 0.17 MW (plant), here kept at its size",
        "2 sgens of unknown type of 0.29 MW in all (taking, what), here generators that can be "
        "called on",
        "2 held voltages (diesel, spare), here free within the limits of the bus",
        "1 cost (load 0)",
        "1 wind turbine of 0.31 MW (hill), here in comments, to be given a profile",
    ]


def test_what_flows_to_earth_is_an_admittance(rich: tuple[Path, Any, Any]) -> None:
    """Charging: 2 pi 60 Hz, 210 nF/km, 1.7 km, 20 kV: 53.83 kvar a line, half at either end."""
    network = feeder_of(rich[0]).network
    np.testing.assert_allclose(network.y_from_pu, 0.5j * 0.0538344, rtol=1e-5)
    np.testing.assert_allclose(network.y_to_pu, network.y_from_pu)
    shunts = dict(zip(network.bus_names, network.y_bus_pu, strict=True))
    assert shunts == pytest.approx({"a": 0.0, "b": 0.4 * 0.22, "c": 0.07 + 1.16j, "d": 0.0})


def test_a_first_case_has_every_device_that_it_can_have(
    rich: tuple[Path, Any, Any], tmp_path: Path
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(starter(str(rich[0])).text)
    case = load_case(path)
    loads = {load.name: complex(load.p_max_mw, load.q_peak_mvar) for load in case.load}
    assert loads["load c"] == pytest.approx(0.89 - 0.08j)
    assert loads["load d"] == pytest.approx(0.14 + 0.105j)
    assert loads["load b"] == pytest.approx(0.77 - 0.4 * 0.22 + 0.32j)
    assert {unit.name: (unit.p_max_mw, unit.q_mvar, unit.curtailable) for unit in case.pv} == {
        "negative load d": (0.45, 0.15, False),
        "roofs": (0.5, 0.1, True),
    }
    units = {unit.name: unit for unit in case.generator}
    assert units.keys() == {"diesel", "spare", "plant", "what"}
    assert [units[n].p_max_mw for n in ("diesel", "spare", "plant", "what")] == [
        0.6, 0.4, 0.17, 0.23,
    ]  # fmt: skip
    assert (units["diesel"].q_min_mvar, units["diesel"].q_max_mvar) == (-0.8, 0.8)
    assert (units["spare"].q_min_mvar, units["spare"].q_max_mvar) == (-0.12, 0.16)
    assert (units["plant"].q_min_mvar, units["plant"].q_max_mvar) == (-0.05, 0.0)
    assert (units["diesel"].cost_per_mwh, units["diesel"].no_load_cost_per_h) == (75.0, 6.0)
    assert units["spare"].cost_curve is not None
    np.testing.assert_allclose(units["spare"].cost_curve, [(0.0, 0.0), (0.3, 15.0), (0.4, 24.0)])
    assert (units["what"].cost_per_mwh, units["what"].cost_curve) == (100.0, None)
    [ess] = case.ess
    assert (ess.p_max_mw, ess.p_min_mw, ess.e_mwh, ess.s_mva) == (0.5, -0.4, 1.6, 0.55)
    assert (ess.soc_min, ess.soc_initial) == (0.25, 0.55)
    [grid] = case.grid
    assert grid.import_max_mw == pytest.approx(1.5 * (0.77 + 0.89 + 0.14 + 0.07))
    assert (grid.export_max_mw, grid.import_cost_per_mwh, grid.v_pu) == (4.0, 31.0, 1.02)
    assert grid.q_max_mvar > 1.0
    network = case.network
    assert network.v_min_pu.tolist() == [1.02, 0.94, 1.0, 0.9]
    assert network.v_max_pu.tolist() == [1.02, 1.06, 1.0, 1.07]


@pytest.mark.parametrize(
    ("table", "column", "value", "named"),
    [
        ("line", "length_km", -1.7, "line line: length_km is -1.7"),
        ("line", "length_km", np.nan, "line line: length_km is None"),
        ("line", "parallel", 0, "line line: parallel is 0"),
        ("line", "df", 0.0, "line line: df is 0.0"),
        ("line", "r_ohm_per_km", -0.3, "line line: r_ohm_per_km is -0.3"),
        ("line", "x_ohm_per_km", np.nan, "x_pu that is a finite number"),
        ("line", "max_i_ka", -0.2, "rating_mva above 0"),
        ("line", "to_bus", 99, "line line: to_bus is 99"),
        ("bus", "vn_kv", 0.0, "vn_kv is 0.0"),
        ("bus", "vn_kv", np.nan, "vn_kv is None"),
        ("bus", "min_vm_pu", 1.2, "v_max_pu of v_min_pu or more"),
        ("load", "bus", 77, "load leading: bus is 77"),
        ("switch", "element", 55, "element is 55"),
    ],
)
def test_what_is_not_sound_is_refused_by_its_row(
    rich: tuple[Path, Any, Any], tmp_path: Path, table: str, column: str, value: float, named: str
) -> None:
    _, net, pp = rich
    path = tmp_path / "wrong.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wrong = pp.pandapowerNet(net)
        row = wrong[table].index[min(1, len(wrong[table]) - 1)]
        wrong[table].loc[row, column] = value
        pp.to_json(wrong, str(path))
    case = tmp_path / "case.toml"
    case.write_text(
        '[network]\nfile = "wrong.json"\n[time]\nstart = 2016-07-12T00:00:00\nslots = 1\n'
        'step_min = 15\n[[grid]]\nbus = "a"\nimport_max_mw = 2\nimport_cost_per_mwh = 40\n'
    )
    from resilience.errors import CaseError

    with pytest.raises(CaseError) as caught:
        load_case(case)
    assert named in str(caught.value)
    assert "hint:" in str(caught.value)


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("PV", "static"), ("lv_RES", "static"), ("PV3_MV", "static"), ("Solarpark", "static"),
        ("WP", "wind"), ("Wind_MV", "wind"), ("WKA 7", "wind"), ("Hydro_MV", "generator"),
        ("Residential fuel cell", "generator"), ("Spreewald", "generator"), (None, "generator"),
    ],
)  # fmt: skip
def test_what_drives_a_static_generator_is_in_its_type(words: str | None, kind: str) -> None:
    row = {"index": 3, "bus": 0, "p_mw": 0.7, "q_mvar": 0.2, "type": words, "in_service": True}
    found = devices({"sgen": [row]}, {0: "a"}, {})
    assert [len(getattr(found, name)) for name in ("static", "wind", "generator")] == [
        int(name == kind) for name in ("static", "wind", "generator")
    ]


def test_a_storage_that_is_said_not_to_charge_has_its_size(tmp_path: Path) -> None:
    """SimBench states max_p_mw = 0 of storages that charge, and an efficiency."""
    row = {
        "index": 4, "bus": 0, "p_mw": -0.3, "min_p_mw": -0.3, "max_p_mw": 0.0, "max_e_mwh": 0.7,
        "efficiency_percent": 0.95, "in_service": True,
    }  # fmt: skip
    found = devices({"storage": [row]}, {0: "a"}, {})
    [unit] = found.storage
    assert (unit.p_mw, unit.p_min_mw, unit.e_mwh, unit.soc) == (0.3, -0.3, 0.7, 0.5)
    assert unit.efficiency == 0.95
    assert [str(x) for x in found.omissions] == [
        "1 efficiency of a storage (storage5), here for each way"
    ]


@pytest.mark.parametrize(
    ("stated", "efficiency", "named"),
    [
        (95.0, 0.95, ["1 efficiency of a storage (storage1), here for each way"]),
        (0.95, 0.95, ["1 efficiency of a storage (storage1), here for each way"]),
        (100.0, 1.0, []),
        (1.0, 1.0, []),
        (np.nan, 1.0, []),
        (0.0, 1.0, ["1 efficiency of a storage out of range (storage1), here without losses"]),
        (130.0, 1.0, ["1 efficiency of a storage out of range (storage1), here without losses"]),
    ],
)
def test_an_efficiency_holds_for_each_way(
    stated: float, efficiency: float, named: list[str]
) -> None:
    """In percent, as the column says, or as a share, which SimBench writes; decay is named."""
    row = {
        "index": 0, "bus": 0, "p_mw": 0.3, "max_e_mwh": 0.7, "efficiency_percent": stated,
        "self-discharge_percent_per_day": 0.13, "in_service": True,
    }  # fmt: skip
    found = devices({"storage": [row]}, {0: "a"}, {})
    text, _ = device_tables(Feeder(make_network([("a", 20.0)], []), storage=found.storage))
    [unit] = tomllib.loads(text)["ess"]
    ways = [unit.get(f"efficiency_{way}", 1.0) for way in ("charge", "discharge")]
    assert ways == [efficiency, efficiency]
    decay = "1 self-discharge of a storage (storage1)"
    assert [str(x) for x in found.omissions] == [*named, decay]


def test_tables_whose_rows_have_names_are_no_elements(
    rich: tuple[Path, Any, Any], tmp_path: Path
) -> None:
    """SimBench has load cases hL and n1; a table of elements that is not read is named."""
    _, net, pp = rich
    path = tmp_path / "more.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        more = pp.pandapowerNet(net)
        more["loadcases"] = more.bus.rename(index=lambda k: f"h{k}")
        more["svc"] = more.bus.iloc[:2][["name", "in_service"]]
        pp.to_json(more, str(path))
    named = [str(omission) for omission in feeder_of(path).omissions]
    assert "2 svcs (a, b)" in named
    assert not [text for text in named if "loadcase" in text]


def frame(index: list[int], **columns: list[Any]) -> dict[str, Any]:
    """A table as pandapower writes it."""
    rows = [list(row) for row in zip(*columns.values(), strict=True)]
    split = {"columns": list(columns), "index": index, "data": rows}
    return {
        "_module": "pandas.core.frame", "_class": "DataFrame", "_object": json.dumps(split),
        "orient": "split",
    }  # fmt: skip


def before_version_3(path: Path) -> Path:
    """The same file with coordinates in tables of their own, as pandapower 2 wrote them."""
    data = json.loads(path.read_text())
    content = data["_object"]
    for kind in ("bus", "line"):
        table = json.loads(content[kind]["_object"])
        at = table["columns"].index("geo")
        stated = [
            (index, json.loads(row[at])["coordinates"])
            for index, row in zip(table["index"], table["data"], strict=True)
            if row[at] is not None
        ]
        table["columns"].pop(at)
        for row in table["data"]:
            row.pop(at)
        content[kind]["_object"] = json.dumps(table)
        content[kind].get("dtype", {}).pop("geo", None)
        index, points = [k for k, _ in stated], [coordinates for _, coordinates in stated]
        columns = {axis: [point[k] for point in points] for k, axis in enumerate("xy")}
        content[f"{kind}_geodata"] = frame(
            index, **({"coords": points} if kind == "line" else columns)
        )
    content |= {"version": "2.14.0", "format_version": "2.14.0"}
    old = path.with_name("old.json")
    old.write_text(json.dumps(data))
    return old


def test_coordinates_of_files_before_pandapower_3(tmp_path: Path) -> None:
    """As from the file of today, which is what pandapower makes of the old one."""
    pp = pytest.importorskip("pandapower")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        net = pp.create_empty_network()
        places = [(110.4, 21.2), (110.5, 21.3), None, (110.7, 21.1)]
        buses = [pp.create_bus(net, 20.0, name=f"b{k}", geodata=p) for k, p in enumerate(places)]
        pp.create_ext_grid(net, buses[0])
        ways = [[(110.4, 21.2), (110.45, 21.27), (110.5, 21.3)], None,
                [(110.5, 21.3), (110.62, 21.22), (110.7, 21.1)]]  # fmt: skip
        ends = [(0, 1), (1, 2), (1, 3)]
        for (start, stop), way, km in zip(ends, ways, (1.2, 0.7, 2.1), strict=True):
            pp.create_line_from_parameters(
                net, buses[start], buses[stop], km, r_ohm_per_km=0.3, x_ohm_per_km=0.2,
                c_nf_per_km=0.0, max_i_ka=0.3, geodata=way,
            )  # fmt: skip
        path = tmp_path / "net.json"
        pp.to_json(net, str(path))
        old = before_version_3(path)
        converted = pp.from_json(str(old))
    found, wanted = feeder_of(old), feeder_of(path)
    assert "_geodata" in old.read_text()
    assert found.places == wanted.places == {
        f"b{k}": place for k, place in enumerate(places) if place is not None
    }  # fmt: skip
    assert found.network.courses == wanted.network.courses
    assert [len(course.points) for course in found.network.courses.values()] == [3, 0, 3]
    texts = [geo and json.loads(geo)["coordinates"] for geo in converted.line.geo]
    assert [points and list(map(tuple, points)) for points in texts] == ways
    assert [str(x) for x in found.omissions] == [str(x) for x in wanted.omissions]
