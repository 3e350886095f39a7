"""MATPOWER files, conversions at their end included."""

import numpy as np
import pytest

from resilience.case import load_case, new_case_text
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


PLAIN = OHMS.split("[PQ", 1)[0]


def refused(tmp_path, text: str) -> str:
    with pytest.raises(FeederError) as caught:
        read(tmp_path, text)
    return "\n".join(value for _, value, *_ in caught.value.findings)


def test_nothing_within_a_block_comment_is_carried_out(tmp_path):
    text = PLAIN + "%{\nmpc.bus(:, 3) = mpc.bus(:, 3) * 2;\n  %{\n  x\n  %}\nif y\n%}\n"
    assert read(tmp_path, text).load[0].p_mw == 100.0
    assert read(tmp_path, text + "mpc.bus(:, 3) = mpc.bus(:, 3) * 2;\n").load[0].p_mw == 200.0


@pytest.mark.parametrize("word", ["if", "for", "while", "switch", "try"])
def test_a_branch_of_the_program_is_refused_by_its_line(tmp_path, word):
    text = PLAIN + f"x = [1 ...\n 2];\n\n{word} x\n  mpc.bus(:, 3) = mpc.bus(:, 3) * 2;\nend\n"
    line = text.splitlines().index(f"{word} x") + 1
    assert f"line {line}: '{word}' is not carried out" in refused(tmp_path, text)


def test_a_statement_that_is_not_understood_is_named_by_its_line(tmp_path):
    text = PLAIN + "mpc.branch(5, :) = [];\n"
    assert f"line {len(text.splitlines())}: statement" in refused(tmp_path, text)


@pytest.mark.parametrize("limit", ["0", "NaN", "Inf"])
def test_a_rating_that_states_no_limit_is_none(tmp_path, limit):
    text = PLAIN.replace("0.2511\t0\t6", f"0.2511\t0\t{limit}")
    assert np.isinf(read(tmp_path, text).network.rating_mva).all()


@pytest.mark.parametrize("power", ["9999999^9999999", "2^2^2^2^2^2", "10^400"])
def test_a_power_too_large_to_compute_is_missed_only_where_it_is_used(tmp_path, power):
    assert read(tmp_path, f"x = {power};\n" + PLAIN).load[0].p_mw == 100.0
    text = PLAIN + f"x = {power};\nmpc.bus(:, 3) = mpc.bus(:, 3) * x;\n"
    refused(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN.replace("'2'", "'1'"),
        "function [baseMVA, bus, gen, branch] = three\nbaseMVA = 10;\nbus = [\n1 3 0 0;\n];\n",
    ],
)
def test_a_file_of_version_1_is_called_that(tmp_path, text):
    assert "version 1" in refused(tmp_path, text)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("mpc.baseMVA = 10", "mpc.baseMVA = -10", "mpc.baseMVA is -10"),
        ("mpc.baseMVA = 10", "mpc.baseMVA = NaN", "mpc.baseMVA is nan"),
        ("\t2\t30\t0.4930", "\t2\t31\t0.4930", "mpc.branch, row 2: T_BUS is 31"),
        ("\t30\t0\t0\t10\t-10", "\t7\t0\t0\t10\t-10", "mpc.gen, row 2: GEN_BUS is 7"),
        ("\t2\t1\t100\t60", "\t2\t1\tNaN\t60", "PD is nan at bus 2"),
        ("\t2\t1\t100\t60", "\t1\t1\t100\t60", "bus 1 in 2 rows"),
        ("\t2\t1\t100\t60", "\t2.5\t1\t100\t60", "bus 2.5"),
        ("12.66\t1\t1.1\t0.9;", "12.66\t1\t1.1;", "row 2: 12 columns in place of 13"),
        ("0.2511\t0\t6", "0.2511\t0\t-6", "2-30: -6"),
        ("0.4930\t0.2511", "0.4930\tNaN", "2-30: nan"),
        ("\t1\t1.1\t0.9;", "\t1\t0.8\t0.9;", "2: 0.8"),
        ("\t2\t30\t0.4930", "\t2\t2\t0.4930", "branch 2-2"),
    ],
)
def test_what_is_not_sound_is_named(tmp_path, old, new, named):
    assert old in PLAIN
    assert named in refused(tmp_path, PLAIN.replace(old, new, 1))


