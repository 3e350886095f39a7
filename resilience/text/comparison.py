"""A comparison as text for a terminal: a verdict in words, and a table as wide as there is room.

A column is a line in `COLUMNS`. It is shown where the report's frame has its key and where the
terminal has room; the highest ranks are left out first. No number is ever cut.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table
from rich.text import Text

from resilience.dispatch.comb import COMB
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND
from resilience.evaluation.verdict import few_events, verdict, yardsticks

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from resilience.evaluation.compare import Report

COLUMN_GAP = 2  # blanks between columns


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes:
        key: column of the frame; of an interval the two ends, low and high.
        head: its name.
        unit: its unit, which stands below the name.
        digits: decimals where the values are below 100; fewer above, never more.
        rank: 1 is shown first, the highest rank is left out first.
        about: what the head leaves open, for the legend.
        scale: the value is multiplied by it.
        sign: whether a plus is shown.
    """

    key: str | tuple[str, str]
    head: str
    unit: str
    digits: int
    rank: int
    about: str = ""
    scale: float = 1.0
    sign: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The columns of the frame that it needs."""
        return (self.key,) if isinstance(self.key, str) else self.key

    def texts(self, frame: pd.DataFrame) -> list[str]:
        """A text per row; what is not defined is empty."""
        values = [self.scale * frame[key].to_numpy(float) for key in self.keys]
        sizes = sorted(abs(v) for v in values[0] if math.isfinite(v))
        middle = sizes[len(sizes) // 2] if sizes else 0.0
        digits = max(min(self.digits, 3 - math.floor(math.log10(max(middle, 1.0)))), 0)
        return [self._text(ends, digits) for ends in zip(*values, strict=True)]

    def _text(self, ends: tuple[float, ...], digits: int) -> str:
        if not all(map(math.isfinite, ends)):
            return ""
        sign = "+" if self.sign else ""
        # Adding 0.0 makes a rounded -0.0 a plain zero.
        return " to ".join(f"{round(end, digits) + 0.0:{sign}.{digits}f}" for end in ends)


COLUMNS = (
    Column("cost_per_day", "cost", "$/day", 2, 1),
    Column("over_rule_per_day", "over rule", "$/day", 2, 7, f"cost above {REFERENCE}", sign=True),
    Column(
        ("over_rule_low", "over_rule_high"),
        "95 % interval",
        "$/day",
        2,
        3,
        f"of the cost above {REFERENCE}; without zero in it, not luck",
        sign=True,
    ),
    Column("gap_percent", "gap", "%", 2, 4, "cost above the bound"),
    Column(
        "over_comb_percent", "over comb", "%", 2, 4, "cost above that of comb on these episodes"
    ),
    Column("over_dual_percent", "over dual", "%", 2, 4, "cost above the dual bound"),
    Column("score", "score", "", 2, 6, f"1 is the bound, 0 is {REFERENCE}"),
    Column("shed_mwh_per_day", "shed", "MWh/day", 3, 2),
    Column("lolp", "LOLP", "%", 2, 9, "share of time in which anything is shed", 100.0),
    Column("worst_per_day", "worst", "$/day", 2, 8, "episode"),
    Column("ac_v_min_pu", "V min", "pu", 3, 5, "lowest voltage by AC power flow"),
    Column(
        "ac_outside_percent",
        "outside",
        "%",
        2,
        5,
        "slots in which AC power flow finds a limit exceeded",
    ),
    Column("ac_unfunded_mwh_per_day", "unfunded", "MWh/day", 2, 11, "AC losses not reckoned with"),
    Column("ms_per_decision", "time", "ms", 2, 10, "per decision"),
    Column("build_cpu_s", "build", "CPU-s", 1, 12, "before the first decision"),
    Column("cvar95_day", "CVaR-95", "$/day", 2, 10, "mean of the worst 5 % of days"),
    Column("worst_day", "worst day", "$", 1, 13),
    Column("iqm_per_day", "IQM", "$/day", 2, 14, "interquartile mean of the episodes"),
    Column("asidi_h_per_day", "ASIDI", "h/day", 3, 15, "outage of the average MW"),
    Column("critical_served_percent", "critical", "%", 2, 8, "energy of critical loads served"),
    Column("critical_lasts_h", "lasts", "h", 1, 8, "until a critical load is shed"),
    Column("asifi_per_day", "ASIFI", "1/day", 3, 17, "interruptions of the average MW"),
    Column("shed_mw_slots_per_day", "shed", "MW-slots", 2, 16, "a day, the paper's unit"),
    Column("eens_mwh", "EENS", "MWh", 2, 18, "expected energy not served in an episode"),
    Column("ac_loss_mwh_per_day", "losses", "MWh/day", 2, 19, "by AC power flow"),
)
"""Every column that there may be, in the order in which they stand."""


def print_report(report: Report, console: Console) -> None:
    """Prints a comparison: what was compared, the verdict, and a row per dispatcher.

    The bound is the first row, then the cheapest. Columns are as many as the terminal has room for.
    """
    name = (report.case.name, "bold")
    console.print(Text.assemble(name, "  ", ", ".join(report.setting)), highlight=False)
    console.print()
    for sentence, style in zip(verdict(report), ("bold", *[""] * 9), strict=False):
        console.print(sentence, style=style, highlight=False)
    for sentence in yardsticks(report):
        console.print(sentence, highlight=False)
    console.print()
    frame = ordered(report.frame())
    shown = chosen(frame, console.width)
    console.print(_table(frame, shown))
    console.print()
    if events := few_events(report):
        console.print(events, highlight=False)
        console.print()
    console.print(_legend(frame, shown), style="dim", highlight=False)


def ordered(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame of a report with the bound first, and nothing of the reference above itself."""
    frame = frame.sort_values("cost_per_day", kind="stable")
    names = [name for name in frame.index if name != BOUND]
    frame = frame.loc[[*(name for name in frame.index if name == BOUND), *names]]
    # What the reference costs above itself needs no number.
    rule = np.asarray(frame.index == REFERENCE)
    for key in ("over_rule_per_day", "over_rule_low", "over_rule_high"):
        frame[key] = np.where(rule, np.nan, frame[key].to_numpy(float))
    return frame


