"""A comparison in sentences: which dispatcher is best, by how much, and whether that is luck."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND, Compared, day_spans
from resilience.evaluation.measures.intervals import MeanInterval
from resilience.evaluation.measures.statistics import triviality
from resilience.evaluation.paired import days_of, difference, expected, varies_days

if TYPE_CHECKING:
    from resilience.evaluation.judged import Judged

SHED_RESOLUTION_MWH = 5e-4
"""Shedding per day that is printed alike is called alike, MWh."""


def ranked(compared: Compared) -> list[str]:
    """Dispatchers by mean cost, the cheapest first; the bound is none of them."""
    cost = {name: expected(compared, values) for name, values in compared.objective.items()}
    return sorted((name for name in cost if name != BOUND), key=lambda name: cost[name])


def saving(compared: Compared, method: str, than: str) -> MeanInterval:
    """What `method` saves against another in $/day on the same episodes, with its interval."""
    return difference(compared, than, method)


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
        sentences.append(_luck(saving(compared, best, REFERENCE), _varied(compared)))
    sentences += _as_good(compared, best, others)
    sentences.append(_room(compared))
    return tuple(sentences)


def yardsticks(judged: Judged) -> list[str]:
    """What nobody without foreknowledge stays below, in sentences; none where nothing is known."""
    days, sentences = judged.days, []
    if judged.comb is not None:
        sentences.append(
            f"Nobody who does not know the end of the blackout costs less than "
            f"{judged.comb / days:.2f} $/day on average over all ends (comb)."
        )
    if judged.dual is not None:
        bound = judged.dual.mean(judged.objective) / days
        sentences.append(
            f"Nobody without foreknowledge costs less than {bound:.2f} $/day on average, as far as "
            f"these episodes show (dual bound; the clairvoyant's is "
            f"{expected(judged, judged.bound) / days:.2f})."
        )
    return sentences


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


def _varied(compared: Compared) -> str:
    """What an interval is over, in words."""
    n, days = compared.scenarios.n, len(day_spans(compared.case))
    if varies_days(compared):
        return f"{n} episodes and their {days} days"
    if compared.scenarios.centre is None:
        return f"{n} episodes"
    return f"{n} episodes of {'this day' if days == 1 else f'these {days} days'} alone"


def _luck(gain: MeanInterval, varied: str) -> str:
    if math.isnan(gain.low):
        return "One episode says nothing about luck; ask for more with --draws."
    span = f"{gain.low:.2f} to {gain.high:.2f} $/day"
    if gain.excludes_zero:
        words = f"That is not luck: the 95 % interval of the saving over {varied} is {span}."
    else:
        words = (
            f"That may be luck: the 95 % interval of the saving over {varied} is {span} and "
            "includes zero; more --draws narrow it."
        )
    return words + (f" Few events: {carried(gain)} of it." if gain.few_events else "")


def few_events(compared: Compared) -> str:
    """Which methods differ from rule 0.9 by a few events only, in words; empty where none does."""
    parts = []
    for name in ranked(compared):
        more = difference(compared, name, REFERENCE)
        if more.few_events:
            parts.append(f"{name} ({carried(more)})")
    if not parts:
        return ""
    return (
        f"Few events make the difference to {REFERENCE}; other storms may turn it: "
        f"{', '.join(parts)}."
    )


def carried(more: MeanInterval) -> str:
    """How few events carry a difference, in words."""
    cells = "day-episodes" if more.days > 1 else "episodes"
    verb = "carries" if more.carriers == 1 else "carry"
    return f"{more.carriers} of {more.n * more.days} {cells} {verb} 80 %"


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
