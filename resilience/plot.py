"""One page that shows a plan: power by source, stored energy, shedding, voltages, islands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.errors import UsageError
from resilience.results import Plan, replacing_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from resilience.models.algebra import Floats

COLOURS = {
    "grid": "#6b7280",
    "generators": "#b45309",
    "PV": "#eab308",
    "storage": "#0f766e",
    "shed": "#dc2626",
    "demand": "#111827",
}
ISLANDS = ("#111827", "#dbeafe", "#fde68a", "#bbf7d0", "#fecaca", "#ddd6fe", "#fbcfe8", "#a5f3fc")


def plot_plan(plan: Plan, path: str | Path | None = None) -> Figure:
    """Draws the plan; with `path` (png, pdf or svg) it is also written there.

    Raises:
        UsageError: the suffix is no picture format.
    """
    from matplotlib.figure import Figure

    if path is not None:
        check_suffix(Path(path))
    panels = [_power, _storage, _shed, _voltage, _islands]
    needs = ["power", "soc", "shed", "voltage", "island"]
    drawn = [p for p, need in zip(panels, needs, strict=True) if need in plan.tables]
    if plan.case is not None and plan.case.outages:
        drawn.append(_lines_out)
    heights = [{_power: 2.4, _islands: 1.5, _lines_out: 0.6}.get(p, 1.2) for p in drawn]
    figure = Figure(figsize=(9.0, 1.2 + 1.35 * sum(heights)), layout="constrained")
    axes = figure.subplots(
        len(drawn), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    hours = _hours(plan)
    for axis, panel in zip(axes, drawn, strict=True):
        panel(axis, plan, hours)
        if panel not in (_islands, _lines_out):
            _outages(axis, plan)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    _time_axis(axes[-1], plan, hours)
    figure.suptitle(_title(plan).replace("$", r"\$"), fontsize=10, x=0.01, ha="left")
    if path is not None:
        with replacing_file(Path(path)) as fresh:
            figure.savefig(fresh, dpi=150)
    return figure


def check_suffix(path: Path) -> None:
    """Raises UsageError unless the suffix is a picture format."""
    allowed = (".png", ".pdf", ".svg")
    if path.suffix not in allowed:
        raise UsageError(
            f"cannot draw to {path.name!r}; allowed suffixes: {', '.join(allowed)}",
            hint=f"{path.stem}.png, say",
        )


def _title(plan: Plan) -> str:
    proven = "" if plan.bound is None else f", proven bound {plan.bound:.3f} $"
    return (
        f"{plan.name}: {plan.method} on {plan.physics}, {plan.status}, "
        f"objective {plan.objective:.3f} ${proven}, shed {plan.shed_mwh:.2f} MWh"
    )


def _hours(plan: Plan) -> Floats:
    slots = plan.tables["power"].values.shape[1]
    return np.arange(slots + 1) * plan.step_min / 60.0


def _groups(plan: Plan) -> dict[str, Sequence[str]]:
    case = plan.case
    if case is None:
        raise UsageError("a plan without its case cannot be drawn", hint="keep case.toml beside it")
    return {
        "grid": [t.name for t in case.grid],
        "generators": [t.name for t in case.generator],
        "PV": [t.name for t in case.pv],
        "storage": [t.name for t in case.ess],
    }


def _stairs(axis: Axes, hours: Floats, bottom: Floats, top: Floats, **style: Any) -> None:
    axis.fill_between(
        hours, np.append(bottom, bottom[-1]), np.append(top, top[-1]), step="post", lw=0, **style
    )


def _power(axis: Axes, plan: Plan, hours: Floats) -> None:
    power = plan.tables["power"]
    up = down = np.zeros(power.values.shape[1])
    for name, devices in _groups(plan).items():
        if not devices:
            continue
        flow = np.array([power[d] for d in devices])
        fed, taken = np.maximum(flow, 0.0).sum(0), np.minimum(flow, 0.0).sum(0)
        _stairs(axis, hours, up, up + fed, color=COLOURS[name], label=name)
        _stairs(axis, hours, down, down + taken, color=COLOURS[name])
        up, down = up + fed, down + taken
    if "demand" in plan.tables:
        demand = plan.tables["demand"].values.sum(0)
        shed = plan.tables["shed"].values.sum(0)
        if shed.max() > 1e-4:
            label = "shed"
            style = {"facecolor": "none", "edgecolor": COLOURS["shed"], "hatch": "////"}
            _stairs(axis, hours, demand - shed, demand, label=label, **style)
        axis.step(
            hours,
            np.append(demand, demand[-1]),
            where="post",
            color=COLOURS["demand"],
            lw=1.0,
            label="demand",
        )
    axis.axhline(0.0, color="black", lw=0.5)
    axis.set_ylabel("power, MW")
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, frameon=False, fontsize=8)


def _storage(axis: Axes, plan: Plan, hours: Floats) -> None:
    soc = plan.tables["soc"]
    case = plan.case
    shades = np.linspace(0.15, 0.85, len(soc.labels))
    import matplotlib as mpl

    colours = mpl.colormaps["viridis"](shades)
    for k, label in enumerate(soc.labels):
        start = next((t.soc_initial for t in case.ess if t.name == label), None) if case else None
        values = soc[label]
        line = np.append(values[0] if start is None else start, values)
        axis.plot(hours, line, color=colours[k], lw=1.3, label=label)
    axis.set_ylim(0.0, 1.0)
    axis.set_ylabel("state of\ncharge")
    _aside(axis)


def _aside(axis: Axes) -> None:
    axis.legend(
        loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8, handlelength=1.2
    )


def _shed(axis: Axes, plan: Plan, hours: Floats) -> None:
    shed = plan.tables["shed"]
    total = shed.values.sum(0)
    _stairs(axis, hours, np.zeros_like(total), total, color=COLOURS["shed"])
    axis.set_ylabel("shed, MW")
    axis.set_ylim(0.0, max(1.05 * total.max(), 0.1))
    if total.max() < 1e-4:
        axis.set_yticks([0.0])
        axis.text(0.5, 0.5, "nothing is shed", transform=axis.transAxes, ha="center", va="center")


def _voltage(axis: Axes, plan: Plan, hours: Floats) -> None:
    voltage = plan.tables["voltage"].values
    low, middle, high = np.quantile(voltage, [0.0, 0.5, 1.0], axis=0)
    _stairs(axis, hours, low, high, color="#93c5fd", label="lowest to\nhighest bus")
    axis.step(
        hours, np.append(middle, middle[-1]), where="post", color="#1d4ed8", lw=1.0, label="median"
    )
    if plan.case is not None:
        for limit in (plan.case.network.v_min_pu.min(), plan.case.network.v_max_pu.max()):
            axis.axhline(limit, color="#dc2626", lw=0.8, ls="--")
    axis.set_ylabel("voltage, pu")
    _aside(axis)


def _islands(axis: Axes, plan: Plan, hours: Floats) -> None:
    from matplotlib.colors import ListedColormap

    table = plan.tables["island"]
    shown = _island_colours(table.values.astype(int))
    axis.pcolormesh(
        hours,
        np.arange(len(table.labels) + 1) + 0.5,
        shown,
        cmap=ListedColormap(ISLANDS),
        vmin=0,
        vmax=len(ISLANDS) - 1,
    )
    many = len(table.labels) > 12
    ticks = np.arange(0, len(table.labels), max(len(table.labels) // 8, 1) if many else 1)
    axis.set_yticks(ticks + 1, [table.labels[k] for k in ticks], fontsize=7)
    axis.set_ylabel("bus\n(islands;\nblack: dead)")
    axis.invert_yaxis()


def _island_colours(number: np.ndarray) -> np.ndarray:
    """(buses, slots) a colour per set of buses, so that an island keeps its colour over time."""
    seen: dict[bytes, int] = {}
    shown = np.zeros_like(number)
    for t in range(number.shape[1]):
        for island in np.unique(number[:, t]):
            members = number[:, t] == island
            if island:
                at = seen.setdefault(members.tobytes(), len(seen))
                shown[members, t] = 1 + at % (len(ISLANDS) - 1)
    return shown


def _lines_out(axis: Axes, plan: Plan, hours: Floats) -> None:
    outages = plan.case.outages if plan.case else ()
    lines = list(dict.fromkeys(outage.line for outage in outages))
    for outage in outages:
        first, stop = hours[outage.first], hours[outage.stop]
        axis.barh(lines.index(outage.line), stop - first, left=first, color="#374151", height=0.7)
    axis.set_yticks(range(len(lines)), lines, fontsize=7)
    axis.set_ylabel("lines\nout")
    axis.set_ylim(len(lines) - 0.5, -0.5)


def _outages(axis: Axes, plan: Plan) -> None:
    if plan.case is None:
        return
    step = plan.step_min / 60.0
    for outage in plan.case.outages:
        axis.axvspan(
            outage.first * step, outage.stop * step, color="black", alpha=0.08, lw=0, zorder=-1
        )


def _time_axis(axis: Axes, plan: Plan, hours: Floats) -> None:
    last = float(hours[-1])
    step = next((s for s in (0.25, 0.5, 1, 2, 3, 6, 12, 24, 48) if last / s <= 13), 96)
    ticks = np.arange(0.0, last + 1e-9, step)
    first = plan.times[0]
    begin = first.hour + first.minute / 60.0
    clock = (begin + ticks) % 24
    axis.set_xticks(ticks, [f"{int(h):02d}:{round(h % 1 * 60):02d}" for h in clock])
    axis.set_xlim(0.0, last)
    axis.set_xlabel(f"time, from {first:%Y-%m-%d}; grey: a line is out")
