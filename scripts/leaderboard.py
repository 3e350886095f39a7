"""Judges trained policies on the test days, and keeps what came out in docs/leaderboard.csv.

    python scripts/leaderboard.py ieee33-tou --runs "apg 30 s"=RUN/seed-0,RUN/seed-1 --others mpc

Several runs of one entry differ in their seed. A row of the same case, knowledge and entry is
replaced; `docs/concepts/leaderboard.md` is made from the file.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import resilience as rs
from resilience.evaluation.measures.intervals import mean_interval
from resilience.evaluation.measures.statistics import gap_values
from resilience.evaluation.paired import bound_by_day, cost_by_day
from resilience.rl.checkpoint import case_digest

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "leaderboard.csv"
FIELDS = (
    "case",
    "told",
    "entry",
    "seeds",
    "train_cpu_s",
    "gap_median_percent",
    "gap_worst_percent",
    "gap_low_percent",
    "gap_high_percent",
    "cpu_ms_per_decision",
    "episodes",
    "commit",
    "case_digest",
)
"""Columns: the gap is that of the mean cost of all episodes to the bound; its median and its worst
are over seeds, its 95 % interval is over seeds, episodes and days, each drawn anew."""
KEY = ("case", "told", "entry")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="leaderboard.py")
    parser.add_argument("case")
    parser.add_argument("--runs", nargs="*", default=[], metavar="ENTRY=RUN,RUN")
    parser.add_argument("--others", nargs="*", default=[], metavar="METHOD")
    parser.add_argument("--days", type=int, default=16)
    parser.add_argument("--draws", type=int, default=32)
    parser.add_argument("--forecast-error", default="none")
    parser.add_argument("--unknown-centre", action="store_true")
    return parser.parse_args()


def entries(options: argparse.Namespace) -> dict[str, list[str]]:
    """Every entry's methods, one per seed."""
    methods: dict[str, list[str]] = {name: [name] for name in options.others}
    for text in options.runs:
        entry, _, folders = text.partition("=")
        kind = entry.split()[0]
        methods[entry] = [f"{kind}:{folder}" for folder in folders.split(",")]
    return methods


def trained_s(method: str) -> float:
    """CPU-seconds that a run was trained for; 0 of what is not trained."""
    _, _, folder = method.partition(":")
    if not folder:
        return 0.0
    *_, last = (Path(folder) / "log.jsonl").read_text(encoding="utf-8").splitlines()
    return float(json.loads(last)["cpu_s"])


def judged(options: argparse.Namespace) -> list[dict[str, Any]]:
    """A row per entry."""
    methods = entries(options)
    report = rs.compare(
        options.case,
        ["rule-0.9", *(name for names in methods.values() for name in names)],
        days=options.days,
        draws=options.draws,
        forecast_error=options.forecast_error,
        known_centre=not options.unknown_centre,
    )
    frame, bound, likely = report.frame(), bound_by_day(report), report.scenarios.probability
    centre = "centre unknown" if options.unknown_centre else "centre told"
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    rows = []
    for entry, names in {"rule-0.9": ["rule-0.9"], **methods}.items():
        gaps = frame.loc[names, "gap_percent"].to_numpy(float)
        costs = np.array([cost_by_day(report, name) for name in names])
        span = mean_interval(100.0 * gap_values(costs, bound, likely), likely)
        rows.append(
            {
                "case": options.case,
                "told": f"errors {options.forecast_error}, {centre}",
                "entry": entry,
                "seeds": len(names),
                "train_cpu_s": f"{median(trained_s(name) for name in names):.0f}",
                "gap_median_percent": f"{median(gaps):.2f}",
                "gap_worst_percent": f"{max(gaps):.2f}",
                "gap_low_percent": f"{span.low:.2f}",
                "gap_high_percent": f"{span.high:.2f}",
                "cpu_ms_per_decision": f"{frame.loc[names, 'cpu_ms_per_decision'].median():.3f}",
                "episodes": report.scenarios.n,
                "commit": commit.stdout.strip(),
                "case_digest": case_digest(report.case),
            }
        )
    return rows


def main() -> None:
    """Judges, and writes the table anew with what came out."""
    rows = {}
    if TABLE.exists():
        with TABLE.open(encoding="utf-8", newline="") as file:
            rows = {tuple(row[key] for key in KEY): row for row in csv.DictReader(file)}
    fresh = judged(arguments())
    rows |= {tuple(str(row[key]) for key in KEY): row for row in fresh}
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[key] for key in sorted(rows))
    for row in fresh:
        print(*row.values(), sep="  ")


if __name__ == "__main__":
    main()
