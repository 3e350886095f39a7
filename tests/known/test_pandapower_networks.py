"""Networks of pandapower with their taps, shunts and shifts, beside pandapower's own power flow."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.case import Network, load_case, new_case_text
from resilience.case.networks.read import finish_network, read_feeder
from resilience.case.schema import NetworkTable
from resilience.models.network.powerflow import Flow, flow

LIBRARY = (
    "mv_oberrhein",
    "example_simple",
    "create_cigre_network_mv",
    "create_cigre_network_lv",
    "simple_four_bus_system",
    "simple_mv_open_ring_net",
    "panda_four_load_branch",
    "four_loads_with_branches_out",
)
"""Radial networks of the library, drawn without chance; all but one have a vector group."""
LOST = ("line", "trafo", "impedance")
TAKEN = ("shunt", "ward")


@pytest.fixture(autouse=True)
def _without_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def library(name: str) -> Any:
    from pandapower import networks

    return getattr(networks, name)()


def run(net: Any) -> None:
    import pandapower as pp

    pp.runpp(net, numba=False, tolerance_mva=1e-10, calculate_voltage_angles=True)


def network_of(net: Any, folder: Path) -> tuple[Network, dict[int, int]]:
    """The network as a case has it, and the position of every bus that is in service."""
    import pandapower as pp

    net.bus["name"] = [f"bus {k}" for k in net.bus.index]
    path = folder / "net.json"
    pp.to_json(net, str(path))
    table = NetworkTable(file=str(path))
    network = finish_network(read_feeder(table).network, table, ())
    in_use = net.bus.index[net.bus.in_service]
    return network, {k: network.bus(f"bus {k}") for k in in_use}


def flow_of(net: Any, network: Network, place: dict[int, int]) -> Flow:
    """Our power flow at the powers of pandapower's, shunts and impedances left to the network."""
    n = len(network.bus_names)
    s, root, v = np.zeros((n, 1), complex), np.zeros(n, bool), np.ones(n)
    for kind, sign in (("load", -1), ("sgen", 1), ("gen", 1), ("storage", -1), ("motor", -1)):
        table, result = net[kind], net[f"res_{kind}"]
        for k in table.index[table.in_service]:
            if table.bus[k] in place:
                p, q = result.p_mw[k], result.q_mvar[k]
                if kind == "load":  # at the voltage that there is, and of that the rest
                    p, q = (
                        table[f"{x}_{unit}"][k]
                        * table.scaling[k]
                        * (1.0 - table[f"const_z_{x}_percent"][k] / 100.0)
                        for x, unit in (("p", "mw"), ("q", "mvar"))
                    )
                s[place[table.bus[k]]] += sign * complex(p, q)
    for k in net.ward.index[net.ward.in_service]:
        s[place[net.ward.bus[k]]] -= complex(net.ward.ps_mw[k], net.ward.qs_mvar[k])
    for k in net.ext_grid.index[net.ext_grid.in_service]:
        root[place[net.ext_grid.bus[k]]], v[place[net.ext_grid.bus[k]]] = (
            True,
            net.ext_grid.vm_pu[k],
        )
    return flow(network, s.real, s.imag, network.in_service, root, v)


def volts_of(net: Any, place: dict[int, int]) -> tuple[list[int], Floats]:
    live = net.bus.index[net.bus.in_service & net.res_bus.vm_pu.notna()]
    return [place[k] for k in live], net.res_bus.vm_pu[live].to_numpy()


def lost_in(net: Any) -> float:
    """MW in branches and in whatever flows to earth at buses."""
    lost = sum(net[f"res_{kind}"].pl_mw.sum() for kind in LOST if len(net[kind]))
    square = {k: net.res_bus.vm_pu[bus] ** 2 for k, bus in net.ward.bus.items()}
    wards = sum(net.ward.pz_mw[k] * square[k] for k in net.ward.index[net.ward.in_service])
    z = net.load.p_mw * net.load.scaling * net.load.const_z_p_percent / 100.0
    loads = (z * net.res_bus.vm_pu[net.load.bus].to_numpy() ** 2)[net.load.in_service].sum()
    return float(lost + net.res_shunt.p_mw.sum() + wards + loads)


