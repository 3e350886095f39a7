"""A blackout of unknown length: its law, its draws, and what is believed of it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import resilience as rs
from resilience.case import Case, case_text
from resilience.case.schema import StormTable
from resilience.errors import CaseError, UsageError
from resilience.fragility.beliefs.belief import case_belief
from resilience.fragility.beliefs.blackout_belief import BlackoutBelief
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.draw import draw, outages_from, sample_case
from resilience.fragility.outages.blackout import CUMULATIVE, Blackout, case_blackout
from resilience.fragility.outages.repair import LAWS
from resilience.testing import small_case
from tests.histories import history

SLOTS = 48
FROZEN = {
    ("fixed", (5.0,)): None,
    ("uniform", (2.0, 9.0)): stats.uniform(2.0, 7.0),
    ("lognormal", (6.0, 0.8)): stats.lognorm(0.8, scale=6.0),
    ("exponential", (4.0,)): stats.expon(scale=4.0),
}
"""Laws with scipy's own; of a fixed length there is none."""


def dark(**blackout: object) -> Case:
    """A feeder of 48 half hours whose main line is lost, and one line more that never is."""
    case = small_case(
        slots=SLOTS,
        step_min=30,
        buses=3,
        lines=[(1, 2, 0.001, 0.001), (2, 3, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 10.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 0.3}],
    )
    return case.replace(blackout=blackout)


def late() -> Blackout:
    """A blackout from slot 7 on."""
    start = dark().window.time(7)
    return case_blackout(dark(lines=["1-2"], start=start, hours=[6.0, 0.8], longest_h=14.0))


@pytest.mark.parametrize(("law", "hours"), FROZEN)
def test_lengths_have_the_probabilities_of_the_law(law: str, hours: tuple[float, ...]) -> None:
    """Against scipy's distributions; all that runs on beyond the horizon is in the last length."""
    chance = case_blackout(dark(law=law, hours=list(hours))).chance
    frozen, ends = FROZEN[law, hours], 0.5 * np.arange(1, SLOTS + 1)
    at_most = (ends >= hours[0]).astype(float) if frozen is None else frozen.cdf(ends)
    assert np.cumsum(chance)[:-1] == pytest.approx(at_most[:-1], abs=1e-9)
    assert chance.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("law", "hours"), FROZEN)
def test_laws_of_blackouts_and_repairs_are_the_same(law: str, hours: tuple[float, ...]) -> None:
    u = np.linspace(0.01, 0.99, 99)
    x = np.asarray(LAWS[law](u, *hours), float)
    back = CUMULATIVE[law](x + 1e-9, *hours)
    assert back == pytest.approx(np.ones(99) if law == "fixed" else u, abs=1e-6)


def test_what_the_law_puts_beyond_the_longest_ends_then() -> None:
    cut = case_blackout(dark(hours=[6.0, 0.8], longest_h=10.0)).chance
    plain = case_blackout(dark(hours=[6.0, 0.8])).chance
    assert cut[:19] == pytest.approx(plain[:19])
    assert cut[19] == pytest.approx(stats.lognorm(0.8, scale=6.0).sf(9.5))
    assert not cut[20:].any()


def test_draws_have_the_frequencies_and_more_of_them_begin_alike() -> None:
    blackout, n = late(), 20_000
    storms = blackout.sample(n, seed=3)
    assert storms.lines == ("1-2",)
    assert not storms.down[0, :7].any()
    assert storms.down[0, 7].all()
    lengths = storms.down[0].sum(axis=0)
    counts = np.bincount(lengths, minlength=len(blackout.chance) + 1)[1:]
    likely = blackout.chance > 5.0 / n
    spread = np.sqrt(blackout.chance[likely] * n)
    assert np.abs(counts[likely] - n * blackout.chance[likely]).max() < 5.0 * spread.max()
    assert (
        stats.chisquare(
            counts[likely],
            n
            * blackout.chance[likely]
            * counts[likely].sum()
            / (n * blackout.chance[likely].sum()),
        ).pvalue
        > 1e-4
    )
    assert np.array_equal(blackout.sample(5, seed=3).down, storms.down[:, :, :5])


def test_every_end_is_the_law_itself() -> None:
    blackout = late()
    every = blackout.every_end()
    lengths = every.down[0].sum(axis=0)
    assert every.probability == pytest.approx(blackout.chance[lengths - 1])
    assert len(set(lengths.tolist())) == every.n == np.count_nonzero(blackout.chance)


