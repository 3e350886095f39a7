"""A first case for any network loads at once."""

import pytest

from resilience.case import load_case, new_case_text
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
