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

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError
from resilience.models.algebra import Labels
from resilience.models.microgrid import Microgrid
from resilience.models.simulator.arrays import Array, namespace
from resilience.models.simulator.merit import fill, ranked
from resilience.models.simulator.modes import modes
from resilience.models.simulator.order import Order, Priced, compiled, priced
from resilience.models.simulator.paper import check, paper_fill, paper_tiers
from resilience.models.simulator.plant import Plant
from resilience.models.simulator.refusals import refuse
from resilience.tolerances import POWER_TOLERANCE_MW

RecourseRule = Literal["economic", "paper"]
RECOURSE: tuple[RecourseRule, ...] = get_args(RecourseRule)
KNOWN = 1024  # compiled price orders kept


@dataclass(frozen=True)
class Step:
    """What one step did, arrays (n, batch), powers in MW.

    Attributes:
        energy: (units, batch) stored energy at the end, MWh.
        cost: (batch,) $ of the step.
        charge, discharge: (units, batch) after masking and cutting back.
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
        """(columns, batch) every source; their names are `Simulator.columns`.

        Worked out when first asked for, from the data of the step: read it before changing them.
        """
        return self._flows()


class _Closed(NamedTuple):
    cost: Array
    charge: Array
    discharge: Array
    spill: Array
    flows: Callable[[], Array]

    def off(self, asked: tuple[Array, Array]) -> Array:
        """(batch,) MW by which it differs from what was asked."""
        done = self.charge - self.discharge
        return self.spill.sum(0) + abs(done - (asked[0] - asked[1])).sum(0)


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
            check(self)
        blocks = {load.name for load in microgrid.case.load if load.block}
        whole = [name in {f"load.shed[{b}]" for b in blocks} for name in self.columns]
        self._blocks: Ints = np.flatnonzero(whole)
        self._orders: dict[bytes, Order] = {}
        self._known: dict[bytes, list[Priced]] = {}

    @property
    def heuristic(self) -> Labels:
        """Sources that are decided greedily: blocks. Without any, a step is the optimum."""
        return tuple(self.columns[k] for k in self._blocks)

    def step(self, energy: Array, action: Array, data: Array, island: Array) -> Step:
        """One step.

        Args:
            energy: (units, batch) stored energy, MWh.
            action: (units, batch) charging power asked for, MW; negative is discharging.
            data: (n_data, batch) or (n_data, 1) from `stacked`, of the kind of `energy`.
            island: (buses, batch) number of the island of every bus.

        Raises:
            UsageError: prices differ within the batch.
        """
        ops = namespace(energy)
        prices, held = self.prices(data)
        asked = self.masked(ops, energy, action, data)
        best, *others = [self._closed(each, asked, data, island) for each in self._in_order(prices)]
        if others:
            best = _nearest(ops, asked, best, others)
        cost, charge, discharge, spill, flows = best
        for price, power in zip(held, (charge, discharge), strict=True):
            if price.any():
                cost = cost + ops.array(price) @ power
        return Step(self.after(energy, charge, discharge), cost, charge, discharge, spill, flows)

    def _closed(
        self, each: Priced, asked: tuple[Array, Array], data: Array, island: Array
    ) -> _Closed:
        """Every island closed by one order, storage doing as asked or less."""
        charge, discharge = asked
        ops, batch, order = namespace(charge), charge.shape[-1], each.order
        need, there = order.parts(ops.wide(order.map(ops, data), batch))
        need = ops.segment(self._with_storage(ops, need, charge - discharge), island)
        there = ops.segment(there, island)
        taken, need = self._recourse(ops, order, need, there, data, island)
        if ops.some(need, POWER_TOLERANCE_MW):
            charge, left = self._cut_back(ops, charge, need, island, 1.0)
            discharge, need = self._cut_back(ops, discharge, left, island, -1.0)
        flows = partial(order.flows, ops, taken, there, data, island)
        cost = each.least(ops, data)[0]
        if self.recourse == "paper":
            cost = cost + each.prices.of(ops) @ (flows() - order.least(ops, data))
        else:
            spent = [value * used for value, used in zip(each.value, taken, strict=True) if value]
            cost = cost + (sum(spent[1:], spent[0]) if spent else need * 0.0).sum(0)
        return _Closed(cost, charge, discharge, ops.positive(-need), flows)

    def _recourse(
        self, ops: Any, order: Order, need: Array, there: Array, data: Array, island: Array
    ) -> tuple[list[Array], Array]:
        if self.recourse == "economic":
            return fill(ops, order, need, there)
        load = ops.segment(ops.wide(self.demand(ops, data), need.shape[-1]), island)
        return paper_fill(ops, need, there, load)

    def _with_storage(self, ops: Any, need: Array, wanted: Array) -> Array:
        if self.n_buses == 1:
            return need + wanted.sum(0)
        return need + self._at_bus.of(ops) @ wanted

    def _cut_back(
        self, ops: Any, power: Array, need: Array, island: Array, sign: float
    ) -> tuple[Array, Array]:
        """Charging cut back by a deficit (sign 1), discharging by a surplus (sign -1), pro rata."""
        there = ops.segment(self._with_storage(ops, need * 0.0, power), island)
        cut = ops.minimum(ops.positive(sign * need), there)
        smallest = ops.array(np.array(POWER_TOLERANCE_MW))
        share = ops.spread(cut / ops.maximum(there, smallest), island)
        return power * (1.0 - ops.rows(share, self.storage_bus)), need - sign * cut

    def _in_order(self, prices: Floats) -> list[Priced]:
        """The order of these prices, or one per mode where a connection could earn in both."""
        key = prices.tobytes()
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= KNOWN:
                self._known.clear()
            if self.recourse == "paper":
                tier, block = paper_tiers(self)
                value, ways = np.zeros(len(block)), [np.zeros(len(tier), bool)]
            else:
                tier, value, block = ranked(self, prices, self._blocks)
                ways = modes(self, prices)
            orders = [self._order(tier, block, closed) for closed in ways]
            found = self._known[key] = [priced(self, order, prices, value) for order in orders]
        return found

    def _order(self, tier: Ints, block: np.ndarray, closed: np.ndarray) -> Order:
        key = tier.tobytes() + closed.tobytes()
        found = self._orders.get(key)
        if found is None:
            if len(self._orders) >= KNOWN:
                self._orders.clear()
            found = self._orders[key] = compiled(self, tier, block, closed)
        return found


def _nearest(ops: Any, asked: tuple[Array, Array], best: _Closed, others: list[_Closed]) -> _Closed:
    """Per member the one that follows what was asked most, and of these the cheapest."""
    off = best.off(asked)
    for other in others:
        other_off = other.off(asked)
        nearer = other_off < off - POWER_TOLERANCE_MW
        as_near = other_off <= off + POWER_TOLERANCE_MW
        better = nearer | (as_near & (other.cost < best.cost))
        best = _Closed(
            cost=ops.where(better, other.cost, best.cost),
            charge=ops.where(better, other.charge, best.charge),
            discharge=ops.where(better, other.discharge, best.discharge),
            spill=ops.where(better, other.spill, best.spill),
            flows=partial(_either, ops, better, other.flows, best.flows),
        )
        off = ops.where(better, other_off, off)
    return best


def _either(ops: Any, first: Array, a: Callable[[], Array], b: Callable[[], Array]) -> Array:
    return ops.where(first, a(), b())
