"""Ratios, charging and shunts of inline networks, and what of them cannot be."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.case.networks.feeder import Branch, Feeder, FeederError, make_network
from resilience.case.networks.read import finish_network
from resilience.case.networks.soundness import network_findings
from resilience.case.schema import LineTable, NetworkTable
from resilience.errors import CaseError

TEXT = """\
name = "two levels"

[network]

[[network.bus]]
name = "a"
vn_kv = 20

[[network.bus]]
name = "b"
vn_kv = 10
shunt_p_mw = 0.05
shunt_q_mvar = -0.3

[[network.bus]]
name = "c"
vn_kv = 10

[[network.line]]
from = "a"
to = "b"
r_ohm = 0.4
x_ohm = 2.0
tap_ratio = 1.025
shift_degree = 30

[[network.line]]
from = "b"
to = "c"
r_ohm = 0.5
x_ohm = 0.3
b_us = 200
g_us = 4

[time]
start = 2024-01-01T00:00:00
slots = 1
step_min = 60

[[grid]]
name = "grid"
bus = "a"
import_max_mw = 5
import_cost_per_mwh = 10
"""


def case_of(folder: Path, *changes: tuple[str, str]) -> Case:
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "case.toml"
    path.write_text(text)
    return load_case(path)


def test_inline_elements_are_in_per_unit_on_1_mva(tmp_path: Path) -> None:
    """At 10 kV an ohm is 0.01 pu, and 100 microsiemens are 0.01 pu."""
    network = case_of(tmp_path).network
    np.testing.assert_allclose(network.r_pu, [0.004, 0.005])
    np.testing.assert_allclose(network.x_pu, [0.02, 0.003])
    np.testing.assert_allclose(network.ratio, [cmath.rect(1.025, math.pi / 6.0), 1.0])
    np.testing.assert_allclose(network.y_from_pu, [0.0, 0.0002 + 0.01j])
    np.testing.assert_allclose(network.y_to_pu, network.y_from_pu)
    np.testing.assert_allclose(network.y_bus_pu, [0.0, 0.05 + 0.3j, 0.0])
    assert network.plain.tolist() == [False, False]


def test_an_impedance_scale_leaves_the_rest_alone(tmp_path: Path) -> None:
    whole = case_of(tmp_path).network
    half = case_of(tmp_path, ("[network]", "[network]\nimpedance_scale = 0.5")).network
    np.testing.assert_allclose(half.x_pu, 0.5 * whole.x_pu)
    for name in ("ratio", "y_from_pu", "y_to_pu", "y_bus_pu"):
        np.testing.assert_array_equal(getattr(half, name), getattr(whole, name))


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("tap_ratio = 1.025\n", "", "20 kV at one end, 10 kV at the other"),
        ("tap_ratio = 1.025", "tap_ratio = 0", "a-b tap_ratio"),
        ("tap_ratio = 1.025", "tap_ratio = 20.5", "branch a-b: 20.5"),
        ("b_us = 200", "shift_degree = 30", "0 without a tap_ratio"),
        ("b_us = 200", "b_us = nan", "b_us"),
        ("shunt_q_mvar = -0.3", "shunt_q_mvar = inf", "shunt_q_mvar"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, old: str, new: str, named: str) -> None:
    with pytest.raises(CaseError) as caught:
        case_of(tmp_path, (old, new))
    assert named in str(caught.value)


def test_numbers_of_files_that_cannot_be_are_named() -> None:
    network = make_network(
        [("1", 10.0), ("2", 10.0), ("3", 10.0)],
        [
            Branch("1", "2", 0.01, 0.02, ratio=0.0),
            Branch("2", "3", -0.01, 0.02, y_to_pu=complex(math.nan, 0.0)),
        ],
        shunts={"3": complex(0.0, math.inf)},
    )
    named = [(value, allowed) for _, value, allowed, _ in network_findings(network)]
    assert named == [
        ("branch 1-2: 0", "a ratio between 0.25 and 4 in per unit"),
        ("branch 2-3: nan", "charging that is a finite number"),
        ("bus 3: inf", "a shunt of finite size"),
    ]


def test_a_shunt_of_a_bus_that_is_not_there_is_refused() -> None:
    with pytest.raises(FeederError, match="shunt at bus 7"):
        make_network([("1", 10.0)], [], shunts={"7": 1j})


def test_an_open_end_hangs_at_the_other_bus_unless_the_plan_may_close_it() -> None:
    """Charging of 0.1 pu behind 1 + 4j pu is 0.1j / (1 + (1 + 4j) 0.1j) at the other end."""
    branches = [
        Branch("1", "2", 0.01, 0.02),
        Branch("2", "3", 1.0, 4.0, in_service=False, y_from_pu=0.2j, y_to_pu=0.1j, open_at="to"),
    ]
    feeder = Feeder(make_network([(name, 10.0) for name in "123"], branches))
    table = NetworkTable(file="somewhere.m")
    fixed = finish_network(feeder.network, table, ())
    seen = 0.2j + 0.1j / (1.0 + (1.0 + 4.0j) * 0.1j)
    np.testing.assert_allclose(fixed.y_bus_pu, [0.0, seen, 0.0])
    line = LineTable(name="2-3", switchable=True)
    np.testing.assert_array_equal(finish_network(feeder.network, table, [line]).y_bus_pu, 0.0)
