"""Scenarios in a few numbers: how often lines and units are out, how long, all lines at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from resilience.arrays import Bools, Ints
from resilience.case import Case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import effective_number


def summary(scenarios: Scenarios, case: Case) -> dict[str, Any]:
    """Chances over the horizon and per calendar day, mean times in hours, scenarios weighted.

    Args:
        scenarios: from the start of the case's horizon on.
        case: says when that is, and how long a slot is.
    """
    dates = [case.window.time(t).date() for t in range(scenarios.slots)]
    first = [t for t, date in enumerate(dates) if t == 0 or date != dates[t - 1]]
    down, weight = scenarios.down, scenarios.probability
    begins = _begins(down, first)
    hours = down.sum(axis=1) @ weight * case.step_h
    counts = begins.sum(axis=1) @ weight
    ever = down.any(axis=1) @ weight
    chance = (begins > 0).mean(axis=1) @ weight
    is_line = np.array([case.network.has_line(name) for name in scenarios.lines], bool)
    together = down[is_line].all(axis=0) if is_line.any() else np.zeros(down.shape[1:], bool)
    all_out = np.logical_or.reduceat(together, first, axis=0).mean(axis=0) @ weight
    elements = {
        name: {
            "outage_chance": float(ever[k]),
            "hours_out": float(hours[k]),
            "outage_chance_per_day": float(chance[k]),
            "hours_out_per_day": float(hours[k] / len(first)),
            "hours_per_outage": float(hours[k] / counts[k]) if counts[k] else 0.0,
        }
        for k, name in enumerate(scenarios.lines)
    }
    lines, units = (
        {
            name: row
            for (name, row), has in zip(elements.items(), is_line, strict=True)
            if has == kind
        }
        for kind in (True, False)
    )
    return {
        "case": case.name,
        "scenarios": scenarios.n,
        "effective_scenarios": effective_number(scenarios.probability),
        "slots": scenarios.slots,
        "step_min": case.step_min,
        "days": len(first),
        "seed": scenarios.seed,
        "process": scenarios.process,
        "lines": lines,
        **({"units": units} if units else {}),
        "all_out_chance": float(together.any(axis=0) @ weight),
        "all_out_chance_per_day": float(all_out),
    }


def _begins(down: Bools, first: Sequence[int]) -> Ints:
    """(lines, days, scenarios) how many outages begin on each day.

    A line after the other: sums of all at once would take eight bytes a slot.

    Args:
        down: (lines, slots, scenarios) where a line is down.
        first: (days,) first slot of each.
    """
    begins: Ints = np.zeros((len(down), len(first), down.shape[2]), np.int32)
    for k, path in enumerate(down):
        begin = path.copy()
        begin[1:] &= ~path[:-1]
        begins[k] = np.add.reduceat(begin, first, axis=0, dtype=np.int32)
    return begins
