"""What is drawn of a comparison, as arrays: episodes and days of every method, and what is shed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.evaluation.comparison import BOUND, Compared, day_spans
from resilience.evaluation.measures.statistics import MeanInterval
from resilience.evaluation.verdict import days_of, interval, ranked, shed_per_day


@dataclass(frozen=True)
class Record:
    """One method.

    Attributes:
        name: of the method.
        over: (episodes,) cost above the bound of the same episode, $/day.
        mean: of `over`, with its 95 % interval, NaN where there is one episode.
        daily: (days, episodes) cost of single days, $; see `daily_cost`.
        shed: mean energy not served, MWh/day.
    """

    name: str
    over: Floats
    mean: MeanInterval
    daily: Floats
    shed: float


def records(compared: Compared) -> list[Record]:
    """Every method by mean cost, the cheapest first; the bound is none of them."""
    return [_record(compared, name) for name in ranked(compared)]


def _record(compared: Compared, name: str) -> Record:
    over = (compared.objective[name] - compared.bound) / days_of(compared)
    mean = interval(compared, over)
    return Record(name, over, mean, daily_cost(compared, name), shed_per_day(compared, name))


def daily_cost(compared: Compared, method: str) -> Floats:
    """(days, episodes) $: cost of the day less what the energy gained over the day is worth.

    The days of an episode add up to its objective and the worth of what was stored at its start.
    """
    trajectory, case = compared.trajectories[method], compared.case
    first = [span.start for span in day_spans(case)]
    spent = np.add.reduceat(trajectory.cost, first, axis=0)
    stored = trajectory.energy[:, [*first, case.slots]].sum(0)
    return spent - compared.end_value_per_mwh * np.diff(stored, axis=0)


def has_bound(compared: Compared) -> bool:
    """Whether the bound's own trajectory is there to be drawn."""
    return BOUND in compared.trajectories
