"""MkDocs hook: the table of `concepts/leaderboard.md`, made from `docs/leaderboard.csv`."""

import csv
from itertools import groupby
from pathlib import Path
from typing import Any

TABLE = Path(__file__).parents[1] / "leaderboard.csv"
PAGE = "concepts/leaderboard.md"
MARK = "<!-- leaderboard -->"
HEAD = (
    "| | seeds | training, CPU-s | median % | worst % | 95 % interval | decision, ms | commit |\n"
    "|---|---:|---:|---:|---:|---:|---:|---|\n"
)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fill the page."""
    return markdown.replace(MARK, tables()) if page.file.src_uri == PAGE else markdown


def tables() -> str:
    """Return a section per case and knowledge, its entries by their median."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = sorted(csv.DictReader(file), key=lambda row: (row["case"], row["told"]))
    sections = []
    for (case, told), group in groupby(rows, key=lambda row: (row["case"], row["told"])):
        entries = sorted(group, key=lambda row: float(row["gap_median_percent"]))
        sections.append(f"### {case}, {told}\n\n{HEAD}" + "".join(map(line, entries)))
    return "\n".join(sections)


def line(row: dict[str, str]) -> str:
    """Return a row of a table."""
    span = f"{row['gap_low_percent']} to {row['gap_high_percent']}"
    cells = (
        row["entry"],
        row["seeds"],
        row["train_cpu_s"],
        row["gap_median_percent"],
        row["gap_worst_percent"],
        span,
        row["cpu_ms_per_decision"],
        f"`{row['commit']}`",
    )
    return "| " + " | ".join(cells) + " |\n"
