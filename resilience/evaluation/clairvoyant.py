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
from resilience.simulation.observation import Observation
from resilience.simulation.world import World

STEEPEST = {"simplex_dual_edge_weight_strategy": -1}  # of a long horizon: half the time of Devex


@dataclass(frozen=True)
class Bound:
    """The clairvoyant optimum per scenario: nobody without foreknowledge can cost less.

    Attributes:
        objective: (scenarios,) $: cost less the worth of the energy left, proven from multipliers.
        charging: (units, slots, scenarios) MW, the decisions that reach it.
    """

    objective: Floats
    charging: Floats


def clairvoyant(world: World, on_scenario: Callable[[], None] | None = None) -> Bound:
    """Solves every scenario over the whole horizon; outages, load and PV are known in advance.

    Where the state of charge is reset every midnight, every day is a horizon of its own.

    Args:
        world: the storms.
        on_scenario: called after every one.
    """
    case, n = world.microgrid.case, world.scenarios.n
    objective = np.zeros(n)
    charging = np.zeros((len(case.ess), case.slots, n))
    spans = np.split(np.arange(case.slots), world.ends[:-1] + 1)
    programs: dict[int, _BoundProgram] = {}
    for slots in spans:
        if len(slots) not in programs:
            programs[len(slots)] = _BoundProgram(world, len(slots))
        programs[len(slots)].calm(slots)
        for k in range(n):
            least, charge = programs[len(slots)].solve(slots, k)
            objective[k] += least
            charging[:, slots, k] = charge
            if on_scenario is not None and slots[-1] == case.slots - 1:
                on_scenario()
    return Bound(objective, charging)


class _BoundProgram:
    """The linear program over a number of slots."""

    def __init__(self, world: World, slots: int) -> None:
        self.world, plain = world, world.microgrid.physics != "copperplate"
        self.small = MergedGrid(world.microgrid, {}) if plain else merged_grid(world.microgrid.case)
        microgrid = self.small.microgrid
        tree = Tree.chain([f"t{t}" for t in range(slots)])
        cuts = terminal_cuts(microgrid.case, world.end_value_per_mwh)
        self.standard = unroll([microgrid.stage(microgrid.case.step_h)], tree, cuts)
        self.solver = Highs(lower(self.standard, integer="none", modes={}))
        self.solver.tune(STEEPEST)
        nothing = np.empty((0, slots), np.intp)
        self.storage = [
            self.standard.columns(f"ess.{way}") if microgrid.case.ess else nothing
            for way in ("charge", "discharge")
        ]

    def calm(self, slots: Ints) -> None:
        """Solves the forecast without outages, from scratch, and remembers its basis."""
        case = self.world.microgrid.case
        self.solver.forget()
        self._take(slots, np.ones((len(self.world.line_up), len(slots)), bool), case.profile)
        self.solver.solve()
        self.basis = self.solver.basis()

    def solve(self, slots: Ints, k: int) -> tuple[float, Floats]:
        """The least that scenario k can cost, and (units, slots) the charging that does it, MW."""
        world = self.world
        names = [None, *world.microgrid.case.profiles]
        every = np.arange(world.microgrid.case.slots)
        true = {name: world.profile(name, every)[:, k] for name in names}
        self._take(slots, world.line_up[:, slots, k], true.__getitem__)
        self.solver.start_at(self.basis)
        found = self.solver.solve()
        charge, discharge = (found.point[columns] for columns in self.storage)
        return self.solver.certified_bound(found), charge - discharge

    def _take(self, slots: Ints, up: Bools, profile: Callable[[str | None], Floats]) -> None:
        microgrid = self.small.microgrid
        seen = self.small.profile(lambda name: profile(name)[slots])
        data = microgrid.data(microgrid.situation(up, seen))
        self.solver.update(self.standard.vectors(data, microgrid.start()))


class Replay:
    """Does what it was told in advance: a plan, or the clairvoyant's decisions."""

    def __init__(self, name: str, charging: Floats) -> None:
        self.name, self.charging = name, charging

    def act(self, seen: Observation) -> Floats:
        """(units, batch) the decisions of slot t."""
        return self.charging[:, seen.t]
