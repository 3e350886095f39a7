"""Crews: work is conserved, priorities hold, and nobody works in the wind."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.stats import kstest, lognorm, norm

from resilience.errors import UsageError
from resilience.fragility.lines.spans import calm
from resilience.fragility.outages.repair import (
    OngoingOutages,
    Repair,
    RepairOutcome,
    crew_since,
    repair_outcome,
)
from tests.unit.fragility.spans import gusts, poles

SLOTS = 400
RNG = np.random.default_rng(5)
FIRST = RNG.integers(0, 60, (8, 300))
FIRST[RNG.random(FIRST.shape) < 0.3] = SLOTS
LENGTH = RNG.integers(1, 12, FIRST.shape)
CALM = np.ones((8, SLOTS), bool)
CALM[:, 20:50] = False
CALM[3:, 70:75] = False
FAILS = FIRST < SLOTS


def run(
    crews: int | None, calm: np.ndarray = CALM, order: np.ndarray | None = None
) -> RepairOutcome:
    return repair_outcome(
        FIRST,
        lambda line, scenario, times: LENGTH[line, scenario],
        lambda t: calm[:, t, None],
        SLOTS,
        crews=crews,
        order=order,
    )


@pytest.mark.parametrize("crews", [None, 1, 2, 5])
def test_work_is_conserved(crews: int | None) -> None:
    found = run(crews)
    assert (found.work_left == 0).all()
    assert (found.work.sum(axis=0) == np.where(FAILS, LENGTH, 0).sum(axis=0)).all()
    assert crews is None or found.work.max() == crews
    assert (found.down.sum(axis=1) >= np.where(FAILS, LENGTH, 0)).all()


@pytest.mark.parametrize("crews", [None, 2])
def test_no_repair_in_the_wind(crews: int | None) -> None:
    found = run(crews)
    assert not found.work[20:50].any()
    in_wind = found.down[:, 20:50]
    assert (np.diff(in_wind.astype(int), axis=1) >= 0).all()
    calm_work = (found.down & CALM[:, :, None]).sum(axis=1)
    if crews is None:
        assert (calm_work == np.where(FAILS, LENGTH, 0)).all()


def test_without_wind_and_queue_an_outage_is_its_work() -> None:
    found = run(None, np.ones_like(CALM))
    slot = np.arange(SLOTS)[:, None]
    inside = (slot >= FIRST[:, None]) & (slot < (FIRST + LENGTH)[:, None]) & FAILS[:, None]
    assert (found.down == inside).all()
    assert (run(8, np.ones_like(CALM)).down == found.down).all()


@pytest.mark.parametrize(("crews", "ranked"), [(1, True), (1, False), (3, True)])
def test_the_queue_of_an_event_simulation(crews: int, ranked: bool) -> None:
    """One scenario at a time, crew by crew, as a list of people would be told."""
    order = np.array([2, 0, 1, 1, 0, 3, 0, 2]) if ranked else np.zeros(8, int)
    found = run(crews, order=order)
    for k in range(40):
        waiting: list[tuple[int, int, int]] = []
        at_work: dict[int, int] = {}
        for t in range(150):
            waiting += [(int(order[i]), t, int(i)) for i in np.flatnonzero(FIRST[:, k] == t)]
            for one in sorted(waiting):
                if len(at_work) < crews and CALM[one[2], t]:
                    at_work[one[2]] = int(LENGTH[one[2], k])
                    waiting.remove(one)
            down = {one[2] for one in waiting} | set(at_work)
            assert set(np.flatnonzero(found.down[:, t, k])) == down
            at_work = {i: left - bool(CALM[i, t]) for i, left in at_work.items()}
            at_work = {i: left for i, left in at_work.items() if left}


@pytest.mark.parametrize("until", [15, 30, 55, 72, 100])
@pytest.mark.parametrize(("crews", "ranked"), [(1, True), (2, False), (3, True)])
def test_who_saw_the_outages_knows_the_queue(crews: int, ranked: bool, until: int) -> None:
    """From the queue that outages tell of, and the work that is left, all goes on as it did."""
    order = np.array([2, 0, 1, 1, 0, 3, 0, 2]) if ranked else np.zeros(8, int)
    whole = run(crews, order=order)
    for k in range(40):
        past, length, first = whole.down[:, :until, k], LENGTH[:, k], FIRST[:, k]
        came = crew_since(past, CALM[:, :until], crews, order)
        assert (came >= 0).sum() <= crews
        worked = CALM[:, :until] & (np.arange(until) >= came[:, None])
        left = np.where(came >= 0, length - worked.sum(axis=1), length)
        is_down = past[:, -1]
        begun = OngoingOutages(
            np.where(is_down, left, 0)[:, None],
            np.where(is_down, first - until, 0),
            is_down & (came < 0),
        )
        rest = repair_outcome(
            np.where(first >= until, first - until, SLOTS)[:, None],
            partial(lambda length, line, scenario, times: length[line], length),
            lambda t: CALM[:, until + t, None],
            SLOTS - until,
            crews=crews,
            order=order,
            ongoing=begun,
        )
        assert (rest.down[:, :, 0] == whole.down[:, until:, k]).all()


def test_no_crew_is_at_a_line_that_is_back() -> None:
    # One crew: at line 0 from slot 2, then at line 2 from slot 6, while line 1 waits until slot 9.
    down = np.zeros((3, 12), bool)
    down[0, 2:6] = down[1, 4:] = down[2, 3:9] = True
    rank = np.array([5, 7, 6])
    since = crew_since(down, np.ones_like(down), 1, rank)
    assert since.tolist() == [-1, 9, -1]
    assert crew_since(down[:, :8], np.ones((3, 8), bool), 1, rank).tolist() == [-1, -1, 6]


def test_one_crew_goes_to_the_hospital_first() -> None:
    first = np.array([[0], [0], [1]])
    found = repair_outcome(
        first,
        lambda line, scenario, times: np.full(len(line), 4),
        lambda t: np.ones((3, 1), bool),
        20,
        crews=1,
        order=Repair(priority={"c": 2.0, "b": 1.0}).order(("a", "b", "c")),
    )
    assert found.down.sum(axis=1).ravel().tolist() == [12, 4, 7]
    assert found.work.ravel().tolist() == [1] * 12 + [0] * 8


def test_what_is_not_done_at_the_end_is_left() -> None:
    found = repair_outcome(
        np.array([[6]]),
        lambda line, scenario, times: np.full(len(line), 10),
        lambda t: np.full((1, 1), t != 7),
        10,
    )
    assert found.work_left.tolist() == [[7]]
    assert found.down[0, :, 0].tolist() == [False] * 6 + [True] * 4


def test_a_line_that_is_back_may_fail_again() -> None:
    asked: list[tuple[int, int]] = []

    def again(line: np.ndarray, scenario: np.ndarray, times: np.ndarray, start: int) -> np.ndarray:
        asked.append((start, int(times[0])))
        return np.full(len(line), start + 1)

    found = repair_outcome(
        np.array([[2]]),
        lambda line, scenario, times: 2 + times,
        lambda t: np.ones((1, 1), bool),
        12,
        again=again,
    )
    assert asked == [(4, 1), (8, 2)]
    assert np.flatnonzero(found.down[0, :, 0]).tolist() == [2, 3, 5, 6, 7, 9, 10, 11]


@pytest.mark.parametrize(("slots", "asked_for"), [(4, []), (5, [4]), (6, [4])])
def test_a_line_that_is_back_in_the_last_slot_fails_no_more(
    slots: int, asked_for: list[int]
) -> None:
    """Down in slots 2 and 3; new in slot 4, if there is one, and down again in it."""
    asked: list[int] = []

    def again(line: np.ndarray, scenario: np.ndarray, times: np.ndarray, start: int) -> np.ndarray:
        asked.append(start)
        return np.full(len(line), start)

    found = repair_outcome(
        np.array([[2]]),
        lambda line, scenario, times: np.full(len(line), 2),
        lambda t: np.ones((1, 1), bool),
        slots,
        again=again,
    )
    assert asked == asked_for
    assert found.down[0, :, 0].tolist() == [t >= 2 for t in range(slots)]


def test_nobody_works_above_20_metres_per_second_unless_told() -> None:
    """Two spans of one line, the windier of which counts; the other line is calmer."""
    lines = poles([2, 1])
    wind = gusts([[12.0, 20.0, 19.9, 3.0], [19.9, 7.0, 20.1, 2.0], [20.1, 8.0, 6.0, 25.0]])
    found = calm(lines, wind, Repair().wind_limit_mps)
    assert found.tolist() == [[True, True, False, True], [False, True, True, False]]
    assert "none above 20 m/s" in str(Repair())


U = np.random.default_rng(6).random(4000)


@pytest.mark.parametrize(
    ("law", "hours", "oracle"),
    [
        ("uniform", (3.0, 8.0), lambda x: np.clip((x - 3.0) / 5.0, 0.0, 1.0)),
        ("lognormal", (6.0, 0.5), lognorm(s=0.5, scale=6.0).cdf),
        ("exponential", (5.0,), lambda x: 1.0 - np.exp(-x / 5.0)),
    ],
)
def test_laws(law: str, hours: tuple[float, ...], oracle: object) -> None:
    slots = Repair(law, hours).work_slots(U, 1e-4)
    assert kstest(slots * 1e-4, oracle).pvalue > 1e-3


def test_whole_slots_and_at_least_one() -> None:
    u = np.array([0.1, 0.9])
    assert Repair("fixed", (3.0,)).work_slots(u, 0.25).tolist() == [12, 12]
    assert Repair("fixed", (3.1,)).work_slots(u, 0.25).tolist() == [13, 13]
    assert Repair("fixed", (0.0,)).work_slots(u, 0.25).tolist() == [1, 1]
    spread = Repair("lognormal", (6.0, 0.5)).work_slots(norm.cdf([-1.0, 0.0, 1.0]), 0.25)
    assert spread.tolist() == [15, 24, 40]


def test_no_repair() -> None:
    with pytest.raises(UsageError, match="law 'normal'; allowed: fixed"):
        Repair("normal")
    with pytest.raises(UsageError, match=r"shortest, longest.*0 crews.*wind limit -1"):
        Repair("uniform", (3.0,), crews=0, wind_limit_mps=-1.0)
    with pytest.raises(UsageError, match="shortest, then longest"):
        Repair("uniform", (4.0, 3.0))
    with pytest.raises(UsageError, match="line z; allowed: a, b"):
        Repair(priority={"z": 1.0}).order(("a", "b"))
