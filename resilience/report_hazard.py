"""A storm's hazard as text for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.fragility.likely import buses_text

if TYPE_CHECKING:
    from rich.console import Console

    from resilience.fragility.feeder_hazard import Hazard

SHOWN = 8


def print_hazard(found: Hazard, console: Console) -> None:
    """Prints the storm, the lines by probability, and the islands that are likely."""
    here = found.storm
    track, case = here.track, here.case
    name = track.name or "storm"
    console.print(f"[bold]{case.name}[/bold]  {name}, {here.geography.about}", highlight=False)
    lines = [f"source   {track.source}"]
    for field, note in track.filled.items():
        lines.append(f"filled   {field}: {note}")
    lines.append(_closest(found))
    blown = here.winds[0]
    strongest = f"{here.strongest_mps.max(initial=0.0):.1f} m/s"
    lines.append(
        f"wind     up to {strongest}, {blown.averaging_s:g} s mean at {blown.height_m:g} m over "
        f"{blown.exposure}"
        + (f", mean of {len(here.members)} tracks" if len(here.members) > 1 else "")
    )
    expected = float(here.failed_by[:, -1].sum())
    lines.append(f"lines    {expected:.1f} of {len(here.lines.names)} expected to fail")
    for line in lines:
        console.print(line, highlight=False)
    _print_lines(found, console)
    _print_islands(found, console)


def _closest(found: Hazard) -> str:
    if found.closest is None:
        return "closest  never within the horizon"
    away, when = found.closest
    case = found.storm.case
    clock = case.window.text(when.replace(second=0))
    if case.storm is not None and case.storm.shift:
        own = when - case.storm.shift
        return f"closest  {away:.0f} km at {clock}, {own:%Y-%m-%d %H:%M} local time of the storm"
    return f"closest  {away:.0f} km at {clock}"


def _print_lines(found: Hazard, console: Console) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("line", "km", "spans", "m/s", "fails", "most likely", "h down"):
        table.add_column(head, justify="left" if head == "line" else "right")
    rows = sorted(found.lines, key=lambda row: -row["failure_probability"])
    for row in rows:
        table.add_row(
            row["line"],
            f"{row['length_km']:.2f}",
            str(row["spans"]),
            f"{row['strongest_wind_mps']:.1f}",
            f"{100 * row['failure_probability']:.1f} %",
            row["likeliest"] or "",
            f"{row['hours_down']:.1f}",
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
    console.print("at the worst moment", highlight=False)
    for state in likely.islandings[:SHOWN]:
        down = f"{len(state.lines)} lines down" if len(state.lines) != 1 else "1 line down"
        text = ", ".join(state.lines[:6]) + (", ..." if len(state.lines) > 6 else "")
        parts = f"{len(state.islands)} part" + ("s" if len(state.islands) != 1 else "")
        shown = f"{down}: {text}" if state.lines else "no line down"
        console.print(f"  {100 * state.probability:5.1f} %  {parts}  {shown}", highlight=False)
