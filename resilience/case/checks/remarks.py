"""What is allowed in a case, and may still not be what is meant."""

from __future__ import annotations

from resilience.case.data import Case


def remarks(case: Case) -> list[str]:
    """Sentences about a valid case that its author should read; none where there is nothing odd."""
    return [*_without_reactive_power(case)]


def _without_reactive_power(case: Case) -> list[str]:
    """A remark on units that can carry an island alone, but not the reactive power of its loads."""
    if all(load.power_factor == 1.0 for load in case.load):
        return []
    storage = [f"[[ess]] {t.name}" for t in case.ess if t.grid_forming and t.s_mva is None]
    units = [
        f"[[generator]] {t.name}" for t in case.generator if t.grid_forming and t.q_max_mvar <= 0.0
    ]
    keys = [key for key, names in (("s_mva", storage), ("q_max_mvar", units)) if names]
    if not keys:
        return []
    return [
        f"{', '.join(storage + units)}: grid-forming without {' or '.join(keys)}, so without "
        "reactive power; an island that has no other source of it sheds every load with a power "
        "factor below 1 on lindistflow and distflow\n"
        f"hint: give {' and '.join(keys)}, or set grid_forming = false"
    ]
