r"""Sources that burn from tanks: what a step draws of them, and who goes without where it ends.

Sources are taken in merit order, blind to fuel. Where a tank holds less than its sources would burn
in the step, they have it in that order, those of one price in proportion, and what they lack is
room that their tiers have not: everybody else then closes the islands. A source that stands in may
empty another tank, so this is done as often as there are tanks. Sources burn in proportion to their
power, $a_g \Delta t$ m³ per MW; the levels are those of `components.tank`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Ints
from resilience.models.simulator.arrays import Array, ArrayOps
from resilience.models.simulator.constants import Constant, Matrix
from resilience.models.simulator.plant import Plant
from resilience.tolerances import POWER_TOLERANCE_MW

FUEL_TOLERANCE_M3 = 1e-12
"""Of the fuel of a step: as much is rounding."""


Tiers = tuple[Array, Array]
"""(tiers, buses, batch) MW that each tier can give in an island, and that all cheaper ones can."""


@dataclass(frozen=True)
class Burners:
    """Sources that burn from tanks, in one order of all sources.

    Attributes:
        tanks: how many there are.
        source: (burners,) which of the sources they are.
        tank: (burners,) from which tank.
        bus: (burners,) its bus.
        first_row: (burners,) where its tier begins among the tiers of all buses, bus by bus.
        per_mw: (burners, 1) m³ burnt in a step per MW.
        of_tank: (tanks, burners) 1 where a burner belongs to a tank.
        before, beside: (burners, burners) 1 where another of the same tank is taken earlier, and
            where it is in the same tier, itself included.
        tiers: their tiers, each once.
        at_tier: (those tiers times buses, burners) 1 where a burner stands.
        at_source: (columns, burners) likewise among the sources.
    """

    tanks: int
    source: Ints
    tank: Ints
    bus: Ints
    first_row: Ints
    per_mw: Constant
    of_tank: Matrix
    before: Matrix
    beside: Matrix
    tiers: Ints
    at_tier: Matrix
    at_source: Matrix

    def share(self, ops: ArrayOps, burnt: Array, fuel: Array) -> Array:
        """(burners, batch) of what they would burn, m³, the share for which there is fuel."""
        remaining = ops.rows(fuel, self.tank) - self.before.as_matrix(ops) @ burnt
        demand = ops.at_least(self.beside.as_matrix(ops) @ burnt, FUEL_TOLERANCE_M3)
        return ops.positive_up_to(remaining / demand, remaining * 0.0 + 1.0)

    def total(self, ops: ArrayOps, burnt: Array) -> Array:
        """(tanks, batch) m³ that burners (burners, batch) burn."""
        return self.of_tank.as_matrix(ops) @ burnt


@dataclass(frozen=True)
class Fuelled:
    """Burners in a slot, arrays (burners, batch).

    Attributes:
        burners: which they are.
        island: number of the island of each.
        row: of its tier there, among the tiers of all buses.
        most_mw: MW that it can give.
        room, before: MW that its tier can give there, and that all cheaper tiers can.
        per_drawn: m³ that it burns per MW drawn from its tier.
    """

    burners: Burners
    island: Array
    row: Array
    most_mw: Array
    room: Array
    before: Array
    per_drawn: Array

    @classmethod
    def of_slot(
        cls, ops: ArrayOps, burners: Burners, island: Array, most_mw: Array, tiers: Tiers
    ) -> Fuelled:
        """Burners that can give `most_mw`.

        Args:
            ops: operations for the kind of array.
            burners: which they are.
            island: (buses, batch) number of the island of every bus.
            most_mw: (burners, batch) MW.
            tiers: MW that each tier can give, and that all cheaper ones can.
        """
        at_bus = ops.rows(island, burners.bus)
        row = at_bus + ops.index(burners.first_row)[:, None]
        flat = [x.reshape(-1, x.shape[-1]) for x in tiers]
        room, before = (ops.at_islands(x, row) for x in flat)
        per_mw = burners.per_mw.as_array(ops)
        per_drawn = per_mw * most_mw / ops.at_least(room, POWER_TOLERANCE_MW)
        return cls(burners, at_bus, row, most_mw, room, before, per_drawn)

    def burnt(self, ops: ArrayOps, need: Array) -> Array:
        """(burners, batch) m³ where islands need (buses, batch) MW and no tier is a block."""
        drawn = ops.at_islands(need, self.island) - self.before
        return ops.positive_up_to(drawn, self.room) * self.per_drawn

    def burnt_of(self, ops: ArrayOps, drawn: list[Array]) -> Array:
        """(burners, batch) m³ where the tiers give (tiers) of (buses, batch) MW."""
        return ops.at_islands(ops.joined(drawn), self.row) * self.per_drawn

    def lost(self, ops: ArrayOps, burnt: Array, fuel: Array, over: Array) -> Array:
        """(burners, batch) MW of what each can give that it cannot where its tank is too low.

        Args:
            ops: operations for the kind of array.
            burnt: (burners, batch) m³ that they would burn.
            fuel: (tanks, batch) m³ that is there for it.
            over: (tanks, batch) m³ that they would burn beyond it.
        """
        is_short = ops.rows(over, self.burners.tank) > FUEL_TOLERANCE_M3
        allowed = burnt * self.burners.share(ops, burnt, fuel) / self.burners.per_mw.as_array(ops)
        return ops.where(is_short, self.most_mw - allowed, self.most_mw * 0.0)


def compiled_burners(plant: Plant, tier: Ints) -> Burners | None:
    """The burners of a plant whose sources are in the tiers (columns,); None without any."""
    source = plant.burners
    if not len(source):
        return None
    per_mw = plant.fuel_per_mw[:, source]
    tank, rank, bus, n = per_mw.indices, tier[source], plant.bus[source], plant.n_buses
    tiers, number = np.unique(rank, return_inverse=True)
    same = tank[:, None] == tank[None, :]
    ones, count = np.ones(len(source)), np.arange(len(source))

    def picked(rows: Ints, n_rows: int) -> Matrix:
        return Matrix(sp.csr_array((ones, (rows, count)), shape=(n_rows, len(source))))

    return Burners(
        tanks=len(plant.tanks),
        source=source,
        tank=np.asarray(tank, np.intp),
        bus=bus,
        first_row=rank * n,
        per_mw=Constant(per_mw.data[:, None]),
        of_tank=picked(tank, len(plant.tanks)),
        before=Matrix(sp.csr_array(same & (rank[None, :] < rank[:, None]), dtype=float)),
        beside=Matrix(sp.csr_array(same & (rank[None, :] == rank[:, None]), dtype=float)),
        tiers=tiers,
        at_tier=picked(number * n + bus, len(tiers) * n),
        at_source=picked(source, len(tier)),
    )


class FuelLimits:
    """What burners of a plant cannot give for want of fuel, each tank shared in proportion.

    It is what somebody knows who decides before islands are closed.

    Args:
        plant: the stage as a step sees it; it has tanks.
    """

    def __init__(self, plant: Plant) -> None:
        source = plant.burners
        per_mw = sp.csr_array(plant.fuel_per_mw[:, source])
        ones, count = np.ones(len(source)), np.arange(len(source))
        self._delivered = plant.delivered
        self._most = plant.bound("upper", plant.sources[source])
        self._per_mw = Matrix(per_mw)
        self._tank = np.asarray(plant.fuel_per_mw[:, source].indices, np.intp)
        at_bus = sp.csr_array((ones, (plant.bus[source], count)), shape=(plant.n_buses, len(count)))
        self._at_bus = Matrix(at_bus)

    def lost(self, ops: ArrayOps, data: Array, fuel: Array) -> Array:
        """(buses, batch) MW that burners there would give at most, and for which there is no fuel.

        Args:
            ops: operations for the kind of array.
            data: (n_data, batch) from `stacked`.
            fuel: (tanks, batch) m³ in every tank.
        """
        most_mw = ops.wide(self._most(ops, data), fuel.shape[-1])
        available = fuel + self._delivered(ops, data)
        burnt = ops.at_least(self._per_mw.as_matrix(ops) @ most_mw, FUEL_TOLERANCE_M3)
        short = 1.0 - ops.positive_up_to(available / burnt, available * 0.0 + 1.0)
        return self._at_bus.as_matrix(ops) @ (most_mw * ops.rows(short, self._tank))
