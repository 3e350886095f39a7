"""Which storm is drawn, and the arrays that are drawn of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError, did_you_mean
from resilience.evaluation.comparison import Compared, day_spans
from resilience.plots.storm_data import FeederView, MethodView, feeder, load_groups, method_view

if TYPE_CHECKING:
    from resilience.case import Case

Day = int | str | None
MAX_METHODS = 6  # beside each other


@dataclass(frozen=True)
class EpisodeView:
    """Everything that is drawn.

    Attributes:
        case: the case.
        which: episode and day, in words.
        start: time of the first slot drawn.
        hours: (slots + 1,) begin of every slot, and the end, h.
        feeder: what everybody shares.
        methods: what each method did.
        groups: loads whose shedding is stacked.
    """

    case: Case
    which: str
    start: datetime
    hours: Floats
    feeder: FeederView
    methods: dict[str, MethodView]
    groups: list[tuple[str, Ints]]


def storm(
    compared: Compared,
    methods: str | Sequence[str],
    episode: int | None = None,
    day: Day = None,
) -> EpisodeView:
    """The arrays that `plot_storm` draws; arguments and errors as there."""
    names = [methods] if isinstance(methods, str) else list(dict.fromkeys(methods))
    _check(compared, names, episode, day)
    case, scenarios = compared.case, compared.scenarios
    spans = day_spans(case)
    k, d = _worst(compared, names, spans, episode, day)
    span = slice(0, case.slots) if day == "all" else spans[d]
    shared = feeder(case, scenarios, k, span)
    exact = getattr(compared, "forecast_error", "none") == "none"
    views = {
        name: method_view(case, compared.trajectories[name], shared, k, span, exact)
        for name in names
    }
    return EpisodeView(
        case=case,
        which=_which(k, d, scenarios.n, len(spans), day == "all"),
        start=case.start + timedelta(hours=span.start * case.step_h),
        hours=np.arange(span.stop - span.start + 1) * case.step_h,
        feeder=shared,
        methods=views,
        groups=load_groups(case, shared, [view.shed for view in views.values()]),
    )


def _which(episode: int, day: int, episodes: int, days: int, all_days: bool) -> str:
    span = f"all {days} days" if all_days else f"day {day + 1} of {days}"
    return f"{span}, episode {episode + 1} of {episodes}"


def _check(compared: Compared, names: list[str], episode: int | None, day: Day) -> None:
    methods = list(compared.trajectories)
    unknown = [name for name in names if name not in methods]
    if unknown:
        strangers = ", ".join(map(repr, unknown))
        raise UsageError(
            f"method {strangers} was not compared; allowed: {', '.join(methods)}",
            hint=did_you_mean(unknown[0], methods),
        )
    if not 0 < len(names) <= MAX_METHODS:
        raise UsageError(
            f"{len(names)} methods; allowed: 1 to {MAX_METHODS} beside each other",
            hint="name fewer",
        )
    _check_number("episode", episode, compared.scenarios.n, "")
    if day != "all":
        _check_number("day", day, len(day_spans(compared.case)), ", or all")


def _check_number(name: str, value: int | str | None, count: int, also: str) -> None:
    if value is not None and not (isinstance(value, int) and 1 <= value <= count):
        raise UsageError(
            f"{name} {value}; allowed: 1 to {count}{also}", hint=f"{name}s count from 1"
        )


def _worst(
    compared: Compared, names: list[str], spans: list[slice], episode: int | None, day: Day
) -> tuple[int, int]:
    """Episode and day, counted from 0: as asked for, or where most is shed, or most is out."""
    begin = [span.start for span in spans]
    shed = sum(compared.trajectories[name].shed.sum(0) for name in names)
    out = compared.scenarios.down.sum(0)
    score = np.add.reduceat(np.round(shed, 6), begin, axis=0)
    if not score.any():
        score = np.add.reduceat(out, begin, axis=0)
    allowed = np.ones(score.shape, bool)
    if isinstance(day, int):
        allowed &= np.arange(len(spans))[:, None] == day - 1
    if episode is not None:
        allowed &= np.arange(score.shape[1])[None] == episode - 1
    worst_day, worst_episode = np.unravel_index(
        np.where(allowed, score, -1.0).argmax(), score.shape
    )
    return int(worst_episode), int(worst_day)
