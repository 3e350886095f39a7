"""A feeder of four breakpoints for the tests of this folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from resilience.case import Case
from resilience.testing import small_case

LINES = ("1-2", "2-3", "3-4", "4-5")


def feeder(
    *,
    days: float = 1,
    step_min: float = 15.0,
    columns: Mapping[str, Sequence[float]] | None = None,
    **load: str,
) -> Case:
    """Five buses in a row; every line between is a breakpoint; `load` says more of the load."""
    return small_case(
        slots=round(days * 24 * 60 / step_min),
        step_min=step_min,
        buses=5,
        lines=[(k, k + 1, 0.01, 0.01) for k in range(1, 5)],
        line_tables=[{"name": line, "breakpoint": True} for line in LINES],
        profiles=columns,
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.0, **load}],
        pv=[{"p_max_mw": 1.0, "profile": "sun"}] if "sun" in (columns or ()) else [],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 0.1}],
    )
