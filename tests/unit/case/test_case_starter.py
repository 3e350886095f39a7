"""A first case for any network loads at once."""

import pytest

from resilience.case import load_case, new_case_text
from resilience.case.starter import starter
from resilience.errors import UsageError


def start(network: str, tmp_path):
    path = tmp_path / "new.toml"
    path.write_text(new_case_text(network))
    return load_case(path)


def test_a_starter_case_has_the_loads_of_the_feeder(tmp_path):
    case = start("case33bw", tmp_path)
    assert case.name == "case33bw"
    assert sum(load.p_max_mw for load in case.load) == pytest.approx(3.715)
    q_mvar = sum(d.p_max_mw * (1 / d.power_factor**2 - 1) ** 0.5 for d in case.load)
    assert q_mvar == pytest.approx(2.3, rel=1e-4)
    assert [(grid.name, grid.bus) for grid in case.grid] == [("ext_grid1", "1")]


@pytest.mark.parametrize(
    "network",
    [
        "case118",
        "case300",
        "create_cigre_network_mv",
        "mv_oberrhein",
        "simple_four_bus_system",
        "ieee_european_lv_asymmetric",
    ],
)
def test_other_networks_start_too(network, tmp_path):
    case = start(network, tmp_path)
    assert case.load
    assert case.grid


def test_the_examples_in_comments_are_right(tmp_path):
    text = new_case_text("case33bw")
    head, examples = text.split("# A storage system")
    lines = [line.removeprefix("# ") for line in examples.splitlines()]
    keys = [line for line in lines if "=" in line or line.startswith("[[")]
    path = tmp_path / "new.toml"
    path.write_text("\n".join([head, *keys]))
    case = load_case(path)
    assert case.ess[0].name == "ess1"
    assert case.generator[0].name == "diesel1"


def test_a_network_that_does_not_exist_is_refused():
    with pytest.raises(UsageError, match="did you mean case33bw"):
        new_case_text("case33b")
    with pytest.raises(UsageError, match="needs no argument"):
        new_case_text("create_dickert_lv_feeders")
    with pytest.raises(UsageError, match="three-winding transformer"):
        new_case_text("example_multivoltage")
    with pytest.raises(UsageError, match="a file that exists"):
        new_case_text("nowhere/feeder.json")


def matpower(folder, *, kv=12.66, p_mw=1.7, gen="", bus="", p_max=10, q_max=10):
    """A file of two buses; `gen` and `bus` are further rows."""
    path = folder / "two.m"
    path.write_text(
        f"mpc.version = '2';\nmpc.baseMVA = 10;\nmpc.bus = [\n1 3 0 0 0 0 1 1 0 {kv} 1 1.1 0.9;\n"
        f"2 1 {p_mw} 0.6 0 0 1 1 0 {kv} 1 1.1 0.9;\n{bus}];\nmpc.gen = [\n"
        f"1 0 0 {q_max} -{q_max} 1.02 100 1 {p_max} 0;\n{gen}];\n"
        "mpc.branch = [\n1 2 0.01 0.02 0 0 0 0 0 0 1 -360 360;\n];\n"
    )
    return path


def test_a_placeholder_for_nominal_voltages_cuts_no_loads(tmp_path):
    """170 MW would be 98 kA at PGLib's 1 kV; in per unit the file is that of any voltage."""
    path = matpower(tmp_path, kv=1.0, p_mw=170.0, p_max=200)
    assert "2 nominal voltages (1, 2), here 1 kV as in the file, a placeholder" in [
        str(omission) for omission in starter(str(path)).omissions
    ]
    case = start(str(path), tmp_path)
    assert case.load[0].p_max_mw == 170.0


def test_a_load_that_is_cut_to_what_a_busbar_carries_is_named(tmp_path):
    path = matpower(tmp_path, kv=0.4, p_mw=10.0)
    limit_mw = 9.0 * 3**0.5 * 0.4
    assert [str(omission) for omission in starter(str(path)).omissions] == [
        f"1 device beyond a busbar's current of {10.0 - limit_mw:.4g} MW (load 2), here cut to 9 kA"
    ]
    assert start(str(path), tmp_path).load[0].p_max_mw == pytest.approx(limit_mw, rel=1e-5)


@pytest.mark.parametrize(("p_max", "q_max"), [(0.4, 0.2), (9999, 9999), ("Inf", "Inf"), (0, 0)])
def test_a_grid_carries_the_calm_day_whatever_the_source_states(tmp_path, p_max, q_max):
    case = start(str(matpower(tmp_path, p_max=p_max, q_max=q_max)), tmp_path)
    [grid] = case.grid
    assert grid.import_max_mw >= 1.7 * 1.2
    assert grid.q_max_mvar >= 0.6 * 1.2


def test_limits_of_the_source_are_the_units_own(tmp_path):
    """Of a generator, of one that gives Mvar alone, and of a dispatchable load."""
    rows = (
        "2 0 0 1.5 -0.5 1 100 1 3.2 0.2;\n2 0 0 0.7 -0.3 1 100 1 0 0;\n"
        "2 0 0 0 -0.1 1 100 1 0 -0.5;\n2 0 0 9999 -9999 1 100 1 0.4 0;\n"
    )
    case = start(str(matpower(tmp_path, gen=rows)), tmp_path)
    first, condenser, free = case.generator
    assert (first.p_min_mw, first.p_max_mw, first.q_min_mvar, first.q_max_mvar) == (
        0.2, 3.2, -0.5, 1.5,
    )  # fmt: skip
    assert (condenser.p_max_mw, condenser.q_min_mvar, condenser.grid_forming) == (0.0, -0.3, False)
    assert free.q_max_mvar == -free.q_min_mvar < 10.0
    flexible = case.load[-1]
    assert (flexible.name, flexible.p_max_mw) == ("flexible2#3", 0.5)
    assert flexible.q_peak_mvar == pytest.approx(0.1)


def test_loads_that_lead_feed_in_or_have_no_megawatts_come_over(tmp_path):
    rows = (
        "3 1 0.8 -0.6 0 0 1 1 0 12.66 1 1.1 0.9;\n4 1 0 0.35 0 0 1 1 0 12.66 1 1.1 0.9;\n"
        "5 1 -1.5 0.2 0 0 1 1 0 12.66 1 1.1 0.9;\n"
    )
    path = matpower(tmp_path, bus=rows)
    lines = "".join(f"2 {k} 0.01 0.02 0 0 0 0 0 0 1 -360 360;\n" for k in (3, 4, 5))
    path.write_text(path.read_text().removesuffix("];\n") + lines + "];\n")
    case = start(str(path), tmp_path)
    assert {load.bus: (load.p_max_mw, load.q_mvar) for load in case.load[1:]} == {
        "3": (0.8, -0.6),
        "4": (0.0, 0.35),
    }
    [plant] = case.pv
    assert (plant.p_max_mw, plant.q_mvar, plant.curtailable) == (1.5, -0.2, False)


def test_a_network_file_is_named_from_the_folder_of_the_case(tmp_path):
    path = matpower(tmp_path)
    assert 'file = "two.m"\n' in starter(str(path), tmp_path).text
    assert f'file = "{path}"\n' in starter(str(path), tmp_path / "elsewhere").text


def test_the_first_lines_say_what_is_left_out(tmp_path):
    path = matpower(tmp_path)
    path.write_text(path.read_text() + "mpc.reserves = [\n1;\n];\n")
    head = starter(str(path)).text.split("name =")[0]
    assert "# Of the network, not in this case:\n# - 1 table (mpc.reserves)\n" in head
