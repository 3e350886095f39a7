"""Belief in a bell: futures against closed forms, and against days that the sampler draws."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest

from resilience.arrays import Bools, Floats
from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.bell_day import told_peaks
from resilience.fragility.beliefs.bell_paths import days_reached, lengths_left
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.beliefs.strata import strata
from resilience.fragility.draw import draw_day, outage_paths
from resilience.fragility.outages.bell import Bell
from tests.histories import history

DAY = 96
BY_DAY = Bell(overnight=False)


def known(t: int, centre: int, since: int = -1, back: int | None = None) -> LineHistory:
    """One line, down since a slot until it was back, or until now; up if it never failed."""
    down = np.zeros((1, DAY), bool)
    if since >= 0:
        down[0, since:back] = True
    return history(down, t, centre=centre)


def belief(bell: Bell, lines: int = 1, seed: int = 1) -> BellBelief:
    return BellBelief(bell, DAY, lines, seed)


def test_strata_hit_every_part_of_the_unit_interval_once() -> None:
    u = strata(50, np.random.default_rng(0))
    assert sorted((u * 50).astype(int)) == list(range(50))


@pytest.mark.parametrize(("t", "centre"), [(0, 48), (45, 48), (50, 48)])
def test_an_outage_yet_to_come_is_as_likely_as_the_bell_says(t: int, centre: int) -> None:
    """Given that it has not failed by t: 1 - prod of (1 - p) over the slots after t."""
    bell = Bell()
    n = 400
    down = belief(bell).paths(known(t, centre), DAY - t - 1, n)
    chance = bell.slot_probability(np.array([centre]))[0, t + 1 :]
    expected = 1.0 - np.prod(1.0 - chance)
    assert down[0].any(0).mean() == pytest.approx(expected, abs=1.0 / n)


def test_a_line_that_failed_today_does_not_fail_again() -> None:
    seen = known(40, 48, 25, 38)
    assert not belief(Bell()).paths(seen, 50, 100).any()
    assert belief(Bell(refail=True)).paths(seen, 50, 100).any()


def test_an_outage_under_way_lasts_as_long_as_its_age_allows() -> None:
    """After 13 slots (0 to 12) of 12 .. 15: at most two more are left, 0, 1 and 2 alike likely."""
    down = belief(Bell()).paths(known(52, 48, since=40), 20, 300)
    left = down[0].sum(0)
    assert np.bincount(left).tolist() == [100, 100, 100]
    assert not np.diff(down[0].astype(int), axis=0).max() > 0


def test_the_night_ends_an_outage_and_brings_a_new_centre() -> None:
    down = belief(BY_DAY).paths(known(94, 90, since=92), 1 + DAY, 200)
    assert down[0, 0].all()
    assert not down[0, 1].all()
    fresh = down[0, 1:].any(0).mean()
    chance = Bell().day_probability(np.arange(DAY)).mean()
    assert fresh == pytest.approx(chance, abs=0.03)


@pytest.mark.parametrize(
    ("t", "slots", "days_touched"),
    [(80, 15, 1), (80, 16, 2), (80, 48, 2), (95, 1, 2), (30, 161, 2), (30, 162, 3)],
)
def test_a_look_ahead_touches_the_days_that_it_reaches(
    t: int, slots: int, days_touched: int
) -> None:
    """Its last slot is t + slots: 95 is today's last, 96 tomorrow's first."""
    assert days_reached(t, slots, DAY) == days_touched


def test_in_the_evening_tomorrow_is_seen() -> None:
    """From slot 80, 48 slots ahead: 15 of today, in which a line that failed stands, then 33."""
    n = 500
    here = known(80, 60, 60, 74)
    down = belief(Bell()).paths(here, 48, n)[0]
    assert not down[:15].any()
    tomorrow = Bell().slot_probability(np.arange(DAY))[:, :33]
    failed = 1.0 - np.prod(1.0 - tomorrow, axis=1).mean()
    assert down.any(0).mean() == pytest.approx(failed, abs=4 * np.sqrt(0.25 / n))
    begins = belief(Bell()).chances(here, 48)[0]
    assert (begins[:15] == 0.0).all()
    assert begins.sum() == pytest.approx(failed, abs=1e-9)
    first = tomorrow[:, 7] * np.prod(1.0 - tomorrow[:, :7], axis=1)
    assert begins[15 + 7] == pytest.approx(first.mean(), abs=1e-12)


def test_midnight_ends_an_outage_that_is_yet_to_come() -> None:
    """It begins about slot 94 and would last 12 slots or more; tomorrow's begin about slot 60."""
    bell = Bell(height=0.9, centres=(60,), overnight=False)
    down = belief(bell).paths(known(85, 94), 10 + 30, 100)[0]
    assert down[:10].any(0).mean() > 0.8
    assert down[9].mean() > 0.5
    assert not down[10:].any()


