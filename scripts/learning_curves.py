"""Keeps the learning curves of runs in docs/curves.csv, and draws all that is there.

    resilience train ieee33-tou --method apg --budget 30s --seeds 0,1,2,3,4 --out RUN
    python scripts/learning_curves.py "apg 30 s"=RUN ...

Curves of the same case, knowledge and entry are replaced. Gaps are on validation days; what a
policy is worth on the test days is in docs/leaderboard.csv. Without runs, only draws.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.plots import style
from resilience.rl.training.curves import LearningCurve, interval, load_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "curves.csv"
PICTURE = ROOT / "docs" / "images" / "learning-curves.png"
FIELDS = ("case", "told", "entry", "seed", "cpu_s", "gap_percent", "commit", "command")
"""Columns: CPU-seconds of training, and how far above the bound the validation days cost then."""
KEY = ("case", "told", "entry")
COLUMNS = 2  # of panels


def command(config: dict[str, Any]) -> str:
    """What a run is repeated with, on a machine of any speed."""
    words = ["resilience train", config["case"], "--method", config["method"]]
    words += ["--iterations", str(config["iterations"]), "--seeds", str(config["seed"])]
    words += ["--days", str(config["days"])] if config["days"] > 1 else []
    if config["forecast_error"] != "none":
        words += ["--forecast-error", config["forecast_error"]]
    return " ".join(words + ([] if config["known_centre"] else ["--unknown-centre"]))


def rows_of(entry: str, curve: LearningCurve, commit: str) -> Iterator[dict[str, str]]:
    """A row per validation."""
    config = curve.config
    centre = "centre told" if config["known_centre"] else "centre unknown"
    for cpu_s, gap in zip(curve.cpu_s, curve.gap, strict=True):
        yield {
            "case": config["case"],
            "told": f"errors {config['forecast_error']}, {centre}",
            "entry": entry,
            "seed": str(curve.seed),
            "cpu_s": f"{cpu_s:.1f}",
            "gap_percent": f"{100.0 * gap:.2f}",
            "commit": commit,
            "command": command(config),
        }


def key(row: dict[str, str]) -> tuple[str, ...]:
    """What rows are replaced by."""
    return tuple(row[name] for name in KEY)


def table() -> list[dict[str, str]]:
    """What is there."""
    if not TABLE.exists():
        return []
    with TABLE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def curves_in(rows: list[dict[str, str]]) -> list[LearningCurve]:
    """A curve per seed."""
    curves = []
    for seed, lines in groupby(rows, key=lambda row: row["seed"]):
        points = np.array([(float(line["cpu_s"]), float(line["gap_percent"])) for line in lines])
        curves.append(LearningCurve(int(seed), points[:, 0], points[:, 1], {}))
    return curves


def draw_panel(axis: Axes, rows: list[dict[str, str]]) -> None:
    """Every entry of a case: a thin line per seed, their mean and its interval."""
    for k, (entry, lines) in enumerate(groupby(rows, key=lambda row: row["entry"])):
        curves, colour = curves_in(list(lines)), style.METHOD_COLOURS[k]
        for curve in curves:
            axis.plot(curve.cpu_s, curve.gap, color=colour, lw=0.6, alpha=0.6)
        if len(curves) > 1:
            when, mean, low, high = interval(curves)
            axis.fill_between(when, low, high, color=colour, alpha=0.2, lw=0)
            axis.plot(when, mean, color=colour, lw=2, label=f"{entry}, {len(curves)} seeds")
    axis.set_title(f"{rows[0]['case']}, {rows[0]['told']}", fontsize=9, loc="left")
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter("{x:g}")
    axis.tick_params(which="both", labelsize=8)
    axis.set_xlim(left=0.0)
    axis.grid(axis="y", which="both", lw=0.4, color="#d1d5db")
    axis.legend(frameon=False, fontsize=8)
    style.open_frame(axis)


def draw(rows: list[dict[str, str]]) -> None:
    """Write the picture: a panel per case and knowledge."""
    from matplotlib.figure import Figure

    panels = [list(group) for _, group in groupby(rows, key=lambda row: (row["case"], row["told"]))]
    height = -(-len(panels) // COLUMNS)
    with style.look():
        figure = Figure(figsize=(8.6, 2.9 * height), layout="constrained")
        axes = figure.subplots(height, COLUMNS, squeeze=False).ravel()
        for axis, panel in zip(axes, panels, strict=False):
            draw_panel(axis, panel)
        for axis in axes[len(panels) :]:
            axis.set_visible(False)
        figure.supxlabel("CPU time of training, s", fontsize=9)
        figure.supylabel("cost over the bound on validation days, %", fontsize=9)
        style.write_figure(figure, PICTURE)


def main() -> None:
    """Takes runs in, writes the table anew and draws it."""
    parser = argparse.ArgumentParser(prog="learning_curves.py")
    parser.add_argument("runs", nargs="*", metavar="ENTRY=RUN")
    git = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, cwd=ROOT, check=True, capture_output=True, text=True)
    fresh: list[dict[str, str]] = []
    for text in parser.parse_args().runs:
        entry, _, folder = text.partition("=")
        for curve in load_curves(Path(folder)):
            fresh += rows_of(entry, curve, commit.stdout.strip())
    replaced = {key(row) for row in fresh}
    rows = sorted([row for row in table() if key(row) not in replaced] + fresh, key=key)
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw(rows)


if __name__ == "__main__":
    main()