def chosen(frame: pd.DataFrame, width: int) -> list[Column]:
    """The columns that the frame has and that fit into `width` letters, first ranks first."""
    room = width - max(map(len, ["method", *map(str, frame.index)]))
    fitting = []
    for column in sorted(filled(frame), key=lambda c: c.rank):
        needed = _width(column, column.texts(frame)) + COLUMN_GAP
        if needed <= room:
            room -= needed
            fitting.append(column)
    return [column for column in COLUMNS if column in fitting]


def filled(frame: pd.DataFrame) -> list[Column]:
    """The columns that the frame has and that say anything of any method."""
    there = [column for column in COLUMNS if set(column.keys) <= set(frame.columns)]
    return [column for column in there if any(column.texts(frame))]


def _width(column: Column, texts: list[str]) -> int:
    return max(map(len, [column.head, column.unit, *texts]))


def _table(frame: pd.DataFrame, shown: list[Column]) -> Table:
    from rich import box

    # The box sets one blank between columns.
    right = (0, COLUMN_GAP - 1, 0, 0)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=right, show_edge=False)
    names = ["method", *map(str, frame.index)]
    table.add_column("method\n", min_width=max(map(len, names)), overflow="fold")
    cells = [column.texts(frame) for column in shown]
    for column, texts in zip(shown, cells, strict=True):
        head = f"{column.head}\n{column.unit}"
        width = _width(column, texts)
        table.add_column(head, justify="right", min_width=width, overflow="fold", no_wrap=True)
    for k, name in enumerate(frame.index):
        label = Text(str(name), "italic" if name == BOUND else "")
        table.add_row(label, *(texts[k] for texts in cells), end_section=name == BOUND)
    return table


def _legend(frame: pd.DataFrame, shown: list[Column]) -> str:
    parts = [f"{BOUND}: the bound, storms known in advance"]
    if COMB in frame.index:
        parts.append(f"{COMB}: the optimum of whoever knows all but the end of the blackout")
    parts += [f"{column.head}: {column.about}" for column in shown if column.about]
    text = "; ".join(parts) + "."
    hidden = len(filled(frame)) - len(shown)
    if hidden:
        text += f" A wider terminal shows {hidden} more columns; --json and --out have them all."
    return text
