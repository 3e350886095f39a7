"""The page of a storm's hazard, from what `hazard --json` prints and `hazard.json` holds."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case.window import Window
from resilience.errors import UsageError
from resilience.pages.charts import Chart, ChartSeries, times
from resilience.pages.document import number, plain, render

MAX_LINES, MAX_LOADS, MAX_ISLANDS = 40, 20, 12
Rows = list[tuple[str, ...]]


def hazard_page(summary: Mapping[str, Any]) -> str:
    """The page as text.

    Args:
        summary: of a hazard.

    Raises:
        UsageError: an earlier version wrote it, without the places of buses.
    """
    if "wind_mps" not in summary:
        raise UsageError(
            "this hazard does not say where buses are; allowed: one of this version",
            hint="run `resilience hazard --out` again",
        )
    failed = np.array(list(summary["failed_by"].values()), float)
    window = Window(
        datetime.fromisoformat(summary["start"]), failed.shape[1], float(summary["step_min"])
    )
    charts = _charts(summary, failed)
    drawn = {
        "times": times(window, window.slots),
        "charts": {key: chart.data() for key, chart in charts.items()},
        "map": _map(summary, failed, window),
    }
    rows = sorted(summary["lines"], key=lambda row: -row["failure_probability"])
    return render(
        "hazard.html.j2",
        summary,
        drawn,
        title=f"{summary['case']}: {summary['storm'] or 'a storm'}",
        verdict=_verdict(summary),
        window=window,
        lines=[_line(row) for row in rows[:MAX_LINES]],
        more=len(rows) - MAX_LINES,
        loads=_loads(summary),
        islands=_islands(summary),
        assumptions=_assumptions(summary),
    )


def _verdict(summary: Mapping[str, Any]) -> list[str]:
    lines, worst = (
        summary["lines"],
        max(summary["lines"], key=lambda row: row["failure_probability"], default=None),
    )
    sentences = [
        f"{number(summary['expected_lines_down'], 1)} of {len(lines)} lines are expected to fail."
    ]
    if worst is not None and worst["failure_probability"] > 0.0:
        sentences.append(
            f"The likeliest is {worst['line']}, {100.0 * worst['failure_probability']:.1f} %, "
            f"most likely at {worst['likeliest']}."
        )
    if summary["closest_km"] is not None:
        when = datetime.fromisoformat(summary["closest_at"])
        sentences.append(
            f"The eye of {summary['storm'] or 'the storm'} is closest at {when:%Y-%m-%d %H:%M}, "
            f"{summary['closest_km']:.0f} km away; the strongest wind along the lines is "
            f"{number(summary['strongest_wind_mps'], 1)} m/s ({summary['wind']})."
        )
    dark = sum(load["dark_mwh"] for load in summary["loads"])
    sentences.append(
        f"Loads in islands without a source miss {number(dark, 2)} MWh on average over "
        f"{summary['scenarios']} sampled storms."
    )
    if summary["synthetic"]:
        sentences.append("The places of the feeder are made up.")
    return sentences


def _charts(summary: Mapping[str, Any], failed: Floats) -> dict[str, Chart]:
    wind = np.array(list(summary["wind_mps"].values()), float)
    between = "weakest to strongest line"
    felt = [
        ChartSeries(between, "var(--band)", "low", wind.min(axis=0)),
        ChartSeries(between, "var(--band)", "high", wind.max(axis=0)),
        ChartSeries("mean", "var(--m0)", "line", wind.mean(axis=0)),
    ]
    counts = [
        ChartSeries("failed so far", "var(--m1)", "line", failed.sum(axis=0)),
        ChartSeries("down", "var(--m3)", "line", np.array(summary["lines_down"], float)),
    ]
    note = f"Nobody repairs above {summary['repair']['wind_limit_mps']:g} m/s."
    return {
        "wind": Chart(
            f"Wind along the lines, {summary['wind']}", "m/s", felt, bottom=0.0, note=note
        ),
        "counts": Chart("Lines, expected number", "", counts, bottom=0.0),
    }


def _map(summary: Mapping[str, Any], failed: Floats, window: Window) -> dict[str, Any]:
    buses = summary["buses"]
    east, north = (
        np.array([bus[key] for bus in buses.values()]) for key in ("east_km", "north_km")
    )
    side = max(float(np.ptp(east)), float(np.ptp(north))) or 1.0
    position = {name: k for k, name in enumerate(buses)}
    wind = np.array(list(summary["wind_mps"].values()), float)
    down, total = np.array(summary["lines_down"], float), failed.sum(axis=0)
    none = [None] * len(buses)
    return {
        "buses": [
            {
                "name": name,
                "x": round((float(x) - float(east.min())) / side, 4),
                "y": round((float(y) - float(north.min())) / side, 4),
                "grid": False,
                "facts": [
                    ["apart from the grid", f"{100.0 * bus['apart']:.1f} %"],
                    ["without a source", f"{100.0 * bus['dark']:.1f} %"],
                    ["hours without", number(bus["dark_hours"], 2)],
                ],
            }
            for (name, bus), x, y in zip(buses.items(), east, north, strict=True)
        ],
        "lines": [
            {
                "name": row["line"],
                "a": position[row["from_bus"]],
                "b": position[row["to_bus"]],
                "facts": [
                    ["fails", f"{100.0 * row['failure_probability']:.1f} %"],
                    ["strongest wind", f"{row['strongest_wind_mps']:.1f} m/s"],
                    ["most likely at", row["likeliest"] or "–"],
                ],
            }
            for row in summary["lines"]
        ],
        "devices": [],
        "every": 1,
        "frames": {
            "state": [[1]] * len(failed), "flow": [None] * len(failed), "chance": plain(failed),
            "voltage": None, "colour": [[1]] * len(buses), "demand": none, "shed": none,
            "power": [], "soc": [],
        },
        "largest": {"flow": 0.0, "shed": 0.0},
        "facts": [
            [
                ["strongest wind", f"{wind[:, t].max(initial=0.0):.1f} m/s"],
                ["lines failed so far", f"{total[t]:.2f}"],
                ["lines down", f"{down[t]:.2f}"],
            ]
            for t in range(window.slots)
        ],
        "legend": [
            [f"{20 * k} to {20 * k + 20} %", "line", f"var(--risk{k})"] for k in range(5)
        ],
        "first": window.slots - 1,
        "note": f"{number(side, 1)} km across; {summary['geography']}. Lines by the probability "
        "that they have failed by the end of the slot.",
    }  # fmt: skip


def _line(row: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        row["line"],
        number(row["length_km"]),
        str(row["spans"]),
        number(row["strongest_wind_mps"], 1),
        number(100.0 * row["failure_probability"], 1),
        row["likeliest"] or "",
        "" if row["hours_if_down"] is None else number(row["hours_if_down"], 1),
    )


def _loads(summary: Mapping[str, Any]) -> Rows:
    rows = [row for row in summary["loads"] if row["dark_chance"]]
    rows.sort(key=lambda row: (-row["critical"], -row["dark_mwh"]))
    return [
        (
            row["load"],
            row["bus"],
            number(row["p_max_mw"]),
            number(100.0 * row["dark_chance"], 1),
            number(row["dark_hours"], 1),
            number(row["dark_mwh"]),
            "critical" if row["critical"] else "",
        )
        for row in rows[:MAX_LOADS]
    ]


def _islands(summary: Mapping[str, Any]) -> Rows:
    return [
        (
            f"{100.0 * island['probability']:.1f}",
            number(island["hours"], 1),
            "yes" if island["alive"] else "no",
            ", ".join(island["buses"]),
        )
        for island in summary["islands"][:MAX_ISLANDS]
    ]


def _assumptions(summary: Mapping[str, Any]) -> Rows:
    repair = summary["repair"]
    rows = [
        ("source", summary["source"]),
        *((f"filled: {field}", str(note)) for field, note in summary["filled"].items()),
        ("wind field", f"{summary['field']}, from the {summary['takes']} of the track"),
        ("wind that curves see", summary["wind"]),
        *(("factor", f"{factor['value']:.3g} {factor['source']}") for factor in summary["factors"]),
        ("poles", f"curve {summary['pole']}, {summary['hardening']:g} times as strong"),
        ("correlation", f"{summary['correlation']:g}"),
        ("repair", f"{repair['law']}, {repair['hours']} h, {repair['crews']} crews"),
        ("tracks", str(summary["members"])),
        ("sampled storms", f"{summary['scenarios']}, seed {summary['seed']}"),
    ]
    return [(name, value) for name, value in rows if value]
