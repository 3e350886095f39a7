"""The clairvoyant bound over the whole horizon, and the dispatcher that acts on it.

Every episode is one linear program over all of its slots. It starts from the optimal basis of the
calm one, the forecast without outages, which is solved once: a storm changes few hours of it, and
what comes out depends on the episode alone, not on those solved before.

Where units are committed or lines switched, that program lets them run and close by shares. So it
is a relaxation: what it costs is proven, and perhaps nobody reaches it. What the clairvoyant does
is found from it in three steps, for some thresholds, of which the cheapest counts: a unit whose
share is above the threshold is asked to run; the simulator follows that as far as its rows allow;
and with that commitment, and the lines as they were, the program is solved once more for all else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.dispatch.decision_columns import DecisionColumns
from resilience.dispatch.merged_grid import MergedGrid, merged_grid
from resilience.errors import SolverError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import LONG_HORIZON_OPTIONS, Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import terminal_cuts
from resilience.models.components.generator import BOUND
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.models.simulator import Decision, MilpSimulator, part_by_part
from resilience.simulation.observation import Action, Observation, parts_of
from resilience.simulation.simulate import simulate
from resilience.simulation.slots import up_before
from resilience.simulation.world import World

THRESHOLDS = (0.2, 0.02)
"""Shares of a unit above which it is asked to run."""


@dataclass(frozen=True)
class Bound:
    """The clairvoyant optimum per scenario: nobody without foreknowledge can cost less.

    Attributes:
        objective: (scenarios,) $: cost less the worth of the energy left, proven from multipliers.
        decision: what is decided, arrays (rows, slots, scenarios): the decisions that reach it, or
            near it where commitment or switches are relaxed.
    """

    objective: Floats
    decision: Decision

    @property
    def charging(self) -> Floats:
        """(units, slots, scenarios) MW."""
        return self.decision.power


def clairvoyant(world: World) -> Bound:
    """The optimum of every scenario over the whole horizon, everything known in advance.

    Where the state of charge is reset every midnight, every day is a horizon of its own.

    Args:
        world: the storms.
    """
    programs = _Programs(world)
    objective, decisions = np.zeros(world.scenarios.n), []
    for k in range(world.scenarios.n):
        objective[k], decision = programs.solved(k)
        decisions.append(programs.committed(k, decision) if programs.is_relaxed else decision)
    return Bound(objective, part_by_part(lambda rows: np.stack(rows, axis=-1), decisions))


def relaxes_integers(world: World) -> bool:
    """Whether the bound lets units run, or lines close, by shares."""
    simulator = world.simulator
    return isinstance(simulator, MilpSimulator) and bool(len(simulator.on) + len(simulator.closed))


class _Programs:
    """The programs of a world's horizon, or of every day of it where days begin anew.

    Args:
        world: the storms.
    """

    def __init__(self, world: World) -> None:
        self.world, self.is_relaxed = world, relaxes_integers(world)
        self.spans = np.split(np.arange(world.microgrid.case.slots), world.ends[:-1] + 1)
        by_length = {n: HorizonProgram(world, n) for n in {len(slots) for slots in self.spans}}
        self.programs = [by_length[len(slots)] for slots in self.spans]
        self.bases = []
        for program, slots in zip(self.programs, self.spans, strict=True):
            program.solve_calm(slots)
            self.bases.append(program.basis)

    def solved(self, k: int, commitment: Decision | None = None) -> tuple[float, Decision]:
        """What scenario k costs at least, $, and what is decided, (rows, slots) each.

        Infinitely much where nothing goes with a commitment.

        Args:
            k: the scenario.
            commitment: what runs and what is closed, (rows, slots); relaxed if omitted.
        """
        bounds, decisions = [], []
        for program, slots, basis in zip(self.programs, self.spans, self.bases, strict=True):
            program.basis = basis
            solution = program.solve(slots, k, commitment=commitment)
            if solution.z is None and commitment is not None:
                return np.inf, commitment
            bounds.append(program.bound(solution))
            decisions.append(program.decision(solution))
        joined = part_by_part(lambda rows: np.concatenate(rows, axis=1), decisions)
        return float(sum(bounds)), joined

    def committed(self, k: int, relaxed: Decision) -> Decision:
        """What can be done in scenario k, from what is decided where units run by shares."""
        episode = self.world.with_scenarios(np.array([k]))
        cheapest, cost = relaxed._replace(on=None, closed=None, ramped_mw=None), np.inf
        for threshold in THRESHOLDS if relaxed.on is not None else (0.0,):
            on = None if relaxed.on is None else (relaxed.on > threshold).astype(float)
            wish = relaxed._replace(on=on, closed=None, ramped_mw=None)
            run = simulate(episode, Replay("", part_by_part(_of_scenario, [wish])))
            commitment = wish._replace(
                on=None if on is None else run.decided("generator.on")[:, :, 0],
                closed=None if relaxed.closed is None else run.decided("line.closed")[:, :, 0],
            )
            total, decision = self.solved(k, commitment)
            if total < cost:
                cheapest, cost = decision, total
        return cheapest


def _of_scenario(parts: list[Floats]) -> Floats:
    return parts[0][:, :, None]


class HorizonProgram:
    """The linear program over a number of slots, of which everything is known.

    Args:
        world: the storms.
        slots: how many.

    Attributes:
        states: names of the states that are there: stored energy, fuel.
        state_columns: (units and tanks, slots) columns of the states at the end of every slot.
        labels: (units and tanks,) names of the units and tanks.
    """

    def __init__(self, world: World, slots: int) -> None:
        self.world, case = world, world.microgrid.case
        # Buses can be merged where lines carry anything.
        is_lossless = world.microgrid.physics == "copperplate"
        self.merged = merged_grid(case) if is_lossless else MergedGrid.as_it_is(world.microgrid)
        microgrid = self.merged.microgrid
        tree = Tree.chain([f"t{t}" for t in range(slots)])
        cuts = terminal_cuts(microgrid, world.end_value_per_mwh)
        stage = microgrid.stage(microgrid.case.step_h, may_spill=True)
        self.standard = standard = unroll([stage], tree, cuts)
        self.with_before = any(datum.name == BOUND for datum in stage.datums)
        self.solver = Highs(lower(standard, integer="none", modes={}))
        self.solver.tune(LONG_HORIZON_OPTIONS)
        self.decided = DecisionColumns.of_program(standard, self.merged)
        nothing = np.empty((0, slots), np.intp)
        self.states = [name for name in ("ess.energy", "tank.level") if standard.has(name)]
        self.state_columns = np.concatenate([nothing, *map(standard.columns, self.states)])

    def solve_calm(self, slots: Ints) -> None:
        """Solves the forecast without outages, from scratch, and remembers its basis."""
        case = self.world.microgrid.case
        self.solver.forget()
        calm = np.ones((len(self.world.line_up), case.slots), bool)
        self.solver.update(self._vectors(slots, calm, case.profile))
        self.solver.solve()
        self.basis = self.solver.basis()

    def solve(
        self,
        slots: Ints,
        k: int,
        state_price: Floats | None = None,
        commitment: Decision | None = None,
    ) -> Solution:
        """The optimum of scenario k.

        Args:
            slots: of the horizon.
            k: the scenario.
            state_price: (units and tanks, slots) $ per MWh or m³ at the end of every slot, beyond
                what the case says.
            commitment: what runs and what is closed, (rows, slots of the horizon); by shares if
                omitted. There may be no point then.
        """
        world = self.world
        names = [None, *world.microgrid.case.profiles]
        every = np.arange(world.microgrid.case.slots)
        true = {name: world.profile(name, every)[:, k] for name in names}
        vectors = self._vectors(slots, world.line_up[:, :, k], true.__getitem__)
        if state_price is not None:
            vectors.cost[self.state_columns] += state_price
        if commitment is not None:
            vectors = self._fixed(vectors, slots, commitment)
        self.solver.update(vectors)
        self.solver.start_at(self.basis)
        return self.solver.solve()

    def bound(self, solution: Solution) -> float:
        """What a scenario costs at least, $, proven from multipliers."""
        return self.solver.certified_bound(solution)

    def decision(self, solution: Solution) -> Decision:
        """What is decided, (rows, slots) each."""
        return self.decided.decision(solution.point, slice(None))

    def levels(self, solution: Solution) -> Floats:
        """(units and tanks, slots) MWh and m³ at the end of every slot."""
        return solution.point[self.state_columns]

    def worth(self, solution: Solution) -> Floats:
        """(units and tanks, slots) $ that one more MWh or m³ at the end of a slot saves behind it.

        Raises:
            SolverError: the solution carries no multipliers.
        """
        if solution.duals is None:
            raise SolverError("a solution without multipliers", hint="make `Highs` with `duals`")
        rows = [self.standard.rows(f"{name.split('.')[0]}.dynamics") for name in self.states]
        return solution.duals.rows[np.concatenate(rows)]

    def _fixed(self, vectors: Vectors, slots: Ints, commitment: Decision) -> Vectors:
        """The vectors with what runs and what is closed fixed."""
        pairs = ((self.decided.on, commitment.on), (self.decided.closed, commitment.closed))
        for columns, values in pairs:
            if columns is not None and values is not None:
                vectors = vectors.fixed(columns.ravel(), values[:, slots].ravel())
        return vectors

    def _vectors(
        self, slots: Ints, path: Bools, profile: Callable[[str | None], Floats]
    ) -> Vectors:
        """The numbers of some slots of a path (lines of the case, slots of the horizon)."""
        microgrid = self.merged.microgrid
        of_slots = self.merged.profile(lambda name: profile(name)[slots])
        before = up_before(path[:, :, None], slots)[:, :, 0] if self.with_before else None
        data = microgrid.data(microgrid.situation(path[:, slots], of_slots, before=before))
        return self.standard.vectors(data, microgrid.start())


class Replay:
    """Does what was decided in advance: a plan's decisions, or the clairvoyant's.

    Args:
        name: what it is called.
        decision: of every slot, (rows, slots, scenarios) each, or (units, slots, scenarios)
            charging power alone, MW.
    """

    def __init__(self, name: str, decision: Decision | Floats) -> None:
        self.name, self.decision = name, parts_of(decision)

    def act(self, observation: Observation) -> Action:
        """The decisions of slot t."""
        return part_by_part(lambda rows: rows[0][:, observation.t], [self.decision])
