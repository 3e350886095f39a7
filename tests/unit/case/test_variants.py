"""The outage process of a case, the variants of ieee33, and horizons of many days."""

import dataclasses
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import resilience as rs
from resilience.case import OutageTable, case_text, load_case
from resilience.errors import CaseError
from resilience.fragility.outages.bell import Bell

CENTRES = (24, 32, 40, 48, 56, 64, 72, 80)


def test_the_outage_table_has_the_settings_and_defaults_of_the_bell():
    assert OutageTable().model_dump() == dataclasses.asdict(Bell())
    assert Bell(**load_case("ieee33-wide").outage.model_dump()).sigma_slots == 8


def test_a_case_without_an_outage_table_has_the_defaults(case_file):
    case = load_case(case_file())
    assert case.outage == OutageTable()
    with pytest.raises(ValidationError):
        case.outage.probability = 0.5  # type: ignore[misc]


def test_an_outage_table_merges_over_its_base_and_is_written(case_file, tmp_path):
    case_file(("[time]", "[outage]\nprobability = 0.5\ncentres = [8, 9]\n[time]"), name="base.toml")
    case = load_case(case_file(text='extends = "base"\n[outage]\nduration_slots = [2, 3]\n'))
    assert case.outage == OutageTable(probability=0.5, centres=(8, 9), duration_slots=(2, 3))
    path = tmp_path / "written.toml"
    path.write_text(case_text(case))
    assert load_case(path).equals(case)
    other = case.replace(outage=OutageTable(refail=True), slots=2)
    assert other.outage == OutageTable(refail=True)
    assert case.replace(slots=2).outage == case.outage


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("probability = 1.0", "probability"),
        ("sigma_slots = 0", "sigma_slots"),
        ("duration_slots = [15, 12]", "duration_slots"),
        ("duration_slots = [0, 12]", "duration_slots[1]"),
        ("duration_slots = [12]", "duration_slots[2]"),
        ("centres = [96]", "centres[1]"),
        ("height = 1.0", "height"),
        ("centre_error_slots = -1", "centre_error_slots"),
        ("shift_slots = 1.5", "shift_slots"),
        ("sigma = 4", "sigma"),
    ],
)
def test_a_wrong_setting_is_named(case_file, line, key):
    with pytest.raises(CaseError) as error:
        load_case(case_file(("[time]", f"[outage]\n{line}\n[time]")))
    [problem] = error.value.mistakes
    assert (problem.table, problem.key) == ("[outage]", key)
    assert problem.hint


def test_variants_change_only_what_they_say():
    base, tou = load_case("ieee33"), load_case("ieee33-tou")
    grid, long, wide = (load_case(f"ieee33-{name}") for name in ("grid", "long", "wide"))
    night = load_case("ieee33-night")
    broken = np.flatnonzero(grid.network.breakpoint)
    assert [grid.network.line_names[i] for i in broken] == ["1-2"]
    assert np.count_nonzero(tou.network.breakpoint) == 4
    assert {load.shed_cost_per_mwh for load in tou.load} == {30.0}
    assert tou.outage == grid.outage == OutageTable(centres=CENTRES)
    assert long.outage == OutageTable(centres=CENTRES, duration_slots=(24, 48), overnight=False)
    assert wide.outage == OutageTable(centres=CENTRES, sigma_slots=8)
    assert night.outage == OutageTable(centres=CENTRES, duration_slots=(24, 48), overnight=True)
    assert night.outages == long.outages
    assert {o.stop - o.first for o in long.outages} <= set(range(24, 49))
    assert {o.stop - o.first for o in wide.outages} <= set(range(12, 16))
    assert base.ess == grid.ess == tou.ess == long.ess == wide.ess


@pytest.mark.parametrize(
    ("name", "cost", "shed_mwh"),
    [
        ("ieee33-grid", 35.118, 0.0),
        ("ieee33-tou", 33.975, 0.0),
        ("ieee33-long", 157.668, 4.043),
        ("ieee33-night", 157.668, 4.043),
        ("ieee33-wide", 34.358, 0.0),
    ],
)
def test_every_variant_has_its_plan(name, cost, shed_mwh):
    plan = rs.solve(load_case(name), method="lp")
    assert plan.objective == pytest.approx(cost, rel=1e-4)
    assert plan.shed_mwh == pytest.approx(shed_mwh, abs=2e-3)


def test_a_tariff_moves_storage_from_the_night_to_the_evening():
    case = load_case("ieee33-tou").replace(outages=())
    plan = rs.solve(case, method="lp", physics="copperplate")
    ess = np.array([plan.tables["power"][unit.name] for unit in case.ess]).sum(axis=0)
    price = case.profile(case.grid[0].tariff_profile)
    charged = {p: -ess[price == p].clip(max=0).sum() * case.step_h for p in (0.1, 0.3, 0.6)}
    drawn = {p: ess[price == p].clip(min=0).sum() * case.step_h for p in (0.1, 0.3, 0.6)}
    # From SoC 0.5 to 0.9 before morning (8.8 MWh), down to 0.1 in the evening, and up to 0.5 again
    # or further before midnight.
    assert drawn == pytest.approx({0.1: 0.0, 0.3: 0.0, 0.6: 17.582}, abs=1e-3)
    assert charged == pytest.approx({0.1: 22.403, 0.3: 0.0, 0.6: 0.0}, abs=1e-3)


def test_a_horizon_of_sixteen_days_reads_no_file_again(monkeypatch: pytest.MonkeyPatch):
    """What `Case.replace` says of its speed: files are in memory after the first time."""
    case = load_case("ieee33-tou")
    read = []
    for name in ("read_bytes", "read_text", "open"):
        monkeypatch.setattr(Path, name, lambda path, *_, **__: read.append(path))
    moved = case.replace(start=datetime(2016, 8, 1), slots=16 * 96)
    monkeypatch.undo()
    assert read == []
    assert moved.profile("PV1").shape == (1536,)
    assert moved.outages == ()
    again = load_case("ieee33-tou").replace(start=datetime(2016, 8, 9), slots=96)
    np.testing.assert_array_equal(moved.profile("PV1")[8 * 96 : 9 * 96], again.profile("PV1"))


def test_the_large_case_is_large():
    case = load_case("large")
    assert len(case.network.bus_names) == 975
    assert np.count_nonzero(case.network.breakpoint) == 50
    assert len(case.ess) == 20


@pytest.mark.slow
def test_the_large_case_has_its_plan():
    plan = rs.solve(load_case("large"), method="lp", time_limit=600)
    assert plan.objective == pytest.approx(144.913, rel=1e-4)
    assert plan.shed_mwh == pytest.approx(11.932, abs=1e-2)
