"""Sources in tiers, compiled: what a step evaluates in one sparse product of the data.

Everything that a tier needs is linear in the data: the need of every bus when all sources stand at
their lowest (a source that takes, as an export, at its largest), and the room of every tier at
every bus. It depends on the order of prices alone; prices themselves enter what an order costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.simulator.arrays import Array, ArrayOps
from resilience.models.simulator.constants import Constant, Map, Matrix
from resilience.models.simulator.fuel import Burners, compiled_burners
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
        lowest: from data to (columns,), where every source stands when nothing is drawn, MW.
        move: from data to (columns,), how far it goes when all of it is drawn, MW.
        burners: sources that burn from tanks; None without any.
    """

    tier: Ints
    block: Bools
    n_buses: int
    bus: Ints
    map: Map
    lowest: Map
    move: Map
    burners: Burners | None = None

    @property
    def tiers(self) -> int:
        """Number of tiers."""
        return len(self.block)

    def flows(
        self,
        ops: ArrayOps,
        drawn: list[Array],
        room: Array,
        data: Array,
        island: Array,
        lost: Array | None = None,
    ) -> Array:
        """(columns, batch) MW of every source, from what its tier gave in its island.

        Args:
            ops: operations for the kind of array.
            drawn: (tiers) of (buses, batch), MW drawn from every tier.
            room: (tiers, buses, batch) MW that each tier could give.
            data: (n_data, batch) or (n_data, 1).
            island: (buses, batch) number of the island of every bus.
            lost: (burners, batch) MW that burners cannot give for want of fuel; None: nothing.
        """
        if not self.tiers:
            return ops.wide(self.lowest(ops, data), island.shape[-1])
        share = ops.stacked(drawn) / ops.at_least(room, POWER_TOLERANCE_MW)
        share = ops.at_islands(share, island).reshape(-1, share.shape[-1])
        row = self.tier * self.n_buses + self.bus
        move = self.move(ops, data)
        if lost is not None and self.burners is not None:
            move = move - self.burners.at_source.as_matrix(ops) @ lost
        return ops.scaled_rows(share, row, move, self.lowest(ops, data))


@dataclass(frozen=True)
class Priced:
    """An order and what it costs.

    Attributes:
        order: the tiers.
        lowest_cost: from data to (1,), the cost of all sources at their lowest, $.
        value: (tiers, 1) $ per MW drawn from a tier.
        steps: (tiers, 1) how much dearer a tier is than the one before.
        prices: (1, columns) $ per MW of every source.
    """

    order: Order
    lowest_cost: Map
    value: Constant
    steps: Constant
    prices: Matrix


def compiled_order(plant: Plant, tier: Ints, block: Bools, closed: Bools) -> Order:
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
    lowest = _sum(_scaled(lower, pick[0]), _scaled(upper, pick[1]))
    room = _sum(upper, lower, -1.0)
    n, columns = plant.n_buses, np.arange(len(tier))
    signed = (plant.sign[:, 0], (plant.bus, columns))
    fed_at_bus = sp.csr_array(signed, shape=(n, len(columns)))
    entries = (np.ones(len(columns)), (tier * n + plant.bus, columns))
    to_tiers = sp.csr_array(entries, shape=(len(block) * n, len(columns)))
    need = _sum(plant.demand, _scaled(lowest, fed_at_bus), -1.0)
    return Order(
        tier=tier,
        block=block,
        n_buses=n,
        bus=plant.bus,
        map=_stacked(need, _scaled(room, to_tiers)),
        lowest=lowest,
        move=_scaled(room, sp.diags_array(plant.sign[:, 0])),
        burners=compiled_burners(plant, tier),
    )


def priced_order(plant: Plant, order: Order, prices: Floats, value: Floats) -> Priced:
    """What an order costs at prices (columns,) in $ per MW, `value` (tiers,) of supply."""
    form = plant.form
    moving = prices @ order.lowest.coefficients + form.offset_data
    constant = np.array([prices @ order.lowest.constant + form.offset])
    lowest_cost = Map(constant, sp.csr_array(moving[None, :]))
    value = value[:, None]
    steps = np.diff(value, axis=0, prepend=0.0)
    row = Matrix(sp.csr_array(prices[None, :]))
    return Priced(order, lowest_cost, Constant(value), Constant(steps), row)


def _scaled(x: Map, matrix: sp.sparray) -> Map:
    return Map(matrix @ x.constant, sp.csr_array(matrix @ x.coefficients))


def _sum(x: Map, y: Map, sign: float = 1.0) -> Map:
    return Map(x.constant + sign * y.constant, x.coefficients + sign * y.coefficients)


def _stacked(*maps: Map) -> Map:
    matrix = sp.vstack([m.coefficients for m in maps], format="csr")
    matrix.eliminate_zeros()
    return Map(np.concatenate([m.constant for m in maps]), matrix)
