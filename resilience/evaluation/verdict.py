"""A comparison in sentences: which dispatcher is best, by how much, and whether that is luck."""

from __future__ import annotations

import math

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND, Compared
from resilience.evaluation.measures.statistics import MeanInterval, mean_interval, triviality

SHED_RESOLUTION_MWH = 5e-4
"""Shedding per day that is printed alike is called alike, MWh."""


def days_of(compared: Compared) -> float:
    """Days of an episode."""
    return compared.case.slots * compared.case.step_h / 24.0


def expected(compared: Compared, values: Floats) -> float:
    """Mean of values (episodes,), weighed by the probability of the storms."""
    return float(compared.scenarios.probability @ values)


def ranked(compared: Compared) -> list[str]:
    """Dispatchers by mean cost, the cheapest first; the bound is none of them."""
    cost = {name: expected(compared, values) for name, values in compared.objective.items()}
    return sorted((name for name in cost if name != BOUND), key=lambda name: cost[name])


def interval(
    compared: Compared, values: Floats, seed: int = 0, *, scale: float = 0.0
) -> MeanInterval:
    """Mean of values (episodes,) and its 95 % interval, NaN where there is one episode.

    They may be differences of numbers of a size, `scale`.
    """
    n = len(values)
    if n < 2:
        return MeanInterval(float(values.mean()), math.nan, math.nan, 0.95, n)
    # Weights enter the values, so that their plain mean is the expectation.
    weighed = values * compared.scenarios.probability * n
    return mean_interval(weighed, np.random.default_rng(seed), scale=scale)


def saving(compared: Compared, method: str, than: str) -> MeanInterval:
    """What `method` saves against another in $/day on the same episodes, with its interval."""
    costs = np.array([compared.objective[method], compared.objective[than]]) / days_of(compared)
    return interval(compared, costs[1] - costs[0], scale=float(np.abs(costs).max()))


def cost_per_day(compared: Compared, method: str) -> float:
    """Mean cost, $/day."""
    return expected(compared, compared.objective[method]) / days_of(compared)


def shed_per_day(compared: Compared, method: str) -> float:
    """Mean energy not served, MWh/day."""
    return expected(compared, compared.trajectories[method].shed_mwh) / days_of(compared)


def verdict(compared: Compared) -> tuple[str, ...]:
    """Sentences for somebody with a storm coming, the most important first."""
    order = ranked(compared)
    best = order[0]
    others = [name for name in order if name not in (best, REFERENCE)]
    sentences = [_best(compared, best)]
    if best != REFERENCE:
        sentences.append(_luck(saving(compared, best, REFERENCE)))
    sentences += _as_good(compared, best, others)
    sentences.append(_room(compared))
    return tuple(sentences)


def _best(compared: Compared, best: str) -> str:
    cost = cost_per_day(compared, best)
    words = (
        f"Best is {best} at {cost:.2f} $/day, shedding {shed_per_day(compared, best):.3f} MWh/day."
    )
    if best == REFERENCE:
        return words + " It keeps the battery full, and nothing that was asked for is cheaper."
    gain = saving(compared, best, REFERENCE).mean
    rule = cost_per_day(compared, REFERENCE)
    share = f" ({100 * gain / abs(rule):.1f} %)" if rule else ""
    words += f" That saves {gain:.2f} $/day{share} against {REFERENCE}, a battery kept full,"
    more = shed_per_day(compared, best) - shed_per_day(compared, REFERENCE)
    if abs(more) < SHED_RESOLUTION_MWH:
        return words + " and sheds as much."
    link, way = ("but", "more") if more > 0 else ("and", "less")
    return words + f" {link} sheds {abs(more):.3f} MWh/day {way}."


def _luck(gain: MeanInterval) -> str:
    if math.isnan(gain.low):
        return "One episode says nothing about luck; ask for more with --draws."
    span = f"{gain.low:.2f} to {gain.high:.2f} $/day"
    if gain.excludes_zero:
        return (
            f"That is not luck: the 95 % interval of the saving over {gain.n} episodes is {span}."
        )
    return (
        f"That may be luck: the 95 % interval of the saving over {gain.n} episodes is {span} and "
        "includes zero; more --draws narrow it."
    )


def _as_good(compared: Compared, best: str, others: list[str]) -> list[str]:
    """Names the methods whose distance to the best may be luck."""
    near = [saving(compared, best, name) for name in others]
    alike = [n for n, s in zip(others, near, strict=True) if s.n > 1 and not s.excludes_zero]
    if not alike:
        return []
    return [f"These storms cannot tell {best} from {' and '.join(alike)}."]


def _room(compared: Compared) -> str:
    rule, best = (expected(compared, v) for v in (compared.objective[REFERENCE], compared.bound))
    room = triviality([rule], [best])
    share = round(100 * room.room_share, 2) + 0.0  # no -0.00
    more = "" if math.isnan(room.room_share) else f" costs {share:.2f} % more than"
    gap = f"a battery kept full{more or ' is compared with'} perfect foresight"
    if room.trivial:
        return f"But this case cannot tell methods apart: {gap}, which is too little to rank them."
    return f"The case can tell methods apart: {gap}."
