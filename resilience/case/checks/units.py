"""Slips of a factor of 1000 that physics gives away: kW as MW, mOhm as ohm."""

from __future__ import annotations

import math
from statistics import median
from typing import Any

from resilience.case.checks.parts import Parts
from resilience.case.networks.network import Network
from resilience.case.schema import LoadTable

_POWERS = ("p_max_mw", "p_min_mw", "s_mva", "import_max_mw", "export_max_mw")
_MAX_CURRENT_KA = 10.0
"""More than any device of a feeder draws."""
_LARGE_CURRENT_KA, _MAX_TIMES_MEDIAN, _MIN_DEVICES, _MAX_FEEDER_KV = 1.0, 100.0, 3, 66.0
"""On a feeder, a device beyond 1 kA and 100 times the median of three or more is a slip, too."""
_MAX_DROP_PU = 20.0
"""Of the voltage, if the whole load hung at the end of one line."""


def check_units(parts: Parts, network: Network) -> None:
    """Notes powers and inline impedances that cannot be in the units of their names."""
    for kind, entries in parts.devices.items():
        typical_mw = _typical_mw(entries)
        for device, title in entries:
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
