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
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import terminal_cuts
from resilience.models.language.tree import Tree
from resilience.models.program.unroll import unroll
from resilience.simulation.observation import Action, Observation, Rationed
from resilience.simulation.world import World

LONG_HORIZON_OPTIONS = {"simplex_dual_edge_weight_strategy": -1}
"""Steepest edge, which HiGHS chooses itself: half the time of Devex on a long horizon."""


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
    programs: dict[int, _BoundProgram] = {}
    for slots in spans:
        if len(slots) not in programs:
            programs[len(slots)] = _BoundProgram(world, len(slots))
        program = programs[len(slots)]
        program.solve_calm(slots)
        for k in range(n):
            bound, charging[:, slots, k], power = program.solve(slots, k)
            objective[k] += bound
            if burner_mw is not None:
                burner_mw[:, slots, k] = power
    return Bound(objective, charging, burner_mw)


class _BoundProgram:
    """The linear program over a number of slots."""

    def __init__(self, world: World, slots: int) -> None:
        self.world, case = world, world.microgrid.case
        # Buses can be merged where lines carry anything.
        is_lossless = world.microgrid.physics == "copperplate"
        self.merged = merged_grid(case) if is_lossless else MergedGrid.as_it_is(world.microgrid)
        microgrid = self.merged.microgrid
        tree = Tree.chain([f"t{t}" for t in range(slots)])
        cuts = terminal_cuts(microgrid, world.end_value_per_mwh)
        stage = microgrid.stage(microgrid.case.step_h, may_spill=True)
        self.standard = unroll([stage], tree, cuts)
        self.solver = Highs(lower(self.standard, integer="none", modes={}))
        self.solver.tune(LONG_HORIZON_OPTIONS)
        nothing = np.empty((0, slots), np.intp)
        self.shares = self.merged.burner_shares
        self.generators = self.standard.columns("generator.p") if len(self.shares) else nothing
        self.storage = [
            self.standard.columns(f"ess.{way}") if microgrid.case.ess else nothing
            for way in ("charge", "discharge")
        ]

    def solve_calm(self, slots: Ints) -> None:
        """Solves the forecast without outages, from scratch, and remembers its basis."""
        case = self.world.microgrid.case
        self.solver.forget()
        self._update(slots, np.ones((len(self.world.line_up), len(slots)), bool), case.profile)
        self.solver.solve()
        self.basis = self.solver.basis()

    def solve(self, slots: Ints, k: int) -> tuple[float, Floats, Floats]:
        """A proven bound on what scenario k costs, $, (units, slots) its charging, and (burners,
        slots) what its generators with a tank give, MW.
        """
        world = self.world
        names = [None, *world.microgrid.case.profiles]
        every = np.arange(world.microgrid.case.slots)
        true = {name: world.profile(name, every)[:, k] for name in names}
        self._update(slots, world.line_up[:, slots, k], true.__getitem__)
        self.solver.start_at(self.basis)
        solution = self.solver.solve()
        charge, discharge = (solution.point[columns] for columns in self.storage)
        bound = self.solver.certified_bound(solution)
        power = solution.point[self.generators]
        return bound, charge - discharge, self.shares @ power if len(self.shares) else power[:0]

    def _update(self, slots: Ints, up: Bools, profile: Callable[[str | None], Floats]) -> None:
        microgrid = self.merged.microgrid
        of_slots = self.merged.profile(lambda name: profile(name)[slots])
        data = microgrid.data(microgrid.situation(up, of_slots))
        self.solver.update(self.standard.vectors(data, microgrid.start()))


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
