"""Belief in units that fail: against what the sampler draws after the same history."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case, load_case
from resilience.fragility.beliefs.belief import Belief, case_belief
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.unit_belief import UnitBelief
from resilience.fragility.draw import draw
from resilience.fragility.outages.scenarios import Scenarios
from resilience.testing import small_case
from tests.histories import history

N, AHEAD = 30_000, 8
PEAK = 40
BELL = {"centres": (PEAK,), "sigma_slots": 8.0, "probability": 0.7, "duration_slots": (8, 24)}


def failing() -> Case:
    """A day of hours; a diesel set and a store behind one line of a bell."""
    case = small_case(
        slots=24,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.2}],
        generator=[
            {"bus": "2", "p_max_mw": 2.0, "start_failure": 0.3, "mttf_h": 8.0, "mttr_h": 5.0,
             "availability": 0.8}
        ],
        ess=[
            {"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0, "mttf_h": 10.0, "mttr_h": 4.0,
             "availability": 0.7}
        ],
    )  # fmt: skip
    return case.replace(outage=BELL)


@pytest.fixture(scope="module")
def drawn() -> Scenarios:
    return draw(failing(), N, 11)


def believed(case: Case, lines: tuple[str, ...]) -> Belief:
    belief = case_belief(case, lines, seed=3)
    assert isinstance(belief, UnitBelief)
    return belief


def seen(drawn: Scenarios, k: int, t: int) -> LineHistory:
    return history(drawn.down[:, :, k], t, centre=PEAK)


@pytest.mark.parametrize("t", [3, 9, 10, 12])
@pytest.mark.parametrize("status", [(0, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0), (1, 1, 1)])
def test_belief_is_what_the_sampler_draws_after_the_same_history(
    drawn: Scenarios, t: int, status: tuple[int, ...]
) -> None:
    """Given all of the line so far, and the units now, whose past tells nothing more."""
    now = (drawn.down[:, t] == np.array(status, bool)[:, None]).all(axis=0)
    since = t - 1 if status[0] else t + 1  # a line that is down has been so for two slots
    line = (np.arange(t + 1) >= since)[:, None]
    same = np.flatnonzero(now & (drawn.down[0, : t + 1] == line).all(axis=0))
    if len(same) < 100:
        assert status[0]  # before the bell, no line fails
        assert t == 3
        return
    futures = drawn.down[:, t + 1 : t + 1 + AHEAD][:, :, same]
    paths = believed(failing(), drawn.lines).paths(seen(drawn, int(same[0]), t), AHEAD, 4000)
    share, expected = paths.mean(axis=2), futures.mean(axis=2)
    sigma = np.sqrt(expected * (1.0 - expected) * (1.0 / len(same) + 1.0 / 4000)) + 1e-3
    assert (np.abs(share - expected) < 4.0 * sigma).all()


def test_chances_are_shares_of_futures_in_which_an_outage_begins(drawn: Scenarios) -> None:
    quiet = np.flatnonzero(~drawn.down[:, :10].any(axis=(0, 1)))
    begins = drawn.down[:, 10:18, quiet] & ~drawn.down[:, 9:17, quiet]
    chances = believed(failing(), drawn.lines).chances(seen(drawn, int(quiet[0]), 9), AHEAD)
    assert chances.shape == (3, AHEAD)
    # A hundred paths: each chance to within three of its standard errors, and all to within less.
    assert np.abs(chances - begins.mean(axis=2)).max() < 0.15
    np.testing.assert_allclose(chances.sum(1), begins.mean(axis=2).sum(1), atol=0.15)


def test_what_is_out_is_back_after_the_mean_of_what_is_left() -> None:
    """Slots of 1 h, repaired in the next with 1 - exp(-1/5): 4.5 more on average, rounded up."""
    case = failing()
    down = np.zeros((3, 24), bool)
    down[1:, 5:] = True
    belief = believed(case, ("1-2", "generator1", "ess1"))
    left = belief.expected_left(history(down, 8, centre=PEAK))
    expected = [1.0 / np.expm1(1.0 / hours) for hours in (5.0, 4.0)]
    assert left.tolist() == [0, *np.ceil(expected).astype(int).tolist()]
    forever = case.with_ess("ess1", mttr_h=None)
    left = believed(forever, ("1-2", "generator1", "ess1")).expected_left(history(down, 8))
    assert left[2] == case.slots


def test_the_same_futures_in_every_slot_and_others_in_every_episode() -> None:
    case, names = failing(), ("1-2", "generator1", "ess1")
    quiet = LineHistory.quiet(3, 4, PEAK)
    first, again = (believed(case, names).paths(quiet, 10, 50) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    other = LineHistory(4, PEAK, quiet.age, quiet.down, quiet.carried, number=1)
    assert (believed(case, names).paths(other, 10, 50) != first).any()


def test_units_that_say_nothing_stay_as_they_are() -> None:
    case = failing().replace(outages="grid1@00:00-01:00")
    belief = believed(case, ("1-2", "grid1"))
    paths = belief.paths(LineHistory.quiet(2, 20, PEAK), 3, 20)
    assert not paths[1].any()


def test_dispatchers_plan_with_units_and_see_no_future() -> None:
    case = failing()
    report = rs.compare(
        case, ["rule", "mpc", "stochastic"], days=1, draws=3, seed=1, causality=True
    )
    assert set(report.trajectories) >= {"mpc", "stochastic", "clairvoyant"}
    bound = report.trajectories["clairvoyant"].objective(case.terminal_value_per_mwh)
    for name, run in report.trajectories.items():
        assert (run.objective(case.terminal_value_per_mwh) >= bound - 1e-6).all(), name


@pytest.mark.parametrize("name", ["ieee33", "ieee33_rammasun", "ieee33-fuel"])
def test_lines_are_believed_as_they_are_without_units(name: str) -> None:
    """Of the bell, a storm on its track, and a blackout alike."""
    case = load_case(name)
    fails = [unit.model_copy(update={"mttf_h": 20.0, "mttr_h": 5.0}) for unit in case.ess]
    case = case.replace(ess=fails)
    lines = draw(load_case(name), 1, 0).lines
    names = (*lines, *(unit.name for unit in fails))
    both, alone = believed(case, names), case_belief(case, lines, seed=3)
    assert (both.daily, both.overnight) == (alone.daily, alone.overnight)
    assert both.longest_slots == alone.longest_slots
    t = min(20, case.slots // 4)
    of_both, of_lines = LineHistory.quiet(len(names), t), LineHistory.quiet(len(lines), t)
    paths = both.paths(of_both, 12, 400)
    np.testing.assert_array_equal(paths[: len(lines)], alone.paths(of_lines, 12, 400))
    chances = both.chances(of_both, 12)
    np.testing.assert_array_equal(chances[: len(lines)], alone.chances(of_lines, 12))
    stays = np.exp(-case.step_h / 20.0)
    assert paths[len(lines) :, 0].mean() == pytest.approx(1.0 - stays, abs=1.0 / 400)


def test_a_lost_grid_that_goes_on_asks_for_no_start() -> None:
    """Sets age in a blackout under way, they are not called on again."""
    case = load_case("ieee33-fuel")
    fails = [unit.model_copy(update={"start_failure": 0.9}) for unit in case.generator]
    case = case.replace(generator=fails)
    lines = draw(load_case("ieee33-fuel"), 1, 0).lines
    names, first = (*lines, *(unit.name for unit in fails)), 5
    down = np.zeros((len(names), case.slots), bool)
    begins = int(draw(case, 1, 0).down[0, :, 0].argmax())
    down[: len(lines), begins:] = True
    belief = believed(case, names)
    during = belief.paths(history(down, begins + first), 1, 200)
    assert not during[len(lines) :].any()
    if begins:
        before = belief.paths(history(down, begins - 1), 1, 200)
        assert before[len(lines) :].mean() == pytest.approx(0.9, abs=0.01)
