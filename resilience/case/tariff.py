"""Time-of-use prices: what a tariff may say, and the profile that it becomes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from resilience.arrays import Floats
from resilience.case.document import Finding
from resilience.case.schema import GridTable
from resilience.case.schema.fields import MAX_PRICE_PER_MWH
from resilience.case.window import DAY_MIN, Window

_CLOCK = re.compile(r"([01]\d|2[0-3]):([0-5]\d)")


def minute_of_day(clock: str) -> int | None:
    """Minutes after midnight of `"06:30"`; `None` for any other text."""
    match = _CLOCK.fullmatch(clock)
    return int(match[1]) * 60 + int(match[2]) if match else None


def wrong_tariff(tariff: Sequence[tuple[str, float]]) -> Iterator[Finding]:
    """What is wrong with the times and prices of a tariff."""
    minutes = [minute_of_day(clock) for clock, _ in tariff]
    for number, ((clock, _), minute) in enumerate(zip(tariff, minutes, strict=True), start=1):
        if minute is None:
            hint = "write two digits for the hour and two for the minute"
            yield f"tariff[{number}]", f'"{clock}"', '"00:00" to "23:59"', hint
    for number, (_, price) in enumerate(tariff, start=1):
        if abs(price) > MAX_PRICE_PER_MWH:
            allowed, hint = f"at most {MAX_PRICE_PER_MWH:,.0f} per MWh", "prices are per MWh"
            yield f"tariff[{number}]", f"{price:g}", allowed, hint
    if None in minutes:
        return
    times = ", ".join(clock for clock, _ in tariff) or "no times"
    if not minutes or minutes[0] != 0:
        hint = 'begin with the price at midnight, ["00:00", ...]'
        yield "tariff", times, '"00:00" as the first time', hint
    elif any(b <= a for a, b in pairwise(m for m in minutes if m is not None)):
        yield "tariff", times, "each time later than the one before", "sort the times of the day"


def tariff_profiles(
    grids: Iterable[GridTable], profiles: Mapping[str, Floats], window: Window
) -> dict[str, Floats]:
    """The price profiles, (slots,) per MWh, of all tariffs under their names."""
    tariffs = {}
    for grid in grids:
        if grid.tariff is not None and grid.tariff_profile is not None:
            prices = tariff_prices(grid.tariff, window)
            if grid.price_profile is not None:
                prices = prices * profiles[grid.price_profile]
            prices.setflags(write=False)
            tariffs[grid.tariff_profile] = prices
    return tariffs


def tariff_prices(tariff: Sequence[tuple[str, float]], window: Window) -> Floats:
    """The price in every slot, (slots,); the mean over a slot in which it changes."""
    starts = np.array([minute_of_day(clock) for clock, _ in tariff], float)
    price = np.array([price for _, price in tariff])
    midnight = window.start.replace(hour=0, minute=0, second=0, microsecond=0)
    begin = (window.start - midnight).total_seconds() / 60.0
    edges = begin + window.step_min * np.arange(window.slots + 1)
    # Cost of 1 MW bought from the first midnight on, at every change of the price over the horizon.
    days = int(edges[-1] // DAY_MIN) + 1
    changes = (np.arange(days)[:, None] * DAY_MIN + starts).ravel()
    prices = np.tile(price, days)
    paid = np.concatenate([[0.0], np.cumsum(prices[:-1] * np.diff(changes))])
    period = np.searchsorted(changes, edges, side="right") - 1
    cost = paid[period] + prices[period] * (edges - changes[period])
    # A slot in which the price does not change has its price exactly, not a mean up to rounding.
    first, last = period[:-1], np.searchsorted(changes, edges[1:], side="left") - 1
    mean = np.diff(cost) / window.step_min
    return np.where(first == last, prices[first], mean)
