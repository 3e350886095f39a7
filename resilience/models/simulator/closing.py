r"""Closing every island of a batch: recourse, what it costs, and cutting storage back.

Without blocks a step needs no source on its own. Drawing cheapest first, an island spends

$$ \sum_k (c_k - c_{k-1}) \max\Big(0, n - \sum_{j<k} r_j\Big) $$

for a need $n$ up to the room $r$ of all its tiers together, with $c$ their prices; that is one
operation for all tiers, and what every source gives is worked out when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from resilience.models.simulator.arrays import Array, ArrayOps, array_ops
from resilience.models.simulator.constants import Matrix
from resilience.models.simulator.fuel import FUEL_TOLERANCE_M3, Fuelled
from resilience.models.simulator.merit import fill
from resilience.models.simulator.paper import paper_fill
from resilience.models.simulator.prices import Way
from resilience.tolerances import POWER_TOLERANCE_MW


class Closed(NamedTuple):
    """What closing every island by one order leads to.

    Attributes:
        cost, charge, discharge, spill: as in `Step`; storage is priced last.
        flows: what works out the power of every source.
        burnt: (tanks, batch) m³ of fuel; None without tanks.
    """

    cost: Array
    charge: Array
    discharge: Array
    spill: Array
    flows: Callable[[], Array]
    burnt: Array | None = None

    def deviation(self, request: tuple[Array, Array]) -> Array:
        """(batch,) MW by which it differs from the charging and discharging requested."""
        net = self.charge - self.discharge
        return self.spill.sum(0) + abs(net - (request[0] - request[1])).sum(0)


@dataclass(frozen=True)
class ReadyOrder:
    """One order of a slot, ready for whatever storage does.

    Attributes:
        way: the order and its prices.
        need: (buses, batch) MW missing in every island without storage, all sources lowest.
        room: (tiers, buses, batch) MW that each tier can give there.
        drawn_before: (tiers + 1, buses, batch) MW of all tiers before one, last of all together.
        data, island: of the slot.
        load: (buses, batch) demand of the islands where the paper's equations close them, MW.
        fuelled: sources that burn from tanks; None without any.
        lost: (burners, batch) MW that these cannot give for want of fuel; None: nothing.
    """

    way: Way
    need: Array
    room: Array
    drawn_before: Array
    data: Array
    island: Array
    load: Array | None
    fuelled: Fuelled | None = None
    lost: Array | None = None

    @classmethod
    def of_slot(cls, way: Way, data: Array, island: Array, demand: Array | None) -> ReadyOrder:
        """Sums everything up island by island, storage aside.

        Args:
            way: the order and its prices.
            data: (n_data, batch) or (n_data, 1).
            island: (buses, batch) number of the island of every bus.
            demand: (buses, batch) MW, where the paper's equations close islands.
        """
        ops, order = array_ops(data), way.order
        values = ops.wide(order.map(ops, data), island.shape[-1])
        sums = ops.sums(values.reshape(order.tiers + 1, *island.shape), island, len(island))
        need, room = sums[0], sums[1:]
        load = None if demand is None else ops.sums(demand, island, len(island))
        before, fuelled = ops.cumulated(room), None
        if order.burners is not None:
            most_mw = ops.wide(
                ops.rows(order.move(ops, data), order.burners.source), island.shape[-1]
            )
            tiers = room, before
            fuelled = Fuelled.of_slot(ops, order.burners, island, most_mw, tiers)
        return cls(way, need, room, before, data, island, load, fuelled)

    def closed(
        self,
        request: tuple[Array, Array],
        units: Array,
        fuel: Array | None = None,
        burner_mw: Array | None = None,
    ) -> Closed:
        """Every island closed, storage doing what is requested or less.

        Args:
            request: (units, batch) MW of charging and of discharging.
            units: (units, batch) number of the island of every unit.
            fuel: (tanks, batch) m³ that is there; None without tanks.
            burner_mw: (burners, batch) MW that burners may give; None: what they can.
        """
        charge, discharge = request
        ops, n = array_ops(charge), len(self.need)
        need = self.need + ops.sums(charge - discharge, units, n)
        if fuel is None:
            return self._closed(ops, request, units, need)
        if self.fuelled is None:
            return self._closed(ops, request, units, need)._replace(burnt=fuel * 0.0)
        order, burnt = self._within(ops, need, fuel, self.fuelled, burner_mw)
        closed = order._closed(ops, request, units, need)
        return closed._replace(burnt=self.fuelled.burners.total(ops, burnt))

    def _within(
        self,
        ops: ArrayOps,
        need: Array,
        fuel: Array,
        unlimited: Fuelled,
        burner_mw: Array | None,
    ) -> tuple[ReadyOrder, Array]:
        """The order with as much room as there is fuel for, and (burners, batch) m³ burnt.

        Args:
            ops: operations for the kind of array.
            need: (buses, batch) MW.
            fuel: (tanks, batch) m³.
            unlimited: the burners with all of their fuel.
            burner_mw: (burners, batch) MW that they may give; None: what they can.
        """
        order, fuelled, lost = self, unlimited, None
        if burner_mw is not None:
            lost = ops.positive(unlimited.most_mw - ops.positive(burner_mw))
            order, fuelled = self._with_less_room(ops, lost, unlimited)
        burnt = order._burnt(ops, need, fuelled)
        for _ in range(unlimited.burners.tanks):
            over = unlimited.burners.total(ops, burnt) - fuel
            if not ops.may_exceed(ops.positive(over), FUEL_TOLERANCE_M3):
                break
            short = unlimited.lost(ops, burnt, fuel, over)
            lost = short if lost is None else ops.maximum(lost, short)
            order, fuelled = self._with_less_room(ops, lost, unlimited)
            burnt = order._burnt(ops, need, fuelled)
        return order, burnt

    def _burnt(self, ops: ArrayOps, need: Array, fuelled: Fuelled) -> Array:
        """(burners, batch) m³ burnt where islands need (buses, batch) MW."""
        if not self.way.order.block.any():
            return fuelled.burnt(ops, need)
        drawn, _ = self._drawn(ops, need)
        return fuelled.burnt_of(ops, drawn)

    def _with_less_room(
        self, ops: ArrayOps, lost: Array, unlimited: Fuelled
    ) -> tuple[ReadyOrder, Fuelled]:
        """The order, and its burners, without what these have lost, (burners, batch) MW."""
        burners, n = unlimited.burners, len(self.need)
        at_tier = (burners.at_tier.as_matrix(ops) @ lost).reshape(-1, n, lost.shape[-1])
        fewer_mw = dict(zip(burners.tiers.tolist(), ops.sums(at_tier, self.island, n), strict=True))
        room = ops.stacked(
            [
                ops.positive(mw - fewer_mw[k]) if k in fewer_mw else mw
                for k, mw in enumerate(self.room)
            ]
        )
        before = ops.cumulated(room)
        most_mw, tiers = unlimited.most_mw - lost, (room, before)
        fuelled = Fuelled.of_slot(ops, burners, self.island, most_mw, tiers)
        return replace(self, room=room, drawn_before=before, lost=lost), fuelled

    def _closed(
        self, ops: ArrayOps, request: tuple[Array, Array], units: Array, need: Array
    ) -> Closed:
        """Islands that need (buses, batch) MW, storage's request included, closed."""
        (charge, discharge), n = request, len(self.need)
        cost, missing = self._spent(ops, need)
        spill = missing[1]
        if ops.may_exceed(missing, POWER_TOLERANCE_MW):
            moved = ops.stacked(request)
            total = ops.sums(moved, units, n)
            cut = ops.positive_up_to(missing, total)
            share = cut / ops.at_least(total, POWER_TOLERANCE_MW)
            charge, discharge = moved * (1.0 - ops.at_islands(share, units))
            spill = spill - cut[1]
        return Closed(cost, charge, discharge, spill, partial(self._flows, ops, need))

    def _spent(self, ops: ArrayOps, need: Array) -> tuple[Array, Array]:
        """(batch,) $ of all sources, and (2, buses, batch) MW that nothing gives, that nothing
        takes.
        """
        way, order = self.way, self.way.order
        if self.load is None and not order.block.any():
            missing = ops.above(ops.stacked([need - self.drawn_before[-1], -need]))
            supply = need - missing[0]
            spent = ops.priced_above(way.steps, supply, self.drawn_before[:-1])
            return way.lowest_cost + spent, missing
        drawn, unmet = self._drawn(ops, need)
        missing = ops.above(ops.stacked([unmet, -unmet]))
        if self.load is None:
            return way.lowest_cost + ops.priced(way.value, ops.stacked(drawn)), missing
        moved = self._flows(ops, need) - order.lowest(ops, self.data)
        assert way.prices is not None
        return way.lowest_cost + (way.prices.as_matrix(ops) @ moved)[0], missing

    def _drawn(self, ops: ArrayOps, need: Array) -> tuple[list[Array], Array]:
        if self.load is None:
            return fill(ops, self.way.order, need, self.room)
        return paper_fill(ops, need, self.room, self.load)

    def _flows(self, ops: ArrayOps, need: Array) -> Array:
        drawn, _ = self._drawn(ops, need)
        order = self.way.order
        return order.flows(ops, drawn, self.room, self.data, self.island, self.lost)


