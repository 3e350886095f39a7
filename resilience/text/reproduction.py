"""A reproduction as text: a table per experiment, with what the source paper prints below."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND
from resilience.rl.reproduce.published import OPEN

if TYPE_CHECKING:
    from rich.console import Console

    from resilience.evaluation.measures.intervals import MeanInterval
    from resilience.rl.reproduce.figures import Figures
    from resilience.rl.reproduce.outage_day import OutageDay
    from resilience.rl.reproduce.outcomes import Outcome
    from resilience.rl.reproduce.run import LearningSummary, Reproduction

COLUMNS = (
    ("average", "average", "$/day", 2),
    ("highest", "highest", "$/day", 2),
    ("lowest", "lowest", "$/day", 2),
    ("shed_mwh", "shed", "MWh/day", 2),
    ("shed_mw_slots", "shed", "MW-slots", 2),
    ("gap_percent", "gap", "%", 1),
)
"""Of the tables of costs: figure, head, unit, decimals."""
SPAN_WIDTH = 9
"""Letters of an interval at most, with as many decimals as fit: eight columns in 80 letters."""
LABEL_WIDTH = 14
HOURS_AROUND = 3  # of an outage, that are printed with it


def print_reproduction(result: Reproduction, console: Console) -> None:
    """Prints all experiments, trainings, the day with an outage, and what the paper leaves open."""
    scale = result.scale
    console.print(
        f"{result.case}: the source paper's experiments, {scale.days} test days, {scale.draws} "
        f"storms each, {scale.seeds} training{'s' * (scale.seeds > 1)} of every learner",
        style="bold",
        highlight=False,
        markup=False,
    )
    for note in result.notes:
        console.print(note, highlight=False, markup=False)
    console.print(
        "Intervals are 95 %, over days, storms and trainings; below stand the paper's figures.",
        highlight=False,
    )
    for number, (title, group) in enumerate(groupby(result.outcomes, key=lambda o: o.title)):
        outcomes = list(group)
        _heading(console, title, outcomes)
        console.print(_costs(outcomes, with_references=number == 0))
        if number == 0 or outcomes[0].case != result.outcomes[0].case:
            console.print()
            console.print(_times(outcomes[0].rows))
        console.print()
        for sentence in dict.fromkeys(map(_telling, outcomes)):
            console.print(sentence, highlight=False, markup=False)
        for note in (note for o in outcomes for note in o.notes):
            console.print(note, highlight=False, markup=False)
    _title(console, "learning, gap to the bound on validation days")
    console.print(_learning(result.learning))
    _title(console, f"storage in an outage: {result.storm.label}, day {result.storm.day}")
    console.print(_storm(result.storm))
    _title(console, "what the paper leaves open, and what is done here")
    console.print(_open())


def _telling(outcome: Outcome) -> str:
    """Whether the case can tell methods apart, for the world that it was asked in."""
    if not outcome.telling:
        return "The gap is to the bound of the economic recourse, and holds the difference of both."
    words = outcome.telling.removeprefix("But ")
    if outcome.variant:
        return f"{outcome.variant}: {words[0].lower()}{words[1:]}"
    return words[0].upper() + words[1:]


def _title(console: Console, words: str) -> None:
    console.print()
    console.print(words, style="bold", highlight=False, markup=False)


def _heading(console: Console, title: str, outcomes: Sequence[Outcome]) -> None:
    cases = ", ".join(dict.fromkeys(outcome.case for outcome in outcomes))
    _title(console, f"{title} ({cases})")


def _table(label: str, columns: Iterable[tuple[str, str]]) -> Table:
    from rich import box

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column(f"{label}\n", no_wrap=True, min_width=LABEL_WIDTH)
    for head, unit in columns:
        table.add_column(f"{head}\n{unit}", justify="right", no_wrap=True)
    return table


def _costs(outcomes: Sequence[Outcome], *, with_references: bool) -> Table:
    table = _table("method", ((head, unit) for _, head, unit, _ in COLUMNS))
    for outcome in outcomes:
        for row in outcome.rows:
            if row.label in (REFERENCE, BOUND) and not with_references:
                continue
            cells = [(row, name, digits) for name, _, _, digits in COLUMNS]
            table.add_row(
                Text(outcome.variant or row.label),
                *(_number(r.statistics[name].mean, digits) for r, name, digits in cells),
            )
            table.add_row(
                Text("  95 %", "dim"),
                *(Text(_span(r.statistics[name], digits), "dim") for r, name, digits in cells),
            )
            if row.paper is not None:
                table.add_row(
                    Text("  paper", "italic"),
                    *(
                        Text(_number(r.published(name), digits), "italic")
                        for r, name, digits in cells
                    ),
                )
    return table


def _times(rows: Sequence[Figures]) -> Table:
    heads = (
        ("training", "CPU-s"),
        ("decision", "ms"),
        ("power flow", "ms/slot"),
        ("outside", "%"),
        ("V min", "pu"),
        ("paper, all", "s"),
    )
    table = _table("method", heads)
    for row in rows:
        table.add_row(
            Text(row.label),
            _number(row.training_cpu_s, 1),
            _number(row.decision_ms, 2),
            _number(row.power_flow_ms, 3),
            _number(row.outside_percent, 1),
            _number(row.v_min_pu, 3),
            Text(_number(row.paper.time_s if row.paper else None, 1), "italic"),
        )
    return table


def _learning(curves: Sequence[LearningSummary]) -> Table:
    heads = (("training", "CPU-s"), ("first", "%"), ("best", "%"), ("last", "%"), ("worst", "%"))
    table = _table("method", heads)
    for curve in curves:
        gaps = (curve.first_gap, curve.best_gap, curve.last_gap, curve.worst_gap)
        table.add_row(
            Text(curve.label),
            _number(curve.cpu_s, 1),
            *(_number(100.0 * gap, 2) for gap in gaps),
        )
    return table


def _storm(storm: OutageDay) -> Table:
    heads = (
        ("lines", "out"),
        ("load", "MW"),
        ("PV", "MW"),
        ("storage", "MW"),
        ("SoC", "%"),
        ("shed", "MW"),
    )
    table = _table("hour", heads)
    out = [k for k, hour in enumerate(storm.hours) if hour["lines_out"]]
    first, last = (out[0], out[-1]) if out else (0, len(storm.hours) - 1)
    for hour in storm.hours[max(first - HOURS_AROUND, 0) : last + HOURS_AROUND + 1]:
        table.add_row(
            str(hour["time"]),
            str(hour["lines_out"] or ""),
            _number(hour["load_mw"], 2),
            _number(hour["pv_mw"], 2),
            f"{hour['storage_mw'] + 0.0:+.2f}",
            _number(100.0 * hour["soc"], 0),
            _number(hour["shed_mw"], 2),
        )
    return table


def _open() -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for head in ("setting", "in the paper", "here"):
        table.add_column(head, overflow="fold")
    for row in OPEN:
        table.add_row(*(Text(words) for words in row))
    return table


def _number(value: float | None, digits: int) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _span(value: MeanInterval, digits: int) -> str:
    if not math.isfinite(value.low):
        return ""
    digits = min(digits, 1) if abs(value.high) >= 10.0 else digits
    digits = 0 if abs(value.high) >= 100.0 else digits
    texts = [
        f"{_number(value.low, fewer)}–{_number(value.high, fewer)}"
        for fewer in range(digits, -1, -1)
    ]
    return next((text for text in texts if len(text) <= SPAN_WIDTH), texts[-1])
