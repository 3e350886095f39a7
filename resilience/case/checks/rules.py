"""Rules for devices: what must hold between the keys of a table, and what is plausible.

A slip of a factor of 1000 is given away by physics: kW as MW, mohm as ohm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.networks.network import Network
from resilience.case.schema import DeviceTable, ESSTable, GeneratorTable, LoadTable
from resilience.case.schema.fields import MAX_PRICE_PER_MWH
from resilience.tolerances import INPUT_TOLERANCE

_MIN_HOURS, _MAX_HOURS = 0.02, 200.0
"""Of storage at full power; beyond either, energy and power are not in one unit."""
_POWERS = ("p_max_mw", "p_min_mw", "q_mvar", "s_mva", "import_max_mw", "export_max_mw")
_MAX_CURRENT_KA = 10.0
"""More than any device of a feeder draws."""
_LARGE_CURRENT_KA, _MAX_TIMES_MEDIAN, _MIN_DEVICES, _MAX_FEEDER_KV = 1.0, 100.0, 3, 66.0
"""On a feeder, a device beyond 1 kA and 100 times the median of three or more is a slip, too."""
_MAX_DROP_PU = 20.0
"""Of the voltage, if the whole load hung at the end of one line."""


@dataclass(frozen=True)
class KeyRule:
    """One fact about a kind of device.

    Attributes:
        kind: of the device.
        needs: keys without which it is not checked; a message names the first of them.
        broken: whether a device breaks it.
        allowed: what may stand there, with the values of the keys in braces.
        hint: what to do about it.
    """

    kind: str
    needs: tuple[str, ...]
    broken: Callable[[Any], bool]
    allowed: str
    hint: str


def _outside_band(unit: ESSTable) -> bool:
    inside = unit.soc_min - INPUT_TOLERANCE <= unit.soc_initial <= unit.soc_max + INPUT_TOLERANCE
    return unit.soc_min <= unit.soc_max and not inside


def _strange_duration(unit: ESSTable) -> bool:
    return unit.p_max_mw > 0 and not _MIN_HOURS <= unit.e_mwh / unit.p_max_mw <= _MAX_HOURS


def _bad_curve(unit: GeneratorTable) -> bool:
    p_mw = [point[0] for point in unit.cost_curve or ()]
    if len(p_mw) < 2 or any(later <= earlier for earlier, later in pairwise(p_mw)):
        return True
    low, high = unit.p_min_mw + INPUT_TOLERANCE, unit.p_max_mw - INPUT_TOLERANCE
    return p_mw[0] > low or p_mw[-1] < high


def _ramped_start_below_minimum(unit: GeneratorTable) -> bool:
    ramped = unit.ramp_up_mw_per_h is not None or unit.ramp_down_mw_per_h is not None
    return ramped and unit.initial_on and unit.p_initial_mw < unit.p_min_mw - INPUT_TOLERANCE


RULES = (
    KeyRule(
        "ess",
        ("soc_min", "soc_max"),
        lambda unit: unit.soc_min > unit.soc_max,
        "at most soc_max = {soc_max:g}",
        "swap the two limits, or lower soc_min",
    ),
    KeyRule(
        "ess",
        ("soc_initial", "soc_min", "soc_max"),
        _outside_band,
        "soc_min = {soc_min:g} to soc_max = {soc_max:g}",
        "set soc_initial inside the band",
    ),
    KeyRule(
        "ess",
        ("soc_final_min", "soc_max"),
        lambda unit: unit.soc_final_min > unit.soc_max + INPUT_TOLERANCE,
        "at most soc_max = {soc_max:g}",
        "lower soc_final_min",
    ),
    KeyRule(
        "ess",
        ("e_mwh", "p_max_mw"),
        _strange_duration,
        f"{_MIN_HOURS:g} h to {_MAX_HOURS:g} h at p_max_mw = {{p_max_mw:g}}",
        "one of e_mwh and p_max_mw is probably in kWh or kW",
    ),
    KeyRule(
        "generator",
        ("p_min_mw", "p_max_mw"),
        lambda unit: unit.p_min_mw > unit.p_max_mw,
        "at most p_max_mw = {p_max_mw:g}",
        "swap the two limits, or lower p_min_mw",
    ),
    KeyRule(
        "generator",
        ("q_min_mvar", "q_max_mvar"),
        lambda unit: unit.q_min_mvar > unit.q_max_mvar,
        "at most q_max_mvar = {q_max_mvar:g}",
        "swap the two limits",
    ),
    KeyRule(
        "generator",
        ("cost_curve", "p_min_mw", "p_max_mw"),
        _bad_curve,
        "two points or more, p_mw rising from at most {p_min_mw:g} to at least {p_max_mw:g}",
        "write [[p_mw, cost_per_h], ...] over the whole range p_min_mw to p_max_mw",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "p_max_mw"),
        lambda unit: unit.p_initial_mw > unit.p_max_mw,
        "at most p_max_mw = {p_max_mw:g}",
        "lower p_initial_mw",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "initial_on"),
        lambda unit: unit.p_initial_mw > 0 and not unit.initial_on,
        "0 while initial_on = false",
        "set initial_on = true, or p_initial_mw = 0",
    ),
    KeyRule(
        "generator",
        ("p_initial_mw", "initial_on", "p_min_mw"),
        _ramped_start_below_minimum,
        "at least p_min_mw = {p_min_mw:g} while initial_on = true, since ramps start there",
        "set p_initial_mw to the output before the first slot",
    ),
)

_REACTIVE = (
    KeyRule(
        "load",
        ("q_mvar", "power_factor"),
        lambda load: load.power_factor != 1.0,
        "nothing beside power_factor = {power_factor:g}",
        "give one of the two; power_factor = 1 takes back a default",
    ),
    KeyRule(
        "pv",
        ("q_mvar", "s_mva"),
        lambda unit: unit.q_mvar != 0.0,
        "nothing beside s_mva = {s_mva:g}, which leaves reactive power free",
        "drop one of the two",
    ),
    KeyRule(
        "pv",
        ("q_mvar", "p_max_mw"),
        lambda unit: unit.q_mvar != 0.0 and unit.p_max_mw == 0.0,
        "0 beside p_max_mw = 0, to which it is in proportion",
        "write a [[load]] with p_max_mw = 0 and q_mvar of the other sign",
    ),
)


def broken_rules(kind: str, device: DeviceTable) -> Iterator[Finding]:
    """What is wrong within one device table."""
    for rule in (*RULES, *_REACTIVE):
        values: dict[str, Any] = {key: getattr(device, key, None) for key in rule.needs}
        if rule.kind == kind and None not in values.values() and rule.broken(device):
            key, value = next(iter(values.items()))
            text = f"{value:g}" if isinstance(value, float | int) else _curve_text(value)
            yield key, text, rule.allowed.format(**values), rule.hint
    for key in type(device).model_fields:
        price = getattr(device, key)
        if key.endswith("_per_mwh") and price is not None and abs(price) > MAX_PRICE_PER_MWH:
            allowed = f"at most {MAX_PRICE_PER_MWH:,.0f} per MWh"
            yield key, f"{price:g}", allowed, "prices are per MWh, not per kWh or per MW of a year"


def _curve_text(curve: Sequence[tuple[float, float]]) -> str:
    return "p_mw = " + ", ".join(f"{point[0]:g}" for point in curve)


def check_units(parts: Parts, network: Network) -> None:
    """Notes powers and inline impedances that cannot be in the units of their names."""
    for kind, entries in parts.devices.items():
        typical_mw = _typical_mw(entries)
        for device, title in entries if not network.placeholder_kv else ():
            if device.bus and network.has_bus(device.bus):
                vn_kv = float(network.vn_kv[network.bus(device.bus)])
                for key, power_mw in _powers(device):
                    is_large = abs(power_mw) > _MAX_TIMES_MEDIAN * typical_mw
                    is_odd = is_large and vn_kv <= _MAX_FEEDER_KV
                    limit_ka = _LARGE_CURRENT_KA if is_odd else _MAX_CURRENT_KA
                    where = (kind, str(device.name), key)
                    _check_current(parts, where, title, power_mw, vn_kv, limit_ka)
    _check_impedances(parts)


def _typical_mw(entries: list[tuple[Any, str]]) -> float:
    """The median power of a kind of device; infinite where there are too few to tell."""
    rated = [getattr(device, "p_max_mw", None) for device, _ in entries]
    powers = [power for power in rated if power is not None]
    return median(powers) if len(powers) >= _MIN_DEVICES else math.inf


def _powers(device: Any) -> list[tuple[str, float]]:
    """The powers of a device by key, without a discharging limit that only mirrors."""
    powers = [(key, getattr(device, key, None)) for key in _POWERS]
    mirror = ("p_min_mw", -(getattr(device, "p_max_mw", None) or 0.0))
    return [(key, power) for key, power in powers if power is not None and (key, power) != mirror]


def _check_current(
    parts: Parts, where: tuple[str, ...], title: str, power_mw: float, vn_kv: float, limit_ka: float
) -> None:
    limit_mw = limit_ka * math.sqrt(3.0) * vn_kv
    if abs(power_mw) > limit_mw:
        value = f"{power_mw:g}, which is {abs(power_mw) / limit_mw * limit_ka:.3g} kA"
        allowed = f"up to {limit_mw:.3g}, which is {limit_ka:g} kA at {vn_kv:g} kV"
        hint = "probably kW given as MW; divide by 1000"
        parts.document.add(where, title, where[-1], value, allowed, hint)


def _check_impedances(parts: Parts) -> None:
    """Refuses an inline line on which the whole load would lose many times the voltage."""
    loads = [device for _, device, _ in parts.all_devices() if isinstance(device, LoadTable)]
    load_mw = sum(load.p_max_mw or 0.0 for load in loads)
    for line, title in parts.inline.lines:
        vn_kv = parts.inline.buses[line.from_].vn_kv
        limit_ohm = _MAX_DROP_PU * vn_kv**2 / load_mw if load_mw > 0 else math.inf
        for key, ohm in (("r_ohm", line.r_ohm), ("x_ohm", line.x_ohm)):
            if ohm > limit_ohm:
                allowed = f"up to {limit_ohm:.3g}, for {load_mw:g} MW of load at {vn_kv:g} kV"
                hint = "probably mOhm given as ohm, or metres taken for kilometres"
                parts.document.add(("network", "line"), title, key, f"{ohm:g}", allowed, hint)
