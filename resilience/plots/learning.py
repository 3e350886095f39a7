"""Learning curves: how far above the bound a policy is while it learns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.files import check_picture
from resilience.plots import style
from resilience.rl.training.curves import LearningCurve, interval, load_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOGARITHMIC_FROM = 8.0  # largest over smallest gap, from which the axis is logarithmic


def plot_learning(run: str | Path, path: str | Path | None = None) -> Figure:
    """Draws the gap to the bound on the validation days over the time of training.

    A line per seed, with a dot where its best policy is; with several, their mean and its 95 %
    interval by bootstrap over seeds.

    Args:
        run: folder of a run, or of one per seed.
        path: of the picture (png, pdf or svg); not written if omitted.

    Raises:
        UsageError: no curve, or a suffix that is no picture format.
    """
    if path is not None:
        check_picture(Path(path))
    curves = load_curves(Path(run))
    with style.look():
        return style.write_figure(_draw(curves), path)


def _draw(curves: list[LearningCurve]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.8), layout="constrained")
    axis = figure.subplots()
    _lines(axis, curves)
    if len(curves) > 1:
        when, mean, low, high = interval(curves)
        colour = style.METHOD_COLOURS[0]
        axis.fill_between(when, 100 * low, 100 * high, color=colour, alpha=0.2, lw=0)
        label = f"mean of {len(curves)} seeds, 95 % interval"
        axis.plot(when, 100 * mean, color=colour, lw=2, label=label)
        axis.legend(frameon=False)
    axis.set_xlabel("CPU time of training, s")
    axis.set_ylabel("cost over the bound, %")
    gaps = np.concatenate([curve.gap for curve in curves])
    if gaps.min() > 0 and gaps.max() > LOGARITHMIC_FROM * gaps.min():
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("{x:g}")
    else:
        axis.set_ylim(bottom=min(0.0, 100 * float(gaps.min())))
    axis.set_xlim(left=0.0)
    axis.grid(axis="y", which="both", lw=0.4, color="#d1d5db")
    style.open_frame(axis)
    style.headed(figure, _heading(curves))
    return figure


def _lines(axis: Axes, curves: list[LearningCurve]) -> None:
    is_one = len(curves) == 1
    for k, curve in enumerate(curves):
        colour = style.METHOD_COLOURS[0] if is_one else "#6b7280"
        label = None if is_one or k else "single seeds; a dot where each is best"
        axis.plot(curve.cpu_s, 100 * curve.gap, color=colour, lw=2 if is_one else 0.8, label=label)
        best = int(np.argmin(curve.gap))
        axis.plot(curve.cpu_s[best], 100 * curve.gap[best], "o", color=colour, ms=4)


def _heading(curves: list[LearningCurve]) -> str:
    config, best = curves[0].config, [100 * curve.gap.min() for curve in curves]
    judged = f"best {best[0]:.2f} % over the bound"
    if len(best) > 1:
        judged = f"best of each: median {np.median(best):.2f} %, worst {max(best):.2f} %"
    return f"{config['case']}, {config['method']}, on validation days: {judged}"