@dataclass(frozen=True)
class ReadyGroup:
    """Members whose sources are taken in the same order, ready for whatever storage does.

    Attributes:
        members: (members,) which they are; None: all of them.
        storage: (1, units) $ per MW of charging and of discharging; None where all are 0.
        units: (units, members) number of the island of every unit.
        orders: the order, or one per way to close connections, see `modes`.
    """

    members: Array | None
    storage: tuple[Matrix | None, Matrix | None]
    units: Array
    orders: tuple[ReadyOrder, ...]

    def chosen(
        self, request: tuple[Array, Array], *more: Array | None
    ) -> tuple[tuple[Array, Array], Array | None, Array | None]:
        """Request, fuel and what burners may give, of the members."""
        charge, discharge = (power[:, self.members] for power in request)
        fuel, burner_mw = (None if x is None else x[:, self.members] for x in more)
        return (charge, discharge), fuel, burner_mw

    def closed(
        self,
        request: tuple[Array, Array],
        fuel: Array | None = None,
        burner_mw: Array | None = None,
    ) -> Closed:
        """Every island closed in the way that is nearest to the request, storage priced."""
        ops = array_ops(request[0])
        closed, *others = [way.closed(request, self.units, fuel, burner_mw) for way in self.orders]
        if others:
            closed = _nearest(ops, request, closed, others)
        cost = closed.cost
        for price, power in zip(self.storage, (closed.charge, closed.discharge), strict=True):
            if price is not None:
                cost = cost + (price.as_matrix(ops) @ power)[0]
        return closed._replace(cost=cost)


