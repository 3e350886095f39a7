r"""Who is better and by how much: statistics of dispatchers on the same storms.

Costs are $ per episode; every dispatcher saw the same ones. Of those, `bound` is the clairvoyant's
cost and `rule09` that of the rule that keeps storage at 0.9. Of many episodes, gap and score are
those of the expected costs, never means of ratios; `intervals.py` says how sure a mean is.

$$ \text{CVaR}_\alpha(X) = \min_\eta \; \eta + \frac{\mathbb{E}[(X - \eta)^+]}{1 - \alpha}, \qquad
   \text{gap} = \frac{\text{cost} - \text{bound}}{|\text{bound}|}, \qquad
   \text{score} = \frac{\text{rule09} - \text{cost}}{\text{rule09} - \text{bound}} $$
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.program.risk_measures import finite_values, weights
from resilience.tolerances import COST_TOLERANCE

TRIVIAL_SHARE = 0.01
"""Below this room between rule 0.9 and the bound, no ranking means anything."""


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


def gap_values(cost: Floats, bound: Floats, likely: Floats | None = None) -> Floats:
    """Values whose mean is the gap of expected costs, and which vary as it does.

    The gap is a quotient of two means. To first order it varies with its episodes as these values
    do: what each adds to the cost beyond the gap that all have, relative to the bound.

    Args:
        cost: (..., episodes, days) $.
        bound: likewise.
        likely: (episodes,) probabilities; all alike if omitted.
    """
    means = [np.average(np.average(values, -2, likely)) for values in (cost, bound)]
    gap, base = gap_to_bound(*means), abs(means[1])
    excess = cost - bound - gap * np.sign(means[1]) * bound
    return gap + excess / np.where(base > 0, base, np.nan)


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
