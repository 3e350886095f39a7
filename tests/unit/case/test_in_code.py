"""Cases built in code are the cases that files would be."""

from __future__ import annotations

import tomllib
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
from resilience.case import case_text, new_case_text
from resilience.case.networks.network import Network

TABLES: dict[str, Any] = {
    "name": "hamlet",
    "network": {
        "bus": [{"name": "a", "vn_kv": 11.0}, {"name": "b", "vn_kv": 11.0}],
        "line": [{"from": "a", "to": "b", "r_ohm": 0.4, "x_ohm": 0.3}],
    },
    "time": {"start": "2024-05-01T06:00", "slots": 4, "step_min": 60.0},
    "profiles": {"columns": {"day": np.array([0.2, 0.9, 1.0, 0.4])}},
    "grid": [{"bus": "a", "import_max_mw": 4.0, "import_cost_per_mwh": 50.0}],
    "load": [
        {"name": "homes", "bus": "b", "p_max_mw": np.float64(2.0), "profile": "day"}
        | {"shed_cost_per_mwh": 900.0, "power_factor": None}
    ],
    "ess": [{"name": "ess1", "bus": "b", "p_max_mw": 1.0, "e_mwh": 2.0}],
    "outages": [("a-b", "08:00", datetime(2024, 5, 1, 9))],
}
NUMBERS = ("vn_kv", "v_min_pu", "v_max_pu", "r_pu", "x_pu", "ratio", "y_from_pu", "y_to_pu")


def test_plain_tables_are_a_case() -> None:
    case = rs.Case.from_dict(TABLES)
    assert case.outages == (rs.Outage("a-b", 2, 3),)
    assert case.start == datetime(2024, 5, 1, 6)
    np.testing.assert_array_equal(case.profile("day"), [0.2, 0.9, 1.0, 0.4])
    plan = rs.solve(case, "lp", physics="copperplate")
    # 3 MWh with the grid, and 2 in the outage: 1 from storage, which holds it, and 1 shed
    assert plan.objective == pytest.approx(50.0 * 3.0 + 900.0)


def test_a_case_written_and_given_as_tables_is_the_same() -> None:
    case = rs.load_case("ieee33")
    again = rs.Case.from_dict(tomllib.loads(case_text(case)))
    assert again.equals(case)


def test_tables_may_extend_a_case_and_hold_those_of_another() -> None:
    base = rs.load_case("ieee33")
    bigger = rs.Case.from_dict({"extends": "ieee33", "ess": [{"name": "ess1", "e_mwh": 12.0}]})
    assert bigger.ess[0].e_mwh == 12.0
    assert bigger.devices == base.with_ess("ess1", e_mwh=12.0).devices
    taken = rs.Case.from_dict(TABLES | {"ess": [base.ess[0].model_copy(update={"bus": "b"})]})
    assert taken.ess[0].e_mwh == base.ess[0].e_mwh
    with pytest.raises(rs.UsageError, match="ieee34"):
        rs.Case.from_dict({"extends": "ieee34"})


def test_profiles_may_be_a_frame() -> None:
    frame = pd.DataFrame({"day": [1.0, 0.5, 0.25, 0.0]})
    case = rs.Case.from_dict(TABLES | {"profiles": {"columns": frame}})
    np.testing.assert_array_equal(case.profile("day"), frame["day"])


def test_all_mistakes_are_told_at_once() -> None:
    wrong = TABLES | {
        "ess": [{"name": "ess1", "bus": "c", "p_max_mw": 1.0, "e_mhw": 2.0}],
        "outages": [("a-b", "08:00")],
    }
    with pytest.raises(rs.CaseError) as caught:
        rs.Case.from_dict(wrong)
    text = str(caught.value)
    assert "did you mean e_mwh" in text
    assert "outages" in text


