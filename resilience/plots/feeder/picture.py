"""The map of a plan as a picture: the feeder at the moments that matter, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.case.schema import GridTable
from resilience.errors import UsageError
from resilience.files import check_picture
from resilience.planning.plan import Plan
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.plots import panels, style
from resilience.plots.feeder.view import CLOSED, OPEN, OUT, FeederMap, feeder_map
from resilience.tolerances import DRAWN_TOLERANCE_MW

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_MOMENTS = 4
MAX_NAMED = 80  # buses, up to which each has its name
WIRE, OUT_COLOUR, INK = "#8a94a0", "#c62828", "#17202a"
LIGHT = 0.55
"""Brightness of a colour from which letters on it are dark."""


def plot_map(
    plan: Plan | ScenarioPlan, path: str | Path | None = None, slots: tuple[int, ...] = ()
) -> Figure:
    """Draws the feeder in some slots of a plan: flows, islands, charge, what is shed, lines out.

    Args:
        plan: of either kind; of one over scenarios its common schedule is drawn.
        path: a .png, .pdf or .svg file, written if given.
        slots: which ones, from 0; if omitted those before the first outage, as it begins, in which
            most is shed or out, and in which the last outage ends.

    Raises:
        UsageError: a suffix that is no picture format, a slot that the plan has not, or a plan
            that was kept without its case.
    """
    if path is not None:
        check_picture(Path(path))
    if plan.case is None:
        raise UsageError("a plan without its case has no map", hint="keep case.toml beside it")
    view = feeder_map(plan, plan.case)
    if wrong := [t for t in slots if not 0 <= t < view.slots]:
        raise UsageError(
            f"slots {', '.join(map(str, wrong))}; allowed: 0 to {view.slots - 1}",
            hint="slots count from 0",
        )
    with style.look():
        return style.write_figure(_draw(view, slots or moments(view)), path)


def moments(view: FeederMap) -> tuple[int, ...]:
    """The slots that are worth a look."""
    out = (view.line_state == OUT).sum(axis=0)
    shed = view.shed_mw.sum(axis=0)
    if not out.any():
        chance = None if view.down_chance is None else view.down_chance.sum(axis=0)
        busiest = int((view.demand_mw.sum(axis=0) if chance is None else chance).argmax())
        worst = [int(shed.argmax())] if shed.max() > DRAWN_TOLERANCE_MW else []
        return tuple(sorted({busiest, *worst}))
    hit = np.flatnonzero(out)
    worst_slot = int((shed if shed.max() > DRAWN_TOLERANCE_MW else out).argmax())
    return tuple(sorted({max(int(hit[0]) - 1, 0), int(hit[0]), worst_slot, int(hit[-1])}))


def _draw(view: FeederMap, slots: tuple[int, ...]) -> Figure:
    from matplotlib.figure import Figure

    columns = min(len(slots), 2)
    rows = -(-len(slots) // columns)
    figure = Figure(figsize=(6.2 * columns, 5.4 * rows + 0.9), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, slot in zip(axes, slots, strict=False):
        _lines(axis, view, slot)
        _buses(axis, view, slot)
        _devices(axis, view, slot)
        axis.set_aspect("equal")
        axis.margins(0.07)
        axis.set_axis_off()
        axis.set_title(_title(view, slot), loc="left", fontsize=9, fontweight="bold")
    for axis in axes[len(slots) :]:
        axis.set_axis_off()
    _legend(figure, view)
    note = ": a diagram, as the network states no coordinates" if view.places.is_computed else ""
    style.headed(figure, f"{view.case.name}{note}")
    return figure


def _title(view: FeederMap, slot: int) -> str:
    demand, shed = (float(mw[:, slot].sum()) for mw in (view.demand_mw, view.shed_mw))
    out = [
        name
        for name, state in zip(view.case.network.line_names, view.line_state[:, slot], strict=True)
        if state == OUT
    ]
    words = f"{view.case.slot_label(slot)}: {demand:.2f} MW asked for, {shed:.2f} shed"
    return words + (f"; out: {', '.join(out)}" if out else "")


def _lines(axis: Axes, view: FeederMap, slot: int) -> None:
    x, y, network = view.places.x, view.places.y, view.case.network
    largest = float(np.nanmax(np.abs(view.flow_mw), initial=0.0)) or 1.0
    for k, (a, b) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
        state, flow = int(view.line_state[k, slot]), float(view.flow_mw[k, slot])
        share = 0.1 if np.isnan(flow) else abs(flow) / largest
        looks: dict[int, dict[str, Any]] = {
            OPEN: {"color": WIRE, "lw": 0.7, "ls": ":"},
            CLOSED: {"color": WIRE, "lw": 0.8 + 5.0 * share, "ls": "-"},
            OUT: {"color": OUT_COLOUR, "lw": 1.6, "ls": (0, (2, 2))},
        }
        axis.plot(x[[a, b]], y[[a, b]], solid_capstyle="round", zorder=1, **looks[state])
        middle = (x[a] + x[b]) / 2.0, (y[a] + y[b]) / 2.0
        if state == OUT:
            axis.plot(*middle, "x", color=OUT_COLOUR, ms=8, mew=2.0, zorder=2)
        elif state == CLOSED and share > 0.01 and not np.isnan(flow):
            dx, dy = np.sign(flow) * (x[b] - x[a]), np.sign(flow) * (y[b] - y[a])
            axis.annotate(
                "", (middle[0] + 0.03 * dx, middle[1] + 0.03 * dy), middle, zorder=2,
                arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 0.0, "mutation_scale": 9},
            )  # fmt: skip


def _buses(axis: Axes, view: FeederMap, slot: int) -> None:
    x, y, network = view.places.x, view.places.y, view.case.network
    few = len(network.bus_names) <= MAX_NAMED
    size = 46.0 if few else 8.0
    shed = view.shed_mw[:, slot]
    hit = shed > DRAWN_TOLERANCE_MW
    if hit.any():
        share = shed[hit] / max(float(view.shed_mw.max()), DRAWN_TOLERANCE_MW)
        axis.scatter(
            x[hit], y[hit], s=2.2 * size, facecolors="none", edgecolors=style.SHED_COLOUR,
            linewidths=(1.5 + 3.5 * np.sqrt(share)).tolist(), zorder=3,
        )  # fmt: skip
    shades = [panels.BAND[code] for code in view.colour[:, slot]]
    axis.scatter(x, y, s=size, c=shades, edgecolors=INK, linewidths=0.8, zorder=4)
    sources = [network.bus(grid.bus) for grid in view.case.tables_of(GridTable)]
    axis.scatter(
        x[sources], y[sources], s=2.4 * size, marker="s", edgecolors=INK, linewidths=1.5,
        c=[shades[k] for k in sources], zorder=4,
    )  # fmt: skip
    for k, name in enumerate(network.bus_names if few else ()):
        axis.annotate(name, (x[k], y[k]), (5, 5), textcoords="offset points", fontsize=7, zorder=6)


def _devices(axis: Axes, view: FeederMap, slot: int) -> None:
    """Units below their buses, side by side; storage is as full as its charge."""
    if len(view.case.network.bus_names) > MAX_NAMED:
        return
    placed: dict[int, int] = {}
    for k, device in enumerate(view.devices):
        if device.kind == "grid":
            continue
        nth = placed[device.bus] = placed.get(device.bus, -1) + 1
        spot = (float(view.places.x[device.bus]), float(view.places.y[device.bus]))
        runs = abs(float(view.power_mw[k, slot])) > DRAWN_TOLERANCE_MW
        runs = runs or device.is_storage
        words = f"{100.0 * view.soc[k, slot]:.0f} %" if device.is_storage else device.name
        axis.annotate(
            words, spot, (-6 + 32 * nth, -12), textcoords="offset points", fontsize=6, zorder=5,
            color=_letters(device.colour) if runs else INK, va="center", ha="center",
            bbox={
                "boxstyle": "round,pad=0.25", "ec": device.colour, "lw": 0.8,
                "fc": device.colour if runs else "white",
            },
        )  # fmt: skip


def _letters(colour: str) -> str:
    """What can be read on a colour."""
    from matplotlib.colors import to_rgb

    red, green, blue = to_rgb(colour)
    return INK if 0.3 * red + 0.59 * green + 0.11 * blue > LIGHT else "white"


def _legend(figure: Figure, view: FeederMap) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    words = {panels.GRID: "on the grid", panels.GRID + 1: "islands, one colour each"}
    words |= {panels.DEAD: "dead"}
    handles: list[Artist] = [
        Line2D([], [], marker="o", ls="none", mec=INK, mfc=panels.BAND[code], label=text)
        for code, text in words.items()
        if (view.colour == code).any()
    ]
    handles += [
        Line2D([], [], color=WIRE, lw=3, label="flow by width"),
    ]
    if (view.line_state == OUT).any():
        look: dict[str, Any] = {"color": OUT_COLOUR, "lw": 1.6, "ls": (0, (2, 2)), "marker": "x"}
        handles.append(Line2D([], [], label="line out", **look))
    if view.shed_mw.max(initial=0.0) > DRAWN_TOLERANCE_MW:
        ring: dict[str, Any] = {"mec": style.SHED_COLOUR, "mfc": "none", "mew": 2.5, "ms": 9}
        handles.append(Line2D([], [], marker="o", ls="none", label="shed, by size", **ring))
    kinds = {device.kind: device.colour for device in view.devices if device.kind != "grid"}
    handles += [
        Patch(color=colour, label="storage, charge at the end" if kind == "storage" else kind)
        for kind, colour in kinds.items()
    ]
    figure.legend(handles=handles, loc="outside lower left", ncols=5, frameon=False, fontsize=8)