@pytest.mark.parametrize("centre", [0, 3, 95])
def test_a_centre_is_known_at_either_end_of_the_day(centre: int) -> None:
    """Slot 0 is a slot like all others, and not the sign of a centre that is not known."""
    bell, n, t = Bell(), 400, 1
    here = known(t, centre)
    chance = bell.slot_probability(np.array([centre]))[0, t + 1 :]
    failed = 1.0 - np.prod(1.0 - chance)
    down = belief(bell).paths(here, DAY - t - 1, n)[0]
    assert down.any(0).mean() == pytest.approx(failed, abs=1.0 / n)
    begins = belief(bell).chances(here, DAY - t - 1)[0]
    np.testing.assert_allclose(begins[:3], chance[:3] * np.cumprod([1.0, *(1.0 - chance[:2])]))


@pytest.mark.parametrize("shared", [True, False])
def test_lines_are_shifted_together_or_each_by_itself(shared: bool) -> None:
    """A bell of one slot: the first line fails at the centre, the others 2 slots around it."""
    bell = Bell(height=0.999, sigma_slots=0.2, shift_slots=2, shared_shift=shared)
    down = belief(bell, 3).paths(LineHistory.quiet(3, 20, 40), 60, 200)
    first = down.argmax(1)[:, down.any(1).all(0)] + 21
    assert first.shape[1] > 190
    assert (first[0] == 40).all()
    assert set(first[1]) == set(first[2]) == {38, 39, 40, 41, 42}
    assert (first[1] == first[2]).all() == shared
    if not shared:
        assert (first[1] == first[2]).mean() == pytest.approx(0.2, abs=0.12)


@pytest.mark.parametrize("centre", [48, -1])
@pytest.mark.parametrize("line", [0, 1])
def test_chances_are_the_frequencies_of_sampled_futures(centre: int, line: int) -> None:
    """Of a line that follows the centre, and of one that is shifted against it."""
    bell, n, slots = Bell(), 20_000, 120
    up = LineHistory.quiet(2, 30, centre)
    down = belief(bell, 2).paths(up, slots, n)[line]
    begins = down & ~np.pad(down, ((1, 0), (0, 0)))[:-1]
    chance = belief(bell, 2).chances(up, slots)[line]
    assert chance.sum() > 0.5
    np.testing.assert_allclose(begins.mean(1), chance, atol=4 * np.sqrt(0.1 * 0.9 / n))


def test_the_same_draws_move_a_failure_later_as_time_goes_by() -> None:
    """No path that is still up at noon fails earlier, seen from noon, than it did before."""
    one = belief(Bell(shift_slots=0))
    first, later = (
        np.where(down.any(0), down.argmax(0) + t + 1, DAY)
        for t in (40, 48)
        for down in [one.paths(known(t, 48), DAY - t - 1, 50)[0]]
    )
    still_up = first > 48
    assert 5 < still_up.sum() < 45
    assert (later[still_up] >= first[still_up]).all()