@pytest.mark.parametrize("name", ["case14", "create_cigre_network_mv"])
def test_a_network_in_memory_is_that_of_its_file(name: str, tmp_path: Path) -> None:
    """Numbers and devices are those that `case new` takes from pandapower itself."""
    import pandapower.networks

    (tmp_path / "new.toml").write_text(new_case_text(name), encoding="utf-8")
    filed = rs.load_case(tmp_path / "new.toml")
    built = rs.Case.from_pandapower(getattr(pandapower.networks, name)())
    assert built.devices == filed.devices
    assert (built.start, built.slots, built.step_min) == (filed.start, filed.slots, filed.step_min)
    assert_same(built.network, filed.network)
    assert {str(o) for o in filed.omissions} <= {str(o) for o in built.omissions}
    (tmp_path / "again.toml").write_text(case_text(built), encoding="utf-8")
    again = rs.load_case(tmp_path / "again.toml")
    assert again.equals(built)
    assert again.omissions == built.omissions


def assert_same(built: Network, filed: Network) -> None:
    assert built.bus_names == filed.bus_names
    assert built.line_names == filed.line_names
    for key in (*NUMBERS, "y_bus_pu", "rating_mva"):
        np.testing.assert_allclose(getattr(built, key), getattr(filed, key), rtol=1e-12, atol=1e-12)
    for key in ("from_bus", "to_bus", "in_service"):
        np.testing.assert_array_equal(getattr(built, key), getattr(filed, key))


def test_branches_of_every_kind_come_along() -> None:
    """Two voltages, a tap, magnetising, a cable's charging, an uneven impedance and a shunt."""
    import pandapower as pp

    net = pp.create_empty_network(name="kinds")
    buses = [pp.create_bus(net, kv, name=f"n{k}") for k, kv in enumerate((110.0, 20.0, 20.0, 20.0))]
    pp.create_ext_grid(net, buses[0])
    pp.create_transformer(net, buses[0], buses[1], "25 MVA 110/20 kV", tap_pos=2)
    pp.create_line(net, buses[1], buses[2], 3.0, "NA2XS2Y 1x240 RM/25 12/20 kV")
    pp.create_impedance(
        net, buses[2], buses[3], 0.02, 0.04, 10.0, gf_pu=0.01, bf_pu=0.03, gt_pu=0.0, bt_pu=0.0
    )
    pp.create_shunt(net, buses[3], q_mvar=-0.5)
    pp.create_load(net, buses[3], p_mw=2.0, q_mvar=0.4)
    case = rs.Case.from_pandapower(
        net, time={"start": "2024-05-01", "slots": 1, "step_min": 60.0}, name="mine"
    )
    assert case.name == "mine"
    assert "uneven charging" in str(case.omissions[-1])
    plan = rs.solve(case, "minlp")
    pp.runpp(net, calculate_voltage_angles=True)
    np.testing.assert_allclose(
        plan.tables["voltage"].values[:, 0], net.res_bus["vm_pu"], rtol=0, atol=2e-5
    )


def test_what_is_no_network_is_refused() -> None:
    with pytest.raises(rs.UsageError, match="allowed: a network of pandapower"):
        rs.Case.from_pandapower("case33bw")
    with pytest.raises(rs.UsageError, match="network of a case: 3; allowed"):
        rs.Case.from_dict(TABLES).replace(network=3)


def test_a_network_and_devices_are_replaced_by_tables() -> None:
    case = rs.Case.from_dict(TABLES)
    network = TABLES["network"] | {"impedance_scale": 2.0}
    changed = case.replace(network=network, ess=[TABLES["ess"][0] | {"e_mwh": 5.0}])
    np.testing.assert_allclose(changed.network.r_pu, 2.0 * case.network.r_pu)
    assert changed.ess[0].e_mwh == 5.0
    with pytest.raises(rs.CaseError, match="did you mean e_mwh"):
        case.replace(ess=[TABLES["ess"][0] | {"e_mhw": 5.0}])


def test_outages_are_texts_or_tuples_everywhere() -> None:
    case = rs.Case.from_dict(TABLES)
    same = (rs.Outage("a-b", 1, 3),)
    tuples = [("a-b", "07:00", "09:00")]
    assert case.replace(outages=tuples).outages == same
    assert rs.parse_outages(tuples, case) == same
    assert rs.solve(case, "lp", outages=tuples).outages == ["a-b@07:00-09:00"]
    with pytest.raises(rs.CaseError, match="LINE@START-STOP"):
        case.replace(outages=[("a-b", "07:00")])
