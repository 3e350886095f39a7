"""The page of a comparison: verdict, table, intervals, and one storm as several methods met it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case.window import Window
from resilience.dispatch.registry import REFERENCE
from resilience.evaluation.comparison import BOUND, Compared
from resilience.evaluation.paired import days_of
from resilience.evaluation.verdict import ranked, verdict
from resilience.pages.charts import Chart, ChartSeries, Mark, lines, spans, times
from resilience.pages.document import number, plain, render
from resilience.pages.plan_charts import demand_series
from resilience.plots.report_data import records
from resilience.plots.storm_choice import EpisodeView, storm
from resilience.plots.storm_data import MethodView
from resilience.plots.style import METHOD_COLOURS, colours
from resilience.text.comparison import filled, ordered

MAX_SIDES = 4
Rows = list[tuple[str, ...]]


def comparison_page(compared: Compared, summary: Mapping[str, Any]) -> str:
    """The page as text.

    Args:
        compared: a report, or what of it was read from a folder.
        summary: what `--json` prints of it.
    """
    view = storm(compared, _sides(compared))
    heads, rows = _table(summary)
    n, days = compared.scenarios.n, days_of(compared)
    dots = {"over": _over(compared), "shed_dots": _shed(compared)}
    window = Window(view.start, len(view.hours) - 1, compared.case.step_min)
    charts = _storm_charts(view)
    drawn = {
        "times": times(window, window.slots, view.feeder.down),
        "charts": dots | {key: chart.data() for key, chart in charts.items()},
    }
    return render(
        "comparison.html.j2",
        summary,
        drawn,
        title=f"{compared.case.name}: a comparison",
        case=compared.case,
        about=f"{n} episode{'s' * (n != 1)} of {days:g} day{'s' * (days != 1)}",
        verdict=verdict(compared),
        warnings=summary.get("warnings", []),
        heads=heads,
        rows=rows,
        marked=(ranked(compared)[0],),
        meanings=_meanings(summary),
        differences=_differences(summary),
        view=view,
        sides=[(name, _side(view, method)) for name, method in view.methods.items()],
        side_keys=[f"{kind}_{k}" for kind in ("power", "soc") for k in range(len(view.methods))],
        outages=_outages(view),
        setting=_setting(summary),
    )


def _sides(compared: Compared) -> list[str]:
    """Whose storm is shown: the best methods, a battery kept full, and the bound."""
    order = ranked(compared)
    names = [*order[: MAX_SIDES - 2], REFERENCE, BOUND]
    return [name for name in dict.fromkeys(names) if name in compared.trajectories]


def _table(summary: Mapping[str, Any]) -> tuple[list[tuple[str, str]], Rows]:
    """Heads with units, and a row per method, of every column that says anything."""
    import pandas as pd

    frame = ordered(pd.DataFrame(summary["methods"]).set_index("method").astype(float))
    shown = filled(frame)
    cells = [column.texts(frame) for column in shown]
    heads = [("method", ""), *((column.head, column.unit) for column in shown)]
    return heads, [(str(name), *row) for name, *row in zip(frame.index, *cells, strict=True)]


def _meanings(summary: Mapping[str, Any]) -> Rows:
    """What heads of the table leave open."""
    import pandas as pd

    frame = pd.DataFrame(summary["methods"]).set_index("method").astype(float)
    bound = (BOUND, "the bound: storms known in advance; nobody can cost less")
    return [bound, *((column.head, column.about) for column in filled(frame) if column.about)]


def _differences(summary: Mapping[str, Any]) -> Rows:
    return [
        (
            f"{pair['method']} less {pair['other']}",
            number(pair["per_day"]),
            "–" if pair["low"] is None else f"{number(pair['low'])} to {number(pair['high'])}",
            "no" if pair["excludes_zero"] else "perhaps",
        )
        for pair in summary.get("differences", [])
    ]


def _over(compared: Compared) -> dict[str, Any]:
    rows = [
        _dots(k, row.name, row.over, row.mean.mean, (row.mean.low, row.mean.high))
        for k, row in enumerate(records(compared))
    ]
    note = "A dot is an episode; large: the mean, with its 95 % interval. Zero: the bound."
    return {"title": "Cost above the bound", "unit": "$/day", "rows": rows, "note": note}


def _shed(compared: Compared) -> dict[str, Any]:
    days, likely = days_of(compared), compared.scenarios.probability
    rows = []
    for k, name in enumerate(ranked(compared)):
        shed = compared.trajectories[name].shed_mwh / days
        rows.append(_dots(k, name, shed, float(likely @ shed), (math.nan, math.nan)))
    note = "A dot is an episode; large: the mean."
    return {"title": "Energy not served", "unit": "MWh/day", "rows": rows, "note": note}


def _dots(
    k: int, name: str, values: Floats, mean: float, ends: tuple[float, float]
) -> dict[str, Any]:
    low, high = (end if math.isfinite(end) else None for end in ends)
    return {
        "name": name,
        "colour": f"var(--m{k % len(METHOD_COLOURS)})",
        "dots": plain(np.asarray(values, float)),
        "mean": mean,
        "low": low,
        "high": high,
    }


def _storm_charts(view: EpisodeView) -> dict[str, Chart]:
    """Power and state of charge of every method, on the same scales; shedding of all in one."""
    methods = list(view.methods.items())
    stacks = [_stack(method) for _, method in methods]
    top = max(float(up.max(initial=0.0)) for up, _ in stacks)
    bottom = min(float(down.min(initial=0.0)) for _, down in stacks)
    charts = {}
    for k, (name, method) in enumerate(methods):
        charts[f"power_{k}"] = Chart(
            f"{name}: power", "MW", _power(method), bottom=1.05 * bottom, top=1.05 * top
        )
    units = view.case.ess
    size = np.array([unit.e_mwh for unit in units], float)
    for k, (name, method) in enumerate(methods):
        series = lines([unit.name for unit in units], 100.0 * method.soc, size) if units else []
        charts[f"soc_{k}"] = Chart(f"{name}: state of charge", "%", series, bottom=0.0, top=100.0)
    shed = [
        ChartSeries(name, f"var(--m{k})", "line", method.shed.sum(axis=0))
        for k, (name, method) in enumerate(methods)
    ]
    return charts | {"shed": Chart("Shed", "MW", shed, bottom=0.0)}


def _stack(method: MethodView) -> tuple[Floats, Floats]:
    """(slots,) the upper and the lower edge of what is drawn."""
    zero = np.zeros(len(method.demand))
    up = np.maximum(sum(method.fed.values(), zero), method.demand)
    return up, -sum(method.intake.values(), zero)


def _power(method: MethodView) -> Sequence[ChartSeries]:
    colour_of = colours()
    sides: tuple[tuple[Mark, Mapping[str, Floats]], ...] = (
        ("up", method.fed),
        ("down", method.intake),
    )
    series = [
        ChartSeries(title, colour_of[title], mark, flow)
        for mark, flows in sides
        for title, flow in flows.items()
        if flow.max(initial=0.0) > 0.0
    ]
    return [*series, *demand_series(method.demand, method.shed.sum(axis=0))]


def _side(view: EpisodeView, method: MethodView) -> str:
    shed = float(method.shed.sum()) * view.case.step_h
    return f"{number(method.cost)} $, {number(shed, 3)} MWh shed"


def _outages(view: EpisodeView) -> Rows:
    """Which line of the storm is out from when to when."""
    window = Window(view.start, len(view.hours) - 1, view.case.step_min)
    rows: Rows = []
    for name, down in zip(view.feeder.lines, view.feeder.down, strict=True):
        hours = [f"{window.label(a)}–{window.end_label(b)}" for a, b in spans(down)]
        rows.append((name, ", ".join(hours)))
    return rows


def _setting(summary: Mapping[str, Any]) -> Rows:
    """The rules of the comparison, in words."""
    storms = [str(summary["episodes"])]
    storms += [summary["process"]] if summary["process"] else []
    storms += [] if summary["seed"] is None else [f"seed {summary['seed']}"]
    rows: Rows = [
        ("storms", ", ".join(storms)),
        ("from", f"{summary['start']}, {summary['days']:g} days"),
        ("physics", f"{summary['physics']}, the bound included"),
        ("energy left", f"worth {summary['end_value_per_mwh']:g} $/MWh"),
        ("forecast errors", str(summary["forecast_error"])),
        ("bound", f"{number(summary['bound_per_day'])} $/day on average"),
        ("a battery kept full costs", f"{number(summary['triviality_percent'])} % more than that"),
    ]
    if summary.get("belief"):
        rows.append(("believed", summary["belief"]))
    return rows
