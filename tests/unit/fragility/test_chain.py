"""From a case's storm to scenarios: the same seed, the same storms; samples meet probabilities."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.case.schema import CurveTable, LineTable
from resilience.fragility import chain
from resilience.fragility.chain import Storm, slot_times, storm, storm_scenarios
from resilience.fragility.draw import outages_from, sample_case
from resilience.fragility.likely import buses_text, likely
from resilience.fragility.lines.curves import CURVES
from resilience.fragility.lines.damage import failed_by
from resilience.fragility.outages.scenarios import Scenarios

CASES = ("ieee33_koinu", "ieee33_rammasun")


@pytest.fixture(scope="module")
def koinu() -> Case:
    return rs.load_case("ieee33_koinu")


@pytest.fixture(scope="module")
def over(koinu: Case) -> Storm:
    return storm(koinu)


def changed(case: Case, **keys: object) -> Case:
    assert case.storm is not None
    return case.replace(storm=case.storm.model_copy(update=keys))


def test_the_same_seed_draws_the_same_storms(koinu: Case) -> None:
    one, again, other = (storm_scenarios(koinu, 20, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.down, again.down)
    assert (one.down != other.down).any()
    np.testing.assert_array_equal(sample_case(koinu, 20, 3).down, one.down)
    drawn = outages_from("storm", koinu, 3)
    assert storm_scenarios(koinu, 1, 3).events() == [(0, o.line, o.first, o.stop) for o in drawn]


def test_slots_are_local_times_of_the_storm(koinu: Case) -> None:
    """The horizon's 2016-08-25 12:00 is noon of 2023-10-04 at UTC + 8: 04:00 UTC, and a slot's
    wind is the strongest of three moments, each in the middle of five minutes."""
    assert str(slot_times(koinu)[0]) == "2023-10-04T04:02:30"
    assert len(slot_times(koinu)) == 3 * koinu.slots
    assert len(slot_times(replace(koinu, step_min=30.0, slots=96))) == 3 * koinu.slots


def test_halving_the_step_changes_no_probability_of_failure(koinu: Case, over: Storm) -> None:
    coarse = storm(replace(koinu, step_min=30.0, slots=96))
    np.testing.assert_allclose(coarse.failed_by[:, -1], over.failed_by[:, -1], rtol=1e-12)
    fine = storm(replace(koinu, step_min=7.5, slots=384))
    np.testing.assert_allclose(fine.failed_by[:, -1], over.failed_by[:, -1], atol=0.01)


def test_hazards_multiply_to_the_probability(over: Storm) -> None:
    stands = np.prod(1.0 - over.hazard, axis=1)
    np.testing.assert_allclose(1.0 - stands, over.failed_by[:, -1], atol=1e-12)


def test_sampled_frequencies_are_the_exact_probabilities(over: Storm) -> None:
    n = 20_000
    often = over.scenarios(n, 1).down.any(axis=1).mean(axis=1)
    exact = over.failed_by[:, -1]
    assert (np.abs(often - exact) < 4.5 * np.sqrt(exact * (1 - exact) / n)).all()


def test_a_storm_across_lines_only_breaks_fewer(koinu: Case, over: Storm) -> None:
    across = storm(changed(koinu, by_angle=True))
    assert (across.failed_by[:, -1] <= over.failed_by[:, -1] + 1e-12).all()
    assert across.failed_by[:, -1].sum() < 0.9 * over.failed_by[:, -1].sum()


def test_the_angle_that_counts_is_that_of_the_hardest_moment(koinu: Case) -> None:
    """Slots of an hour see the same largest wind across a line as slots of five minutes do."""
    table = {"by_angle": True}
    fine = storm(replace(changed(koinu, **table), step_min=5.0, slots=576))
    coarse = storm(replace(changed(koinu, **table), step_min=60.0, slots=48))
    assert len(slot_times(coarse.case)) == len(slot_times(fine.case))
    np.testing.assert_allclose(coarse.failed_by[:, -1], fine.failed_by[:, -1], rtol=1e-12)
    strongest = coarse.winds[0].strongest_mps
    assert strongest is not None
    assert (strongest >= coarse.winds[0].speed_mps).all()
    windy = np.zeros((32, 48), bool)
    np.logical_or.at(windy, coarse.lines.span_line, strongest > 20.0)
    np.testing.assert_array_equal(coarse.calm(coarse.winds[0]), ~windy)


def test_a_line_has_poles_spans_and_strength_of_its_own(koinu: Case, over: Storm) -> None:
    """A substation is one element of its own curve, a cable never fails, the rest is as before."""
    lines = [
        LineTable(name="1-2", pole="substation", span_m=1000.0, hardening=1.1),
        LineTable(name="2-3", hardening=1.6 * 1.2),
        LineTable(name="3-4", underground=True),
    ]
    found = storm(koinu.replace(line=lines))
    names = list(found.lines.names)
    assert "3-4" not in names
    assert not found.case.network.breakpoint[koinu.network.line("3-4")]
    assert np.bincount(found.lines.span_line)[names.index("1-2")] == 1
    gust = found.strongest_mps[names.index("1-2")].max()
    assert found.failed_by[names.index("1-2"), -1] == pytest.approx(
        CURVES["substation"].probability(gust / 1.1), abs=1e-9
    )
    before = dict(zip(over.lines.names, over.failed_by[:, -1], strict=True))
    stronger = dict(zip(names, found.failed_by[:, -1], strict=True))
    assert stronger["2-3"] < 0.5 * before["2-3"]
    for name in set(names) - {"1-2", "2-3"}:
        assert stronger[name] == pytest.approx(before[name], abs=1e-9)


def test_conductors_are_hardened_with_their_lines(koinu: Case) -> None:
    """Of two halves as strong as one another the second is as good as another pole per span."""
    one = storm(changed(koinu, conductor="pole"))
    twice = storm(changed(koinu, correlation=0.0, conductor="pole"))
    once = storm(changed(koinu, correlation=0.0))
    stands = 1.0 - once.failed_by[:, -1]
    poles = np.array([name != "1-2" for name in once.lines.names])  # a substation has none
    np.testing.assert_allclose(1.0 - twice.failed_by[poles, -1], stands[poles] ** 2, rtol=1e-9)
    assert (one.failed_by[:, -1] < twice.failed_by[:, -1]).all()


def test_curves_and_options_of_the_wind_are_the_cases(koinu: Case, over: Storm) -> None:
    same = CurveTable(median_mps=58.2, beta=0.195, averaging_s=3)
    own = storm(changed(koinu, curves={"mine": same}, pole="mine"))
    np.testing.assert_array_equal(own.failed_by, over.failed_by)
    still = storm(changed(koinu, asymmetry="none"))
    turned = storm(changed(koinu, inflow="hubbert1991"))
    rough = storm(changed(koinu, roughness="tchazards", inland_km=3.0))
    assert np.abs(still.winds[0].speed_mps - over.winds[0].speed_mps).max() > 1.0
    assert turned.winds[0].direction_deg is not None
    assert over.winds[0].direction_deg is not None
    assert np.abs(turned.winds[0].direction_deg - over.winds[0].direction_deg).max() > 10.0
    ratio = (0.66 + 0.34 * np.exp(-3.0 / 0.4)) / 0.8
    np.testing.assert_allclose(rough.winds[0].speed_mps, ratio * over.winds[0].speed_mps)


def test_the_line_with_priority_is_mended_first(koinu: Case) -> None:
    assert koinu.storm is not None
    asked = {"crews": 1, "priority": {"12-13": 1.0}}
    plain, first = (
        storm(changed(koinu, repair=koinu.storm.repair.model_copy(update=keys))).scenarios(300, 0)
        for keys in ({"crews": 1}, asked)
    )
    at = plain.lines.index("12-13")
    assert first.down[at].sum() < 0.95 * plain.down[at].sum()
    others = np.arange(len(plain.lines)) != at
    assert first.down[others].sum() > plain.down[others].sum()
    np.testing.assert_array_equal(first.down.any(axis=1), plain.down.any(axis=1))


def test_stronger_poles_fail_less(koinu: Case, over: Storm) -> None:
    strong = storm(changed(koinu, hardening=2.0))
    poles = np.array([name != "1-2" for name in over.lines.names])
    assert (strong.failed_by[poles, -1] < over.failed_by[poles, -1]).all()
    np.testing.assert_array_equal(strong.failed_by[~poles], over.failed_by[~poles])


def test_a_forecast_spreads_the_risk(koinu: Case) -> None:
    """Of members, the hazard is the mean; each has its own wind."""
    assert koinu.storm is not None
    errors = koinu.storm.forecast.model_copy(
        update={"members": 3, "issued": datetime(2023, 10, 4, 12), "cross_km_per_day": 60.0}
    )
    found = storm(changed(koinu, forecast=errors))
    assert len(found.winds) == 3
    assert np.abs(found.winds[0].speed_mps - found.winds[1].speed_mps).max() > 1.0
    one = [failed_by(found.lines, wind, found.timing) for wind in found.winds]
    np.testing.assert_allclose(found.failed_by, np.mean(one, axis=0), atol=1e-12)


def test_breakpoints_only_are_four_lines(koinu: Case) -> None:
    few = storm_scenarios(changed(koinu, lines="breakpoints"), 5, 0)
    assert few.lines == ("1-2", "2-19", "3-23", "6-26")


@pytest.mark.parametrize("by_angle", [False, True])
def test_nothing_is_mended_in_the_wind(koinu: Case, by_angle: bool) -> None:
    """No outage ends in a slot whose wind at the line is above the limit, nor right after one,
    whatever direction the wind has that breaks it."""
    over = storm(replace(changed(koinu, by_angle=by_angle), step_min=60.0, slots=48))
    drawn = over.scenarios(200, 5)
    assert drawn.down.any()
    calm = over.calm(over.winds[0])
    for _, line, _, stop in drawn.events():
        if stop < drawn.slots:
            assert calm[drawn.lines.index(line), stop - 1]


@pytest.mark.parametrize("name", CASES)
def test_the_storm_of_a_case_is_dated_and_its_source_is_named(name: str) -> None:
    case = rs.load_case(name)
    track = chain.case_track(case)
    assert case.storm is not None
    assert case.storm.source
    assert len(track.time) >= 12
    assert track.averaging_s == 120.0
    assert set(track.filled) == {"penv_hpa", "rmw_km"}
    found = storm(case)
    assert found.geography.synthetic
    assert 3.0 < found.failed_by[:, -1].sum() < 6.0
    assert len(found.lines.names) == 32


def test_the_outages_of_a_case_are_a_draw_of_its_storm() -> None:
    for name in CASES:
        case = rs.load_case(name)
        assert case.outages == outages_from("storm", case, 9)


def test_islands_of_a_storm_known_by_hand() -> None:
    """Line 6-26 is out for 8 slots in the first of two storms, 6-26 and 2-19 in the second, half as
    likely each."""
    case = rs.load_case("ieee33")
    down = np.zeros((2, case.slots, 2), bool)
    down[0, 10:18] = True
    down[1, 12:16, 1] = True
    found = likely(case, Scenarios(("6-26", "2-19"), down, np.array([0.5, 0.5])))
    behind = {one.buses: one for one in found.islands}
    lateral = behind[tuple(str(k) for k in range(26, 34))]
    assert (lateral.probability, lateral.hours, lateral.alive) == (1.0, 2.0, True)
    other = behind[("19", "20", "21", "22")]
    assert (other.probability, other.hours) == (0.5, 1.0)
    assert len(behind) == 2
    assert {one.lines for one in found.islandings} == {("6-26",), ("2-19", "6-26")}
    assert found.apart[case.network.bus("30")] == 1.0
    assert found.apart[case.network.bus("20")] == 0.5
    assert not found.dark.any()


def test_buses_are_named_in_spans() -> None:
    assert buses_text(["3", "1", "2", "7", "north"]) == "1-3, 7, north"
