"""The price of being short of a storm reserve: between the dearest source and the cheapest loss."""

from __future__ import annotations

from collections.abc import Iterable

from resilience.case.checks.parts import Parts
from resilience.case.schema import DeviceTable


def reserve_price_range(devices: Iterable[DeviceTable]) -> tuple[float, float]:
    """The marginal cost of the dearest generator and the price of the cheapest shedding, $/MWh.

    At a price below the first, a reserve is never built from a generator; above the second, load is
    shed to keep it.
    """
    devices = tuple(devices)
    costs = [cost for d in devices if (cost := d.marginal_cost_per_mwh) is not None]
    losses = [price for d in devices if (price := d.shed_price_per_mwh) is not None]
    return max(costs, default=0.0), min(losses, default=0.0)


def check_reserve(parts: Parts, price: float) -> None:
    """Notes a reserve price, per MWh, that lies outside its range; devices must be sound."""
    low, high = reserve_price_range(device for _, device, _ in parts.all_devices())
    if low < price < high:
        return
    key = "reserve_price_per_mwh"
    allowed = f"above {low:g}, the dearest generator, and below {high:g}, the cheapest shedding"
    hint = "outside, load is shed to keep a reserve, or none is ever kept; leave it out"
    parts.document.add((key,), "", key, f"{price:g}", allowed, hint)