@pytest.mark.parametrize("overnight", [True, False])
def test_what_is_expected_to_be_left_ends_at_midnight_or_not(overnight: bool) -> None:
    """Since slots 83 and 70: 13 slots of 11 to 14, and 1 of 0 and 1; slot 95 is the last."""
    for t, left in ((83, 13 if overnight else 12), (80, 13)):
        down = np.zeros((3, DAY), bool)
        down[0, t:], down[2, t - 13 :] = True, True
        found = belief(Bell(overnight=overnight), 3).expected_left(history(down, t, centre=60))
        assert found.tolist() == [left, 0, 1]


def test_what_is_left_of_an_outage() -> None:
    assert lengths_left(Bell(), 0, DAY).tolist() == [11, 12, 13, 14]
    assert lengths_left(Bell(), 13, DAY).tolist() == [0, 1]
    assert lengths_left(Bell(), 40, DAY).tolist() == [0]
    # Of an hour each: 12 quarters are 3 hours, and 13, 14 and 15 are 4.
    assert lengths_left(Bell(), 0, 24).tolist() == [2, 3, 3, 3]


def test_an_outage_runs_on_past_midnight() -> None:
    """Down since 22:00 for 3 to 3.75 h, and still down at 00:15 for certain."""
    down = np.zeros((1, 2 * DAY), bool)
    down[0, 88:] = True
    one = belief(Bell(height=0.0))
    evening = one.paths(history(down, 90, centre=60), 20, 100)[0]
    assert evening[:9].all()
    assert evening.sum(axis=0).max() == 12
    night = history(down, 1, start=DAY, day=1)
    assert night.age.tolist() == [9]
    assert night.carried.tolist() == [True]
    assert not night.spent.any()
    left = one.paths(night, 20, 100)[0].sum(axis=0)
    assert np.bincount(left).tolist() == [0, 0, 25, 25, 25, 25]


def test_silence_tells_of_the_peak() -> None:
    """By hand, two peaks and hourly slots without shifts: what has not failed has not peaked."""
    bell = Bell(height=0.9, sigma_slots=2.0, shift_slots=0, centres=(20, 60))
    hourly, seen = BellBelief(bell, 24, 1), LineHistory.quiet(1, 10)
    stands = np.prod(1.0 - bell.slot_probability([20, 60], 60.0)[:, :11], axis=1)
    today = hourly.days.today(seen)
    assert today.weight == pytest.approx(stands / stands.sum(), abs=1e-14)
    fails = 1.0 - np.prod(1.0 - bell.slot_probability([20, 60], 60.0)[:, 11:], axis=1)
    expected = float(fails @ stands / stands.sum())
    assert hourly.chances(seen, 13).sum() == pytest.approx(expected, abs=1e-12)
    assert expected > 1.5 * fails.mean()  # what one believes who has seen nothing
    assert hourly.paths(seen, 13, 1000)[0].any(axis=0).mean() == pytest.approx(expected, abs=0.01)


def test_what_the_bell_cannot_do_leaves_the_belief_as_it_was() -> None:
    bell = Bell(height=0.5, sigma_slots=0.5, centres=(60,), shift_slots=0)
    today = belief(bell).days.today(known(12, -1, since=0))
    assert today.weight.tolist() == [1.0]
    assert belief(bell).paths(known(12, -1, since=0, back=12), 80, 50).sum() == 0


def test_a_peak_is_told_with_an_error_that_the_day_cuts_off() -> None:
    """By counting what the sampler tells."""
    bell = Bell(centre_error_slots=3, centres=(1, 2, 4, 40))
    counts: dict[int, list[int]] = defaultdict(list)
    for centre in bell.centres:
        for error in range(-3, 4):
            counts[max(centre + error, 0)].append(centre)
    for told, centres in counts.items():
        peaks, weight = told_peaks(bell, told)
        assert dict(zip(peaks.tolist(), weight.tolist(), strict=True)) == pytest.approx(
            {c: centres.count(c) / len(centres) for c in centres}
        )
    assert told_peaks(bell, 70)[0].tolist() == [70]
    assert told_peaks(Bell(), -1)[1] == pytest.approx(np.full(DAY, 1 / DAY))


