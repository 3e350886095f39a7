"""The clairvoyant bound over the whole horizon, and the dispatcher that acts on it.

Every episode is one linear program over all of its slots. It starts from the optimal basis of the
calm one, the forecast without outages, which is solved once: a storm changes few hours of it, and
what comes out depends on the episode alone, not on those solved before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.dispatch.merged_grid import MergedGrid, merged_grid
from resilience.errors import SolverError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import LONG_HORIZON_OPTIONS, Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import terminal_cuts
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Vectors
from resilience.models.program.unroll import unroll
from resilience.simulation.observation import Action, Observation, Rationed
from resilience.simulation.slots import up_before
from resilience.simulation.world import World


@dataclass(frozen=True)
class Bound:
    """The clairvoyant optimum per scenario: nobody without foreknowledge can cost less.

    Attributes:
        objective: (scenarios,) $: cost less the worth of the energy left, proven from multipliers.
        charging: (units, slots, scenarios) MW, the decisions that reach it.
        burner_mw: (burners, slots, scenarios) MW of generators with a tank; None without tanks.
    """

    objective: Floats
    charging: Floats
    burner_mw: Floats | None = None


def clairvoyant(world: World) -> Bound:
    """The optimum of every scenario over the whole horizon, everything known in advance.

    Where the state of charge is reset every midnight, every day is a horizon of its own.

    Args:
        world: the storms.
    """
    case, n = world.microgrid.case, world.scenarios.n
    objective = np.zeros(n)
    charging = np.zeros((len(case.ess), case.slots, n))
    burners = sum(unit.tank is not None for unit in case.generator)
    burner_mw = np.zeros((burners, case.slots, n)) if burners else None
    spans = np.split(np.arange(case.slots), world.ends[:-1] + 1)
    programs: dict[int, HorizonProgram] = {}
    for slots in spans:
        if len(slots) not in programs:
            programs[len(slots)] = HorizonProgram(world, len(slots))
        program = programs[len(slots)]
        program.solve_calm(slots)
        for k in range(n):
            solution = program.solve(slots, k)
            objective[k] += program.bound(solution)
            charging[:, slots, k] = program.charging(solution)
            if burner_mw is not None:
                burner_mw[:, slots, k] = program.burner_mw(solution)
    return Bound(objective, charging, burner_mw)


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
        self.with_before = any(datum.name == "generator.bound" for datum in stage.datums)
        self.solver = Highs(lower(standard, integer="none", modes={}))
        self.solver.tune(LONG_HORIZON_OPTIONS)
        nothing = np.empty((0, slots), np.intp)
        self.shares = self.merged.burner_shares
        self.generators = standard.columns("generator.p") if len(self.shares) else nothing
        self.storage = [
            standard.columns(f"ess.{way}") if microgrid.case.ess else nothing
            for way in ("charge", "discharge")
        ]
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

    def solve(self, slots: Ints, k: int, state_price: Floats | None = None) -> Solution:
        """The optimum of scenario k.

        Args:
            slots: of the horizon.
            k: the scenario.
            state_price: (units and tanks, slots) $ per MWh or m³ at the end of every slot, beyond
                what the case says.
        """
        world = self.world
        names = [None, *world.microgrid.case.profiles]
        every = np.arange(world.microgrid.case.slots)
        true = {name: world.profile(name, every)[:, k] for name in names}
        vectors = self._vectors(slots, world.line_up[:, :, k], true.__getitem__)
        if state_price is not None:
            vectors.cost[self.state_columns] += state_price
        self.solver.update(vectors)
        self.solver.start_at(self.basis)
        return self.solver.solve()

    def bound(self, solution: Solution) -> float:
        """What a scenario costs at least, $, proven from multipliers."""
        return self.solver.certified_bound(solution)

    def charging(self, solution: Solution) -> Floats:
        """(units, slots) charging power, MW."""
        charge, discharge = (solution.point[columns] for columns in self.storage)
        return np.asarray(charge - discharge)

    def burner_mw(self, solution: Solution) -> Floats:
        """(burners, slots) MW of the generators with a tank."""
        return np.asarray(self.shares @ solution.point[self.generators])

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
    """Does what was decided in advance: a plan's decisions, or the clairvoyant's."""

    def __init__(self, name: str, charging: Floats, burner_mw: Floats | None = None) -> None:
        self.name, self.charging, self.burner_mw = name, charging, burner_mw

    def act(self, observation: Observation) -> Action:
        """(units, batch) the decisions of slot t, with those of generators with a tank if any."""
        power = self.charging[:, observation.t]
        return (
            power if self.burner_mw is None else Rationed(power, self.burner_mw[:, observation.t])
        )
