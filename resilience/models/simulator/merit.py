r"""The economic recourse: cheapest first, which is the optimum of an island without losses.

With storage fixed, the recourse of an island is a continuous knapsack: its sources in merit order
are the optimum of the one-slot linear program. Sources of one price make a tier and share it in
proportion to their room.

A block is a tier of its own and is taken whole: greedily in merit order, given back where a dearer
one made it needless. The sources that are no blocks then close what is left, so that a block that
sheds more than was missing gives the rest back to the cheapest of them. That is a heuristic.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools, Floats, Ints, rounded
from resilience.models.simulator.arrays import Array, ArrayOps
from resilience.models.simulator.order import Order
from resilience.models.simulator.plant import Plant
from resilience.tolerances import POWER_TOLERANCE_MW, PRICE_DIGITS


def merit_order(plant: Plant, prices: Floats, blocks: Ints) -> tuple[Ints, Floats, Bools]:
    """The tiers by what one more MW of supply costs, cheapest first.

    Args:
        plant: the stage as a step sees it.
        prices: (columns,) $ per MW.
        blocks: sources that are all or nothing.

    Returns:
        (columns,) every source's tier; (tiers,) $ per MW of supply; (tiers,) whether it is a block.
    """
    marginal = rounded(prices / plant.sign[:, 0], PRICE_DIGITS)
    block_number = np.zeros(
        len(prices), np.intp
    )  # 0: not a block; every block is a tier of its own
    block_number[blocks] = 1 + np.arange(len(blocks))
    keys, tier = np.unique(np.stack([marginal, block_number]), axis=1, return_inverse=True)
    return tier.ravel(), keys[0], keys[1] > 0


def fill(ops: ArrayOps, order: Order, need: Array, room: Array) -> tuple[list[Array], Array]:
    """Draws from the tiers in order until the need of every island is met.

    Args:
        ops: operations for the kind of array.
        order: the tiers.
        need: (buses, batch) MW missing, in the row of the island's number.
        room: (tiers, buses, batch) MW that each tier can give there.

    Returns:
        (tiers) of (buses, batch), MW drawn from every tier; and the need that remains (negative: a
        surplus), (buses, batch).
    """
    drawn = {}
    if order.block.any():
        for k, shed in _shed_blocks(ops, order, need, room).items():
            drawn[k] = shed
            need = need - shed
    for k in range(order.tiers):
        if k not in drawn:
            drawn[k] = ops.positive_up_to(need, room[k])
            need = need - drawn[k]
    return [drawn[k] for k in range(order.tiers)], need


def _shed_blocks(ops: ArrayOps, order: Order, need: Array, room: Array) -> dict[int, Array]:
    """(buses, batch) MW that every block sheds, by its tier: all or nothing."""
    unmet, loose_need, shed = need, need, {}
    shortfall = {}  # what the sources cheaper than a block cannot give, blocks aside
    for k in range(order.tiers):
        if order.block[k]:
            shortfall[k] = loose_need
            shed[k] = ops.where(unmet > POWER_TOLERANCE_MW, room[k], room[k] * 0.0)
            unmet = unmet - shed[k]
        else:
            unmet = unmet - ops.positive_up_to(unmet, room[k])
            loose_need = loose_need - room[k]
    total = sum(shed.values())
    # From the dearest on: a block is needless if the others alone cover its shortfall.
    for k in reversed(shed):
        needless = total - shed[k] >= shortfall[k] - POWER_TOLERANCE_MW
        trimmed = ops.where(needless, shed[k] * 0.0, shed[k])
        total, shed[k] = total - shed[k] + trimmed, trimmed
    return shed