WIDE = {
    "height": 0.35, "sigma_slots": 6.0, "duration_slots": (12, 20), "shift_slots": 4,
    "centres": (30, 50, 80), "overnight": True,
}  # fmt: skip
OPTIONS = [
    {},
    {"overnight": False},
    {"shared_shift": True},
    {"common_draw": True},
    {"common_draw": True, "shared_shift": True},
    {"centre_error_slots": 3},
    {"refail": True},
    {"refail": True, "overnight": False},
    {"refail": True, "common_draw": True},
    {"wrap": True},
    {"rate": True},
    {"duration_slots": (60, 110)},
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda x: "-".join(x) or "as is")
def test_belief_is_what_days_of_the_same_history_do(options: dict[str, object]) -> None:
    """Against the sampler: of many days, those with one history, and what became of them.

    In hourly slots, seen in the evening of the first day and in the night and noon after it.
    """
    per_day, ahead, paths = 24, 20, 1000
    lines = 3 if "shared_shift" in options or "common_draw" in options else 2
    bell = Bell(**(WIDE | options))  # type: ignore[arg-type]
    believed, rng = BellBelief(bell, per_day, lines, 1), np.random.default_rng(3)
    told_too = bell.centre_error_slots > 0
    alike: dict[object, list[Bools]] = defaultdict(list)
    seen: dict[object, LineHistory] = {}
    drawn = [draw_day(bell, lines, per_day, rng.spawn(2500)) for _ in range(2)]
    for k, down in enumerate(outage_paths(drawn, bell)):
        for day, t in ((0, 7), (0, 9), (0, 16), (1, 1)):
            told = int(drawn[day].forecast[k]) if told_too else -1
            one = history(down, t, centre=told, start=day * per_day, day=day)
            key: object = (day, t, told, *(x.tobytes() for x in (one.age, one.down, one.carried)))
            now = day * per_day + t
            alike[key].append(down[:, now : now + 1 + ahead])
            seen[key] = one
    often = [key for key, found in alike.items() if len(found) >= 40]
    assert len(often) >= 4
    assert told_too or any(seen[key].spent.any() for key in often)
    for key in often:
        happened, n = np.array(alike[key]), len(alike[key])
        after = believed.paths(seen[key], ahead, paths).transpose(2, 0, 1)
        now_down = np.repeat(happened[:1, :, :1], paths, axis=0)
        expected = np.concatenate([now_down, after], axis=2)
        facts = [(begins(happened).mean(axis=0), believed.chances(seen[key], ahead))]
        facts += list(zip(facts_of(happened), facts_of(expected), strict=True))
        for x, y in facts:
            share = (n * x + paths * y) / (n + paths)
            spread = np.maximum(share * (1.0 - share), 1.0 / n)
            error = np.sqrt(spread * (1.0 / n + 1.0 / paths))
            assert np.all(np.abs(x - y) < 4.5 * error), (seen[key], n)


def facts_of(down: Bools) -> list[Floats]:
    """Where lines are down, where all are; whether any fails, and whether all do."""
    fails = np.asarray(begins(down).any(axis=2))
    later = down[:, :, 1:]
    return [
        later.mean(axis=0),
        later.all(axis=1).mean(axis=0),
        np.asarray(fails.any(axis=1).mean()),
        np.asarray(fails.all(axis=1).mean()),
    ]


def begins(down: Bools) -> Bools:
    """(days, lines, slots - 1) where an outage begins, from the second slot on."""
    return np.asarray(down[:, :, 1:] & ~down[:, :, :-1])