def test_all_mistakes_are_told_together(tmp_path):
    text = PLAIN.replace("= 10;", "= -10;").replace("\t2\t30\t", "\t2\t31\t")
    assert len(refused(tmp_path, text).splitlines()) == 2


def test_a_dc_line_is_refused_unless_it_is_out_of_service(tmp_path):
    dcline = "mpc.dcline = [\n\t1\t2\t{}\t0.3\t0.2\t0\t0\t1\t1\t0\t1\t0\t0\t0\t0\t0\t0;\n];\n"
    assert "mpc.dcline, row 1" in refused(tmp_path, PLAIN + dcline.format(1))
    assert len(read(tmp_path, PLAIN + dcline.format(0)).network.line_names) == 3


def test_limits_and_costs_of_generators_come_over(tmp_path):
    """Costs: 240 $/MWh and 30 $/h; points through (0.5, 60), (1.5, 200); 8 p^2 + 20 p + 5."""
    gen = (
        "\t1\t0\t0\t10\t-10\t1.02\t100\t1\t5\t-3;\n"
        "\t30\t0\t0\t0.8\t-0.4\t1\t100\t1\t1.2\t0.3;\n"
        "\t2\t0\t0\t0.7\t-0.2\t1\t100\t1\t1.5\t0.5;\n"
        "\t2\t0\t0\t0.6\t-0.1\t1\t100\t0\t9\t0;\n"
        "\t30\t0\t0\t0\t-0.15\t1\t100\t1\t0\t-0.5;\n"
    )
    cost = (
        "mpc.gencost = [\n2 0 0 3 8 20 5 0;\n2 150 0 2 240 30 0 0;\n1 0 0 2 0.5 60 1.5 200;\n"
        "2 0 0 2 1 0 0 0;\n2 0 0 2 75 0 0 0;\n];\n"
    )
    start = PLAIN.index("mpc.gen = [\n") + len("mpc.gen = [\n")
    text = PLAIN[:start] + gen + PLAIN[PLAIN.index("];", start) :] + cost
    feeder = read(tmp_path, text)
    first, second = feeder.generator
    assert (first.p_min_mw, first.p_mw, first.q_min_mvar, first.q_max_mvar) == (0.3, 1.2, -0.4, 0.8)
    assert (first.cost.per_mwh, first.cost.per_h, first.cost.start) == (240.0, 30.0, 150.0)
    assert (second.name, second.cost.per_mwh) == ("gen2", 140.0)
    [grid] = feeder.grid
    assert (grid.p_min_mw, grid.p_mw) == (-3.0, 5.0)
    assert grid.cost.per_mwh == pytest.approx(20.0 + 8.0 * 5.0)
    points = np.array(grid.cost.curve)
    np.testing.assert_allclose(points[:, 1], 8 * points[:, 0] ** 2 + 20 * points[:, 0] + 5)
    assert (points[0, 0], points[-1, 0]) == (0.0, 5.0)
    [load] = feeder.flexible
    assert (load.bus, load.p_mw, load.q_mvar, load.cost.per_mwh) == ("30", 0.5, 0.15, 75.0)


def test_voltage_limits_are_those_of_every_bus(tmp_path):
    text = PLAIN.replace("12.66\t1\t1.1\t0.9;", "12.66\t1\t1.05\t0.95;", 1)
    network = read(tmp_path, text).network
    assert network.v_min_pu.tolist() == [1.0, 0.95, 0.9]
    assert network.v_max_pu.tolist() == [1.0, 1.05, 1.1]


def test_a_table_that_is_not_read_is_named(tmp_path):
    text = PLAIN + "mpc.reserves = [\n1 2 3;\n];\nmpc.areas = [];\n"
    assert [str(x) for x in read(tmp_path, text).omissions][-1] == "1 table (mpc.reserves)"


