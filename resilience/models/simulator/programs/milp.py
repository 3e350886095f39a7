"""The stage stepped whole: commitment, ramps, curves, blocks and switchable lines.

A slot is a small mixed-integer program per member, the very stage that is planned with. States are
all that it remembers: energy, fuel, what runs, hours still to wait, power before, closed lines.
What was decided ahead is fixed by bounds, and the rows of the stage are its mask: minimum times,
ramps, what a dark island can do, radiality. Recourse is the cheapest point that is left. Where
there is none, the decision is followed as far as can be:

- the power of ramped units is set free first;
- then a commitment or a switch that is followed, and a MW that is not spilled, are worth more than
  a MW of the storage order, and that more than any price, as in `NetworkSimulator`.

Every state has an outcome, since load can be shed, charging cut back, and power that must be given
spilled. What is not decided is chosen by its cost in the slot: units as integers of that program;
lines stay as they are while nothing is shed and no loop arises, and are else moved where that
saves more than `MOVE_WORTH`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError, UsageError
from resilience.models.algebra import Labels
from resilience.models.backends.base import Solution
from resilience.models.backends.branching import Branching
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.components import Generators, in_roles
from resilience.models.language.stage import Block, Stage
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.models.simulator.arrays import array_ops
from resilience.models.simulator.decision import Decision
from resilience.models.simulator.numpy_ops import NumPyOps
from resilience.models.simulator.plant import LEVEL, SPILLED, STATE, Plant
from resilience.models.simulator.programs.network import INTAKE_WORTH, ORDER_WORTH
from resilience.models.simulator.refusals import refuse_endless
from resilience.models.simulator.simulator import Step
from resilience.models.structures import Largest
from resilience.models.structures.base import Mode

MOVE_WORTH = 1e-3  # of moving a line that nobody asked to move, in units of the largest price
SHED_MW = 1e-6

Pair = tuple[Ints, Floats]
"""Columns, and the values at which they are fixed."""


class MilpSimulator(Plant):
    """Steps a microgrid with everything that its stage remembers and decides.

    Args:
        microgrid: the microgrid at copperplate or lindistflow.
        dt: length of a step, h.

    Attributes:
        decision_columns: names of the columns of `Step.decisions`, as `generator.on[gen1]`: all of
            the stage but storage power, sources and what is spilled.
        decided: where they stand in the form.
        device_states: names of the states beside energy and fuel, as `generator.on`.

    Raises:
        UsageError: distflow, or units that may have to burn what is not there.
    """

    heuristic = ()

    def __init__(self, microgrid: Microgrid, dt: float) -> None:
        if microgrid.physics == "distflow":
            raise UsageError(
                "commitment and switches are stepped at lindistflow or copperplate, not distflow",
                hint="a step is a mixed-integer program; AC power flow certifies afterwards",
            )
        super().__init__(microgrid, dt)
        refuse_endless(microgrid)
        form = self.form
        self.device_states: Labels = tuple(
            after.name for _, after in form.stage.states if after.name not in (STATE, LEVEL)
        )
        inner = [
            (int(column), f"{block.name}[{label}]")
            for block in form.own_blocks
            if not block.name.endswith(SPILLED)
            for column, label in zip(form.columns(block), block.labels, strict=True)
        ]
        apart = {*self.sources.tolist(), *np.concatenate(self.stored).tolist()}
        inner = [pair for pair in inner if pair[0] not in apart]
        self.decided: Ints = np.array([column for column, _ in inner], np.intp)
        self.decision_columns: Labels = tuple(name for _, name in inner)
        self.spilled = self._columns_of([b for b in form.own_blocks if b.name.endswith(SPILLED)])
        self.spill_bus = np.argmax(self._balance[:, self.spilled].toarray() != 0.0, axis=0)
        self._read_decisions()
        self.standard = unroll([form.stage], Tree.chain(["now"]))
        self.table = self.standard.copies[0].columns[0]
        # In the order of their declaration: none depends on a later one.
        self._maxima = [
            (
                y.indices,
                y.data[:, None],
                [
                    (matrix.toarray(), arg.const[:, None])
                    for matrix, arg in zip(xs, structure.args[1:], strict=True)
                ],
            )
            for structure, (y, *xs) in form.structures
            if isinstance(structure, Largest)
        ]
        self.restart()

    def restart(self) -> None:
        """Forgets every basis, so that what comes depends on no step before.

        Among decisions of equal cost the basis chooses, and what is chosen is carried on.
        """
        solver = Highs(lower(self.standard, integer="none", modes={}), duals=False)
        modes = list(self.standard.structures_of(Mode).values())
        self.search = Branching(solver, np.flatnonzero(self.standard.integer), modes)

    def __reduce__(self) -> tuple[type[MilpSimulator], tuple[Microgrid, float]]:
        return MilpSimulator, (self.microgrid, self.dt)  # a solver cannot be sent to a process

    def _stage(self) -> Stage:
        return self.microgrid.stage(self.dt, may_spill=True)

    def _columns_of(self, blocks: list[Block]) -> Ints:
        """Columns of the form in which blocks stand."""
        return np.concatenate([np.empty(0, np.intp), *(self.form.columns(b) for b in blocks)])

    def _named(self, *names: str) -> Ints:
        return self._columns_of([b for b in self.form.own_blocks if b.name in names])

    def _read_decisions(self) -> None:
        """Reads which columns a `Decision` speaks of."""
        self.on, self.closed = self._named("generator.on"), self._named("line.closed")
        power, none = self._named("generator.p"), np.empty(0, np.intp)
        units = self.microgrid.fleets.get("generator")
        self.ramped = power[units.ramped] if isinstance(units, Generators) else none
        tanks = self.microgrid.tanks
        self.burning = none if tanks is None else power[tanks.burners]
        self.burner_min = np.zeros(len(self.burning))
        if tanks is not None:
            needs = np.isin(tanks.burners, tanks.generators.committed)
            p_min = np.array([unit.p_min_mw for unit in tanks.generators.tables])
            self.burner_min = np.where(needs, p_min[tanks.burners], 0.0)
        loads = in_roles(self.microgrid.fleets.values(), "load")
        self.sheds = self._named(*(fleet.shed for fleet in loads))

    def step(
        self,
        energy: Floats,
        decision: Decision,
        data: Floats,
        island: Ints,
        fuel: Floats | None = None,
        states: Mapping[str, Floats] | None = None,
    ) -> Step:
        """One step; NumPy arrays only.

        Args:
            energy: (units, batch) stored energy, MWh.
            decision: what is decided ahead.
            data: (n_data, batch) or (n_data, 1) from `stacked`.
            island: (buses, batch) number of the island of every bus.
            fuel: (tanks, batch) m³ in every tank; None without tanks.
            states: by name of `device_states`, (devices, batch) at the start.

        Raises:
            UsageError: torch arrays.
            ValueError: states or fuel are not told.
            SolverError: a member has no outcome.
        """
        ops = array_ops(energy)
        if not isinstance(ops, NumPyOps):
            raise UsageError("this simulator steps NumPy arrays", hint="gradients need Simulator")
        batch = energy.shape[1]
        data = ops.wide(data, batch)
        request = self.masked_action(
            ops, energy, decision.power, self.power_limits(ops, data, batch)
        )
        slot = _SlotVectors.build(self, self._start(energy, fuel, states), decision, data)
        points = [self._member(slot, k, decision, request) for k in range(batch)]
        z = self._tight(np.array(points).reshape(batch, len(self.table)).T)
        charge, discharge = (
            np.clip(z[columns], 0.0, limit)
            for columns, limit in zip(self.stored, request, strict=True)
        )
        after = self.after(energy, charge, discharge)
        z[self.stored[0]], z[self.stored[1]] = charge, discharge
        if self.units:
            z[self.positions(STATE)] = after
        cost = (slot.prices * z).sum(0) + self.form.offsets(data)
        spill = np.zeros((self.n_buses, batch))
        np.add.at(spill, (island[self.spill_bus], np.arange(batch)[None, :]), z[self.spilled])
        return Step(
            energy=after,
            cost=cost,
            charge=charge,
            discharge=discharge,
            spill=spill,
            _flows=lambda: z[self.sources],
            fuel=z[self.positions(LEVEL)] if self.tanks else None,
            states={name: z[self.positions(name)] for name in self.device_states},
            decisions=z[self.decided],
        )

    def _start(
        self, energy: Floats, fuel: Floats | None, states: Mapping[str, Floats] | None
    ) -> dict[str, Floats]:
        """Every state at the start by name, (labels, batch).

        Raises:
            ValueError: one is not told.
        """
        start = {**(states or {}), STATE: energy}
        if fuel is not None:
            start[LEVEL] = fuel
        lacks = [after.name for _, after in self.form.stage.states if after.name not in start]
        if lacks:
            raise ValueError(f"no {', '.join(lacks)} at the start of the step was told")
        return start

    def _member(
        self, slot: _SlotVectors, k: int, decision: Decision, request: tuple[Floats, Floats]
    ) -> Floats:
        """(columns of the form,) the outcome of one member.

        Raises:
            SolverError: it has none.
        """
        vectors, table = slot.vectors(k), self.table
        storage = [
            (table[self.stored[i]], power[:, k]) for i, power in enumerate(request)
        ]  # fmt: skip
        firm = [*storage, (table[self.spilled], np.zeros(len(self.spilled)))]
        wishes: list[Pair] = []
        if decision.on is not None and len(self.on):
            wishes.append((table[self.on], np.round(decision.on[:, k])))
        if decision.closed is not None and len(self.closed):
            wishes.append((table[self.closed], np.round(decision.closed[:, k])))
        stay = [] if decision.closed is not None else self._lines_as_they_are(slot, k)
        ramps = (
            []
            if decision.ramped_mw is None or not len(self.ramped)
            else [(table[self.ramped], decision.ramped_mw[:, k])]
        )
        solution = None
        for more in [ramps, []] if ramps else [[]]:
            solution = self._least(vectors, [*firm, *wishes, *stay, *more])
            if solution.z is not None:
                break
        assert solution is not None
        if stay and (solution.z is None or solution.z[table[self.sheds]].sum() > SHED_MW):
            moved = self._least(self._with_moves_priced(vectors, stay[0]), [*firm, *wishes])
            if moved.objective < solution.objective:
                solution = moved
        if solution.z is None:
            solution = self.search.solve(self._softened(vectors, storage, [*wishes, *stay]))
        if solution.z is None:
            raise SolverError(
                f"member {k} has no outcome, whatever is shed",
                hint="look for a voltage band or a reactive limit that excludes standing still",
            )
        return self._tidy(solution.z, vectors)

    def _least(self, vectors: Vectors, pairs: list[Pair]) -> Solution:
        """The cheapest point with some columns fixed, as far as their bounds allow."""
        lower, upper = vectors.lower.copy(), vectors.upper.copy()
        for columns, values in pairs:
            lower[columns] = upper[columns] = values
        # A line that failed is open, a unit in the dark stands still, whatever was asked for.
        for columns in (self.table[self.on], self.table[self.closed]):
            upper[columns] = np.minimum(upper[columns], vectors.upper[columns])
            lower[columns] = np.minimum(lower[columns], upper[columns])
        return self.search.solve(replace(vectors, lower=lower, upper=upper))

    def _lines_as_they_are(self, slot: _SlotVectors, k: int) -> list[Pair]:
        """Switchable lines at their status before."""
        if not len(self.closed):
            return []
        return [(self.table[self.closed], np.round(slot.start["line.closed"][:, k]))]

    def _with_moves_priced(self, vectors: Vectors, stay: Pair) -> Vectors:
        """The vectors with a small price for every line that is moved."""
        cost, (columns, status) = vectors.cost.copy(), stay
        worth = MOVE_WORTH * max(float(np.abs(cost).max(initial=0.0)), self.dt)
        cost[columns] -= (2.0 * status - 1.0) * worth
        return replace(vectors, cost=cost, offset=vectors.offset + float(status.sum()) * worth)

    def _softened(self, vectors: Vectors, storage: list[Pair], wishes: list[Pair]) -> Vectors:
        """The vectors with all that is asked for worth more than any price."""
        cost, upper = vectors.cost.copy(), vectors.upper.copy()
        order_worth = ORDER_WORTH * max(float(np.abs(cost).max(initial=0.0)), self.dt)
        for columns, power in storage:
            upper[columns] = power
            cost[columns] -= order_worth
        cost[self.table[self.spilled]] += INTAKE_WORTH * order_worth
        for columns, status in wishes:
            cost[columns] -= (2.0 * status - 1.0) * INTAKE_WORTH * order_worth
        return replace(vectors, cost=cost, upper=upper)

    def _tidy(self, z: Floats, vectors: Vectors) -> Floats:
        """(columns of the form,) integers whole and every bound held."""
        z = np.clip(z, vectors.lower, vectors.upper)
        integers = self.search.integers
        z[integers] = np.round(z[integers])
        return z[self.table]

    def _tight(self, z: Floats) -> Floats:
        """The points (columns of the form, batch) with every maximum tight."""
        z = np.ascontiguousarray(z)
        for columns, scale, expressions in self._maxima:
            largest = np.max([matrix @ z + const for matrix, const in expressions], axis=0)
            z[columns] = largest / scale + 0.0  # no -0
        return z


@dataclass
class _SlotVectors:
    """Vectors of a slot for all members.

    Attributes:
        start: every state at the start by name, (labels, members).
        lower, upper, cost: (members, columns) of the program.
        row_lower, row_upper: (members, rows).
        prices: (columns of the form, members).
    """

    start: dict[str, Floats]
    lower: Floats
    upper: Floats
    cost: Floats
    row_lower: Floats
    row_upper: Floats
    prices: Floats

    @classmethod
    def build(
        cls, plant: MilpSimulator, start: dict[str, Floats], decision: Decision, data: Floats
    ) -> _SlotVectors:
        """The vectors of a slot.

        Args:
            plant: what steps it.
            start: every state by name.
            decision: of which the burners' limits are bounds in any case.
            data: (n_data, members).
        """
        form, standard, table = plant.form, plant.standard, plant.table
        low, high, sides, prices = form.numbers(data)
        members = data.shape[1]
        lower, upper, cost = np.zeros((3, members, standard.n_columns))
        present = table[form.n_now :]
        lower[:, present], upper[:, present] = low.T, high.T
        for name, columns in standard.initial.items():
            lower[:, columns] = upper[:, columns] = start[name].T
        cost[:, table] = prices.T
        if decision.burner_mw is not None and len(plant.burning):
            burning = table[plant.burning]
            allowed = np.maximum(decision.burner_mw.T, plant.burner_min)
            upper[:, burning] = np.minimum(upper[:, burning], allowed)
        row_lower = np.where(standard.equality, sides.T, -np.inf)
        return cls(start, lower, upper, cost, row_lower, sides.T.copy(), prices)

    def vectors(self, k: int) -> Vectors:
        """Those of one member."""
        return Vectors(
            self.cost[k], 0.0, self.lower[k], self.upper[k], self.row_lower[k], self.row_upper[k]
        )
