"""Water values as a picture: time across, state of charge upwards, $/MWh as colour."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.files import check_picture
from resilience.plots.style import headed, look, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from resilience.dispatch.sddp.values import WaterValues


def plot_water_values(values: WaterValues, path: str | Path | None = None) -> Figure:
    """One panel per storage unit.

    Args:
        values: from `water_values`.
        path: where to write the picture, if anywhere.

    Raises:
        UsageError: the suffix is no picture format.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    if path is not None:
        check_picture(Path(path))
    n, slots = len(values.units), values.per_mwh.shape[1]
    hours = np.arange(1, slots + 1) * values.step_h
    positive = values.per_mwh[values.per_mwh > 0.0]
    low = max(float(positive.min(initial=np.inf)), 1e-2) if len(positive) else 1e-2
    norm = LogNorm(low, max(float(values.per_mwh.max()), low * 1.01), clip=True)
    with look():
        figure = Figure(figsize=(7.0, 0.8 + 1.5 * n), layout="constrained")
        axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
        for axis, name, bus, worth in zip(
            axes, values.units, values.buses, values.per_mwh, strict=True
        ):
            shown = axis.pcolormesh(hours, values.soc, worth.T, norm=norm, cmap="cividis")
            axis.set_title(f"{name}, bus {bus}", loc="left", fontsize=9)
            axis.set_ylabel("state of charge")
        axes[-1].set_xlabel("hour of the day")
        figure.colorbar(
            shown, ax=list(axes), label="worth of stored energy, $/MWh".replace("$", r"\$")
        )
        headed(figure, f"Water values: {values.about}")
        return write_figure(figure, path)
