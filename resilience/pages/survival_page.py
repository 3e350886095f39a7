"""The page of survival: the chance that loads are served through a loss of the main grid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from resilience.evaluation.survival import Survival
from resilience.pages.document import number, render

MAX_STARTS = 12


def survival_page(survival: Survival) -> str:
    """The page as text."""
    table, longest = survival.frame(), max(survival.durations_h)
    kinds = {
        "all loads": ("all", survival.all_h),
        "critical loads": ("critical", survival.critical_h),
    }
    lines = [
        _line(survival, f"var(--m{k})", name, key, lasts_h, longest)
        for k, (name, (key, lasts_h)) in enumerate(kinds.items())
        if lasts_h is not None
    ]
    chart = {
        "title": "Fully served, of all starts",
        "unit": "%",
        "longest": longest,
        "lines": lines,
        "note": "Dots: each duration with all starts that it fits behind, and its 95 % interval.",
    }
    rows = []
    for hours, row in table.iterrows():
        cells = [f"{hours:g}", f"{row['starts']:g}"]
        for key in ("critical", "all"):
            share, low, high = (
                100.0 * float(row[f"{key}_{end}"]) for end in ("served", "low", "high")
            )
            interval = "–" if math.isnan(share) else f"{low:.0f} to {high:.0f}"
            cells += [number(share, 1), interval]
        rows.append(tuple(cells))
    return render(
        "survival.html.j2",
        survival.summary(),
        {"charts": {"chance": chart}},
        title=f"{survival.case.name}: survival",
        survival=survival,
        chart=chart,
        verdict=_verdict(survival),
        rows=rows,
        shortest=_shortest(survival),
    )


def _line(
    survival: Survival, colour: str, name: str, key: str, lasts_h: Any, longest: float
) -> dict[str, Any]:
    """The share of starts that lasts, exactly, and the durations that were asked for."""
    lasting = lasts_h[survival.ahead_h >= longest]
    hours = np.unique(np.append(lasting[lasting <= longest], [0.0, longest]))
    table = 100.0 * survival.frame()
    ends = ("served", "low", "high")
    return {
        "name": name,
        "colour": colour,
        "hours": hours.tolist(),
        "share": [100.0 * float((lasting >= hour).mean()) for hour in hours],
        "points": [
            [hour, *(float(row[f"{key}_{end}"]) for end in ends)]
            for hour, (_, row) in zip(survival.durations_h, table.iterrows(), strict=True)
        ],
    }


def _verdict(survival: Survival) -> list[str]:
    key = "all" if survival.critical_h is None else "critical"
    loads = "all loads" if survival.critical_h is None else "critical loads"
    table = survival.frame()
    sentences = [
        f"{loads.capitalize()} are fully served for {hours:g} h without the main grid in "
        f"{100.0 * float(row[f'{key}_served']):.1f} % of {row['starts']:g} starts."
        for hours, row in table.iloc[[0, -1]].iterrows()
    ]
    first, last = (f"{t.astype('datetime64[D]')}" for t in survival.start[[0, -1]])
    method = f"Dispatched by {survival.method}; starts from {first} to {last}."
    return [*dict.fromkeys(sentences), method]


def _shortest(survival: Survival) -> list[tuple[str, str]]:
    """When the grid is worst lost, and how long loads last then."""
    lasts = survival.all_h if survival.critical_h is None else survival.critical_h
    order = np.argsort(lasts, kind="stable")[:MAX_STARTS]
    return [
        (str(survival.start[k].astype("datetime64[m]")).replace("T", " "), number(lasts[k], 2))
        for k in order
        if np.isfinite(lasts[k])
    ]
