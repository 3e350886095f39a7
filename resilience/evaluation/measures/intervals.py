r"""The mean over episodes and days, and how far it may be from that of other storms and days.

All episodes of a comparison share their days, and trainings their storms: values x stand in a table
whose axes (trainings, episodes, days) would each be drawn anew in another experiment. The variance
of their mean under that is the sum of the components of the analysis of variance. With the mean
square $M_S$ of the effect of some axes together, per number of its levels,

$$ V = \sum_{\emptyset \ne S} (-1)^{|S| + 1} M_S, \qquad
   \frac{1}{f} = \sum_S \frac{M_S^2}{V^2 f_S} + \frac{\sum_c u_c^4}{(\sum_c u_c^2)^2} $$

V is at least that of each axis alone. A bootstrap of days and episodes (Owen, The pigeonhole
bootstrap, Annals of Applied Statistics 1, 2007) tends to the sum of the $M_S$ instead, three times
V where neither matters by itself; being a mean's, either needs no resampling. The interval is
Student's with f degrees of freedom: Satterthwaite's of V, fewer where few cells c carry the squared
deviations u. One storm that decides gives f near 1, and an interval six times as wide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.fragility.outages.weights import ROUNDING, effective_number
from resilience.tolerances import COST_TOLERANCE

CONFIDENCE = 0.95
CARRIED_SHARE = 0.8  # of a mean, that few cells may carry
FEW_EVENTS = 10  # cells; fewer say little of the storms that were not drawn


@dataclass(frozen=True)
class MeanInterval:
    """A mean and its confidence interval, in the unit of the values.

    Attributes:
        mean: mean of the values.
        low: lower end.
        high: upper end.
        confidence: probability that such an interval covers the true mean.
        n: number of episodes, or of values where there are no other axes.
        rounding: what the values may be off by themselves.
        days: number of days of an episode that were varied as well; 1: none.
        carriers: least number of day-episodes that carry 80 % of the mean.
    """

    mean: float
    low: float
    high: float
    confidence: float
    n: int
    rounding: float = 0.0
    days: int = 1
    carriers: int = 0

    @property
    def excludes_zero(self) -> bool:
        """True where the sign of the mean is neither luck, at this confidence, nor rounding."""
        return self.low > self.rounding or self.high < -self.rounding

    @property
    def few_events(self) -> bool:
        """True where fewer than ten day-episodes, and a quarter of all, carry 80 % of the mean."""
        return 0 < self.carriers < FEW_EVENTS and 4 * self.carriers <= self.n * self.days


def mean_interval(
    values: ArrayLike,
    likely: Floats | None = None,
    *,
    confidence: float = CONFIDENCE,
    scale: float = 0.0,
) -> MeanInterval:
    """Mean of values and its interval, all axes with more than one entry varied.

    Args:
        values: (episodes, days), with an axis in front of them for each further thing that is
            varied, as trainings; or (episodes,).
        likely: (episodes,) probabilities; all alike if omitted.
        confidence: of the interval.
        scale: size of the numbers that the values are differences of, which are rounded.

    Returns:
        The interval, its ends NaN where a single value allows none.

    Raises:
        UsageError: values that are not finite, or none.
    """
    x, shares = _table(values, likely)
    cells = math.prod(np.ix_(*shares)) * np.ones_like(x)
    mean = float((cells * x).sum())
    rounding = COST_TOLERANCE * scale
    episodes, days = x.shape[-2:]
    carriers = _carriers((cells * x).sum(tuple(range(x.ndim - 2))), mean, rounding)
    about = {"rounding": rounding, "days": days, "carriers": carriers}
    if max(map(effective_number, shares)) <= 1.0 + ROUNDING:
        return MeanInterval(mean, math.nan, math.nan, confidence, episodes, **about)
    if np.ptp(x) <= max(rounding, COST_TOLERANCE * abs(mean)):
        return MeanInterval(mean, mean, mean, confidence, episodes, **about)
    variance, freedom = _variance(x, shares)
    freedom = 1.0 / (1.0 / freedom + _concentration(cells * (x - mean)))
    half = _student_quantile(freedom, confidence) * math.sqrt(variance)
    return MeanInterval(mean, mean - half, mean + half, confidence, episodes, **about)


def _table(values: ArrayLike, likely: Floats | None) -> tuple[Floats, list[Floats]]:
    """The values as (..., episodes, days), and weights along each axis that add up to 1.

    Episodes that cannot happen are left out.
    """
    x: Floats = np.asarray(values, float)
    x = x.reshape(-1, 1) if x.ndim < 2 else x
    if x.size == 0 or not np.isfinite(x).all():
        raise UsageError(
            f"values of the shape {x.shape}; allowed: at least one value, all finite",
            hint="leave failed episodes out of every method of the comparison",
        )
    shares = [np.full(n, 1.0 / n) for n in x.shape]
    if likely is not None:
        there = likely > 0
        x, shares[-2] = x[..., there, :], likely[there]
    return x, shares


def _variance(x: Floats, shares: Sequence[Floats]) -> tuple[float, float]:
    """Variance of the mean of x, and Satterthwaite's degrees of freedom of it.

    Args:
        x: a table.
        shares: weights along each of its axes, adding up to 1.
    """
    levels = [effective_number(share) for share in shares]
    varied = [axis for axis, n in enumerate(levels) if n > 1.0 + ROUNDING]
    total, largest, doubt = 0.0, 0.0, 0.0
    for count in range(1, len(varied) + 1):
        for axes in combinations(varied, count):
            freedom = math.prod(levels[axis] - 1.0 for axis in axes)
            unbiased = math.prod(levels[axis] / (levels[axis] - 1.0) for axis in axes)
            square = unbiased * float((_effect(x, shares, axes) ** 2).sum())
            total += square if count % 2 else -square
            largest = max(largest, square if count == 1 else 0.0)
            doubt += square**2 / freedom
    variance = max(total, largest)
    return variance, variance**2 / doubt


def _effect(x: Floats, shares: Sequence[Floats], axes: Sequence[int]) -> Floats:
    """What some axes together add to the mean of x, beyond what fewer of them do, by level."""
    effect = x
    for axis, share in enumerate(shares):
        weight = share.reshape([-1 if k == axis else 1 for k in range(x.ndim)])
        mean = (weight * effect).sum(axis, keepdims=True)
        effect = weight * (effect - mean) if axis in axes else mean
    return effect


def _concentration(deviations: Floats) -> float:
    """1 over the number of cells that carry the squared deviations; 1 where one does."""
    squares = deviations**2
    return float((squares**2).sum() / squares.sum() ** 2)


def _carriers(parts: Floats, mean: float, rounding: float) -> int:
    """The least number of the parts (episodes, days) of a mean that carry 80 % of it; 0 of none."""
    if abs(mean) <= rounding:
        return 0
    carried = np.cumsum(np.sort((np.sign(mean) * parts).ravel())[::-1])
    return int(np.argmax(carried >= CARRIED_SHARE * abs(mean) * (1.0 - COST_TOLERANCE))) + 1


def _student_quantile(freedom: float, confidence: float) -> float:
    """Half the width of a two-sided interval, in standard errors."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 * (1.0 + confidence)))