@pytest.mark.parametrize("name", LIBRARY)
def test_a_power_flow_is_that_of_pandapower(name: str, tmp_path: Path) -> None:
    net = library(name)
    run(net)
    network, place = network_of(net, tmp_path)
    ours = flow_of(net, network, place)
    rows, volts = volts_of(net, place)
    np.testing.assert_allclose(ours.v_pu[rows, 0], volts, atol=1e-7)
    assert ours.loss_mw[0] == pytest.approx(lost_in(net), abs=1e-7)


def odd_net() -> Any:
    """No factor of a branch or a shunt is 1, and no two of a kind are alike."""
    import pandapower as pp

    net = pp.create_empty_network(sn_mva=2.0, f_hz=60.0)
    kv = (110.0, 20.0, 20.0, 20.0, 0.4, 6.0, 20.0, 20.0)
    hv, a, b, c, d, e, f, g = (pp.create_bus(net, vn) for vn in kv)
    pp.create_ext_grid(net, hv, vm_pu=1.02)
    trafo: dict[str, Any] = {"vkr_percent": 0.6, "vk_percent": 11.0, "pfe_kw": 25.0}
    trafo |= {"i0_percent": 0.4, "tap_neutral": 0, "tap_min": -9, "tap_max": 9}
    pp.create_transformer_from_parameters(
        net, hv, a, sn_mva=16.0, vn_hv_kv=115.0, vn_lv_kv=20.5, shift_degree=150.0, tap_side="hv",
        tap_pos=3, tap_step_percent=1.5, tap_changer_type="Ratio", parallel=2,
        tap2_side="lv", tap2_neutral=0, tap2_pos=1, tap2_step_percent=1.1, tap2_min=-2,
        tap2_max=2, tap2_changer_type="Ratio", **trafo,
    )  # fmt: skip
    pp.create_transformer_from_parameters(
        net, b, d, sn_mva=0.63, vn_hv_kv=20.0, vn_lv_kv=0.42, shift_degree=30.0, tap_side="lv",
        tap_pos=-2, tap_step_percent=1.3, tap_step_degree=40.0, tap_changer_type="Symmetrical",
        **trafo | {"pfe_kw": 1.2, "vk_percent": 6.0},
    )  # fmt: skip
    pp.create_transformer_from_parameters(
        net, c, e, sn_mva=2.5, vn_hv_kv=20.0, vn_lv_kv=6.3, tap_side="hv", tap_pos=2,
        tap_step_degree=3.0, tap_changer_type="Ideal", **trafo | {"pfe_kw": 0.0},
    )  # fmt: skip
    net.trafo["leakage_resistance_ratio_hv"] = [0.3, 0.5, 0.5]
    net.trafo["leakage_reactance_ratio_hv"] = [0.6, 0.45, 0.5]
    for start, stop, length_km, parallel in ((a, b, 4.7, 1), (b, c, 3.9, 2), (c, f, 6.1, 1),
                                             (a, g, 5.3, 1), (g, c, 2.7, 1)):  # fmt: skip
        pp.create_line_from_parameters(
            net, start, stop, length_km, r_ohm_per_km=0.3, x_ohm_per_km=0.2, c_nf_per_km=250.0,
            g_us_per_km=3.0, max_i_ka=0.3, parallel=parallel,
        )  # fmt: skip
    net.bus.loc[f, "in_service"] = False
    pp.create_switch(net, g, 4, et="l", closed=False)
    pp.create_load(net, b, 1.1, 0.4, scaling=0.9)
    pp.create_load(net, d, 0.2, 0.1, const_z_p_percent=40.0, const_z_q_percent=70.0)
    pp.create_load(net, e, 1.3, 0.5)
    pp.create_load(net, g, 0.7, 0.2)
    pp.create_ward(net, c, ps_mw=0.2, qs_mvar=0.1, pz_mw=0.15, qz_mvar=-0.2)
    pp.create_shunt(net, e, q_mvar=-0.3, p_mw=0.02, step=2, vn_kv=6.3)
    return net


