"""Networks from pandapower, from files and from inline tables mean the same physics."""

import warnings

import numpy as np
import pytest

from resilience.case import load_case
from resilience.case.networks.feeder import FeederError
from resilience.case.networks.pandapower_branches import _trafo
from resilience.case.networks.pandapower_net import feeder_by_name, feeder_from_tables
from resilience.case.networks.pandapower_tables import tables_of_call
from resilience.case.networks.read import read_feeder
from resilience.case.schema import NetworkTable
from resilience.errors import UsageError

BRANCH_R, BRANCH_X = 2, 3


def pandapower_net(build):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="pandapower")
        import pandapower as pp

        return pp, build(pp)


def solved_branches(net, pp) -> np.ndarray:
    """Return r and x on 1 MVA of the lines and transformers in pandapower's own power flow."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="pandapower")
        pp.runpp(net, numba=False, calculate_voltage_angles=False)
    rows = [range(*net._pd2ppc_lookups["branch"].get(kind, (0, 0))) for kind in ("line", "trafo")]
    branch = net._ppc["branch"].real[[*rows[0], *rows[1]]]
    return branch[:, [BRANCH_R, BRANCH_X]] / net.sn_mva


@pytest.mark.parametrize(
    "name",
    ["case33bw", "create_cigre_network_mv", "simple_four_bus_system", "simple_mv_open_ring_net"],
)
def test_impedances_are_those_of_pandapowers_power_flow(name):
    pp, net = pandapower_net(lambda pp: getattr(pp.networks, name)())
    network = feeder_by_name(name).network
    ours = np.column_stack([network.r_pu, network.x_pu])
    np.testing.assert_allclose(ours, solved_branches(net, pp), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["case33bw", "case118", "case57", "iceland"])
def test_reading_pandapowers_files_gives_what_its_functions_give(name):
    read, called = (
        feeder_by_name(name),
        feeder_from_tables(tables_of_call(name), "pandapower", name),
    )
    assert read.network.equals(called.network)
    assert (read.load, read.grid, read.generator) == (called.load, called.grid, called.generator)


def test_case33bw_has_the_names_of_the_literature():
    network = feeder_by_name("case33bw").network
    assert network.bus_names == tuple(str(k) for k in range(1, 34))
    ties = [network.line_names[i] for i in np.flatnonzero(~network.in_service)]
    assert ties == ["21-8", "9-15", "12-22", "18-33", "25-29"]
    head = network.line("1-2")
    assert network.r_pu[head] * 12.66**2 == pytest.approx(0.0922)
    assert network.x_pu[head] * 12.66**2 == pytest.approx(0.0470)
    assert np.isinf(network.rating_mva).all()


def test_own_names_are_kept_where_they_tell_buses_apart():
    network = feeder_by_name("create_cigre_network_mv").network
    assert network.bus_names[1] == "Bus 1"
    assert network.line("Line 1-2") == 0


def test_unknown_names_come_with_the_nearest():
    network = feeder_by_name("case33bw").network
    with pytest.raises(UsageError, match="did you mean 6-26"):
        network.line("26-6")
    with pytest.raises(UsageError, match="bus '34'"):
        network.bus("34")


def switched_net(pp):
    """Two busbars behind a coupler, two parallel cables, an open ring and a transformer."""
    net = pp.create_empty_network()
    hv, a, b, c, d = (
        pp.create_bus(net, vn, name=n)
        for n, vn in (("hv", 110), ("a", 20), ("b", 20), ("c", 20), ("d", 20))
    )
    pp.create_ext_grid(net, hv)
    pp.create_transformer(net, hv, a, "25 MVA 110/20 kV")
    pp.create_switch(net, b, a, et="b", closed=True)
    for ends in ((b, c), (b, c), (c, d), (d, a)):
        pp.create_line(net, *ends, length_km=2.0, std_type="NA2XS2Y 1x240 RM/25 12/20 kV")
    pp.create_switch(net, d, 3, et="l", closed=False)
    pp.create_load(net, d, 1.0, 0.2)
    pp.create_load(net, d, 0.5, 0.1, scaling=2.0)
    return net


@pytest.fixture
def switched(tmp_path):
    pp, net = pandapower_net(switched_net)
    path = tmp_path / "switched.json"
    pp.to_json(net, str(path))
    return path, net, pp


def read(path):
    return read_feeder(NetworkTable(file=str(path)))


def test_closed_switches_fuse_buses_and_open_ones_open_lines(switched):
    path, net, pp = switched
    network = read(path).network
    assert network.bus_names == ("hv", "a", "c", "d")
    assert network.bus("b") == network.bus("a")
    assert network.line_names == ("b-c", "b-c#2", "c-d", "d-a", "hv-a")
    assert network.in_service.tolist() == [True, True, True, False, True]
    np.testing.assert_allclose(network.r_pu, solved_branches(net, pp)[:, 0])


def test_ratings_are_currents_at_nominal_voltage(switched):
    path, net, _ = switched
    network = read(path).network
    limit_ka = net.line.max_i_ka[0]
    assert network.rating_mva[0] == pytest.approx(np.sqrt(3) * 20 * limit_ka)
    assert network.rating_mva[network.line("hv-a")] == pytest.approx(25.0)


def test_devices_of_a_file_keep_their_scaling(switched):
    path, _, _ = switched
    feeder = read(path)
    assert sum(load.p_mw for load in feeder.load) == pytest.approx(2.0)
    assert {load.bus for load in feeder.load} == {"d"}
    assert [grid.bus for grid in feeder.grid] == ["hv"]


def test_a_device_may_name_a_fused_bus(switched, tmp_path):
    path, _, _ = switched
    case = tmp_path / "case.toml"
    case.write_text(
        f'[network]\nfile = "{path.name}"\n[time]\nstart = 2016-07-12T00:00:00\nslots = 1\n'
        'step_min = 15\n[[ess]]\nname = "e"\nbus = "b"\np_max_mw = 1\ne_mwh = 2\n'
    )
    assert load_case(case).network.bus("b") == 1


@pytest.mark.parametrize(
    ("text", "value"),
    [("{}", "a pandapower network"), ("not json", "a pandapower network")],
)
def test_a_file_that_is_no_network_is_refused(tmp_path, text, value):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(FeederError, match=value):
        read(path)
    other = path.rename(path.with_suffix(".txt"))
    with pytest.raises(FeederError, match=r"\.json or a MATPOWER"):
        read(other)


def test_inline_tables_and_pandapower_give_the_same_pu(case_file):
    network = load_case(case_file()).network
    assert network.r_pu[0] == pytest.approx(0.4 / 12.66**2)
    assert network.line_names == ("1-2", "2-3", "3-4", "4-1")
    assert network.rating_mva.tolist() == [np.inf, 5.0, np.inf, np.inf]
    assert network.in_service.tolist() == [True, True, True, False]
    assert network.switchable.tolist() == [False, False, False, True]
    assert network.breakpoint.tolist() == [True, False, False, False]
    assert network.v_min_pu.tolist() == [0.95] * 4
    assert network.v_max_pu.tolist() == [1.1, 1.1, 1.05, 1.1]


def test_impedance_scale_scales_both_parts(case_file):
    whole = load_case(case_file()).network
    half = load_case(case_file(("[network]", "[network]\nimpedance_scale = 0.5"))).network
    np.testing.assert_allclose(half.r_pu, 0.5 * whole.r_pu)
    np.testing.assert_allclose(half.x_pu, 0.5 * whole.x_pu)


def test_parts_with_a_grid_of_their_own_are_no_mistake(tmp_path):
    from resilience.case import new_case_text

    path = tmp_path / "two.toml"
    path.write_text(new_case_text("mv_oberrhein"))
    assert len(load_case(path).grid) == 2


def test_a_transformer_without_data_is_refused(switched):
    path, _, _ = switched
    path.write_text(path.read_text().replace("vk_percent", "uk_percent"))
    with pytest.raises(FeederError, match="vk_percent"):
        read(path)


def odd_net(pp):
    """A net in which no factor of a branch is 1 and no two branches are equal."""
    net = pp.create_empty_network(sn_mva=2.0)
    hv, a, b, c, d = (
        pp.create_bus(net, vn, name=n)
        for n, vn in (("hv", 110), ("a", 20), ("b", 20), ("c", 20), ("d", 20))
    )
    pp.create_ext_grid(net, hv, vm_pu=1.03, max_p_mw=7.0)
    pp.create_transformer_from_parameters(
        net, hv, a, sn_mva=16.0, vn_hv_kv=110.0, vn_lv_kv=21.0, vkr_percent=0.7, vk_percent=11.0,
        pfe_kw=0.0, i0_percent=0.0, parallel=2, df=0.9, max_loading_percent=80.0,
    )  # fmt: skip
    for start, stop, length_km, parallel, df, loading in (
        (a, b, 1.7, 3, 0.8, 90.0),
        (b, c, 2.3, 2, 0.7, 70.0),
    ):
        pp.create_line_from_parameters(
            net, start, stop, length_km, r_ohm_per_km=0.31, x_ohm_per_km=0.13, c_nf_per_km=0.0,
            max_i_ka=0.25, parallel=parallel, df=df, max_loading_percent=loading,
        )  # fmt: skip
    pp.create_impedance(net, c, d, rft_pu=0.03, xft_pu=0.05, sn_mva=4.0)
    pp.create_asymmetric_load(
        net, d, p_a_mw=0.2, p_b_mw=0.3, p_c_mw=0.5, q_a_mvar=0.05, q_b_mvar=0.07, q_c_mvar=0.11,
        scaling=1.5,
    )  # fmt: skip
    pp.create_sgen(net, c, p_mw=0.6, q_mvar=0.13, scaling=0.5, type="PV")
    pp.create_gen(net, b, p_mw=0.4, max_p_mw=0.9, vm_pu=1.02)
    return net


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    pp, net = pandapower_net(odd_net)
    path = tmp_path_factory.mktemp("odd") / "odd.json"
    pp.to_json(net, str(path))
    return read(path), net, pp


def test_a_transformer_whose_resistance_is_all_of_its_impedance_has_no_reactance():
    """Rounded data may say a little more than all; pandapower has no answer to that."""
    row = {
        "sn_mva": 0.4, "vn_lv_kv": 0.42, "vk_percent": 3.0, "vkr_percent": 3.001,
        "parallel": 2, "df": 0.9, "max_loading_percent": 80.0,
    }  # fmt: skip
    pi = _trafo(row, 11.0, 0.38, 50.0)
    r_pu, x_pu, rating = pi.z_pu.real, pi.z_pu.imag, pi.rating_mva
    assert r_pu == pytest.approx(0.03001 / 0.4 / 2 * (0.42 / 0.38) ** 2)
    assert x_pu == 0.0
    assert rating == pytest.approx(0.4 * 0.9 * 2 * 0.8)


def test_parallel_branches_and_their_own_bases_have_the_impedances_of_the_power_flow(odd):
    feeder, net, pp = odd
    network = feeder.network
    ours = np.column_stack([network.r_pu, network.x_pu])
    assert network.line_names == ("a-b", "b-c", "hv-a", "c-d")
    np.testing.assert_allclose(ours[:3], solved_branches(net, pp), rtol=1e-9)
    np.testing.assert_allclose(ours[3], [0.03 / 4.0, 0.05 / 4.0])


def test_a_rating_is_that_of_all_circuits_derated_and_loaded_as_far_as_allowed(odd):
    network = odd[0].network
    np.testing.assert_allclose(
        network.rating_mva,
        [
            np.sqrt(3) * 20 * 0.25 * 3 * 0.8 * 0.9,
            np.sqrt(3) * 20 * 0.25 * 2 * 0.7 * 0.7,
            16.0 * 2 * 0.9 * 0.8,
            np.inf,
        ],
    )


def test_powers_of_devices_are_scaled_and_phases_are_added(odd):
    feeder = odd[0]
    load, static = feeder.load[0], feeder.static[0]
    assert (load.bus, load.p_mw, load.q_mvar) == ("d", pytest.approx(1.5), pytest.approx(0.345))
    assert (static.bus, static.p_mw, static.q_mvar) == ("c", 0.3, 0.065)
    assert [(g.bus, g.p_mw, g.v_pu) for g in feeder.generator] == [("b", 0.9, 1.02)]
    assert [(g.bus, g.p_mw, g.v_pu) for g in feeder.grid] == [("hv", 7.0, 1.03)]


def test_a_closed_switch_with_a_resistance_is_a_branch(tmp_path):
    def net_with_a_switch(pp):
        net = pp.create_empty_network()
        a, b = (pp.create_bus(net, 11.0, name=name) for name in "ab")
        pp.create_ext_grid(net, a)
        pp.create_switch(net, a, b, et="b", closed=True, z_ohm=0.6)
        return net

    pp, net = pandapower_net(net_with_a_switch)
    pp.to_json(net, str(tmp_path / "switch.json"))
    network = read(tmp_path / "switch.json").network
    assert network.bus_names == ("a", "b")
    np.testing.assert_allclose([network.r_pu, network.x_pu], [[0.6 / 121.0], [0.0]])


def test_inline_lines_are_on_the_voltage_of_their_first_bus():
    table = NetworkTable.model_validate(
        {
            "bus": [{"name": "1", "vn_kv": 11.0}, {"name": "2", "vn_kv": 11.0}],
            "line": [{"from": "1", "to": "2", "r_ohm": 0.7, "x_ohm": 0.3, "rating_mva": 4.0}],
        }
    )
    network = read_feeder(table).network
    np.testing.assert_allclose([network.r_pu, network.x_pu], [[0.7 / 121.0], [0.3 / 121.0]])


@pytest.mark.parametrize("end", ["from", "to"])
def test_a_branch_to_a_bus_out_of_service_is_none(tmp_path, end):
    def net_with_a_dead_bus(pp):
        net = pp.create_empty_network()
        a, b, dead = (pp.create_bus(net, 20.0, name=name) for name in ("a", "b", "dead"))
        net.bus.loc[dead, "in_service"] = False
        pp.create_ext_grid(net, a)
        ends = (dead, b) if end == "from" else (b, dead)
        for start, stop in ((a, b), ends):
            pp.create_line(net, start, stop, 2.5, "NA2XS2Y 1x240 RM/25 12/20 kV")
        return net

    pp, net = pandapower_net(net_with_a_dead_bus)
    pp.to_json(net, str(tmp_path / "dead.json"))
    network = read(tmp_path / "dead.json").network
    assert (network.bus_names, network.line_names) == (("a", "b"), ("a-b",))
