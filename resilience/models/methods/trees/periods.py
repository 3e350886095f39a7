r"""Trees over a horizon: a pool of good ones for every slot, and the cheapest way through it.

Powers at the buses are taken from a point of the program, whatever devices make them: they follow
from the flows of all lines. A pool grows out of what the point and the start of the horizon
suggest, improved for all slots with the same lines together, then slot by slot. With $c_{kt}$ what
tree $k$ costs in slot $t$, and the switching costs $m$ between two trees, the cheapest sequence is
a shortest path (Bellman):

$$ V_t(k) = c_{kt} + \min_j \left(V_{t-1}(j) + m_{jk}\right) $$
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Complexes, Floats, Ints
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import Deadline
from resilience.models.methods.start import spanning_forest
from resilience.models.methods.trees.exchange import TreeTask, improved, rated
from resilience.models.methods.trees.forest import TreeLines

LEAST_PRICE = 1e-3  # $ per MWh lost, where energy costs nothing
MAX_POOL = 64  # trees of one pattern


@dataclass(frozen=True)
class Demand:
    """What a point of the program asks of the network, slot by slot.

    Attributes:
        drawn: (buses, slots) taken at the buses, MVA.
        v_pu: (buses, slots) voltages, pu.
        carried: (lines, slots) apparent power at the first end, MVA.
    """

    drawn: Complexes
    v_pu: Floats
    carried: Floats

    @classmethod
    def from_point(cls, program: CaseProgram, z: Floats) -> Demand:
        """Follows from flows, losses and voltages at z."""
        network, standard = program.microgrid.network, program.standard
        p, q = (z[standard.columns(f"line.{power}")] for power in ("p", "q"))
        sent = p + 1j * q
        arrived = sent.copy()
        if standard.has("line.l"):
            impedance = network.r_pu + 1j * network.x_pu
            arrived -= impedance[:, None] * z[standard.columns("line.l")]
        drawn = np.zeros((len(network.bus_names), p.shape[1]), complex)
        np.add.at(drawn, network.to_bus, arrived)
        np.add.at(drawn, network.from_bus, -sent)
        v = np.sqrt(np.maximum(z[standard.columns("bus.v_sq")], 0.0))
        return cls(drawn, v, np.abs(sent))


def better_switches(program: CaseProgram, z: Floats, seconds: float) -> Floats | None:
    """(switches, slots) a good forest for every slot, as values of `line.closed`.

    Args:
        program: has switchable lines, and voltages.
        z: (columns,) a point of it, relaxed or not; its powers are kept, its switches suggest.
        seconds: that the search may take.

    Returns:
        Nothing where some slot has no forest with an operating point, or where loops may be, too.
    """
    radial = program.microgrid.network.radial
    if seconds <= 0.0 or not radial or not program.standard.has("line.q"):
        return None
    return SlotTrees(program.in_mw, z * program.column_unit, Deadline(seconds)).switches()


class SlotTrees:
    """The slots of a program, in groups with the same lines up and the same buses alive."""

    def __init__(self, program: CaseProgram, z: Floats, deadline: Deadline) -> None:
        network, situation = program.microgrid.network, program.situation
        self.program, self.z, self.deadline = program, z, deadline
        self.demand = Demand.from_point(program, z)
        self.switched = np.flatnonzero(network.switchable)
        self.up, self.alive = situation.line_up, situation.alive > 0.5
        self.wires = TreeLines(
            ends=np.stack([network.from_bus, network.to_bus], axis=1),
            z=network.r_pu + 1j * network.x_pu,
            tap=network.tap,
            rating=network.rating_mva,
            switchable=network.switchable,
            v_min=network.v_min_pu,
            v_max=network.v_max_pu,
        )
        self.suggested = np.round(z[program.standard.columns("line.closed")])
        self.weight, self.root_max = self._prices(), self._root_max()

    @property
    def switching_cost(self) -> Floats:
        """(switches,) $ each time."""
        return self.program.microgrid.network.switching_cost[self.switched]

    def switches(self) -> Floats | None:
        """See `better_switches`."""
        slots = self.up.shape[1]
        patterns, group = np.unique(np.vstack([self.up, self.alive]), axis=1, return_inverse=True)
        pools: list[tuple[Floats, Floats]] = []
        for k in range(n := patterns.shape[1]):
            members = np.flatnonzero(group.ravel() == k)
            pool = self._pool(members, (k + 1) * self.deadline.limit_s / n)
            if pool is None:
                return None
            pools.append(pool)
        numbers = [int(k) for k in group.ravel()]
        start = self.program.x0["line.closed"] > 0.5
        stages = [pools[numbers[t]] for t in range(slots)]
        place = [int((group.ravel()[:t] == numbers[t]).sum()) for t in range(slots)]
        costs = [stage[1][:, place[t]] for t, stage in enumerate(stages)]
        trees = [stage[0] for stage in stages]
        return cheapest_sequence(trees, costs, start.astype(float), self.switching_cost)

    def _pool(self, slots: Ints, seconds: float) -> tuple[Floats, Floats] | None:
        """(trees, switches) trees for slots of one pattern, and (trees, slots) their costs.

        Args:
            slots: of the pattern.
            seconds: reading of the deadline by which it is to end.
        """
        task, spent = self._task(slots), self.deadline.spent_s
        if not len(task.roots):
            return np.zeros((1, len(self.switched))), np.zeros((1, len(slots)))
        pool: dict[bytes, tuple[Bools, Floats]] = {}

        def offer(subtask: TreeTask, closed: Bools, is_late: Callable[[], bool]) -> None:
            forest = improved(subtask, closed, is_late).forest.closed
            if forest.tobytes() not in pool and len(pool) < MAX_POOL:
                pool[forest.tobytes()] = forest, rated(task, forest).scores

        def after(share: float) -> Callable[[], bool]:
            end = share * seconds + (1.0 - share) * spent
            return lambda: self.deadline.spent_s > end

        for k, closed in enumerate(self._starts(slots)):
            offer(task, closed, after(0.5 if k else 1.0))
        is_late = after(1.0)
        if len(slots) > 1:
            for t in np.argsort(-np.abs(task.drawn).sum(0)).tolist():
                if is_late():
                    break
                nearest = min(pool.values(), key=lambda tree: float(tree[1][t]))
                offer(task.slots(np.array([t])), nearest[0], is_late)
        trees, scores = zip(*pool.values(), strict=True)
        costs = np.array(scores)
        if not np.isfinite(costs).any(0).all():
            return None
        is_live = self.alive[:, slots[0]][self.wires.ends[self.switched, 0]]
        return np.array(trees)[:, self.switched] * is_live.astype(float), costs

    def _task(self, slots: Ints) -> TreeTask:
        alive = self.alive[:, slots[0]]
        return TreeTask(
            wires=self.wires,
            up=self.up[:, slots[0]],
            roots=self._roots(int(slots[0])),
            alive=alive,
            drawn=self.demand.drawn[:, slots] * alive[:, None],
            v_root=self.demand.v_pu[:, slots],
            root_max=self.root_max[:, slots],
            weight=self.weight[slots],
        )

    def _roots(self, slot: int) -> Ints:
        """In each island that lines could make: all grids that may not share a tree, else the
        forming unit that can feed in most.
        """
        microgrid, situation = self.program.microgrid, self.program.situation
        forming = microgrid.forming_in(situation)
        forming = np.broadcast_to(forming, (len(forming), self.up.shape[1]))[:, slot]
        island = situation.island[:, slot]
        roots: list[int] = []
        for number in np.unique(island[forming & self.alive[:, slot]]):
            members = np.flatnonzero((island == number) & forming)
            apart = members[microgrid.separate_grids[members]]
            largest = members[np.argmax(self.root_max[members, slot])]
            roots += apart.tolist() if len(apart) else [int(largest)]
        return np.array(roots, np.intp)

    def _starts(self, slots: Ints) -> list[Bools]:
        """(lines,) forests: as at the start, as the point has switches, and along its flows."""
        network = self.program.microgrid.network
        first, up = int(slots[0]), self.up[:, slots[0]]
        roots = np.zeros(len(self.alive), bool)
        roots[self._roots(first)] = True
        forests: dict[bytes, Bools] = {}
        initial, middle = network.in_service.copy(), network.in_service.copy()
        initial[self.switched] = self.program.x0["line.closed"] > 0.5
        middle[self.switched] = self.suggested[:, slots].mean(1) > 0.5
        carried = self.demand.carried[:, slots].mean(1)
        for closed, rank in ((initial, 0.0 * carried), (middle, 0.0 * carried), (up, -carried)):
            order = np.lexsort((rank, ~closed, network.switchable))
            forest = spanning_forest(self.wires.ends, order[up[order]], closed, roots, roots)
            forests.setdefault(forest.tobytes(), forest)
        return list(forests.values())

    def _prices(self) -> Floats:
        """(slots,) $ per MW lost: a mean of what energy costs, and what losses cost besides."""
        program, z = self.program, self.z
        standard, case, price = program.standard, program.case, []
        for rows in standard.rows("balance.p").T:
            fed = np.maximum(standard.a[rows].sum(axis=0) * z, 0.0)  # lines cancel out
            spent = program.vectors.cost[fed > 0.0] @ z[fed > 0.0]
            price.append(spent / max(float(fed.sum()), LEAST_PRICE))
        mean = np.maximum(price, LEAST_PRICE * case.step_h)
        return mean + case.step_h * case.loss_cost_per_mwh

    def _root_max(self) -> Floats:
        """(buses, slots) most that the devices of a bus can feed in, MW."""
        feed_max = np.zeros(len(self.alive))
        for fleet in self.program.microgrid.fleets.values():
            np.add.at(feed_max, fleet.bus, np.maximum(fleet.power_range()[1], 0.0))
        return np.repeat(feed_max[:, None], self.up.shape[1], axis=1)


def cheapest_sequence(
    trees: list[Floats], costs: list[Floats], start: Floats, switching_cost: Floats
) -> Floats:
    """(switches, slots) the sequence of least cost; see the module's docstring."""
    before, value = start[None, :], np.zeros(1)
    choices: list[Ints] = []
    for pool, cost in zip(trees, costs, strict=True):
        moved = (np.abs(before[:, None, :] - pool[None, :, :]) * switching_cost).sum(2)
        total = value[:, None] + moved
        choices.append(total.argmin(0))
        value, before = total.min(0) + cost, pool
    k, sequence = int(value.argmin()), []
    for pool, choice in zip(reversed(trees), reversed(choices), strict=True):
        sequence.append(pool[k])
        k = int(choice[k])
    return np.array(sequence[::-1]).T
