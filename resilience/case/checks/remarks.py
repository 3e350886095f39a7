"""What is allowed in a case, and may still not be what is meant."""

from __future__ import annotations

from datetime import timedelta

from resilience.case.data import Case
from resilience.case.deliveries import delivery_slot
from resilience.case.networks.omissions import omission_text
from resilience.case.schema import DeviceTable, ESSTable, GridTable, LoadTable, PVTable

_REACTIVE_KEYS = ("s_mva", "q_max_mvar")
"""Keys by which a device has reactive power, of an inverter and of a machine."""
_MAX_LISTED = 8
_DAWN_H, _DUSK_H = 4, 22
"""Hours between which the sun may shine in summer."""


def remarks(case: Case) -> list[str]:
    """Sentences about a valid case that its author should read; none where there is nothing odd."""
    return [
        *_not_modelled(case),
        *_sun_at_night(case),
        *_without_reactive_power(case),
        *_without_end_value(case),
        *_unused_tanks(case),
        *_missed_deliveries(case),
        *_forming_on_nothing(case),
    ]


def _not_modelled(case: Case) -> list[str]:
    """A remark on what of the network's source is not modelled."""
    if not case.omissions:
        return []
    hint = "hint: voltages and losses differ from those of a power flow of the network file"
    return [f"not modelled: {omission_text(case.omissions)}\n{hint}"]


def _sun_at_night(case: Case) -> list[str]:
    """A remark on plants whose sun never sets; those that must be taken are no plants."""
    times = (case.start + timedelta(minutes=case.step_min) * t for t in range(case.slots))
    plants = [p for p in case.tables_of(PVTable) if p.profile is None and p.curtailable]
    if not plants or all(_DAWN_H <= time.hour < _DUSK_H for time in times):
        return []
    count = f"{len(plants)} plants" if len(plants) > 1 else f"[[pv]] {plants[0].name}"
    return [
        f"{count} without a profile: the sun shines at night as by day\n"
        "hint: give [defaults.pv] profile = ..., a column of [profiles]"
    ]


def _without_end_value(case: Case) -> list[str]:
    """A remark on storage whose energy is worth nothing behind the horizon."""
    units = [u for u in case.tables_of(ESSTable) if u.soc_final_min is None]
    if "terminal_value_per_mwh" in case.source or not units:
        return []
    names = _listed([f"[[ess]] {unit.name}" for unit in units])
    return [
        f"{names}: stored energy is worth nothing at the end, so a plan ends with empty storage "
        "wherever that saves anything\n"
        "hint: give terminal_value_per_mwh, 0 if that is meant, or soc_final_min"
    ]


def _unused_tanks(case: Case) -> list[str]:
    """A remark on tanks that nobody burns from."""
    burnt_from = {unit.tank for unit in case.generator}
    names = [f"[[tank]] {tank.name}" for tank in case.tank if tank.name not in burnt_from]
    if not names:
        return []
    return [
        f"{_listed(names)}: no generator burns from it\n"
        "hint: give the [[generator]] tank = ... and fuel_m3_per_mwh"
    ]


def _missed_deliveries(case: Case) -> list[str]:
    """A remark on deliveries of which no slot of the horizon can make use."""
    names = [
        f"[[tank]] {tank.name} delivery[{number}]"
        for tank in case.tank
        for number, delivery in enumerate(tank.delivery, start=1)
        if not 0 <= delivery_slot(delivery, case.window) < case.slots
    ]
    if not names:
        return []
    return [
        f"{_listed(names)}: outside the horizon, {case.window}, so it brings nothing\n"
        "hint: fuel can be used from the first slot that starts when it is there"
    ]


def _forming_on_nothing(case: Case) -> list[str]:
    """A remark on generators that carry an island though their tank is empty."""
    names = [
        f"[[generator]] {unit.name}"
        for unit in case.generator
        if unit.tank is not None and unit.grid_forming and not unit.needs_commitment
    ]
    if not names:
        return []
    return [
        f"{_listed(names)}: burns nothing at no load, so it forms its island with an empty tank, "
        "too, and PV there goes on\n"
        "hint: give fuel_no_load_m3_per_h, which needs commitment, or set grid_forming = false"
    ]


def _without_reactive_power(case: Case) -> list[str]:
    """A remark on units that can carry an island alone, but not the reactive power of its loads."""
    charged = case.network.is_charged
    if not charged and all(load.q_peak_mvar == 0.0 for load in case.tables_of(LoadTable)):
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
    names = _listed([name for name, _ in units])
    effect = "sheds every load with a power factor below 1 on lindistflow and distflow"
    if charged:
        effect = "has no plan on lindistflow and distflow, as shunts or charging need a match"
    return [
        f"{names}: grid-forming without {' or '.join(keys)}, so without "
        f"reactive power; an island that has no other source of it {effect}\n"
        f"hint: give {' and '.join(keys)}, or set grid_forming = false"
    ]


def _listed(names: list[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more


def _missing_key(unit: DeviceTable) -> str | None:
    """The key that would give a grid-forming unit the reactive power that it lacks."""
    if not getattr(unit, "grid_forming", False):
        return None
    keys = [key for key in _REACTIVE_KEYS if key in type(unit).model_fields]
    powers = [getattr(unit, key) or 0.0 for key in keys]
    return keys[0] if keys and max(powers) <= 0.0 else None
