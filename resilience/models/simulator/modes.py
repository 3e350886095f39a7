"""Which side of a grid connection to close where importing and exporting at once would earn."""

from __future__ import annotations

from itertools import product

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.components import in_roles
from resilience.models.simulator.plant import Plant
from resilience.tolerances import PRICE_TOLERANCE

MAX_CONNECTIONS = 4  # for which both sides are tried, 2^4 ways


def modes(plant: Plant, prices: Floats) -> list[Bools]:
    """The ways to close sources, (columns,) True where one is closed; usually one that closes none.

    The cheapest dispatch does both at once only where both prices together earn, as negative
    prices may, so only there a way is to be chosen.

    Args:
        plant: the stage as a step sees it.
        prices: (columns,) $ per MW.

    Raises:
        UsageError: too many connections would earn.
    """
    exchanges = in_roles(plant.microgrid.fleets.values(), "exchange")
    flows = [(name, sign) for fleet in exchanges for name, sign in fleet.flows.items()]
    ways = [
        np.flatnonzero(np.isin(plant.kinds, [name for name, sign in flows if sign * way > 0]))
        for way in (1.0, -1.0)
    ]
    both = np.stack(ways)[:, prices[ways[0]] + prices[ways[1]] < -PRICE_TOLERANCE]
    if both.shape[1] > MAX_CONNECTIONS:
        raise UsageError(
            f"{both.shape[1]} grid connections earn by importing and exporting at once; "
            f"allowed: {MAX_CONNECTIONS}",
            hint="an import price below what exports earn is a mistake in most cases",
        )
    closings = []
    for sides in product((0, 1), repeat=both.shape[1]):
        closed = np.zeros(len(prices), bool)
        closed[both[list(sides), np.arange(both.shape[1])]] = True
        closings.append(closed)
    return closings
