"""Sources in tiers, compiled: what a step evaluates in one sparse product of the data.

Everything that a tier needs is linear in the data: the need of every bus when all sources stand at
their least (a source that takes, as an export, at its most), and the room of every tier at every
bus. It depends on the order of prices alone; prices themselves enter what an order costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.simulator.arrays import Array, Constant, Map
from resilience.models.simulator.plant import Plant
from resilience.tolerances import POWER_TOLERANCE_MW


@dataclass(frozen=True)
class Order:
    """The sources in tiers.

    Attributes:
        tier: (columns,) number of every source's tier, 0 is taken from first.
        block: (tiers,) whether the tier is one block.
        n_buses: number of buses.
        bus: (columns,) where the sources stand.
        map: from data to the need of every bus and the room of every tier at every bus, MW.
        least: (columns,) from data: where every source stands when nothing is taken, MW.
        move: (columns,) from data: how far it goes when all of it is taken, MW.
    """

    tier: Ints
    block: Bools
    n_buses: int
    bus: Ints
    map: Map
    least: Map
    move: Map

    @property
    def tiers(self) -> int:
        """Number of tiers."""
        return len(self.block)

    def parts(self, found: Array) -> tuple[Array, Array]:
        """Need (buses, batch) and room (tiers, buses, batch) from what `map` gave."""
        n = self.n_buses
        return found[:n], found[n:].reshape(self.tiers, n, found.shape[-1])

    def flows(
        self, ops: Any, taken: list[Array], there: Array, data: Array, island: Array
    ) -> Array:
        """(columns, batch) every source, from what its tier gave in its island."""
        smallest = ops.array(np.array(POWER_TOLERANCE_MW))
        share = ops.joined([used[None] for used in taken]) / ops.maximum(there, smallest)
        share = ops.spread(share, island).reshape(-1, share.shape[-1])
        used = ops.rows(share, self.tier * self.n_buses + self.bus)
        return ops.plus(ops.times(used, self.move(ops, data)), self.least(ops, data))


@dataclass(frozen=True)
class Priced:
    """An order and what it costs.

    Attributes:
        order: the tiers.
        least: from data to the cost of all sources at their least, $.
        value: (tiers,) $ per MW taken from a tier.
        prices: (columns,) $ per MW of every source.
    """

    order: Order
    least: Map
    value: tuple[float, ...]
    prices: Constant


def compiled(plant: Plant, tier: Ints, block: Bools, closed: Bools) -> Order:
    """Compiles tiers.

    Args:
        plant: the stage as a step sees it.
        tier: (columns,) number of every source's tier.
        block: (tiers,) whether the tier is one block.
        closed: (columns,) sources that stand at zero whatever their bounds.
    """
    open_ = sp.diags_array(np.where(closed, 0.0, 1.0))
    lower, upper = _scaled(plant.lower, open_), _scaled(plant.upper, open_)
    feeds = plant.sign[:, 0] > 0
    pick = sp.diags_array(feeds * 1.0), sp.diags_array(~feeds * 1.0)
    least = _sum(_scaled(lower, pick[0]), _scaled(upper, pick[1]))
    room = _sum(upper, lower, -1.0)
    n, each = plant.n_buses, np.arange(len(tier))
    place = sp.csr_array((plant.sign[:, 0], (plant.bus, each)), shape=(n, len(each)))
    where = (np.ones(len(each)), (tier * n + plant.bus, each))
    stacked = sp.csr_array(where, shape=(len(block) * n, len(each)))
    need = _sum(plant.demand, _scaled(least, place), -1.0)
    return Order(
        tier=tier,
        block=block,
        n_buses=n,
        bus=plant.bus,
        map=_stacked(need, _scaled(room, stacked)),
        least=least,
        move=_scaled(room, sp.diags_array(plant.sign[:, 0])),
    )


def priced(plant: Plant, order: Order, prices: Floats, value: Floats) -> Priced:
    """What an order costs at prices (columns,) in $ per MW, `value` (tiers,) of supply."""
    form = plant.form
    moving = prices @ order.least.coefficients + form.offset_data
    constant = np.array([prices @ order.least.constant + form.offset])
    least = Map(constant, sp.csr_array(moving[None, :]))
    return Priced(order, least, tuple(value.tolist()), Constant(prices))


def _scaled(x: Map, matrix: Any) -> Map:
    return Map(matrix @ x.constant, sp.csr_array(matrix @ x.coefficients))


def _sum(x: Map, y: Map, sign: float = 1.0) -> Map:
    return Map(x.constant + sign * y.constant, x.coefficients + sign * y.coefficients)


def _stacked(*parts: Map) -> Map:
    matrix = sp.vstack([p.coefficients for p in parts], format="csr")
    matrix.eliminate_zeros()
    return Map(np.concatenate([p.constant for p in parts]), matrix)
