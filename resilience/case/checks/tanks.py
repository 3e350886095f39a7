"""Rules that join tanks, what is delivered to them, and the generators that burn from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.reading import show
from resilience.case.schema import GeneratorTable, TankTable
from resilience.errors import did_you_mean
from resilience.tolerances import INPUT_TOLERANCE

_MIN_HOURS, _MAX_HOURS = 0.02, 10_000.0
"""Of a full tank at full power of all its generators; beyond, one number is in litres."""
_FUEL_KEYS = ("fuel_m3_per_mwh", "fuel_no_load_m3_per_h", "fuel_curve")


def check_tanks(parts: Parts) -> None:
    """Notes what is wrong with tanks and with what generators say of fuel."""
    document = parts.document
    for tank, title in parts.tanks:
        document.add_findings(("tank", str(tank.name)), title, _wrong_tank(tank))
    for unit, title in parts.devices.get("generator", []):
        findings = [*_wrong_reference(parts, unit), *_wrong_fuel(unit)]
        document.add_findings(("generator", str(unit.name)), title, findings)
    _check_hours(parts)


def _wrong_tank(tank: TankTable) -> Iterator[Finding]:
    capacity, initial = tank.capacity_m3, tank.initial_m3
    if capacity is not None and initial is not None and initial > capacity:
        allowed = f"at most capacity_m3 = {capacity:g}"
        yield "initial_m3", f"{initial:g}", allowed, "lower it, or raise capacity_m3"
    for number, delivery in enumerate(tank.delivery or (), start=1):
        key = f"delivery[{number}]"
        if (delivery.time is None) == (delivery.hour is None):
            value = "neither time nor hour" if delivery.time is None else "time and hour"
            yield key, value, "one of time and hour", "hour counts from the start of the horizon"
        elif delivery.time is not None and delivery.time.tzinfo is not None:
            hint = "profiles and outages are in local time; drop the offset"
            yield f"{key}.time", show(delivery.time), "a time without offset", hint


def _wrong_reference(parts: Parts, unit: GeneratorTable) -> Iterator[Finding]:
    names = [str(tank.name) for tank, _ in parts.tanks]
    if unit.tank is not None and unit.tank not in names:
        hint = did_you_mean(unit.tank, names) if names else "add [[tank]] with name, capacity_m3"
        yield "tank", show(unit.tank), "the name of a [[tank]]", hint


def _wrong_fuel(unit: GeneratorTable) -> Iterator[Finding]:
    curve, slope, no_load = unit.fuel_curve, unit.fuel_m3_per_mwh, unit.fuel_no_load_m3_per_h
    stated = [key for key in _FUEL_KEYS if getattr(unit, key)]
    if unit.tank is None:
        for key in stated:
            hint = "name its [[tank]]: tank = ..., or remove it; prices are in cost_per_mwh"
            value = "a curve" if key == "fuel_curve" else f"{getattr(unit, key):g}"
            yield key, value, "nothing without a tank", hint
        return
    if not stated or stated == ["fuel_no_load_m3_per_h"]:
        hint = "a diesel set burns some 0.25, litres per kWh; or give fuel_curve"
        yield "fuel_m3_per_mwh", "nothing", "a value, beside tank", hint
    if curve is None:
        return
    for key, fuel in (("fuel_m3_per_mwh", slope), ("fuel_no_load_m3_per_h", no_load)):
        if fuel:
            yield key, f"{fuel:g}", "nothing beside fuel_curve", "give one of the two"
    if unit.p_min_mw is not None and unit.p_max_mw is not None:
        yield from _wrong_curve(curve, unit.p_min_mw, unit.p_max_mw)


def _wrong_curve(
    curve: Sequence[tuple[float, float]], p_min_mw: float, p_max_mw: float
) -> Iterator[Finding]:
    """What is wrong with the points of a fuel curve; the first of it."""
    p_mw = [point[0] for point in curve]
    covers = len(curve) > 1 and p_mw[0] <= p_min_mw + INPUT_TOLERANCE
    covers = covers and p_mw[-1] >= p_max_mw - INPUT_TOLERANCE
    if not covers or any(later <= earlier for earlier, later in pairwise(p_mw)):
        allowed = f"two points or more, p_mw rising from {p_min_mw:g} or less to {p_max_mw:g}"
        hint = "write [[p_mw, m3_per_h], ...] over the whole range p_min_mw to p_max_mw"
        yield "fuel_curve", "p_mw = " + ", ".join(f"{p:g}" for p in p_mw), allowed, hint
        return
    slopes = [(y2 - y1) / (x2 - x1) for (x1, y1), (x2, y2) in pairwise(curve)]
    text = "m3_per_h = " + ", ".join(f"{point[1]:g}" for point in curve)
    if p_mw[0] < 0.0 or curve[0][1] < 0.0 or slopes[0] < 0.0:
        yield "fuel_curve", text, "power and fuel of 0 or more, rising", "more power burns more"
        return
    for number, (before, after) in enumerate(pairwise(slopes), start=2):
        if after < before * (1.0 - INPUT_TOLERANCE) - INPUT_TOLERANCE:
            value = f"{after:g} m³/MWh behind point {number}, {before:g} before it"
            hint = "a curve that bends down burns less per MWh at more power; straighten it"
            yield "fuel_curve", value, "a convex curve: no piece flatter than the last", hint
            return


def _check_hours(parts: Parts) -> None:
    """Refuses tanks that their generators empty in a minute, or not in a year."""
    for tank, title in parts.tanks:
        units = [unit for unit, _ in parts.devices.get("generator", []) if unit.tank == tank.name]
        m3_per_h = sum(_most_burned(unit) for unit in units)
        if tank.capacity_m3 is None or m3_per_h <= 0.0:
            continue
        hours = tank.capacity_m3 / m3_per_h
        if not _MIN_HOURS <= hours <= _MAX_HOURS:
            where, key = ("tank", str(tank.name), "capacity_m3"), "capacity_m3"
            allowed = (
                f"{_MIN_HOURS:g} h to {_MAX_HOURS:g} h at full power, which {hours:.3g} is not"
            )
            hint = "capacity or fuel is probably in litres; divide by 1000"
            parts.document.add(where, title, key, f"{tank.capacity_m3:g}", allowed, hint)


def _most_burned(unit: GeneratorTable) -> float:
    """m³ per h at full power; 0 where that is not stated."""
    is_stated = unit.fuel_curve is not None or unit.fuel_m3_per_mwh is not None
    if not is_stated or unit.p_max_mw is None or (unit.fuel_curve and len(unit.fuel_curve) < 2):
        return 0.0
    if unit.fuel_curve is not None:
        return float(unit.fuel_curve[-1][1])
    return unit.p_max_mw * (unit.fuel_m3_per_mwh or 0.0) + (unit.fuel_no_load_m3_per_h or 0.0)
