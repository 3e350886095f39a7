"""A storm's hazard as text for a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.case.schema import StormTable
from resilience.fragility.assumptions import assumptions
from resilience.fragility.likely import buses_text
from resilience.fragility.wind.convert import SUSTAINED_S

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from resilience.fragility.chain import Storm
    from resilience.fragility.feeder_hazard import Hazard

MAX_LOADS, MAX_ISLANDS, MAX_LINES, MAX_MOMENTS = 8, 8, 40, 8
FAR_FROM_SUN_H = 3.0
FAR_KM = 1000.0  # where no storm's wind matters
MIN_CHANCE_LISTED = 0.01  # a rarer state of the whole feeder tells nobody anything


def print_hazard(hazard: Hazard, console: Console) -> None:
    """Prints the storm, its course, lines by probability, loads in the dark, likely islands."""
    from rich.text import Text

    storm = hazard.storm
    about = f"  {storm.track.name or 'storm'}, {storm.geography.about}"
    console.print(Text.assemble((storm.case.name, "bold"), about))
    for line in _head(hazard):
        console.print(line, highlight=False)
    _print_course(hazard, console)
    _print_lines(hazard, console)
    _print_loads(hazard, console)
    _print_islands(hazard, console)


def _head(hazard: Hazard) -> list[str]:
    storm = hazard.storm
    track = storm.track
    lines = [f"source   {track.source}"]
    lines += [f"filled   {field}: {note}" for field, note in track.filled.items()]
    lines.append(_closest(hazard))
    basis = assumptions(storm)
    lines += [f"field    {_field(basis, len(track.time))}", f"factors  {_factors(basis)}"]
    wind = storm.winds[0]
    lines.append(
        f"wind     up to {storm.strongest_mps.max(initial=0.0):.1f} m/s, {wind.averaging_s:g} s "
        f"mean at {wind.height_m:g} m over {wind.exposure}{_of_members(storm)}"
    )
    lines.append(f"poles    {_poles(basis)}")
    lines.append(f"repair   {storm.repair}")
    expected = f"{storm.failed_by[:, -1].sum():.1f}"
    if len(storm.winds) > 1:
        expected += f" ± {hazard.noise:.1f}"
    by_case = any(keys["underground"] is not None for keys in basis["exceptions"].values())
    safe = f"; {basis['cables']} underground" if basis["cables"] else ""
    safe += " by the network file" if safe and not by_case else ""
    lines.append(f"lines    {expected} of {len(storm.lines.names)} expected to fail{safe}")
    if len(storm.winds) > 1:
        lines.append(
            f"noise    ± is one standard error of {len(storm.winds)} tracks drawn with seed "
            f"{basis['forecast']['seed']}; more members narrow it"
        )
    return lines


def _field(basis: dict[str, Any], points: int) -> str:
    """The wind field, what it takes of the track, and how motion adds to it."""
    text = f"{basis['field']}, from the {basis['takes']} of the track; asymmetry "
    text += basis["asymmetry"] + (f", inflow {basis['inflow']}" if basis["inflow"] else "")
    filled = basis["points_without_pressure"]
    if filled and "pressure" in basis["takes"]:
        text += f"; keeps the wind at {filled} of {points} points, which state no pressure"
    return text


def _factors(basis: dict[str, Any]) -> str:
    """What a stated wind is multiplied by until a curve sees it."""
    texts = [f"{factor['value']:.3g} {factor['source']}" for factor in basis["factors"]]
    if basis["averaging_s"] != SUSTAINED_S:
        offset = basis["agency_offset_kt"]
        less = f"less {offset:g} kt, " if offset else ""
        whose = f"as {basis['agency']}" if basis["agency"] else "Harper 2010, of no agency"
        mean = f"from {basis['averaging_s']:g} s to one minute, {whose}"
        texts.insert(0, f"{less}{1.0 / basis['agency_factor']:.3g} {mean}")
    return "; ".join(texts) or "none"


def _poles(basis: dict[str, Any]) -> str:
    """Curve and strength of poles, conductors, and lines that are otherwise."""
    conductor = f", conductors {basis['conductor']}" if basis["conductor"] else ""
    mode = "" if basis["mode"] == "running_max" else f", mode {basis['mode']}"
    apart = len(basis["exceptions"])
    otherwise = f"; {apart} line{'s' if apart != 1 else ''} otherwise" if apart else ""
    return (
        f"curve {basis['pole']}{conductor}, {basis['hardening']:g} times as strong, "
        f"correlation {basis['correlation']:g}{mode}{otherwise}"
    )


def _of_members(storm: Storm) -> str:
    strongest_mps = [float(member.speed_mps.max(initial=0.0)) for member in storm.winds]
    if len(strongest_mps) == 1:
        return ""
    return (
        f", mean of {len(strongest_mps)} tracks; "
        f"the strongest {max(strongest_mps):.1f}, the weakest {min(strongest_mps):.1f}"
    )


def _closest(hazard: Hazard) -> str:
    if hazard.closest is None:
        return "closest  never within the horizon"
    away, when = hazard.closest
    case = hazard.storm.case
    clock = case.window.text(when.replace(second=0))
    table = case.storm or StormTable()
    far = f", more than {FAR_KM:g} km: is it this feeder's storm?" if away > FAR_KM else ""
    unshifted = f", {when - table.shift:%Y-%m-%d %H:%M}" if table.shift else ""
    return f"closest  {away:.0f} km at {clock}{unshifted} local time, {_zone(hazard, table)}{far}"


def _zone(hazard: Hazard, table: StormTable) -> str:
    """How far local time is ahead of UTC, and how far the sun says."""
    text = f"UTC{table.utc_offset_h:+g}"
    sun = round(hazard.storm.geography.middle[1] / 15.0)
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


def _print_course(hazard: Hazard, console: Console) -> None:
    """A row per few hours: the wind until then, lines that have failed, are down, load dark."""
    storm, case = hazard.storm, hazard.storm.case
    hours = max(math.ceil(case.slots * case.step_h / MAX_MOMENTS), 1)
    every = max(round(hours / case.step_h), 1)
    demand_mw = np.zeros_like(hazard.likely.dark_by_slot)
    for load in case.load:
        demand_mw[case.network.bus(load.bus)] += load.p_max_mw * case.profile(load.profile)
    dark_mw = (hazard.likely.dark_by_slot * demand_mw).sum(axis=0)
    down = hazard.scenarios.down.sum(axis=0) @ hazard.scenarios.probability
    table = _table("by", "wind, m/s", "lines failed", "lines down", "MW without a source")
    for stop in [*range(every, case.slots, every), case.slots]:
        table.add_row(
            case.window.text(case.window.time(stop)),
            f"{storm.strongest_mps[:, max(stop - every, 0) : stop].max(initial=0.0):.1f}",
            f"{storm.failed_by[:, stop - 1].sum():.1f}",
            f"{down[stop - 1]:.1f}",
            f"{dark_mw[stop - 1]:.2f}",
        )
    console.print(table)


def _print_lines(hazard: Hazard, console: Console) -> None:
    table = _table("line", "km", "spans", "m/s", "fails", "most likely", "h if it fails")
    rows = sorted(hazard.lines, key=lambda row: -row["failure_probability"])
    for row in rows[:MAX_LINES]:
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
    still_down = float(hazard.scenarios.down[:, -1].sum(axis=0) @ hazard.scenarios.probability)
    if still_down >= 0.05:
        stop = hazard.storm.case.window.text(hazard.storm.case.window.stop)
        console.print(
            f"{still_down:.1f} lines are still down at the end, {stop}: "
            "their hours are cut off there",
            highlight=False,
        )
    if len(rows) > MAX_LINES:
        following = 100 * rows[MAX_LINES]["failure_probability"]
        console.print(
            f"... and {len(rows) - MAX_LINES} more, {following:.1f} % or less; --out writes all",
            highlight=False,
        )


def _print_loads(hazard: Hazard, console: Console) -> None:
    rows = sorted(hazard.loads, key=lambda row: (-row["critical"], -row["dark_mwh"]))
    rows = [row for row in rows if row["dark_chance"]]
    console.print(
        f"loads in islands without a grid-forming source, of {hazard.scenarios.n} sampled storms",
        highlight=False,
    )
    if not rows:
        console.print("  none", highlight=False)
        return
    table = _table("load", "bus", "MW", "dark", "h", "MWh", "")
    critical = sum(row["critical"] for row in rows)
    for row in rows[: max(MAX_LOADS, critical)]:
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


def _print_islands(hazard: Hazard, console: Console) -> None:
    n, likely = hazard.scenarios.n, hazard.likely
    console.print(
        f"islands of {n} sampled storms, apart from the grid at some time", highlight=False
    )
    for island in likely.islands[:MAX_ISLANDS]:
        buses = buses_text(island.buses) + ("" if island.alive else ", no source")
        chance = f"{100 * island.probability:5.1f} %"
        console.print(f"  {chance}  {island.hours:5.1f} h  {buses}", highlight=False)
    if not likely.islands:
        console.print("  none", highlight=False)
    console.print(_at_once(hazard), highlight=False)
    for state in likely.islandings[:MAX_ISLANDS]:
        if state.probability < MIN_CHANCE_LISTED or not state.lines:
            continue
        text = ", ".join(state.lines[:6]) + (", ..." if len(state.lines) > 6 else "")
        pieces = f"{len(state.islands)} part" + ("s" if len(state.islands) != 1 else "")
        console.print(
            f"  {100 * state.probability:5.1f} %  {pieces} without {text}", highlight=False
        )


def _at_once(hazard: Hazard) -> str:
    """How many lines are down at once, in how many storms."""
    lines_down = hazard.scenarios.down.sum(axis=0).max(axis=0)
    weight = hazard.scenarios.probability
    order = np.argsort(-lines_down, kind="stable")
    share = np.cumsum(weight[order])
    half, tenth = (
        int(lines_down[order][min(int(np.searchsorted(share, chance)), len(order) - 1)])
        for chance in (0.5, 0.1)
    )
    none = 100 * float(weight[lines_down == 0].sum())
    return (
        f"lines down at once: {half} or more in half of the storms, {tenth} or more in one of ten, "
        f"none in {none:.0f} %"
    )
