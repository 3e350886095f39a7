r"""Who is better, by how much, and is that luck: statistics of dispatchers on the same storms.

Costs are $ per episode, one value per episode or member; every dispatcher saw the same ones. Of
those, `bound` is the clairvoyant's cost and `rule09` that of the rule that keeps storage at 0.9.

$$ \text{CVaR}_\alpha(X) = \min_\eta \; \eta + \frac{\mathbb{E}[(X - \eta)^+]}{1 - \alpha}, \qquad
   \text{score} = \frac{\text{rule09} - \text{cost}}{\text{rule09} - \text{bound}} $$
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.program.risk_measures import finite_values, weights
from resilience.tolerances import COST_TOLERANCE

TRIVIAL_SHARE = 0.01
"""Below this room between rule 0.9 and the bound, no ranking means anything."""


@dataclass(frozen=True)
class MeanInterval:
    """A mean and its bootstrap confidence interval, in the unit of the values.

    Attributes:
        mean: mean of the values.
        low: lower end.
        high: upper end.
        confidence: probability that such an interval covers the true mean.
        n: number of values.
        rounding: what the values may be off by themselves.
    """

    mean: float
    low: float
    high: float
    confidence: float
    n: int
    rounding: float = 0.0

    @property
    def excludes_zero(self) -> bool:
        """True where the sign of the mean is neither luck, at this confidence, nor rounding."""
        return self.low > self.rounding or self.high < -self.rounding


@dataclass(frozen=True)
class Triviality:
    """How much the best possible is below rule 0.9: the room in which a method can be clever.

    Attributes:
        room_share: (rule09 - bound) / |bound|.
        trivial: room below 1 %: any ranking of methods is noise.
    """

    room_share: float
    trivial: bool


def interquartile_mean(values: ArrayLike) -> float:
    """Mean without the lowest and highest quarter (each rounded down to whole values)."""
    from scipy.stats import trim_mean

    return float(trim_mean(finite_values(values), 0.25))


def expected(values: Floats, likely: Floats) -> float:
    """The mean by probability of the values that are there; NaN where none is."""
    there = np.isfinite(values) & (likely > 0)
    weight = float(likely[there].sum())
    return float(likely[there] @ values[there]) / weight if weight else float("nan")


def mean_interval(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    strata: ArrayLike | None = None,
    confidence: float = 0.95,
    resamples: int = 9999,
    method: Literal["BCa", "percentile"] = "BCa",
    scale: float = 0.0,
) -> MeanInterval:
    """Mean of values and its bootstrap interval.

    Args:
        values: one number per episode.
        rng: source of the resamples; the same generator state gives the same interval.
        strata: label of every value, such as its draw: each stratum is resampled by itself and
            keeps its size. None: one stratum.
        confidence: of the interval.
        resamples: number of bootstrap samples.
        method: "BCa" (corrects bias and skewness) or "percentile".
        scale: size of the numbers that the values are differences of, which are rounded.

    Raises:
        UsageError: labels that do not fit, a stratum of one value, which nothing can be drawn from.
    """
    x = finite_values(values)
    groups = _groups(x, strata)
    mean = float(x.mean())
    rounding = COST_TOLERANCE * scale
    if all(np.ptp(group) <= max(rounding, COST_TOLERANCE * abs(mean)) for group in groups):
        return MeanInterval(mean, mean, mean, confidence, len(x), rounding)
    interval = _bootstrap(groups, rng, confidence, resamples, method)
    low, high = float(interval.low), float(interval.high)
    return MeanInterval(mean, low, high, confidence, len(x), rounding)


def paired_difference(
    cost: ArrayLike,
    reference: ArrayLike,
    rng: np.random.Generator,
    *,
    strata: ArrayLike | None = None,
    confidence: float = 0.95,
    resamples: int = 9999,
    method: Literal["BCa", "percentile"] = "BCa",
) -> MeanInterval:
    """Mean of cost - reference on the same episodes, with its interval; below 0: cheaper.

    Arguments and errors as for `mean_interval`; also raised where the lengths differ.
    """
    return mean_interval(
        _paired(cost, reference),
        rng,
        strata=strata,
        confidence=confidence,
        resamples=resamples,
        method=method,
        scale=_size(cost, reference),
    )


def run_interval(
    values: Floats,
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = 9999,
) -> MeanInterval:
    """Mean over runs and episodes, and its percentile interval.

    Runs and episodes are resampled apart from each other: another training, or another storm, would
    have met all of the others. One run or one episode says nothing of how others would differ; the
    interval is then over the others alone, and NaN where there are none.

    Args:
        values: (runs, episodes) one number each.
        rng: source of the resamples.
        confidence: of the interval.
        resamples: number of bootstrap samples.
    """
    runs, episodes = values.shape
    mean = float(finite_values(values.ravel()).mean())
    if runs == episodes == 1:
        return MeanInterval(mean, float("nan"), float("nan"), confidence, 1)
    of_run, of_episode = (
        rng.multinomial(n, np.full(n, 1.0 / n), size=resamples) / n for n in (runs, episodes)
    )
    means = np.einsum("kr,re,ke->k", of_run, values, of_episode, optimize=True)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return MeanInterval(mean, float(low), float(high), confidence, values.size)


def score(cost: ArrayLike, rule09: ArrayLike, bound: ArrayLike) -> Floats:
    """(rule09 - cost) / (rule09 - bound), elementwise: 1 is the best possible, 0 is rule 0.9.

    NaN where rule 0.9 is as good as the bound: there is nothing to score.
    """
    cost, rule09, bound = (np.asarray(v, float) for v in (cost, rule09, bound))
    room = rule09 - bound
    open_ = np.abs(room) > COST_TOLERANCE * _size(rule09, bound)
    return np.where(open_, (rule09 - cost) / np.where(open_, room, 1.0), np.nan)


def gap_to_bound(cost: ArrayLike, bound: ArrayLike) -> Floats:
    """(cost - bound) / |bound|, elementwise: share above the best possible; NaN at bound 0."""
    cost, bound = np.asarray(cost, float), np.asarray(bound, float)
    base = np.abs(bound)
    return np.where(base > 0, (cost - bound) / np.where(base > 0, base, 1.0), np.nan)


def triviality(rule09: ArrayLike, bound: ArrayLike) -> Triviality:
    """Triviality test of a case, from the mean costs of rule 0.9 and of the bound.

    A bound of 0 leaves the room undefined (NaN); it then counts as trivial only where rule 0.9
    costs nothing either.
    """
    rule, best = float(finite_values(rule09).mean()), float(finite_values(bound).mean())
    room = float(gap_to_bound(rule, best))
    return Triviality(room, rule <= 0.0 if np.isnan(room) else room < TRIVIAL_SHARE)


def value_of_stochastic_solution(
    mean_value_cost: ArrayLike, stochastic_cost: ArrayLike, probability: Floats | None = None
) -> float:
    """VSS in $: what the plan for the mean costs more than the stochastic one, on all scenarios."""
    return _expected(_paired(mean_value_cost, stochastic_cost), probability)


def value_of_perfect_information(
    stochastic_cost: ArrayLike, clairvoyant_cost: ArrayLike, probability: Floats | None = None
) -> float:
    """EVPI in $: what the stochastic plan costs more than knowing the scenario beforehand."""
    return _expected(_paired(stochastic_cost, clairvoyant_cost), probability)


def _bootstrap(
    groups: list[Floats], rng: np.random.Generator, confidence: float, resamples: int, method: str
) -> Any:
    """Confidence interval of the mean of all groups, each resampled by itself."""
    from scipy.stats import bootstrap

    total = sum(len(group) for group in groups)
    share = [len(group) / total for group in groups]

    def pooled(*samples: Floats, axis: int = -1) -> Floats:
        # BCa leaves one value out at a time: its group must keep its share in the mean.
        means = [s * x.mean(axis=axis) for s, x in zip(share, samples, strict=True)]
        return reduce(np.add, means)

    return bootstrap(
        groups,
        pooled,
        n_resamples=resamples,
        confidence_level=confidence,
        method=method,
        vectorized=True,
        rng=rng,
    ).confidence_interval


def _groups(x: Floats, strata: ArrayLike | None) -> list[Floats]:
    """Values of every stratum."""
    if strata is None:
        groups = [x]
    else:
        label = np.asarray(strata)
        if label.shape != x.shape:
            raise UsageError(f"strata have the shape {label.shape}; allowed: {x.shape}")
        groups = [x[label == stratum] for stratum in np.unique(label)]
    if min(len(group) for group in groups) < 2:
        raise UsageError(
            "a stratum has 1 value; allowed: at least 2",
            hint="take more episodes, or leave the strata out",
        )
    return groups


def _size(*costs: ArrayLike) -> float:
    """The largest of all costs, whatever its sign."""
    return max(float(np.abs(values).max(initial=0.0)) for values in map(np.asarray, costs))


def _paired(cost: ArrayLike, reference: ArrayLike) -> Floats:
    a, b = finite_values(cost), finite_values(reference)
    if a.shape != b.shape:
        raise UsageError(
            f"pairs of {len(a)} and {len(b)} episodes; allowed: the same episodes for both"
        )
    return a - b


def _expected(values: Floats, probability: Floats | None) -> float:
    return float(weights(probability, len(values)) @ values)
