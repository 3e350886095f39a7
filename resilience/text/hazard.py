"""A storm's hazard as text for a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from resilience.case.schema import StormTable
from resilience.fragility.likely import buses_text
from resilience.fragility.wind import MODELS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from resilience.fragility.feeder_hazard import Hazard

SHOWN, MOST_LINES, MOMENTS = 8, 40, 8
FAR_FROM_SUN_H = 3.0
LIKELY = 0.01  # a state of the whole feeder that is rarer than this tells nobody anything


def print_hazard(found: Hazard, console: Console) -> None:
    """Prints the storm, its course, lines by probability, loads in the dark, likely islands."""
    for line in _head(found):
        console.print(line, highlight=False)
    _print_course(found, console)
    _print_lines(found, console)
    _print_loads(found, console)
    _print_islands(found, console)


def _head(found: Hazard) -> list[str]:
    here = found.storm
    track, case = here.track, here.case
    lines = [f"[bold]{case.name}[/bold]  {track.name or 'storm'}, {here.geography.about}"]
    lines.append(f"source   {track.source}")
    lines += [f"filled   {field}: {note}" for field, note in track.filled.items()]
    lines.append(_closest(found))
    table = case.storm or StormTable()
    used = MODELS[table.wind].uses
    lines.append(f"field    {table.wind}, from the {used} of the track")
    blown = here.winds[0]
    tops = [float(one.speed_mps.max(initial=0.0)) for one in here.winds]
    members = ""
    if len(tops) > 1:
        members = f", mean of {len(tops)} tracks; the strongest {max(tops):.1f}, the weakest "
        members += f"{min(tops):.1f}"
    lines.append(
        f"wind     up to {here.strongest_mps.max(initial=0.0):.1f} m/s, {blown.averaging_s:g} s "
        f"mean at {blown.height_m:g} m over {blown.exposure}{members}"
    )
    expected = float(here.failed_by[:, -1].sum())
    cables = [line.name for line in case.line if line.underground]
    safe = f"; {len(cables)} underground" if cables else ""
    lines.append(
        f"poles    curve {table.pole}, {table.hardening:g} times as strong, "
        f"correlation {table.correlation:g}"
    )
    lines.append(f"repair   {here.repair}")
    lines.append(f"lines    {expected:.1f} of {len(here.lines.names)} expected to fail{safe}")
    return lines


def _closest(found: Hazard) -> str:
    if found.closest is None:
        return "closest  never within the horizon"
    away, when = found.closest
    case = found.storm.case
    clock = case.window.text(when.replace(second=0))
    table = case.storm or StormTable()
    own = f", {when - table.shift:%Y-%m-%d %H:%M}" if table.shift else ""
    return f"closest  {away:.0f} km at {clock}{own} local time, {_zone(found, table)}"


def _zone(found: Hazard, table: StormTable) -> str:
    """How far local time is ahead of UTC, and how far the sun says."""
    text = f"UTC{table.utc_offset_h:+g}"
    sun = round(found.storm.geography.middle[1] / 15.0)
    if abs((table.utc_offset_h - sun + 12.0) % 24.0 - 12.0) <= FAR_FROM_SUN_H:
        return text
    return f"{text} though the sun says UTC{sun:+d}: utc_offset_h in [[storm]]"


def _table(*heads: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for k, head in enumerate(heads):
        table.add_column(head, justify="right" if k else "left")
    return table


def _print_course(found: Hazard, console: Console) -> None:
    """A row per few hours: the wind until then, lines that have failed, are down, load dark."""
    here, case = found.storm, found.storm.case
    hours = max(math.ceil(case.slots * case.step_h / MOMENTS), 1)
    every = max(round(hours / case.step_h), 1)
    demand_mw = np.zeros_like(found.likely.dark_by_slot)
    for load in case.load:
        demand_mw[case.network.bus(load.bus)] += load.p_max_mw * case.profile(load.profile)
    dark_mw = (found.likely.dark_by_slot * demand_mw).sum(axis=0)
    down = found.scenarios.down.sum(axis=0) @ found.scenarios.probability
    table = _table("by", "wind, m/s", "lines failed", "lines down", "MW without a source")
    for stop in [*range(every, case.slots, every), case.slots]:
        table.add_row(
            case.window.text(case.window.time(stop)),
            f"{here.strongest_mps[:, max(stop - every, 0) : stop].max(initial=0.0):.1f}",
            f"{here.failed_by[:, stop - 1].sum():.1f}",
            f"{down[stop - 1]:.1f}",
            f"{dark_mw[stop - 1]:.2f}",
        )
    console.print(table)


def _print_lines(found: Hazard, console: Console) -> None:
    table = _table("line", "km", "spans", "m/s", "fails", "most likely", "h if it fails")
    rows = sorted(found.lines, key=lambda row: -row["failure_probability"])
    for row in rows[:MOST_LINES]:
        table.add_row(
            row["line"],
            f"{row['length_km']:.2f}",
            str(row["spans"]),
            f"{row['strongest_wind_mps']:.1f}",
            f"{100 * row['failure_probability']:.1f} %",
            row["likeliest"] or "",
            "" if row["hours_if_down"] is None else f"{row['hours_if_down']:.1f}",
        )
    console.print(table)
    left = float(found.scenarios.down[:, -1].sum(axis=0) @ found.scenarios.probability)
    if left >= 0.05:
        stop = found.storm.case.window.text(found.storm.case.window.stop)
        console.print(
            f"{left:.1f} lines are still down at the end, {stop}: their hours are cut off there",
            highlight=False,
        )
    if len(rows) > MOST_LINES:
        next_one = 100 * rows[MOST_LINES]["failure_probability"]
        console.print(
            f"... and {len(rows) - MOST_LINES} more, {next_one:.1f} % or less; --out writes all",
            highlight=False,
        )


def _print_loads(found: Hazard, console: Console) -> None:
    rows = sorted(found.loads, key=lambda row: (-row["critical"], -row["dark_mwh"]))
    rows = [row for row in rows if row["dark_chance"]]
    console.print(
        f"loads in islands without a grid-forming source, of {found.scenarios.n} sampled storms",
        highlight=False,
    )
    if not rows:
        console.print("  none", highlight=False)
        return
    table = _table("load", "bus", "MW", "dark", "h", "MWh", "")
    critical = sum(row["critical"] for row in rows)
    for row in rows[: max(SHOWN, critical)]:
        table.add_row(
            row["load"],
            row["bus"],
            f"{row['p_max_mw']:.2f}",
            f"{100 * row['dark_chance']:.1f} %",
            f"{row['dark_hours']:.1f}",
            f"{row['dark_mwh']:.2f}",
            "critical" if row["critical"] else "",
        )
    console.print(table)


def _print_islands(found: Hazard, console: Console) -> None:
    n, likely = found.scenarios.n, found.likely
    console.print(
        f"islands of {n} sampled storms, apart from the grid at some time", highlight=False
    )
    for one in likely.islands[:SHOWN]:
        buses = buses_text(one.buses) + ("" if one.alive else ", no source")
        chance = f"{100 * one.probability:5.1f} %"
        console.print(f"  {chance}  {one.hours:5.1f} h  {buses}", highlight=False)
    if not likely.islands:
        console.print("  none", highlight=False)
    console.print(_at_once(found), highlight=False)
    for state in likely.islandings[:SHOWN]:
        if state.probability < LIKELY or not state.lines:
            continue
        text = ", ".join(state.lines[:6]) + (", ..." if len(state.lines) > 6 else "")
        parts = f"{len(state.islands)} part" + ("s" if len(state.islands) != 1 else "")
        console.print(
            f"  {100 * state.probability:5.1f} %  {parts} without {text}", highlight=False
        )


def _at_once(found: Hazard) -> str:
    """How many lines are down at once, in how many storms."""
    most = found.scenarios.down.sum(axis=0).max(axis=0)
    weight = found.scenarios.probability
    order = np.argsort(-most, kind="stable")
    share = np.cumsum(weight[order])
    half, tenth = (
        int(most[order][min(int(np.searchsorted(share, at)), len(most) - 1)]) for at in (0.5, 0.1)
    )
    none = 100 * float(weight[most == 0].sum())
    return (
        f"lines down at once: {half} or more in half of the storms, {tenth} or more in one of ten, "
        f"none in {none:.0f} %"
    )
