r"""The economic recourse: cheapest first, which is the optimum of an island without losses.

With storage fixed, the recourse of an island is a continuous knapsack: its sources in merit order
are the optimum of the one-slot linear program. Sources of one price make a tier and share it in
proportion to their room.

A block is a tier of its own and is taken whole: greedily in merit order, given back where a dearer
one made it needless. The sources that are no blocks then close what is left, so that a block that
sheds more than was missing gives the rest back to the cheapest of them. That is a heuristic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.simulator.arrays import Array
from resilience.models.simulator.order import Order
from resilience.models.simulator.plant import Plant
from resilience.tolerances import POWER_TOLERANCE_MW, PRICE_DECIMALS


def ranked(plant: Plant, prices: Floats, blocks: Ints) -> tuple[Ints, Floats, Bools]:
    """The tiers by what one more MW of supply costs, cheapest first.

    Args:
        plant: the stage as a step sees it.
        prices: (columns,) $ per MW.
        blocks: sources that are all or nothing.

    Returns:
        (columns,) every source's tier; (tiers,) $ per MW of supply; (tiers,) whether it is a block.
    """
    marginal = np.round(prices / plant.sign[:, 0], PRICE_DECIMALS)
    alone = np.zeros(len(prices), np.intp)
    alone[blocks] = 1 + np.arange(len(blocks))
    keys, tier = np.unique(np.stack([marginal, alone]), axis=1, return_inverse=True)
    return tier.ravel(), keys[0], keys[1] > 0


def fill(ops: Any, order: Order, need: Array, there: Array) -> tuple[list[Array], Array]:
    """Takes from the tiers in order until the need of every island is met.

    Args:
        ops: operations for the kind of array.
        order: the tiers.
        need: (buses, batch) MW missing, in the row of the island's number.
        there: (tiers, buses, batch) MW that each tier can give there.

    Returns:
        What every tier gave, and the need that is left (negative: a surplus), (buses, batch).
    """
    taken = {}
    if order.block.any():
        for k, shed in _blocks(ops, order, need, there).items():
            taken[k] = shed
            need = need - shed
    need = need + 0.0  # fresh, to be changed in place
    for k in range(order.tiers):
        if k not in taken:
            taken[k] = ops.minimum(ops.positive(need), there[k])
            need = ops.less(need, taken[k])
    return [taken[k] for k in range(order.tiers)], need


def _blocks(ops: Any, order: Order, need: Array, there: Array) -> dict[int, Array]:
    """What every block sheds: all or nothing."""
    left, before, shed = need, need, {}
    short = {}
    for k in range(order.tiers):
        if order.block[k]:
            short[k] = before  # what the cheaper sources cannot give, blocks aside
            shed[k] = ops.where(left > POWER_TOLERANCE_MW, there[k], there[k] * 0.0)
            left = left - shed[k]
        else:
            left = left - ops.minimum(ops.positive(left), there[k])
            before = before - there[k]
    total = sum(shed.values())
    for k in reversed(shed):
        spare = total - shed[k] >= short[k] - POWER_TOLERANCE_MW
        kept = ops.where(spare, shed[k] * 0.0, shed[k])
        total, shed[k] = total - shed[k] + kept, kept
    return shed