GENERATORS = (
    "\t1\t0\t0\t10\t-10\t1.02\t100\t1\t5\t0;\n"
    "\t2\t0.1\t0\t0.2\t-0.2\t1\t100\t1\t1.2\t0.15;\n"
    "\t30\t0\t0\t0\t0\t1\t100\t1\t0.7\t0;\n"
    "\t2\t0\t0\t0.4\t-0.3\t1\t100\t1\t0.9\t0;\n"
    "\t30\t0\t0\t0.1\t0\t1\t100\t1\t0.5\t-0.6;\n"
    "\t2\t0\t0\t0\t0\t1\t100\t0\t9\t0;\n"
    "\t30\t0\t0\t0\t-0.15\t1\t100\t1\t0\t-0.4;\n"
    "\t2\t0\t0\t0\t0\t1\t100\t1\t0.3\t-0.1;\n"
)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("genfuel", ("ng", "solar", "wind", "hydro", "ess", "solar", "dl", "solar")),
        ("gentype", ("ST", "PV", "WT", "HY", "BA", "PV", "OT", "PV")),
    ],
)
def test_fuels_say_what_drives_a_unit(tmp_path, column, words):
    """The sun at night is left to a profile, wind to comments, a battery to an energy."""
    start = PLAIN.index("mpc.gen = [\n") + len("mpc.gen = [\n")
    text = PLAIN[:start] + GENERATORS + PLAIN[PLAIN.index("];", start) :]
    strings = "\n".join(f"\t'{word}';  % the unit's fuel" for word in words)
    costs = "mpc.gencost = [\n2 0 0 2 31 0;\n2 0 0 2 4 7;\n" + "2 0 0 2 0 0;\n" * 6 + "];\n"
    text += f"mpc.{column} = {{\n{strings}\n}};\n{costs}"
    feeder = read(tmp_path, text)
    groups = ("grid", "static", "wind", "generator", "storage", "flexible")
    assert {g: [(u.bus, u.p_mw) for u in getattr(feeder, g)] for g in groups} == {
        "grid": [("1", 5.0)],
        "static": [("2", 1.2)],
        "wind": [("30", 0.7)],
        "generator": [("2", 0.9), ("2", 0.3)],
        "storage": [("30", 0.5)],
        "flexible": [("30", 0.4)],
    }
    [storage] = feeder.storage
    assert (storage.p_min_mw, storage.e_mwh) == (-0.6, None)
    assert [str(x) for x in feeder.omissions] == [
        "1 held voltage (gen2#2), here free within the limits of the bus",
        "1 reactive range of a plant of sun or wind (gen2)",
        "1 reactive range of a storage (gen30#2)",
        "1 two-way generator of 0.1 MW (gen2#3), here one that only gives",
        "1 cost curve of a plant of sun or wind (gen2), here its mean slope",
        "1 least output of a plant of sun or wind of 0.15 MW (gen2)",
    ]
    case = tmp_path / "case.toml"
    case.write_text(new_case_text(str(tmp_path / "feeder.m")))
    [plant] = load_case(case).pv
    assert (plant.p_max_mw, plant.profile, plant.cost_per_mwh) == (1.2, None, 4.0)
    assert '# profile = "wind"' in case.read_text()
    assert "does not say how much energy it holds" in case.read_text()


def test_fuels_of_another_length_are_named(tmp_path):
    feeder = read(tmp_path, PLAIN + "mpc.genfuel = { 'solar' };\n")
    assert not feeder.static
    assert str(feeder.omissions[-1]) == "1 table (mpc.genfuel)"


ANGLES = {  # columns 12 and 13 of a branch, degrees; MATPOWER has 0 and a full turn for none
    "both": ("-30 21.5", (-30.0, 21.5)),
    "one side": ("-360 25", (-np.inf, 25.0)),
    "zeros": ("0 0", (-np.inf, np.inf)),
    "a full turn": ("-360 360", (-np.inf, np.inf)),
    "no numbers": ("NaN NaN", (-np.inf, np.inf)),
    "no columns": ("", (-np.inf, np.inf)),
}


@pytest.mark.parametrize("name", ANGLES)
def test_limits_of_angles_are_read(name, tmp_path):
    columns, limits = ANGLES[name]
    text = f"""\
mpc.version = '2';
mpc.baseMVA = 1;
mpc.bus = [ 1 3 0 0 0 0 1 1 0 10 1 1.1 0.9; 2 1 0.5 0 0 0 1 1 0 10 1 1.1 0.9 ];
mpc.branch = [ 1 2 0 0.3 0 1 1 1 0 0 1 {columns} ];
"""
    feeder = read(tmp_path, text)
    assert feeder.omissions == ()
    network = feeder.network
    assert (network.angle_min_degree[0], network.angle_max_degree[0]) == limits
