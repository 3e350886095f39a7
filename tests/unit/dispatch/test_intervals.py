"""Intervals of means over episodes and days: textbook cases, brute force, simulated coverage."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import f_oneway, t

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.evaluation.measures.intervals import MeanInterval, _variance, mean_interval


def rng(seed: int = 7) -> np.random.Generator:
    return np.random.default_rng(seed)


def alike(*shape: int) -> list[Floats]:
    return [np.full(n, 1.0 / n) for n in shape]


def test_many_values_of_one_axis_have_the_interval_of_the_textbook() -> None:
    x = rng().normal(3.0, 2.0, 4000)
    for values in (x, x[:, None], x[None]):
        found = mean_interval(values)
        half = t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x))
        assert (found.low, found.high) == pytest.approx(
            (x.mean() - half, x.mean() + half), abs=1e-3
        )
        assert found.excludes_zero


@pytest.mark.parametrize("shape", [(6, 9), (4, 16), (2, 2)])
def test_the_variance_is_that_of_the_textbook_on_two_ways(shape: tuple[int, int]) -> None:
    """Mean squares of rows, columns and interaction by hand: (MSA + MSB - MSAB) / (a b)."""
    a, b = shape
    x = rng().normal(size=shape) + 2.0 * rng(8).normal(size=(a, 1)) + 3.0 * rng(9).normal(size=b)
    row, column, mean = x.mean(1, keepdims=True), x.mean(0, keepdims=True), x.mean()
    rows = b * ((row - mean) ** 2).sum() / (a - 1)
    columns = a * ((column - mean) ** 2).sum() / (b - 1)
    both = ((x - row - column + mean) ** 2).sum() / ((a - 1) * (b - 1))
    variance = _variance(x, alike(a, b))[0]
    assert variance * a * b == pytest.approx(max(rows + columns - both, rows, columns))
    # One way, SciPy agrees: F is the mean square between over the one within.
    between = _variance(row, alike(a, 1))[0] * a * b
    within = x.var(axis=1, ddof=1).mean()
    assert between / within == pytest.approx(f_oneway(*x).statistic)


@pytest.mark.parametrize(
    ("spread", "true"),
    [
        ((1.0, 0.0, 0.0, 0.5), 1 / 5 + 0.25 / 240),
        ((0.0, 1.0, 0.0, 0.5), 1 / 6 + 0.25 / 240),
        ((0.5, 1.0, 1.0, 2.0), 0.25 / 5 + 1 / 6 + 1 / 8 + 4 / 240),
    ],
)
def test_the_variance_is_that_of_means_drawn_anew(
    spread: tuple[float, float, float, float], true: float
) -> None:
    """Trainings, episodes and days, each with an effect of its own, drawn 3000 times."""
    draw, variances, means = rng(1), [], []
    for _ in range(3000):
        x = sum(
            size * draw.normal(size=shape)
            for size, shape in zip(
                spread, [(5, 1, 1), (1, 6, 1), (1, 1, 8), (5, 6, 8)], strict=True
            )
        )
        x = np.broadcast_to(x, (5, 6, 8))
        variances.append(_variance(x, alike(5, 6, 8))[0])
        means.append(x.mean())
    assert np.var(means) == pytest.approx(true, rel=0.1)
    assert np.mean(variances) == pytest.approx(true, rel=0.1)


def test_weights_that_are_counts_are_repeated_episodes() -> None:
    """Kish: an episode of weight 2/4 counts as two, but is one storm."""
    x = np.array([3.0, 5.0, 11.0])
    weighed = mean_interval(x, np.array([0.5, 0.25, 0.25]))
    assert weighed.mean == pytest.approx(np.mean([3, 3, 5, 11]))
    levels = 1.0 / (0.25 + 0.0625 + 0.0625)
    linear = np.array([0.5, 0.25, 0.25]) * (x - weighed.mean)
    variance = levels / (levels - 1.0) * (linear**2).sum()
    freedom = 1.0 / (1.0 / (levels - 1.0) + (linear**4).sum() / (linear**2).sum() ** 2)
    half = t.ppf(0.975, freedom) * np.sqrt(variance)
    assert weighed.high - weighed.low == pytest.approx(2.0 * half)


def test_weights_keep_a_difference_that_all_episodes_share() -> None:
    found = mean_interval(np.full((3, 2), 4.0), np.array([0.7, 0.2, 0.1]))
    assert (found.low, found.mean, found.high) == pytest.approx((4.0, 4.0, 4.0))


def test_an_episode_that_cannot_happen_is_none() -> None:
    x = rng().normal(size=(4, 3))
    likely = np.array([0.25, 0.25, 0.5])
    found = mean_interval(np.insert(x[:3], 1, 1e6, axis=0), np.insert(likely, 1, 0.0))
    assert found == mean_interval(x[:3], likely)


def test_a_single_value_has_no_interval() -> None:
    alone = (np.array([[3.0]]), None), (np.array([[3.0], [9.0]]), np.array([1.0, 0.0]))
    for values, likely in alone:
        found = mean_interval(values, likely)
        assert found.mean == 3.0
        assert np.isnan([found.low, found.high]).all()
        assert not found.excludes_zero


def test_what_is_varied_is_every_axis_that_can_be() -> None:
    """Where days differ alone and all storms share them, nine storms know no more than one."""
    day = rng().normal(size=(1, 12))
    shared = np.repeat(day, 9, axis=0) + 1e-6 * rng(8).normal(size=(9, 12))
    variance = _variance(shared, alike(9, 12))[0]
    assert variance == pytest.approx(day.var(ddof=1) / 12, rel=1e-5)
    assert variance == pytest.approx(_variance(day, alike(1, 12))[0], rel=1e-5)
    storms_alone = mean_interval(shared.mean(1))
    assert storms_alone.high - storms_alone.low < 1e-5


def test_what_is_rounding_grows_with_the_costs() -> None:
    """0.1 $ in 1e9 are rounding, 1000 $ are not; 1e-4 $ in 1 $ are not either."""
    near, far = 1e9 + np.array([0.0, 0.1, -0.05]), 1e9 + np.array([0.0, 1e3, -2e3])
    for sign in (1.0, -1.0):
        found = mean_interval(sign * near)
        assert found.low == found.high == pytest.approx(sign * near.mean(), rel=1e-15)
    for wide in (far, 2.0 + np.array([0.0, 1e-4, 3e-4]), 1e-9 * np.array([33.0, 38.0])):
        found = mean_interval(wide)
        assert found.low < wide.mean() < found.high


def test_a_difference_by_rounding_is_no_difference() -> None:
    cost = 40.0 + np.arange(9.0)
    by_rounding = mean_interval(1e-13 * (3.0 + cost), scale=48.0)
    assert by_rounding.low > 0
    assert not by_rounding.excludes_zero
    assert mean_interval(1e-6 * (3.0 + cost), scale=48.0).excludes_zero
    assert not mean_interval(np.zeros(4), scale=48.0).excludes_zero


def test_what_cannot_be_averaged_is_refused() -> None:
    for values in ([], [1.0, np.nan]):
        with pytest.raises(UsageError, match="at least one value, all finite"):
            mean_interval(values)


def test_few_events_are_counted() -> None:
    """Of 64 cells three hold 27 of 30: 12 + 12 are 80 %. An even difference is none of events."""
    x = np.zeros((4, 16))
    x[0, 3], x[0, 5], x[2, 5] = 12.0, 3.0, 12.0
    x[3] = 3.0 / 16.0
    for sign in (1.0, -1.0):
        found = mean_interval(sign * x)
        assert (found.carriers, found.few_events) == (2, True)
    # 0.8 * 64.03 = 51.2.
    assert mean_interval(np.ones((4, 16)) + 1e-3 * x).carriers == 52
    assert not mean_interval(np.ones((4, 16)) + 1e-3 * x).few_events
    assert mean_interval(np.zeros((4, 16))).carriers == 0
    # Three of four cells are not few of them.
    assert not mean_interval(np.array([1.0, 2.0, 1.0, 1.0])).few_events


def test_trainings_are_no_events() -> None:
    """The same storm in five trainings is one event."""
    x = np.zeros((5, 4, 16))
    x[:, 1, 2] = 1.0
    assert mean_interval(x).carriers == 1


def test_what_few_storms_decide_is_as_sure_as_their_number() -> None:
    """Of k like events, all on one side, a sign test is sure of the side from 6 on, as 2 / 2^6 is
    below 5 %; the interval is from 7 on. Of one event it is no surer than of two values: Student's
    12.7 standard errors at one degree of freedom.
    """
    for k in range(1, 12):
        x = np.zeros((32, 16))
        x[np.arange(k), np.arange(k)] = 1.0
        assert mean_interval(x).excludes_zero == (k > 6)
    x = np.zeros((32, 16))
    x[0, 0] = 1.0
    assert 1.0 + 12.7 < mean_interval(x).high * 512 < 1.0 + 20.0


def shed(share: float) -> Callable[[np.random.Generator, int, int], tuple[Floats, float]]:
    """A share of the days sheds 0.3 MWh at 30 $/MWh, exponentially distributed."""

    def draw(generator: np.random.Generator, n: int, days: int) -> tuple[Floats, float]:
        events = generator.random((n, days)) < share
        return events * generator.exponential(9.0, (n, days)), 9.0 * share

    return draw


def normal(generator: np.random.Generator, n: int, days: int) -> tuple[Floats, float]:
    return 1.0 + generator.normal(size=(n, days)), 1.0


def of_days(generator: np.random.Generator, n: int, days: int) -> tuple[Floats, float]:
    """Days differ by more than storms do."""
    return 1.0 + generator.normal(size=days) + 0.5 * generator.normal(size=(n, days)), 1.0


def risky_days(generator: np.random.Generator, n: int, days: int) -> tuple[Floats, float]:
    """A quarter of the days sheds in one storm of five, the others never."""
    share = 0.2 * (generator.random(days) < 0.25)
    return (generator.random((n, days)) < share) * generator.exponential(9.0, (n, days)), 0.45


LAWS = {
    "normal": (normal, 0.93),
    "of days": (of_days, 0.93),
    "risky days": (risky_days, 0.88),
    "shed 0.05": (shed(0.05), 0.92),
}
"""Law of what a day-episode costs more, and the least coverage."""


def coverage(law: str, n: int, days: int, repetitions: int, seed: int) -> float:
    """How often the interval has the true mean in it."""
    generator, hits = np.random.default_rng(seed), 0
    for _ in range(repetitions):
        x, true = LAWS[law][0](generator, n, days)
        found: MeanInterval = mean_interval(x)
        hits += found.low <= true <= found.high
    return hits / repetitions


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("n", [4, 32])
def test_95_percent_intervals_cover_the_truth(law: str, n: int) -> None:
    """A small sample of the simulation below: two standard errors of 300 are 2.5 points."""
    assert coverage(law, n, 16, 300, seed=n) >= LAWS[law][1] - 0.025


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("n", [4, 8, 16, 32])
def test_95_percent_intervals_cover_the_truth_many_times(law: str, n: int) -> None:
    """The table of docs/concepts/evaluation.md: two standard errors of 4000 are 0.7 points."""
    assert coverage(law, n, 16, 4000, seed=n) >= LAWS[law][1]


@pytest.mark.slow
@pytest.mark.parametrize(("n", "days"), [(16, 4), (32, 4)])
def test_fewer_days_need_more_episodes(n: int, days: int) -> None:
    assert coverage("shed 0.05", n, days, 4000, seed=n) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize(("n", "days"), [(4, 4), (8, 4), (4, 1), (8, 1), (32, 1)])
def test_what_was_not_drawn_cannot_be_covered_and_is_all_that_is_missed(n: int, days: int) -> None:
    """Where 0.05 n days is 1.6 or less, many samples have no event, and nothing shows that one may
    come. With several days nearly all of the others cover the truth.
    """
    empty = 0.95 ** (n * days)
    covered = coverage("shed 0.05", n, days, 4000, seed=n)
    assert covered <= 1.0 - empty + 0.02
    if days > 1:
        assert covered >= 0.97 * (1.0 - empty)
