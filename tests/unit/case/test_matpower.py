"""MATPOWER files, conversions at their end included."""

import numpy as np
import pytest

from resilience.case.networks.feeder import FeederError
from resilience.case.networks.pandapower_net import feeder_by_name
from resilience.case.networks.read import read_feeder
from resilience.case.schema import NetworkTable

# Three buses in the style of MATPOWER's distribution cases: kW and ohm, converted at the end.
OHMS = """\
function mpc = three
%THREE  it's a test; mpc.bus = [ in a comment
mpc.version = '2';
mpc.baseMVA = 10;
mpc.bus = [ %% kW
\t1\t3\t0\t0\t0\t0\t1\t1\t0\t12.66\t1\t1\t1;
\t2\t1\t100\t60\t0\t0\t1\t1\t0\t12.66\t1\t1.1\t0.9;
\t30\t1\t90, 40\t0\t0\t1\t1\t0\t21.927763/sqrt(3)\t1\t1.1\t0.9
];
mpc.gen = [
\t1\t0\t0\t10\t-10\t1.02\t100\t1\t5\t0;
\t30\t0\t0\t10\t-10\t1\t100\t1\t0.5\t0;
\t2\t0\t0\t10\t-10\t1\t100\t0\t9\t0;
];
mpc.branch = [  %% ohms
\t1\t2\t0.0922\t0.0470\t0\t0\t0\t0\t0\t0\t1\t-360\t360;
\t2\t30\t0.4930\t0.2511\t0\t6\t0\t0\t0\t0\t1\t-360\t360;
\t1\t30\t2.0\t2.0\t0\t0\t0\t0\t0\t0\t0\t-360\t360;
];
mpc.bus_name = { 'one'; 'two'; 'th%ree' };
[PQ, PV, REF, NONE, BUS_I, BUS_TYPE, PD, QD, GS, BS, BUS_AREA, VM, ...
    VA, BASE_KV, ZONE, VMAX, VMIN, LAM_P, LAM_Q, MU_VMAX, MU_VMIN] = idx_bus;
Vbase = mpc.bus(1, BASE_KV) * 1e3;      %% in Volts
Sbase = mpc.baseMVA * 1e6;              %% in VA
mpc.branch(:, [BR_R BR_X]) = mpc.branch(:, [BR_R BR_X]) / (Vbase^2 / Sbase);
mpc.bus(:, [PD, QD]) = mpc.bus(:, [PD, QD]) / 1e3;
"""


def read(tmp_path, text):
    path = tmp_path / "feeder.m"
    path.write_text(text)
    return read_feeder(NetworkTable(file=str(path)))


def test_the_conversions_of_distribution_cases_are_carried_out(tmp_path):
    feeder = read(tmp_path, OHMS)
    network, reference = feeder.network, feeder_by_name("case33bw").network
    assert network.bus_names == ("1", "2", "30")
    assert network.line_names == ("1-2", "2-30", "1-30")
    np.testing.assert_allclose(network.r_pu[:2], reference.r_pu[:2], rtol=1e-12)
    np.testing.assert_allclose(network.x_pu[:2], reference.x_pu[:2], rtol=1e-12)
    np.testing.assert_allclose(network.vn_kv, 12.66, rtol=1e-6)
    assert network.rating_mva.tolist() == [np.inf, 6.0, np.inf]
    assert network.in_service.tolist() == [True, True, False]
    assert [(d.bus, d.p_mw, d.q_mvar) for d in feeder.load] == [
        ("2", 0.1, 0.06),
        ("30", 0.09, 0.04),
    ]
    assert [(d.bus, d.p_mw, d.v_pu) for d in feeder.grid] == [("1", 5.0, 1.02)]
    assert [(d.bus, d.p_mw) for d in feeder.generator] == [("30", 0.5)]


def test_a_power_factor_at_the_end_makes_kva_into_kw_and_kvar(tmp_path):
    text = OHMS + "pf = 0.8;\nmpc.bus(:, QD) = mpc.bus(:, PD) * sin(acos(pf));\n"
    text += "mpc.bus(:, PD) = mpc.bus(:, PD) * pf;\n"
    load = read(tmp_path, text).load[0]
    assert load.p_mw == pytest.approx(0.08)
    assert load.q_mvar == pytest.approx(0.06)


def test_a_factor_may_be_negative_and_a_power(tmp_path):
    text = OHMS + "k = -2;\nmpc.bus(:, QD) = mpc.bus(:, QD) * -1.5 / k^2;\n"
    assert read(tmp_path, text).load[0].q_mvar == pytest.approx(0.06 * -1.5 / 4.0)


def test_without_conversions_values_are_pu_on_the_base_of_the_file(tmp_path):
    feeder = read(tmp_path, OHMS.split("[PQ", 1)[0])
    np.testing.assert_allclose(feeder.network.r_pu, [0.00922, 0.0493, 0.2])
    assert feeder.load[0].p_mw == 100.0


@pytest.mark.parametrize(
    "statement",
    [
        "mpc.branch(:, 3) = mpc.branch(:, 3) / mpc.Zbase;",
        "mpc.branch(:, 3) = mpc.branch(:, 3) * 2 + 1;",
        "mpc.branch(5, :) = [];",
        "mpc.bus(:, PD) = scale_loads(mpc);",
    ],
)
def test_other_statements_on_the_tables_are_refused(tmp_path, statement):
    with pytest.raises(FeederError, match="not understood"):
        read(tmp_path, OHMS + statement)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("12.66\t1\t1\t1;", "0\t1\t1\t1;", "baseKV is 0 at bus 1"),
        ("mpc.baseMVA = 10;", "", "baseMVA"),
        ("mpc.branch = [", "mpc.lines = [", "branch"),
        ("\t100\t60", "\tNone\t60", "None"),
    ],
)
def test_a_file_that_lacks_what_is_needed_is_refused(tmp_path, old, new, message):
    with pytest.raises(FeederError, match=message):
        read(tmp_path, OHMS.replace(old, new, 1).split("[PQ", 1)[0])
