"""Learning curves of runs on disk, and what several seeds say together."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.files import reading
from resilience.inputs import read_table, read_text

CONFIG_FILE, CURVE_FILE = "config.json", "curve.csv"
LAST_FILE, RESULT_FILE = "last.safetensors", "result.json"
COLUMNS = ("iteration", "cpu_s", "loss", "cost_per_day", "gap")
RESAMPLES = 2000
POINTS = 60  # in time, at which seeds are held against each other
CONFIDENCE = 0.95


@dataclass(frozen=True)
class LearningCurve:
    """What a run has logged.

    Attributes:
        seed: of the run.
        cpu_s: (lines,) CPU-seconds of training.
        gap: (lines,) over the bound on the validation days, relative.
        config: what the run was started with.
    """

    seed: int
    cpu_s: Floats
    gap: Floats
    config: dict[str, Any]


class Interval(NamedTuple):
    """The mean over seeds, arrays (points,).

    Attributes:
        cpu_s: when.
        mean: of the gaps then, each between the two lines around.
        low, high: ends of its interval, by bootstrap over seeds.
    """

    cpu_s: Floats
    mean: Floats
    low: Floats
    high: Floats


def run_folders(folder: Path) -> list[Path]:
    """The runs in a folder: itself, or a sub-folder per seed; none if it is neither."""
    if (folder / CURVE_FILE).is_file():
        return [folder]
    return sorted(
        (path.parent for path in folder.glob(f"seed-*/{CURVE_FILE}")),
        key=lambda path: (len(path.name), path.name),
    )


def load_curves(folder: Path) -> list[LearningCurve]:
    """The curves of the runs in a folder.

    Raises:
        UsageError: there is none, one cannot be read, or they are of different cases or methods.
    """
    curves = [_curve(run) for run in run_folders(folder)]
    if not curves:
        raise UsageError(
            f"{folder} holds no learning curve ({CURVE_FILE})",
            hint="a run has one from its first validation on",
        )
    for key in ("case", "method"):
        if len(values := sorted({str(c.config.get(key)) for c in curves})) > 1:
            raise UsageError(
                f"{folder} holds runs of different {key}s: {', '.join(values)}; allowed: one",
                hint="draw them one by one",
            )
    return curves


def _curve(run: Path) -> LearningCurve:
    with reading(run / CURVE_FILE, "learning curve"):
        table = read_table(run / CURVE_FILE)
        config = json.loads(read_text(run / CONFIG_FILE))
        cpu_s, gap = (
            np.array([table.number(cell) for cell in table.cells(name)], float)
            for name in ("cpu_s", "gap")
        )
        if not (len(gap) and np.isfinite([cpu_s, gap]).all()):
            raise ValueError("no row, or cells that are no numbers")
        return LearningCurve(int(config["seed"]), cpu_s, gap, config)


def interval(curves: list[LearningCurve], seed: int = 0) -> Interval:
    """The mean over seeds and its interval, over the time that all of them have.

    Args:
        curves: of two seeds or more.
        seed: of the resampling.
    """
    first = max(curve.cpu_s[0] for curve in curves)
    last = max(min(curve.cpu_s[-1] for curve in curves), first)
    when = np.linspace(first, last, POINTS)
    gaps = np.array([np.interp(when, curve.cpu_s, curve.gap) for curve in curves])
    chosen = np.random.default_rng(seed).integers(len(gaps), size=(RESAMPLES, len(gaps)))
    means = gaps[chosen].mean(1)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(means, [tail, 1.0 - tail], axis=0)
    return Interval(when, gaps.mean(0), low, high)
