"""Prices of a batch, and in which order its members' sources are taken.

Members of equal prices, or of prices that put sources in the same order, are stepped together, each
at prices of its own. Whoever steps the same data again and again asks for `Simulator.priced` once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.simulator.arrays import Array, ArrayOps
from resilience.models.simulator.constants import Matrix
from resilience.models.simulator.order import Order, Priced
from resilience.models.simulator.plant import MemberPrices


@dataclass(frozen=True)
class Way:
    """One order, and what it costs each of some members.

    Attributes:
        order: the tiers.
        value: (tiers, members) or (tiers, 1) $ per MW drawn.
        steps: likewise, how much dearer a tier is than the one before.
        lowest_cost: (members,) $ of all sources at their lowest.
        prices: (1, columns) $ per MW of every source; None where members differ.
    """

    order: Order
    value: Array
    steps: Array
    lowest_cost: Array
    prices: Matrix | None


@dataclass(frozen=True)
class PriceGroup:
    """Members whose sources are taken in the same order.

    Attributes:
        members: (members,) which they are; None: all of them.
        storage: (1, units) $ per MW of charging and of discharging; None where all are 0.
        ways: the order, or one per way to close connections, see `modes`.
    """

    members: Array | None
    storage: tuple[Matrix | None, Matrix | None]
    ways: tuple[Way, ...]


@dataclass(frozen=True)
class PricedBatch:
    """A batch in groups.

    Attributes:
        groups: every member is in one of them.
        place: (batch,) where each member is when groups are laid side by side; None: there is one.
    """

    groups: tuple[PriceGroup, ...]
    place: Array | None = None


def priced_batch(
    ops: ArrayOps,
    data: Array,
    prices: Sequence[MemberPrices],
    in_order: Callable[[Floats], list[Priced]],
    row: Callable[[Floats], Matrix | None],
    *,
    apart: bool,
) -> PricedBatch:
    """Groups a batch.

    Args:
        ops: operations for the kind of array.
        data: (n_data, batch) or (n_data, 1).
        prices: of the batch, from `Plant.prices`.
        in_order: the orders that prices (columns,) lead to.
        row: prices (units,) as a row; None where all are 0.
        apart: members of different prices are never joined.
    """
    ways = [in_order(group_prices.sources) for group_prices in prices]
    if len(prices) == 1:
        return PricedBatch((_group(ops, data, prices, ways, None, row),))
    joined: dict[tuple[bytes, ...], list[int]] = {}
    for k, group_prices in enumerate(prices):
        orders = [str(id(priced.order)).encode() for priced in ways[k]]
        key = (
            (group_prices.sources.tobytes(),)
            if apart
            else (group_prices.storage.tobytes(), *orders)
        )
        joined.setdefault(key, []).append(k)
    groups, members = [], []
    for ones in joined.values():
        paid = [prices[k] for k in ones]
        members.append(np.concatenate([_chosen(price) for price in paid]))
        chosen = ops.index(members[-1])
        groups.append(_group(ops, data, paid, [ways[k] for k in ones], chosen, row))
    place = np.argsort(np.concatenate(members), kind="stable")
    return PricedBatch(tuple(groups), ops.index(place))


def _group(
    ops: ArrayOps,
    data: Array,
    prices: Sequence[MemberPrices],
    ways: list[list[Priced]],
    members: Array | None,
    row: Callable[[Floats], Matrix | None],
) -> PriceGroup:
    """The members of some prices, one after the other; `ways` are the orders of each price."""
    parts = [data if p.members is None else data[:, ops.index(p.members)] for p in prices]
    of_group = []
    for same in zip(*ways, strict=True):  # one order, price by price
        lowest = [priced.lowest_cost(ops, x)[0] for priced, x in zip(same, parts, strict=True)]
        if len(same) == 1:
            value, steps = same[0].value.as_array(ops), same[0].steps.as_array(ops)
            of_group.append(Way(same[0].order, value, steps, lowest[0], same[0].prices))
            continue
        counts = [len(_chosen(price)) for price in prices]
        wide = [ops.wide(cost, n) for cost, n in zip(lowest, counts, strict=True)]
        value, steps = (
            ops.array(np.repeat(np.concatenate(values, axis=1), counts, axis=1))
            for values in zip(*((p.value.value, p.steps.value) for p in same), strict=True)
        )
        of_group.append(Way(same[0].order, value, steps, ops.joined(wide), None))
    charge, discharge = (row(price) for price in prices[0].storage)
    return PriceGroup(members, (charge, discharge), tuple(of_group))


def _chosen(prices: MemberPrices) -> Ints:
    return np.empty(0, np.intp) if prices.members is None else prices.members
