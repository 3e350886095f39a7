"""The price of being short of a storm reserve: between the dearest source and the cheapest loss."""

from __future__ import annotations

from collections.abc import Iterable

from resilience.case.checks.parts import Parts
from resilience.case.schema import GeneratorTable, HeadTable, LoadTable


def reserve_price_range(
    generators: Iterable[GeneratorTable], loads: Iterable[LoadTable]
) -> tuple[float, float]:
    """The marginal cost of the dearest generator and the price of the cheapest shedding, $/MWh.

    At a price below the first, a reserve is never built from a generator; above the second, load is
    shed to keep it.
    """
    low = max((unit.marginal_cost_per_mwh for unit in generators), default=0.0)
    high = min((load.shed_cost_per_mwh * load.priority for load in loads), default=0.0)
    return low, high


def check_reserve(parts: Parts, head: HeadTable) -> None:
    """Notes a reserve price that lies outside its range; devices must be sound."""
    price = head.reserve_price_per_mwh
    if price is None:
        return
    generators, loads = ([t for t, _ in parts.devices.get(k, [])] for k in ("generator", "load"))
    low, high = reserve_price_range(generators, loads)
    if low < price < high:
        return
    key = "reserve_price_per_mwh"
    allowed = f"above {low:g}, the dearest generator, and below {high:g}, the cheapest shedding"
    hint = "outside, load is shed to keep a reserve, or none is ever kept; leave it out"
    parts.document.add((key,), "", key, f"{price:g}", allowed, hint)