@pytest.mark.parametrize("t", [-1, 3, 6, 7, 15, 27, 33])
def test_the_belief_is_that_of_draws_with_the_same_history(t: int) -> None:
    """Of 40,000 draws, those that are still down now: how long the others' lines stay down."""
    blackout, n = late(), 4_000
    storms = blackout.sample(40_000, seed=1)
    alike = storms.down[0, t] if t >= 7 else np.ones(storms.n, bool)
    ahead = storms.down[0][t + 1 :, alike].mean(axis=1)
    seen = history(storms.down[:, :, np.flatnonzero(alike)[0]], t)
    belief = BlackoutBelief(blackout, ("1-2", "2-3"), seed=2)
    paths = belief.paths(seen_by_two(seen), SLOTS - t - 1, n)
    error = 4.0 * np.sqrt(0.25 / max(alike.sum(), 1)) + 1.0 / n
    assert np.abs(paths[0].mean(axis=1) - ahead).max() < error
    assert not paths[1].any()
    if t + 1 < SLOTS:
        assert belief.next_down(seen_by_two(seen))[0] == pytest.approx(ahead[0], abs=error)
    begins = belief.chances(seen_by_two(seen), 12)
    assert begins[0].sum() == (1.0 if -6 <= t < 7 and 7 - t - 1 < 12 else 0.0)
    expected = belief.expected_left(seen_by_two(seen))
    if t >= 7:
        assert expected[0] == pytest.approx(ahead.sum(), abs=1.0 + 20 * error)
    assert expected[1] == 0


def seen_by_two(seen: LineHistory) -> LineHistory:
    """The same with a second line that stands."""
    return seen.of_lines(np.array([0, -1]))


def test_a_blackout_that_is_over_does_not_come_again() -> None:
    down = np.zeros((1, SLOTS), bool)
    down[0, 7:12] = True
    belief = BlackoutBelief(late(), ("1-2",))
    assert not belief.paths(history(down, 20), 20, 10).any()
    assert not belief.chances(history(down, 20), 20).any()


def test_the_case_draws_and_believes_its_blackout() -> None:
    case = dark(hours=[6.0, 0.8])
    assert case.is_dated
    assert sample_case(case, 3, 0).down.any(axis=1).all()
    assert isinstance(case_belief(case, ("1-2",)), BlackoutBelief)
    assert outages_from("blackout", case, 4)[0].line == "1-2"
    assert np.array_equal(draw(case, 3, 0).down, sample_case(case, 3, 0).down)
    with pytest.raises(UsageError, match="2 days of a blackout"):
        draw(case, 3, 0, days=2)
    with pytest.raises(UsageError, match="no \\[blackout\\]"):
        case_blackout(rs.load_case("ieee33"))


def test_a_blackout_is_written_and_read_alike(tmp_path: Path) -> None:
    case = dark(lines=["1-2"], hours=[6.0, 0.8], longest_h=10.0)
    path = tmp_path / "dark.toml"
    path.write_text(case_text(case), encoding="utf-8")
    assert rs.load_case(path).equals(case)
    assert not case.replace(blackout=None).equals(case)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("lines", ["1-3"], "a line of the network"),
        ("lines", ["1-2", "1-2"], "every line once"),
        ("start", datetime(2000, 1, 1), "a time within the horizon"),
        ("hours", [24.0], "\\[median, sigma\\] of lognormal hours"),
        ("hours", [24.0, 4.0], "up to 3"),
        ("hours", [0.0, 0.8], "above 0"),
        ("longest_h", -1.0, "greater than 0"),
    ],
)
def test_mistakes_are_named(key: str, value: object, words: str) -> None:
    with pytest.raises(CaseError, match=words):
        dark(**{key: value})


def test_a_storm_and_a_blackout_do_not_go_together() -> None:
    storm = StormTable.model_validate(
        {
            "averaging_s": 600,
            "points": [
                [datetime(2016, 7, 11, 20), 22.0, 122.0, 930, 54],
                [datetime(2016, 7, 12, 8), 21.9, 120.9, 945, 47],
            ],
        }
    )
    with pytest.raises(CaseError, match="one of the two"):
        dark().replace(storm=storm)