def test_every_kind_of_element_is_that_of_pandapower(tmp_path: Path) -> None:
    """Taps of all kinds on both sides, T equivalents, ends that hang, shunts of other voltages."""
    net = odd_net()
    run(net)
    network, place = network_of(net, tmp_path)
    ours = flow_of(net, network, place)
    rows, volts = volts_of(net, place)
    np.testing.assert_allclose(ours.v_pu[rows, 0], volts, atol=1e-8)
    assert ours.loss_mw[0] == pytest.approx(lost_in(net), abs=1e-8)
    sent = dict(zip(network.line_names, ours.p_line_mw[:, 0], strict=True))
    assert sent["bus 1-bus 2"] == pytest.approx(net.res_line.p_from_mw[0], abs=1e-8)
    assert sent["bus 0-bus 1"] == pytest.approx(net.res_trafo.p_hv_mw[0], abs=1e-8)


def test_an_impedance_with_admittances_is_that_of_pandapower(tmp_path: Path) -> None:
    import pandapower as pp

    net = pp.create_empty_network(sn_mva=3.0)
    a, b = pp.create_bus(net, 20.0), pp.create_bus(net, 20.0)
    pp.create_ext_grid(net, a, vm_pu=1.01)
    pp.create_impedance(
        net, a, b, rft_pu=0.03, xft_pu=0.05, sn_mva=4.0, gf_pu=0.01, bf_pu=0.02, gt_pu=0.005,
        bt_pu=-0.03,
    )  # fmt: skip
    pp.create_load(net, b, 0.8, 0.3)
    run(net)
    network, place = network_of(net, tmp_path)
    ours = flow_of(net, network, place)
    np.testing.assert_allclose(ours.v_pu[:, 0], net.res_bus.vm_pu, atol=1e-9)
    assert ours.p_line_mw[0, 0] == pytest.approx(net.res_impedance.p_from_mw[0], abs=1e-9)


@pytest.mark.parametrize(
    "name", ["create_cigre_network_mv", "panda_four_load_branch", "simple_mv_open_ring_net",
             "mv_oberrhein"]
)  # fmt: skip
def test_a_calm_hour_of_a_first_case_is_that_of_pandapower(name: str, tmp_path: Path) -> None:
    """Plants stand still in these networks, and are left out of the plan; so are ratings, which a
    power flow does not keep.
    """
    text = new_case_text(name).replace("slots = 96", "slots = 1").replace("= 15", "= 60")
    blocks = [block for block in text.split("\n\n") if not block.lstrip("\n").startswith("[[pv]]")]
    path = tmp_path / "case.toml"
    path.write_text("\n\n".join(blocks))
    case = load_case(path)
    free = np.full_like(case.network.rating_mva, np.inf)
    case = replace(case, network=replace(case.network, rating_mva=free))
    plan = rs.solve(case, method="minlp")
    net = library(name)
    if len(net.sgen):
        net.sgen["scaling"] = 0.0
    run(net)
    assert plan.status == "optimal"
    assert plan.shed_mwh == pytest.approx(0.0, abs=1e-6)
    assert plan.energy_mwh["losses"] == pytest.approx(lost_in(net), abs=1e-6)
    lowest = plan.tables["voltage"].values.min()
    assert lowest == pytest.approx(net.res_bus.vm_pu.min(), abs=1e-6)
    assert plan.not_modelled == [x for x in plan.not_modelled if "sgen" in x]
