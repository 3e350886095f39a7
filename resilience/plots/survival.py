"""Survival as a picture: the chance that loads are served, by the duration of the outage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.evaluation.survival import Survival
from resilience.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_survival(survival: Survival, path: str | Path | None = None) -> Figure:
    """Draws the chance of being fully served over the duration of the outage.

    Lines are exact for the starts behind which profiles are long enough for the longest duration;
    dots and bars are the durations that were asked for, each with all starts that it fits behind.

    Args:
        survival: from `resilience.survive`.
        path: a .png, .pdf or .svg file.

    Raises:
        UsageError: a suffix that is no picture format.
    """
    return style.picture(lambda: _draw(survival), path)


def _draw(survival: Survival) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.8), layout="constrained")
    axis = figure.subplots()
    table, longest = survival.frame(), max(survival.durations_h)
    fits = survival.ahead_h >= longest
    kinds = (("all", survival.all_h, 2.4, "s"), ("critical", survival.critical_h, 1.2, "o"))
    for colour, (kind, lasts_h, width, mark) in zip(style.METHOD_COLOURS, kinds, strict=False):
        if lasts_h is None:
            continue
        share, low, high = (100 * table[f"{kind}_{x}"] for x in ("served", "low", "high"))
        hours = np.unique(np.append(lasts_h[fits & (lasts_h <= longest)], [0.0, longest]))
        chance = [100 * float((lasts_h[fits] >= h).mean()) for h in hours]
        axis.step(hours, chance, where="pre", color=colour, lw=width, label=f"{kind} loads")
        off = np.maximum([share - low, high - share], 0.0)
        axis.errorbar(table.index, share, off, fmt=mark, color=colour, ms=4, lw=0.8, capsize=2)
    axis.set_xlabel("hours without the main grid")
    axis.set_ylabel("fully served, % of starts")
    axis.set_ylim(0.0, 103.0)
    axis.set_xlim(left=0.0)
    axis.grid(axis="y", lw=0.4, color="#d1d5db")
    axis.legend(frameon=False, loc="lower left")
    style.open_frame(axis)
    style.headed(
        figure, f"{survival.case.name}: {len(survival.start)} losses of the grid, {survival.method}"
    )
    return figure
