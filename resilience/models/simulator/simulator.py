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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError
from resilience.models.algebra import Labels
from resilience.models.components import in_roles
from resilience.models.microgrid import Microgrid
from resilience.models.simulator.arrays import Array, array_ops
from resilience.models.simulator.closing import ReadyGroup, ReadyOrder, side_by_side
from resilience.models.simulator.constants import Matrix
from resilience.models.simulator.merit import merit_order
from resilience.models.simulator.modes import modes
from resilience.models.simulator.order import Order, Priced, compiled_order, priced_order
from resilience.models.simulator.paper import check_paper, paper_tiers
from resilience.models.simulator.plant import Plant, StorageSlot
from resilience.models.simulator.prices import PricedBatch, priced_batch
from resilience.models.simulator.refusals import refuse

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
        fuel: (tanks, batch) m³ in every tank at the end; None without tanks.
        states: (devices, batch) by name, as `generator.on`, at the end; of `MilpSimulator` alone.
        decisions: (columns, batch) all of the stage that is not in the others, likewise; their
            names are `MilpSimulator.decision_columns`.
    """

    energy: Array
    cost: Array
    charge: Array
    discharge: Array
    spill: Array
    _flows: Callable[[], Array] = field(repr=False, compare=False)
    fuel: Array | None = None
    states: Mapping[str, Array] = field(default_factory=dict)
    decisions: Array | None = None

    @cached_property
    def flows(self) -> Array:
        """(columns, batch) MW of every source; their names are `Simulator.columns`.

        Worked out when first asked for, from the data of the step: read it before changing them.
        """
        return self._flows()


class ReadySlot(NamedTuple):
    """Everything of a slot that storage has no part in; see `Simulator.ready`.

    Attributes:
        storage: what it is to storage.
        groups: every member is in one of them.
        place: (batch,) where each member is when groups are laid side by side; None: there is one.
        delivered: (tanks, batch) or (tanks, 1) m³ of fuel that arrive; None without tanks.
    """

    storage: StorageSlot
    groups: tuple[ReadyGroup, ...]
    place: Array | None
    delivered: Array | None = None


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

    def ready(self, data: Array, island: Array) -> ReadySlot:
        """A slot, for whoever steps it repeatedly.

        It reads prices back from their device; `step_ready` does not.

        Args:
            data: (n_data, batch) or (n_data, 1) from `stacked`.
            island: (buses, batch) number of the island of every bus.
        """
        ops, batch = array_ops(data), island.shape[-1]
        priced = self.priced(data)
        storage = self.storage_slot(data, island)
        demand = ops.wide(self.demand(ops, data), batch) if self.recourse == "paper" else None

        def chosen(array: Array | None, members: Array | None) -> Any:
            if array is None or members is None:
                return array
            return ops.wide(array, batch)[:, members]

        groups = []
        for group in priced.groups:
            data_of, island_of, units_of, demand_of = (
                chosen(array, group.members) for array in (data, island, storage.island, demand)
            )
            orders = [ReadyOrder.of_slot(w, data_of, island_of, demand_of) for w in group.ways]
            groups.append(ReadyGroup(group.members, group.storage, units_of, tuple(orders)))
        delivered = self.delivered(ops, data) if self.tanks else None
        return ReadySlot(storage, tuple(groups), priced.place, delivered)

    def step(
        self,
        energy: Array,
        action: Array,
        data: Array,
        island: Array,
        fuel: Array | None = None,
        burner_mw: Array | None = None,
    ) -> Step:
        """One step. Members of different prices, as of different slots, do as if they were alone.

        Args:
            energy: (units, batch) stored energy, MWh.
            action: (units, batch) charging power requested, MW; negative is discharging.
            data: (n_data, batch) or (n_data, 1) from `stacked`, of the kind of `energy`.
            island: (buses, batch) number of the island of every bus.
            fuel: (tanks, batch) m³ in every tank; None without tanks.
            burner_mw: (burners, batch) MW that sources with a tank may give; None: what they can.
        """
        return self.step_ready(energy, action, self.ready(data, island), fuel, burner_mw)

    def step_ready(
        self,
        energy: Array,
        action: Array,
        slot: ReadySlot,
        fuel: Array | None = None,
        burner_mw: Array | None = None,
    ) -> Step:
        """One step of a slot that is ready; see `step`.

        Raises:
            ValueError: fuel is not told though there are tanks.
        """
        ops = array_ops(energy)
        request = self.masked_action(ops, energy, action, slot.storage.power_limits)
        if slot.delivered is not None:
            fuel = self.available_fuel(fuel, slot.delivered)
        if slot.place is None:
            closed = slot.groups[0].closed(request, fuel, burner_mw)
        else:
            parts = [group.closed(*group.chosen(request, fuel, burner_mw)) for group in slot.groups]
            closed = side_by_side(ops, parts, slot.place)
        cost, charge, discharge, spill, flows, burnt = closed
        level = None if fuel is None or burnt is None else self.fuel_after(fuel, burnt)
        after = self.after(energy, charge, discharge)
        return Step(after, cost, charge, discharge, spill, flows, level)

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
