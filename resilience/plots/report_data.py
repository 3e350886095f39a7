"""What is drawn of a comparison, as arrays: episodes and days of every method, and what is shed."""

from __future__ import annotations

from dataclasses import dataclass

from resilience.arrays import Floats
from resilience.evaluation.comparison import BOUND, Compared
from resilience.evaluation.measures.intervals import MeanInterval
from resilience.evaluation.paired import daily_cost, days_of, over_bound
from resilience.evaluation.verdict import ranked, shed_per_day


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
    mean = over_bound(compared, name)
    return Record(name, over, mean, daily_cost(compared, name), shed_per_day(compared, name))


def has_bound(compared: Compared) -> bool:
    """Whether the bound's own trajectory is there to be drawn."""
    return BOUND in compared.trajectories
