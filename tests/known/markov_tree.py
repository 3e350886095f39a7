"""A multistage problem small enough to write out as one tree, with storage behind a weak line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.sddp.model import Cuts, Multistage, NoiseOutcomes
from resilience.dispatch.sddp.training import Engine
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.language.tree import Cut, Tree
from resilience.models.microgrid import Microgrid
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll
from resilience.testing import small_case

SLOTS = 3
NOISE = (np.array([0.3, 0.7]), np.array([1.3, 0.8]))  # probability, factor on demand
PRICES = np.array([0.4, 0.1])  # $/MWh left at the end
PER_SLOT = (0.2, 0.5, 0.35)  # chance that the line fails
BACK = 0.6
FIRST = np.array([[0.9, 0.1]])


def microgrid() -> Microgrid:
    """One load and two unlike storage units behind the line, generator and PV on either side."""
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[
            {"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 20.0, "profile": "demand"},
            {"bus": "1", "p_max_mw": 0.4, "shed_cost_per_mwh": 9.0},
        ],
        pv=[{"bus": "2", "p_max_mw": 1.0, "profile": "sun", "curtailable": True}],
        ess=[
            {"bus": "2", "p_max_mw": 0.8, "e_mwh": 2.0, "efficiency_charge": 0.9, "soc_min": 0.1},
            {"bus": "1", "p_max_mw": 0.5, "e_mwh": 1.0, "degradation_cost_per_mwh": 0.1},
        ],
        generator=[{"bus": "2", "p_max_mw": 0.5, "cost_per_mwh": 2.0}],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
        profiles={"demand": [1.0], "sun": [1.0]},
    )
    return Microgrid.build(case, "copperplate")


@dataclass(frozen=True)
class Node:
    """One node of the written-out tree."""

    parent: int
    chance: float
    t: int
    mode: int
    outcome: int


def transitions() -> list[Floats]:
    """Chances of (up, down) from (up, down), slot by slot; the first from nothing."""
    return [FIRST, *(np.array([[1.0 - p, p], [BACK, 1.0 - BACK]]) for p in PER_SLOT[1:])]


def data(world: Microgrid, mode: int, outcome: int, sun: float) -> dict[str, Floats]:
    """(labels, 1) the data of one node; the demand depends on the sun too, by a tenth of it."""
    demand = NOISE[1][outcome] * (0.9 - 0.1 * sun)
    values = {"demand": demand, "sun": sun, None: 1.0}
    up = np.array([[mode == 0]])
    return world.data(world.situation(up, lambda name: np.array([values[name]])))


def multistage(world: Microgrid) -> Multistage:
    """The problem as the engine takes it: one level, the sun."""

    def outcomes(mode: int) -> NoiseOutcomes:
        each = [[data(world, mode, w, sun) for sun in (0.0, 1.0)] for w in range(2)]
        names = each[0][0]
        parts = {
            k: np.stack([np.concatenate([a[k], b[k] - a[k]], axis=1) for a, b in each], axis=1)
            for k in names
        }
        return NoiseOutcomes(0, NOISE[0], parts)

    slots = [[outcomes(0), outcomes(1)] for _ in range(SLOTS)]
    return Multistage([world.stage(1.0)], slots, transitions(), Cuts.of_prices(PRICES, 1))


def nodes() -> list[Node]:
    """Every history of modes and outcomes."""
    found: list[Node] = []
    last = [(-1, 1.0, 0)]
    for t, moves in enumerate(transitions()):
        level = []
        for parent, chance, mode in last:
            for after in range(2):
                for w in range(2):
                    share = chance * moves[mode, after] * NOISE[0][w]
                    found.append(Node(parent, share, t, after, w))
                    level.append((len(found) - 1, share, after))
        last = level
    return found


@dataclass(frozen=True)
class Written:
    """The tree as one linear program."""

    world: Microgrid
    standard: Standard
    nodes: list[Node]

    @classmethod
    def out(cls, world: Microgrid) -> Written:
        every = nodes()
        tree = Tree(
            np.array([n.parent for n in every]),
            np.array([n.chance for n in every]),
            np.zeros(len(every), np.intp),
            tuple(f"node {k}" for k in range(len(every))),
        )
        cut = Cut(0.0, {"ess.energy": -PRICES})
        return cls(world, unroll([world.stage(1.0)], tree, [cut]), every)

    def solve(self, energy: Floats, sun: float) -> Solution:
        each = [data(self.world, n.mode, n.outcome, sun) for n in self.nodes]
        joined = {k: np.concatenate([part[k] for part in each], axis=1) for k in each[0]}
        solver = Highs(lower(self.standard, integer="none", modes={}))
        solver.update(self.standard.vectors(joined, {"ess.energy": energy}))
        return solver.solve()


def policy_cost(engine: Engine, energy: Floats, sun: float) -> float:
    """Expected cost of the policy that the cuts make, over every history."""
    levels, problem = np.array([[sun]]), engine.multistage

    def visit(t: int, state: Floats, mode: int) -> float:
        if t == problem.slots:
            return problem.terminal.value(state, levels[0])
        total = 0.0
        for after, chance in enumerate(problem.transition[t][mode]):
            for w, share in enumerate(NOISE[0]):
                block = np.array([2 * after + w])
                slot = engine.slots[t].blocks
                end, spent = slot.step(block, state[None], levels)
                total += chance * share * (spent[0] + visit(t + 1, end[0], after))
        return total

    return visit(0, energy, 0)
