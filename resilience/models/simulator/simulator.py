"""The stage stepped at copperplate: arrays with a trailing batch axis, NumPy or torch.

A step masks the storage action so that no state leaves its bounds, closes every island by recourse
(`merit`, or `paper`), and prices what was done with the stage's own cost terms. What recourse
cannot close is closed by cutting back charging (a deficit that even shedding leaves) or discharging
(a surplus that neither curtailment nor export takes); a surplus of power that must be taken is then
spilled. So every state has an outcome:

- charging in an island: served by what the island has, shedding included, and cut back beyond;
- discharging more than is wanted: exported where there is a grid, else cut back;
- an island with no source: all demand is shed and storage stands still.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Literal, NamedTuple, get_args

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError
from resilience.models.algebra import Labels
from resilience.models.components import in_roles
from resilience.models.microgrid import Microgrid
from resilience.models.simulator.arrays import Array, ArrayOps, array_ops
from resilience.models.simulator.constants import Matrix
from resilience.models.simulator.merit import fill, merit_order
from resilience.models.simulator.modes import modes
from resilience.models.simulator.order import Order, Priced, compiled_order, priced_order
from resilience.models.simulator.paper import check_paper, paper_fill, paper_tiers
from resilience.models.simulator.plant import Plant
from resilience.models.simulator.prices import PricedBatch, PriceGroup, Way, priced_batch
from resilience.models.simulator.refusals import refuse
from resilience.tolerances import POWER_TOLERANCE_MW

RecourseRule = Literal["economic", "paper"]
RECOURSE: tuple[RecourseRule, ...] = get_args(RecourseRule)
MAX_ORDERS = 1024  # compiled orders that are kept


@dataclass(frozen=True)
class Step:
    """What one step did, arrays (n, batch), powers in MW.

    Attributes:
        energy: (units, batch) stored energy at the end, MWh.
        cost: (batch,) $ of the step.
        charge, discharge: (units, batch) MW after masking and cutting back.
        spill: (buses, batch) power that had to be taken and could not be used, in the row of the
            island's number.
    """

    energy: Array
    cost: Array
    charge: Array
    discharge: Array
    spill: Array
    _flows: Callable[[], Array] = field(repr=False, compare=False)

    @cached_property
    def flows(self) -> Array:
        """(columns, batch) MW of every source; their names are `Simulator.columns`.

        Worked out when first asked for, from the data of the step: read it before changing them.
        """
        return self._flows()


class _Closed(NamedTuple):
    """What closing every island by one order leads to.

    Attributes:
        cost, charge, discharge, spill: as in `Step`; storage is priced last.
        flows: what works out the power of every source.
    """

    cost: Array
    charge: Array
    discharge: Array
    spill: Array
    flows: Callable[[], Array]

    def deviation(self, request: tuple[Array, Array]) -> Array:
        """(batch,) MW by which it differs from the charging and discharging requested."""
        net = self.charge - self.discharge
        return self.spill.sum(0) + abs(net - (request[0] - request[1])).sum(0)


class Simulator(Plant):
    """Steps a microgrid at copperplate physics, on its merged graph.

    Args:
        microgrid: the microgrid, with copperplate physics.
        dt: length of a step, h.
        recourse: how an island's balance is closed: "economic", by merit order, which is the
            optimum of the island's one-slot linear program; or "paper", its eqs. (20) and (21).

    Raises:
        UsageError: an unknown recourse; another physics; or the stage needs decisions (commitment,
            switching), memory (ramps), curves or ratings that a step does not hold.
    """

    def __init__(
        self, microgrid: Microgrid, dt: float, recourse: RecourseRule = "economic"
    ) -> None:
        if recourse not in RECOURSE:
            raise UsageError(
                f"recourse {recourse!r} is unknown; allowed: {', '.join(RECOURSE)}",
                hint="'economic' is the merit order by cost, 'paper' its equations 20 and 21",
            )
        if microgrid.physics != "copperplate":
            raise UsageError(
                f"the simulator steps copperplate physics, not {microgrid.physics}",
                hint="use microgrid(case, 'copperplate'), or NetworkSimulator for lindistflow",
            )
        super().__init__(microgrid, dt)
        refuse(self, blocks=True, ratings=True)
        self.recourse = recourse
        if recourse == "paper":
            check_paper(self)
            self.charges_at_zero = True  # generators run for the load, so discharging is cut back
        blocks = {
            f"{fleet.shed}[{name}]"
            for fleet in in_roles(microgrid.fleets.values(), "load")
            for name, is_block in zip(fleet.names, fleet.is_block(), strict=True)
            if is_block
        }
        self._blocks: Ints = np.flatnonzero([name in blocks for name in self.columns])
        self._orders: dict[bytes, Order] = {}
        self._priced_orders: dict[bytes, list[Priced]] = {}
        self._rows: dict[bytes, Matrix] = {}

    @property
    def heuristic(self) -> Labels:
        """Sources that are decided greedily: blocks. Without any, a step is the optimum."""
        return tuple(self.columns[k] for k in self._blocks)

    def priced(self, data: Array) -> PricedBatch:
        """What a step needs to know of the prices in `data`, for whoever steps them repeatedly.

        It reads prices back from their device; a step that is given it does not.
        """
        by_price = self.recourse == "paper"
        return priced_batch(
            array_ops(data), data, self.prices(data), self._in_order, self._row, apart=by_price
        )

    def step(
        self,
        energy: Array,
        action: Array,
        data: Array,
        island: Array,
        priced: PricedBatch | None = None,
    ) -> Step:
        """One step. Members of different prices, as of different slots, do as if they were alone.

        Args:
            energy: (units, batch) stored energy, MWh.
            action: (units, batch) charging power requested, MW; negative is discharging.
            data: (n_data, batch) or (n_data, 1) from `stacked`, of the kind of `energy`.
            island: (buses, batch) number of the island of every bus.
            priced: from `priced(data)`; worked out if omitted.
        """
        ops, batch = array_ops(energy), energy.shape[-1]
        priced = priced or self.priced(data)
        request = self.masked_action(ops, energy, action, data)
        if priced.place is None:
            closed = self._grouped(priced.groups[0], request, data, island)
        else:
            wide = ops.wide(data, batch)
            parts = [
                self._grouped(
                    group,
                    (request[0][:, group.members], request[1][:, group.members]),
                    wide[:, group.members],
                    island[:, group.members],
                )
                for group in priced.groups
            ]
            closed = _side_by_side(ops, parts, priced.place)
        cost, charge, discharge, spill, flows = closed
        return Step(self.after(energy, charge, discharge), cost, charge, discharge, spill, flows)

    def _grouped(
        self, group: PriceGroup, request: tuple[Array, Array], data: Array, island: Array
    ) -> _Closed:
        """Every island of some members closed in the way that is nearest, storage priced."""
        ops = array_ops(request[0])
        closed, *others = [self._closed(way, request, data, island) for way in group.ways]
        if others:
            closed = _nearest(ops, request, closed, others)
        cost = closed.cost
        for price, power in zip(group.storage, (closed.charge, closed.discharge), strict=True):
            if price is not None:
                cost = cost + (price.as_matrix(ops) @ power)[0]
        return closed._replace(cost=cost)

    def _closed(
        self, way: Way, request: tuple[Array, Array], data: Array, island: Array
    ) -> _Closed:
        """Every island closed by one order, storage doing what is requested or less."""
        charge, discharge = request
        ops, batch, order = array_ops(charge), charge.shape[-1], way.order
        need, room = order.need_and_room(ops.wide(order.map(ops, data), batch))
        need = ops.island_sums(self._with_storage(ops, need, charge - discharge), island)
        room = ops.island_sums(room, island)
        drawn, need = self._recourse(ops, order, need, room, data, island)
        if ops.may_exceed(need, POWER_TOLERANCE_MW):
            charge, need = self._cut_back(ops, charge, need, island, 1.0)
            discharge, need = self._cut_back(ops, discharge, need, island, -1.0)
        flows = partial(order.flows, ops, drawn, room, data, island)
        cost = way.lowest_cost
        if way.prices is not None and self.recourse == "paper":
            moved = flows() - order.lowest(ops, data)
            cost = cost + (way.prices.as_matrix(ops) @ moved)[0]
        else:
            spent = [
                value * mw
                for value, mw in zip(way.value, drawn, strict=True)
                if not isinstance(value, float) or value
            ]
            cost = cost + (sum(spent[1:], spent[0]) if spent else need * 0.0).sum(0)
        return _Closed(cost, charge, discharge, ops.positive(-need), flows)

    def _recourse(
        self, ops: ArrayOps, order: Order, need: Array, room: Array, data: Array, island: Array
    ) -> tuple[list[Array], Array]:
        if self.recourse == "economic":
            return fill(ops, order, need, room)
        load = ops.island_sums(ops.wide(self.demand(ops, data), need.shape[-1]), island)
        return paper_fill(ops, need, room, load)

    def _with_storage(self, ops: ArrayOps, need: Array, power: Array) -> Array:
        """(buses, batch) the need with the power (units, batch) of storage added at its buses."""
        if self.n_buses == 1:
            return need + power.sum(0)
        return need + self._at_bus.as_matrix(ops) @ power

    def _cut_back(
        self, ops: ArrayOps, power: Array, need: Array, island: Array, sign: float
    ) -> tuple[Array, Array]:
        """Charging cut back by a deficit (sign 1), discharging by a surplus (sign -1), pro rata.

        Where nothing is missing no gradient passes: half of one would, of two zeros' minimum.
        """
        total = ops.island_sums(self._with_storage(ops, need * 0.0, power), island)
        beyond = sign * need
        cut = ops.where(beyond > 0.0, ops.minimum(beyond, total), need * 0.0)
        share = ops.at_buses(
            cut / ops.maximum(total, ops.array(np.array(POWER_TOLERANCE_MW))), island
        )
        return power * (1.0 - ops.rows(share, self.storage_bus)), need - sign * cut

    def _in_order(self, prices: Floats) -> list[Priced]:
        """The order of these prices, or one per mode where a connection could earn in both."""
        key = prices.tobytes()
        in_order = self._priced_orders.get(key)
        if in_order is None:
            if len(self._priced_orders) >= MAX_ORDERS:
                self._priced_orders.clear()
            if self.recourse == "paper":
                tier, block = paper_tiers(self)
                value, ways = np.zeros(len(block)), [np.zeros(len(tier), bool)]
            else:
                tier, value, block = merit_order(self, prices, self._blocks)
                ways = modes(self, prices)
            orders = [self._order(tier, block, closed) for closed in ways]
            in_order = [priced_order(self, order, prices, value) for order in orders]
            self._priced_orders[key] = in_order
        return in_order

    def _row(self, prices: Floats) -> Matrix | None:
        """Prices (units,) as a row, None where all are 0; its sums are the same in any batch."""
        key = prices.tobytes()
        if key not in self._rows and prices.any():
            if len(self._rows) >= MAX_ORDERS:
                self._rows.clear()
            self._rows[key] = Matrix(sp.csr_array(prices[None, :]))
        return self._rows.get(key)

    def _order(self, tier: Ints, block: np.ndarray, closed: np.ndarray) -> Order:
        key = tier.tobytes() + closed.tobytes()
        order = self._orders.get(key)
        if order is None:
            if len(self._orders) >= MAX_ORDERS:
                self._orders.clear()
            order = self._orders[key] = compiled_order(self, tier, block, closed)
        return order


def _nearest(
    ops: ArrayOps, request: tuple[Array, Array], first: _Closed, alternatives: list[_Closed]
) -> _Closed:
    """Per member the one that is nearest to the request, and of equally near ones the cheapest."""
    best, deviation = first, first.deviation(request)
    for candidate in alternatives:
        its_deviation = candidate.deviation(request)
        nearer = its_deviation < deviation - POWER_TOLERANCE_MW
        as_near = its_deviation <= deviation + POWER_TOLERANCE_MW
        better = nearer | (as_near & (candidate.cost < best.cost))
        best = _Closed(
            cost=ops.where(better, candidate.cost, best.cost),
            charge=ops.where(better, candidate.charge, best.charge),
            discharge=ops.where(better, candidate.discharge, best.discharge),
            spill=ops.where(better, candidate.spill, best.spill),
            flows=partial(_either, ops, better, candidate.flows, best.flows),
        )
        deviation = ops.where(better, its_deviation, deviation)
    return best


def _side_by_side(ops: ArrayOps, parts: Sequence[_Closed], place: Array) -> _Closed:
    """Groups joined, every member in its place."""

    def joined(arrays: Iterable[Array]) -> Array:
        return ops.beside(list(arrays))[..., place]

    cost, charge, discharge, spill, flows = zip(*parts, strict=True)
    return _Closed(
        joined(cost),
        joined(charge),
        joined(discharge),
        joined(spill),
        lambda: joined(work_out() for work_out in flows),
    )


def _either(ops: ArrayOps, first: Array, x: Callable[[], Array], y: Callable[[], Array]) -> Array:
    return ops.where(first, x(), y())