def _nearest(
    ops: ArrayOps, request: tuple[Array, Array], first: Closed, alternatives: Sequence[Closed]
) -> Closed:
    """Per member the one that is nearest to the request, and of equally near ones the cheapest."""
    best, deviation = first, first.deviation(request)
    for candidate in alternatives:
        its_deviation = candidate.deviation(request)
        nearer = its_deviation < deviation - POWER_TOLERANCE_MW
        as_near = its_deviation <= deviation + POWER_TOLERANCE_MW
        better = nearer | (as_near & (candidate.cost < best.cost))
        best = Closed(
            cost=ops.where(better, candidate.cost, best.cost),
            charge=ops.where(better, candidate.charge, best.charge),
            discharge=ops.where(better, candidate.discharge, best.discharge),
            spill=ops.where(better, candidate.spill, best.spill),
            flows=partial(_either, ops, better, candidate.flows, best.flows),
            burnt=None if best.burnt is None else ops.where(better, candidate.burnt, best.burnt),
        )
        deviation = ops.where(better, its_deviation, deviation)
    return best


def side_by_side(ops: ArrayOps, parts: Sequence[Closed], place: Array) -> Closed:
    """Groups joined, every member in its place."""

    def joined(arrays: Iterable[Array]) -> Array:
        return ops.beside(list(arrays))[..., place]

    cost, charge, discharge, spill, flows, burnt = zip(*parts, strict=True)
    return Closed(
        joined(cost),
        joined(charge),
        joined(discharge),
        joined(spill),
        lambda: joined(work_out() for work_out in flows),
        None if burnt[0] is None else joined(burnt),
    )


def _either(ops: ArrayOps, first: Array, x: Callable[[], Array], y: Callable[[], Array]) -> Array:
    return ops.where(first, x(), y())
