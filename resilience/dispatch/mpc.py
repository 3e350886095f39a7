"""Rolling optimisation over a short window, and the clairvoyant bound over the whole horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.dispatch.base import Observation, World
from resilience.models.algebra import Floats
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.tree import Cut, Tree
from resilience.models.unroll import unroll

PAPER_SLOTS = 8


class MPC:
    """Solves a window of slots, applies its first decision, and moves on.

    It takes the present line status for the whole window: it is blind to outages to come, and to
    the end of one that has begun. Profiles within the window are known. The paper's baseline has
    8 slots and no terminal value, so it drains the storage; `value_per_mwh` mends that.

    Args:
        world: where it acts.
        slots: length of the window.
        value_per_mwh: what energy left at the end of the window is worth, $/MWh.
        name: how it is called in reports.
    """

    def __init__(
        self, world: World, slots: int = PAPER_SLOTS, value_per_mwh: float = 0.0, name: str = ""
    ) -> None:
        self.world, self.slots = world, slots
        self.name = name or ("mpc" if value_per_mwh else "mpc-blind")
        grid = world.grid
        cut = Cut(0.0, {"ess.energy": np.full(len(grid.case.ess), -value_per_mwh)})
        tree = Tree.chain([f"+{k}" for k in range(slots)])
        stage = grid.stage(grid.case.step_h)
        self.problem = unroll([stage], tree, [cut] if value_per_mwh else [])
        self.solver = Highs(lower(self.problem, exact={}), duals=False)
        self.first = [self.problem.columns(f"ess.{way}")[:, 0] for way in ("charge", "discharge")]

    def act(self, seen: Observation) -> Floats:
        """The first slot of each scenario's window."""
        case = self.world.grid.case
        at = np.minimum(seen.t + np.arange(self.slots), case.slots - 1)
        found = np.empty_like(seen.energy)
        for k in range(seen.energy.shape[1]):
            up = np.repeat(seen.line_up[:, [k]], self.slots, axis=1)
            situation = self.world.grid.situation(up, lambda name: case.profile(name)[at])
            data = self.world.grid.data(situation)
            self.solver.update(self.problem.vectors(data, {"ess.energy": seen.energy[:, k]}))
            z = self.solver.solve().point
            found[:, k] = z[self.first[0]] - z[self.first[1]]
        return found


@dataclass(frozen=True)
class Bound:
    """The clairvoyant optimum per scenario: nobody without foreknowledge can cost less.

    Attributes:
        objective: (scenarios,) $: cost less the worth of the energy left at the end.
        charging: (units, slots, scenarios) MW, the decisions that reach it.
    """

    objective: Floats
    charging: Floats


def clairvoyant(world: World, value_per_mwh: float) -> Bound:
    """Solves every scenario over the whole horizon with its outages known in advance."""
    grid, scenarios = world.grid, world.scenarios
    case = grid.case
    cut = Cut(0.0, {"ess.energy": np.full(len(case.ess), -value_per_mwh)})
    tree = Tree.chain([f"t{t}" for t in range(case.slots)])
    problem = unroll([grid.stage(case.step_h)], tree, [cut] if value_per_mwh else [])
    solver = Highs(lower(problem, exact={}))
    charge, discharge = (problem.columns(f"ess.{way}") for way in ("charge", "discharge"))
    objective = np.empty(scenarios.n)
    charging = np.empty((*charge.shape, scenarios.n))
    for k in range(scenarios.n):
        data = grid.data(grid.situation(world.line_up[:, :, k]))
        solver.update(problem.vectors(data, grid.start()))
        found = solver.solve()
        objective[k] = solver.certified_bound(found)
        charging[:, :, k] = found.point[charge] - found.point[discharge]
    return Bound(objective, charging)


class Replay:
    """Does what it was told in advance: a plan, or the clairvoyant's decisions."""

    def __init__(self, name: str, charging: Floats) -> None:
        self.name, self.charging = name, charging

    def act(self, seen: Observation) -> Floats:
        """(units, batch) the decisions of slot t."""
        found: Floats = self.charging[:, seen.t]
        return found
