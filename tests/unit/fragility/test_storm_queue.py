"""Belief in few crews: of all storms that look the same until now, what becomes of the lines?"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Bools
from resilience.fragility.beliefs.storm_belief import StormBelief
from resilience.fragility.lines.damage import Timing
from resilience.fragility.lines.spans import SpanWind, poles_in_series
from resilience.fragility.outages.repair import Repair
from resilience.fragility.outages.storms import Sampling, sample_storms
from tests.histories import history

NAMES = ("a", "b", "c", "d")
HOURLY = Timing(step_h=1.0)


def storm(speed: np.ndarray, repair: Repair, step_h: float = 1.0) -> Any:
    """A storm over four lines of three poles each: speed (slots,) or (lines, slots)."""
    slots = speed.shape[-1]
    by_line = np.broadcast_to(speed, (len(NAMES), slots))
    lines = poles_in_series(NAMES, np.repeat(np.arange(4), 3), correlation=0.3)
    return SimpleNamespace(
        lines=lines,
        winds=[SpanWind(np.repeat(by_line, 3, axis=0), 3.0, 10.0, "land")],
        case=SimpleNamespace(slots=slots),
        timing=Timing(step_h=step_h),
        repair=repair,
        calm=lambda wind: by_line <= repair.wind_limit_mps,
    )


def drawn(of: Any, n: int, seed: int = 1) -> Bools:
    """(lines, slots, n) where lines are down; a mended line holds, as is believed."""
    return sample_storms(
        of.lines, of.winds, n, seed,
        repair=of.repair, timing=of.timing, sampling=Sampling(refail=False),
    ).down  # fmt: skip


@pytest.mark.parametrize(
    ("repair", "left"),
    [
        (Repair("fixed", (4.0,), crews=1), [0, 12, 28, 44]),
        (Repair("fixed", (4.0,), crews=2), [0, 0, 12, 12]),
        (Repair("fixed", (4.0,), crews=1, priority={"d": 1.0, "c": 1.0}), [28, 44, 0, 12]),
    ],
)
def test_lines_that_wait_for_a_crew_are_not_mended(repair: Repair, left: list[int]) -> None:
    """All lines fail in slot 0, crews work from slot 1 on: 16 slots a line, 20 of them are over."""
    of = storm(np.where(np.arange(96) < 1, 200.0, 5.0), repair, 0.25)
    down = drawn(of, 1)[:, :, 0]
    assert down[:, 0].all()
    assert down[:, 21:].sum(axis=1).tolist() == left
    assert StormBelief.from_storm(of, NAMES).expected_left(history(down[:, :21])).tolist() == left


def test_a_line_in_work_keeps_its_crew_when_one_of_higher_priority_fails() -> None:
    """Line a is in work since slot 2; c, the hospital's, fails in slot 4 and waits for it."""
    of = storm(np.full(40, 5.0), Repair("fixed", (8.0,), crews=1, priority={"c": 1.0}))
    past = np.zeros((4, 6), bool)
    past[0, 2:] = past[1, 3:] = past[2, 4:] = True
    assert StormBelief.from_storm(of, NAMES).expected_left(history(past)).tolist() == [4, 20, 12, 0]


def test_crews_are_expected_out_where_half_the_members_let_them_work() -> None:
    """The wind at d drops a slot later in every member: in 1, 2, 3, then 4 of them there is work.
    At a there is none, at c there is always; what the storm does not meet never needs any.
    """
    of = storm(np.full(9, 5.0), Repair("fixed", (4.0,), wind_limit_mps=17.0))
    of.winds, slot = of.winds * 4, np.arange(9)
    never, always = np.zeros(9, bool), np.ones(9, bool)
    calm = iter([np.stack([never, never, always, slot >= drop]) for drop in (3, 4, 5, 6)])
    of.calm = lambda wind: next(calm)
    belief = StormBelief.from_storm(of, ("d", "elsewhere", "c"))
    assert belief.calm.tolist() == [(slot >= 4).tolist(), always.tolist(), always.tolist()]


WINDY = np.array([40.0, 52.0, 58.0, 61.0, 30.0, 15.0, 15.0, 30.0] + [10.0] * 24)
UNEVEN = np.stack([WINDY, np.roll(WINDY, 1), WINDY + 2.0, np.minimum(WINDY, 53.0)])
REPAIRS = (
    Repair("uniform", (0.5, 3.5), crews=1),
    Repair("uniform", (0.5, 3.5), crews=2, priority={"c": 2.0, "d": 1.0}),
    Repair("exponential", (2.0,), crews=1, priority={"b": 1.0}),
    Repair("lognormal", (3.0, 0.5), crews=3),
    Repair("uniform", (0.5, 3.5)),
)


@pytest.mark.parametrize("repair", REPAIRS, ids=lambda r: f"{r.law}-{r.crews}-{len(r.priority)}")
def test_outages_go_on_as_in_all_storms_that_look_the_same(repair: Repair) -> None:
    """Rejection: of many storms, those whose lines were down in the same slots until now."""
    of = storm(UNEVEN, repair)
    down, n = drawn(of, 100_000), 4000
    found = StormBelief.from_storm(of, NAMES)
    checked = 0
    for t in (4, 6, 9, 12):
        past = np.packbits(down[:, : t + 1].reshape(-1, down.shape[2]), axis=0)
        _, which, count = np.unique(past, axis=1, return_inverse=True, return_counts=True)
        for k in np.argsort(-count)[:12].tolist():
            alike = down[:, :, which.ravel() == k]
            if alike[:, t, 0].sum() < 2 or count[k] < 800:
                continue
            later = alike[:, t + 1 :]
            paths = found.paths(history(alike[:, : t + 1, 0]), later.shape[1], n)
            often, believed = later.mean(axis=2), paths.mean(axis=2)
            both = (often * count[k] + believed * n) / (count[k] + n)
            error = np.sqrt(np.maximum(both * (1 - both), 2e-3) * (1 / count[k] + 1 / n))
            assert (np.abs(often - believed) < 4.5 * error).all(), (t, alike[:, : t + 1, 0])
            checked += 1
    assert checked >= 15
