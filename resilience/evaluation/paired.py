"""Methods in pairs: what one costs more than another on the same episodes, day by day."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from resilience.arrays import Floats
from resilience.evaluation.comparison import BOUND, Compared, day_spans
from resilience.evaluation.measures.intervals import MeanInterval, mean_interval

LEAST_DAYS = 4
"""Fewer say next to nothing of others: from two days an interval spans 25 standard errors."""


def days_of(compared: Compared) -> float:
    """Days of an episode."""
    return compared.case.slots * compared.case.step_h / 24.0


def expected(compared: Compared, values: Floats) -> float:
    """Mean of values (episodes,), weighed by the probability of the storms."""
    return float(compared.scenarios.probability @ values)


def daily_cost(compared: Compared, method: str) -> Floats:
    """(days, episodes) $: cost of the day less what the energy gained over the day is worth.

    The days of an episode add up to its objective and the worth of what was stored at its start.
    """
    trajectory, case = compared.trajectories[method], compared.case
    first = [span.start for span in day_spans(case)]
    spent = np.add.reduceat(trajectory.cost, first, axis=0)
    stored = trajectory.energy[:, [*first, case.slots]].sum(0)
    return spent - compared.end_value_per_mwh * np.diff(stored, axis=0)


def cost_by_day(compared: Compared, method: str) -> Floats:
    """(episodes, days) $ that add up to the objective.

    `daily_cost`, and by its length every day's share of what that leaves: the worth of what was
    stored at the start, or the credit of all midnights where storage is reset at each.
    """
    by_day = daily_cost(compared, method).T
    return by_day + _shared_out(compared, compared.objective[method] - by_day.sum(1))


def bound_by_day(compared: Compared) -> Floats:
    """(episodes, days) $ that add up to the bound, by the days of the path that reaches it.

    Alike on all days where that path is not there.
    """
    if BOUND not in compared.trajectories:
        return _shared_out(compared, compared.bound)
    by_day = cost_by_day(compared, BOUND)
    return by_day + _shared_out(compared, compared.bound - compared.objective[BOUND])


def _shared_out(compared: Compared, amounts: Floats) -> Floats:
    """(episodes, days) amounts (episodes,) split over the days by their length."""
    slots = np.array([span.stop - span.start for span in day_spans(compared.case)])
    return np.multiply.outer(amounts, slots / slots.sum())


def varies_days(compared: Compared) -> bool:
    """Whether the days of an episode tell of others: like ones, each with a storm of its own."""
    slots = [span.stop - span.start for span in day_spans(compared.case)]
    is_daily = compared.scenarios.centre is not None and len(set(slots)) == 1
    return is_daily and len(slots) >= LEAST_DAYS


def difference(compared: Compared, method: str, than: str) -> MeanInterval:
    """What `method` costs more per day than another on the same episodes, $, with its interval.

    Days are varied beside episodes where each has a storm of its own and is as long as the others,
    and where there are at least `LEAST_DAYS`; else the interval is about these days alone. Ends are
    NaN where a single episode allows none.
    """
    return _interval(compared, cost_by_day(compared, method), cost_by_day(compared, than))


def over_bound(compared: Compared, method: str) -> MeanInterval:
    """What `method` costs more per day than the bound; as `difference`."""
    return _interval(compared, cost_by_day(compared, method), bound_by_day(compared))


def _interval(compared: Compared, cost: Floats, less: Floats) -> MeanInterval:
    """Mean of a cost (episodes, days) less another, $ per day."""
    days, costs = days_of(compared), np.array([cost, less])
    scale = float(np.abs(costs.sum(-1)).max()) / days
    if not varies_days(compared):
        costs = costs.sum(-1, keepdims=True)
    more = (costs[0] - costs[1]) * costs.shape[-1] / days
    interval = mean_interval(more, compared.scenarios.probability, scale=scale)
    # One episode is one path, however many its days are.
    return interval if interval.n > 1 else replace(interval, low=math.nan, high=math.nan)
