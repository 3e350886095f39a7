"""What is allowed in a case, and may still not be what is meant."""

from __future__ import annotations

from resilience.case.data import Case
from resilience.case.schema import DeviceTable, ESSTable, GridTable, LoadTable

_REACTIVE_KEYS = ("s_mva", "q_max_mvar")
"""Keys by which a device has reactive power, of an inverter and of a machine."""


def remarks(case: Case) -> list[str]:
    """Sentences about a valid case that its author should read; none where there is nothing odd."""
    return [*_without_reactive_power(case), *_without_end_value(case)]


def _without_end_value(case: Case) -> list[str]:
    """A remark on storage whose energy is worth nothing behind the horizon."""
    units = [u for u in case.tables_of(ESSTable) if u.soc_final_min is None]
    if "terminal_value_per_mwh" in case.source or not units:
        return []
    names = ", ".join(f"[[ess]] {unit.name}" for unit in units)
    return [
        f"{names}: stored energy is worth nothing at the end, so a plan ends with empty storage "
        "wherever that saves anything\n"
        "hint: give terminal_value_per_mwh, 0 if that is meant, or soc_final_min"
    ]


def _without_reactive_power(case: Case) -> list[str]:
    """A remark on units that can carry an island alone, but not the reactive power of its loads."""
    if all(load.power_factor == 1.0 for load in case.tables_of(LoadTable)):
        return []
    units = [
        (f"[[{kind}]] {unit.name}", key)
        for kind, tables in case.devices.items()
        for unit in tables
        if not isinstance(unit, GridTable) and (key := _missing_key(unit)) is not None
    ]
    keys = [key for key in _REACTIVE_KEYS if key in {missing for _, missing in units}]
    if not keys:
        return []
    names = ", ".join(name for name, _ in units)
    return [
        f"{names}: grid-forming without {' or '.join(keys)}, so without "
        "reactive power; an island that has no other source of it sheds every load with a power "
        "factor below 1 on lindistflow and distflow\n"
        f"hint: give {' and '.join(keys)}, or set grid_forming = false"
    ]


def _missing_key(unit: DeviceTable) -> str | None:
    """The key that would give a grid-forming unit the reactive power that it lacks."""
    if not getattr(unit, "grid_forming", False):
        return None
    keys = [key for key in _REACTIVE_KEYS if key in type(unit).model_fields]
    powers = [getattr(unit, key) or 0.0 for key in keys]
    return keys[0] if keys and max(powers) <= 0.0 else None
