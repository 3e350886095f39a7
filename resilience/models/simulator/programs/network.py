"""The stage stepped on the network: a linear program per member, voltages and ratings held.

The interface is that of `Simulator`, for comparisons at `lindistflow`, or at copperplate where
lines have ratings. Recourse is the cheapest dispatch of the slot. Storage follows the masked order
unless even shedding cannot close the balance within the network's limits: following a MW of it is
worth more than any price, and taking power that must be taken is worth more still, so that cutting
storage back comes last but for spilling. What shunts take cannot be shed: if need be, storage gives
it beside its order. At copperplate without ratings both steps agree, except that units which are
cut back together share the cut in proportion there and in any way here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError, UsageError
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.components import in_roles
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.models.simulator.arrays import ArrayOps, array_ops
from resilience.models.simulator.modes import modes
from resilience.models.simulator.numpy_ops import NumPyOps
from resilience.models.simulator.plant import DELIVERY, LEVEL, STATE, MemberPrices, Plant
from resilience.models.simulator.refusals import refuse
from resilience.models.simulator.simulator import Step

ORDER_WORTH = 1e3  # of a MW of the storage order, in units of the largest price
INTAKE_WORTH = 30.0  # of a MW that must be taken, in units of the former


class NetworkSimulator(Plant):
    """Steps a microgrid with its voltages and line ratings, one HiGHS for all members and slots.

    Args:
        microgrid: the microgrid at copperplate or lindistflow.
        dt: length of a step, h.

    Raises:
        UsageError: distflow; or the stage needs decisions (commitment, blocks, switching), memory
            (ramps) or curves that a step does not hold.
    """

    heuristic = ()

    def __init__(self, microgrid: Microgrid, dt: float) -> None:
        if microgrid.physics == "distflow":
            raise UsageError(
                "the network simulator steps lindistflow or copperplate, not distflow",
                hint="its recourse is a linear program; AC power flow certifies afterwards",
            )
        super().__init__(microgrid, dt)
        refuse(self, blocks=False, ratings=False)
        self.standard = unroll([self.form.stage], Tree.chain(["now"]))
        self.solver = Highs(lower(self.standard, modes={}), duals=False)
        self.table = self.standard.copies[0].columns[0]

    def __reduce__(self) -> tuple[type[NetworkSimulator], tuple[Microgrid, float]]:
        return NetworkSimulator, (self.microgrid, self.dt)  # a solver cannot be sent to a process

    def step(
        self,
        energy: Floats,
        action: Floats,
        data: Floats,
        island: Ints,
        fuel: Floats | None = None,
        burner_mw: Floats | None = None,
    ) -> Step:
        """One step; see `Simulator.step`. NumPy arrays only.

        Raises:
            UsageError: torch arrays.
            ValueError: fuel is not told though there are tanks.
            SolverError: a member has no dispatch at all.
        """
        ops = array_ops(energy)
        if not isinstance(ops, NumPyOps):
            raise UsageError(
                "the network simulator steps NumPy arrays", hint="gradients need Simulator"
            )
        fuel = self._fuel(ops, fuel, data, energy.shape[1])
        if burner_mw is None:
            burner_mw = np.full((len(self.burners), energy.shape[1]), np.inf)
        groups = self.prices(data)
        if groups[0].members is None:
            return self._step(ops, groups[0], (energy, fuel, burner_mw), action, data, island)
        members = [np.empty(0, np.intp) if g.members is None else g.members for g in groups]
        steps = [
            self._step(
                ops,
                group,
                (energy[:, k], fuel[:, k], burner_mw[:, k]),
                action[:, k],
                data[:, k],
                island[:, k],
            )
            for group, k in zip(groups, members, strict=True)
        ]
        place = np.argsort(np.concatenate(members))

        def joined(name: str) -> Floats:
            return np.concatenate([getattr(step, name) for step in steps], axis=-1)[..., place]

        return Step(
            energy=joined("energy"),
            cost=joined("cost"),
            charge=joined("charge"),
            discharge=joined("discharge"),
            spill=joined("spill"),
            _flows=lambda: joined("flows"),
            fuel=joined("fuel") if self.tanks else None,
        )

    def _fuel(self, ops: ArrayOps, fuel: Floats | None, data: Floats, n: int) -> Floats:
        """(tanks, members) m³ that is there in a step."""
        if not self.tanks:
            return np.empty((0, n))
        return cast("Floats", self.available_fuel(fuel, self.delivered(ops, data)))

    def _step(
        self,
        ops: ArrayOps,
        paid: MemberPrices,
        state: tuple[Floats, Floats, Floats],
        action: Floats,
        data: Floats,
        island: Ints,
    ) -> Step:
        """One step of members of equal prices; the state has what burners may give, too."""
        energy, fuel, _ = state
        prices, storage_prices = paid.sources, paid.storage
        limits = self.power_limits(ops, data, energy.shape[-1])
        charge, discharge = self.masked_action(ops, energy, action, limits)
        data = ops.wide(data, energy.shape[1])
        batch = _Batch.build(self, state, (charge, discharge), data)
        if self.microgrid.network.is_charged:
            discharge = batch.spare = self.possible(ops, energy, limits)[1]
        closed = [self.table[self.sources[shut]] for shut in modes(self, prices)]
        z = np.array([self._best(batch, k, closed) for k in range(energy.shape[1])]).T
        z = z[self.table]
        charge, discharge = (
            np.clip(z[columns], 0.0, limit)
            for columns, limit in zip(self.stored, (charge, discharge), strict=True)
        )
        flows = z[self.sources]
        spilled = np.maximum(batch.intake - flows[batch.must], 0.0)
        flows[batch.must] += spilled  # it came, and is spilled: as the other simulator counts it
        cost = prices @ flows + storage_prices[0] @ charge + storage_prices[1] @ discharge
        cost = cost + self.form.offset + self.form.offset_data @ ops.wide(data, len(cost))
        spill = np.zeros((self.n_buses, energy.shape[1]))
        cells = island[self.bus[batch.must]], np.arange(energy.shape[1])[None, :]
        np.add.at(spill, cells, spilled)
        after = self.after(energy, charge, discharge)
        if self.tanks:
            fuel_after = self.fuel_after(fuel, self.fuel_per_mw @ flows)
        return Step(
            after, cost, charge, discharge, spill, lambda: flows, fuel_after if self.tanks else None
        )

    def _best(self, batch: _Batch, k: int, closed: list[Ints]) -> Floats:
        """(columns,) the cheapest point of member k over the ways to close connections."""
        best = self._solved(batch.vectors(k), closed)
        if best is None and batch.spare is not None:
            best = self._solved(batch.rescue(k), closed)
        if best is None:
            raise SolverError(
                f"member {k} has no dispatch within the network's limits, whatever is shed",
                hint="look for a voltage band or a reactive limit that excludes standing still",
            )
        return best

    def _solved(self, vectors: Vectors, closed: list[Ints]) -> Floats | None:
        """(columns,) the cheapest point over the ways to close connections; None without any."""
        best, objective = None, np.inf
        for shut in closed:
            self.solver.update(vectors.fixed(shut, np.zeros(len(shut))) if len(shut) else vectors)
            solution = self.solver.solve()
            if solution.z is not None and solution.objective < objective:
                best, objective = solution.z, solution.objective
        return best


@dataclass
class _Batch:
    """Vectors of all members of a batch.

    Attributes:
        cost, lower, upper: (members, columns) of the program.
        row_lower, row_upper: (members, rows).
        must: (n,) sources whose power has to be taken.
        intake: (n, members) MW that has to be taken of them.
        discharging: (units,) columns of the program.
        order_worth: of a MW of the storage order, $.
        spare: (units, members) MW that storage could give beside any order; None where nothing
            flows to earth.
    """

    cost: Floats
    lower: Floats
    upper: Floats
    row_lower: Floats
    row_upper: Floats
    must: Ints
    intake: Floats
    discharging: Ints
    order_worth: float
    spare: Floats | None = None

    @classmethod
    def build(
        cls,
        plant: NetworkSimulator,
        state: tuple[Floats, Floats, Floats],
        request: tuple[Floats, Floats],
        data: Floats,
    ) -> _Batch:
        """The vectors of a slot.

        Args:
            plant: what steps it.
            state: energy (units, members) MWh, fuel that is there (tanks, members) m³, and what
                burners may give (burners, members) MW.
            request: charging and discharging power (units, members), MW.
            data: (n_data, members).
        """
        energy, fuel, burner_mw = state
        form, standard, table = plant.form, plant.standard, plant.table
        low, high, sides, prices = form.numbers(data)
        n, members = standard.n_columns, energy.shape[1]
        lower, upper, cost = np.zeros((members, n)), np.zeros((members, n)), np.zeros(n)
        present = table[form.n_now :]
        lower[:, present], upper[:, present] = low.T, high.T
        rhs = sides.T.copy()
        np.add.at(cost, table, prices[:, 0])
        if len(plant.units):
            stored = standard.initial[STATE]
            lower[:, stored] = upper[:, stored] = energy.T
        if plant.tanks:
            level = standard.initial[LEVEL]
            # What is delivered is in what is there.
            lower[:, level] = upper[:, level] = fuel.T
            arrives = table[plant.positions(DELIVERY)] if plant.has_deliveries else level[:0]
            lower[:, arrives] = upper[:, arrives] = 0.0
            burners = table[plant.sources[plant.burners]]
            upper[:, burners] = np.minimum(upper[:, burners], np.maximum(burner_mw.T, 0.0))
        order_worth = ORDER_WORTH * max(float(np.abs(cost).max(initial=0.0)), plant.dt)
        for columns, power in zip(plant.stored, request, strict=True):
            upper[:, table[columns]] = power.T
            cost[table[columns]] -= order_worth
        weather = in_roles(plant.microgrid.fleets.values(), "weather")
        weather_flows = [name for fleet in weather for name in fleet.flows]
        must = np.flatnonzero(np.isin(plant.kinds, weather_flows) & (plant.sign[:, 0] > 0))
        columns = table[plant.sources[must]]
        intake = lower[:, columns].T.copy()
        must, intake = must[intake.any(1)], intake[intake.any(1)]
        columns = table[plant.sources[must]]
        lower[:, columns] = 0.0
        cost = np.broadcast_to(cost, (members, n)).copy()
        # Only what has to be taken is worth so much: where a member has none, nothing changes.
        cost[:, columns] -= INTAKE_WORTH * order_worth * (intake.T > 0.0)
        row_lower = np.where(standard.equality, rhs, -np.inf)
        discharging = table[plant.stored[1]]
        return cls(cost, lower, upper, row_lower, rhs, must, intake, discharging, order_worth)

    def rescue(self, k: int) -> Vectors:
        """Those of one member whose storage gives what the network itself takes, and no more.

        What shunts and iron losses take cannot be shed, whatever storage was told to give.
        """
        assert self.spare is not None
        cost, upper = self.cost[k].copy(), self.upper[k].copy()
        cost[self.discharging] += 2.0 * self.order_worth
        upper[self.discharging] = self.spare[:, k]
        return replace(self.vectors(k), cost=cost, upper=upper)

    def vectors(self, k: int) -> Vectors:
        """Those of one member."""
        return Vectors(
            self.cost[k], 0.0, self.lower[k], self.upper[k], self.row_lower[k], self.row_upper[k]
        )
