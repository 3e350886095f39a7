"""What `cases/ieee33.toml` promises about itself: voltage, islands, storm and demand."""

import math
from itertools import pairwise

import numpy as np
import pytest

from resilience.case import Case, load_case

ISLANDS = {"A": range(2, 19), "B": range(19, 23), "C": range(23, 26), "D": range(26, 34)}
HEAD = {"A": "1-2", "B": "2-19", "C": "3-23", "D": "6-26"}


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case("ieee33")


def full_load_voltage(case: Case, impedance_scale: float) -> float:
    """Lowest AC voltage in pu with every load at its peak and no local source."""
    import pandapower
    import pandapower.networks

    net = pandapower.networks.case33bw()
    net.load = net.load.drop(net.load.index)
    net.line[["r_ohm_per_km", "x_ohm_per_km"]] *= impedance_scale
    for load in case.load:
        q_mvar = load.p_max_mw * math.tan(math.acos(load.power_factor))
        pandapower.create_load(net, int(load.bus) - 1, p_mw=load.p_max_mw, q_mvar=q_mvar)
    pandapower.runpp(net, numba=False)
    return float(net.res_bus.vm_pu.min())


def test_full_load_without_local_sources_keeps_the_voltage(case: Case) -> None:
    scale = case.source["network"]["impedance_scale"]
    assert full_load_voltage(case, scale) == pytest.approx(0.91184, abs=1e-5)
    assert full_load_voltage(case, 1.0) < 0.75


def test_impedances_of_the_case_are_the_scaled_ones(case: Case) -> None:
    network = case.network
    first = network.line("1-2")
    assert network.r_pu[first] == pytest.approx(0.394 * 0.0922 / 12.66**2)


def island(bus: str) -> str:
    return next(name for name, buses in ISLANDS.items() if int(bus) in buses)


def island_sums(devices: tuple, key: str = "p_max_mw") -> dict[str, float]:
    totals = dict.fromkeys(ISLANDS, 0.0)
    for device in devices:
        totals[island(device.bus)] += getattr(device, key)
    return {name: round(total, 6) for name, total in totals.items()}


def test_devices_per_island(case: Case) -> None:
    assert island_sums(case.load) == {"A": 4.24, "B": 0.97, "C": 2.11, "D": 2.11}
    assert island_sums(case.generator) == {"A": 3, "B": 1, "C": 1, "D": 1}
    assert island_sums(case.pv) == {"A": 4, "B": 1, "C": 2, "D": 2}
    assert island_sums(case.ess) == {"A": 3, "B": 1, "C": 1.5, "D": 2}
    assert island_sums(case.ess, "e_mwh") == {"A": 9, "B": 3, "C": 4, "D": 6}
    breakpoints = np.flatnonzero(case.network.breakpoint)
    assert {case.network.line_names[i] for i in breakpoints} == set(HEAD.values())


def test_outages_follow_the_paper(case: Case) -> None:
    outages = {outage.line: outage for outage in case.outages}
    assert set(outages) == set(HEAD.values())
    assert (case.slot_label(outages["1-2"].first), outages["1-2"].stop) == ("14:00", 70)
    for outage in outages.values():
        assert abs(outage.first - outages["1-2"].first) <= 3
        assert 12 <= outage.stop - outage.first <= 16


def test_columns_differ(case: Case) -> None:
    assert len({pv.profile for pv in case.pv}) == 6
    assert len({load.profile for load in case.load}) == 12
    along_feeder = sorted(case.load, key=lambda load: int(load.bus))
    for one, next_ in pairwise(along_feeder):
        assert one.profile != next_.profile


def power(case: Case, devices: tuple, name: str) -> np.ndarray:
    """Available PV or demanded load of an island per slot, MW."""
    here = [device for device in devices if island(device.bus) == name]
    return np.sum([device.p_max_mw * case.profile(device.profile) for device in here], axis=0)


@pytest.mark.parametrize(("name", "missing_mwh"), [("C", 1.7065), ("D", 2.8862)])
def test_short_islands_need_more_than_storage_holds_at_the_start(
    case: Case, name: str, missing_mwh: float
) -> None:
    outage = next(outage for outage in case.outages if outage.line == HEAD[name])
    net = power(case, case.load, name) - power(case, case.pv, name) - 1.0
    missing = np.maximum(net[outage.first : outage.stop], 0).sum() * case.step_h
    assert missing == pytest.approx(missing_mwh, abs=1e-4)
    [ess] = [ess for ess in case.ess if island(ess.bus) == name]
    held = (ess.soc_initial - ess.soc_min) * ess.e_mwh * ess.efficiency_discharge
    full = (ess.soc_max - ess.soc_min) * ess.e_mwh * ess.efficiency_discharge
    assert held < missing < full


def test_energy_of_the_day(case: Case) -> None:
    load = sum(power(case, case.load, name) for name in ISLANDS)
    pv = sum(power(case, case.pv, name) for name in ISLANDS)
    assert np.sum(load) * case.step_h == pytest.approx(140.687, abs=1e-3)
    assert np.max(load) == pytest.approx(7.688, abs=1e-3)
    assert np.sum(pv) * case.step_h == pytest.approx(22.641, abs=1e-3)


def test_commitment_variant_changes_only_the_generators(case: Case) -> None:
    variant = load_case("ieee33-commitment")
    assert variant.name == "ieee33-commitment"
    assert variant.outages == case.outages
    assert (variant.load, variant.pv, variant.ess) == (case.load, case.pv, case.ess)
    for unit, base in zip(variant.generator, case.generator, strict=True):
        assert (unit.name, unit.p_max_mw, unit.bus) == (base.name, base.p_max_mw, base.bus)
        assert unit.p_min_mw == pytest.approx(0.3 * base.p_max_mw)
        assert (unit.min_up_h, unit.min_down_h) == (1.0, 0.5)
        assert unit.ramp_up_mw_per_h is not None
        assert unit.ramp_up_mw_per_h * variant.step_h > unit.p_min_mw


def test_profile_file_is_scaled_to_a_maximum_of_one(case: Case) -> None:
    import pandas as pd

    assert case.path is not None
    path = case.path.parent / case.source["profiles"]["file"]
    frame = pd.read_csv(path, index_col="time", parse_dates=True)
    assert frame.shape == (62 * 96, 20)
    assert frame.index.equals(pd.date_range("2016-07-01", periods=62 * 96, freq="15min"))
    assert (frame >= 0).all(axis=None)
    assert (frame.max() == 1).all()
    alike = frame.iloc[:, 8:].corr().to_numpy() - np.eye(12)
    assert alike.max() < 0.84
