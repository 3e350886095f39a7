"""A case and its outage scenarios as a two-stage program.

The trunk is what to do as long as nothing unforeseen happens: its lines are down where they are
down in every scenario, and nowhere else. A scenario leaves it in the slot in which its own outage
shows, which is seen at the start of that slot. A trunk that ends after a given number of slots,
common to all, is the textbook's first stage.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.errors import UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import CaseProgram, line_up_before, terminal_cuts
from resilience.models.idle_ratings import without_idle_ratings
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.program.risk import Risk
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll
from resilience.planning.two_stage.two_stage import IN, TwoStage
from resilience.simulation.world import microgrid_with_fallible_lines


@dataclass(frozen=True)
class DistinctScenarios:
    """Scenarios, each kept once, in an order in which neighbours are alike.

    Attributes:
        line_up: (elements of the case, slots, distinct scenarios) False where one is down.
        probability: (distinct scenarios,) of each.
        index: (scenarios,) which of the distinct ones every scenario is.
        number: (distinct scenarios,) the first of the scenarios that it stands for.
    """

    line_up: Bools
    probability: Floats
    index: Ints
    number: Ints

    @classmethod
    def among(cls, scenarios: Scenarios, case: Case) -> DistinctScenarios:
        """The different ones among some scenarios."""
        up = scenarios.status(case.elements)
        # Slot by slot, so that scenarios that begin alike lie side by side.
        path = np.packbits(~up.transpose(2, 1, 0).reshape(scenarios.n, -1), axis=1)
        _, first, index = np.unique(path, axis=0, return_index=True, return_inverse=True)
        chance = np.zeros(len(first))
        np.add.at(chance, index.ravel(), scenarios.probability)
        return cls(up[:, :, first], chance, index.ravel(), first)

    @property
    def n(self) -> int:
        """How many there are."""
        return len(self.probability)

    @property
    def common(self) -> Bools:
        """(elements, slots) False where one is down in all of them."""
        return np.asarray(self.line_up.any(axis=2))

    def leaving(self) -> Ints:
        """(distinct scenarios,) first slot in which each leaves `common`; past the end: none."""
        apart = (self.line_up != self.common[:, :, None]).any(axis=0)
        return np.where(apart.any(axis=0), apart.argmax(axis=0), len(apart))


@dataclass(frozen=True)
class ScenarioProgram:
    """The two-stage program of a case and its scenarios.

    Attributes:
        microgrid: the microgrid that is planned for.
        two_stage: trunk, branches and data.
        distinct: the scenarios, each kept once.
        leaves: (distinct scenarios,) slot in which each leaves the trunk.
        chain: (distinct scenarios,) index in `two_stage.branches`, -1 for the one that stays.
        slot: (nodes of the tree,) slot of every node.
    """

    microgrid: Microgrid
    two_stage: TwoStage
    distinct: DistinctScenarios
    leaves: Ints
    chain: Ints
    slot: Ints = field(repr=False)

    def mean_states(self) -> Floats | None:
        """(trunk nodes, states) of the plan for mean data: what a planner without scenarios does.

        None where mean data has no plan.
        """
        chance = self.two_stage.tree.probability
        data = {}
        for name, values in self.two_stage.data.items():
            wide = np.broadcast_to(values, (len(values), self.two_stage.tree.n))
            sums = [np.bincount(self.slot, chance * row, self.slots) for row in wide]
            data[name] = np.array(sums).reshape(len(values), self.slots)
        problem = self.full()
        solver = Highs(lower(problem, integer="none", modes={}))
        solver.update(problem.vectors(data, self.two_stage.x0))
        z = solver.solve().z
        ends = [problem.state_columns(t) for t in range(self.two_stage.trunk)]
        return None if z is None else z[np.array(ends, np.intp)]

    @property
    def slots(self) -> int:
        """Slots of the horizon."""
        return self.microgrid.case.slots

    def full(self) -> Standard:
        """The whole horizon as one chain: what a scenario's trunk and chain make together."""
        labels = [self.microgrid.case.slot_label(t) for t in range(self.slots)]
        return unroll(self.two_stage.stages, Tree.chain(labels), self.two_stage.cuts)

    def program_of(self, scenario: int, full: Standard) -> CaseProgram:
        """The whole horizon of one of the distinct scenarios, with its data."""
        up = self.distinct.line_up[:, :, scenario]
        situation = self.microgrid.situation(
            up,
            before=line_up_before(up, full.tree),
            is_last=np.arange(self.slots) == self.slots - 1,
        )
        return CaseProgram(
            self.microgrid, full, situation, self.microgrid.data(situation), dict(self.two_stage.x0)
        )

    @property
    def trunk(self) -> CaseProgram:
        """The common slots, with their data."""
        slots = np.arange(self.two_stage.trunk)
        case = self.microgrid.case
        situation = self.microgrid.situation(
            self.distinct.common[:, slots], lambda name: case.profile(name)[slots]
        )
        return CaseProgram(
            self.microgrid,
            self.two_stage.first,
            situation,
            self.two_stage.first_data,
            dict(self.two_stage.x0),
        )


def microgrid_to_plan(case: Case, scenarios: Scenarios, physics: Physics) -> Microgrid:
    """The microgrid of a plan over scenarios, whose lines can fail; see `without_idle_ratings`."""
    microgrid = microgrid_with_fallible_lines(case, scenarios, physics)
    return without_idle_ratings(microgrid) if physics == "copperplate" else microgrid


def scenario_program(
    microgrid: Microgrid,
    distinct: DistinctScenarios,
    *,
    common_slots: int | None = None,
    most_common_slots: int | None = None,
    risk: Risk | None = None,
) -> ScenarioProgram:
    """The two-stage program.

    Args:
        microgrid: the microgrid, see `microgrid_with_fallible_lines`.
        distinct: its scenarios.
        common_slots: slots after which every scenario goes its own way; None: each leaves the trunk
            when its own outage shows. 0: nothing is decided in common, everybody is clairvoyant.
        most_common_slots: slots after which at the latest every scenario goes its own way.
        risk: the objective over scenarios, expected cost if omitted.

    Raises:
        UsageError: scenarios that differ within the slots that are to be common.
    """
    case = microgrid.case
    leaves = distinct.leaving()
    if common_slots is not None:
        _check_common(case, distinct, leaves, common_slots)
        leaves = np.full(distinct.n, common_slots)
    if most_common_slots is not None and most_common_slots < case.slots:
        leaves = np.minimum(leaves, most_common_slots)
    trunk = max(int(min(leaves.max(), case.slots)), 1)
    stays = leaves >= case.slots
    tree, slot, chain = _trunk_and_branches(case, distinct, leaves, trunk)
    line_up = np.empty((len(distinct.line_up), tree.n), bool)
    line_up[:, :trunk] = distinct.common[:, :trunk]
    for k in np.flatnonzero(~stays):
        nodes = slice(*_span(leaves, stays, trunk, case.slots, int(k)))
        line_up[:, nodes] = distinct.line_up[:, leaves[k] :, k]
    situation = microgrid.situation(
        line_up,
        lambda name: case.profile(name)[slot],
        before=line_up_before(line_up, tree),
        is_last=slot == case.slots - 1,
    )
    stages, data = [microgrid.stage(case.step_h)], microgrid.data(situation)
    two_stage = TwoStage(
        stages, tree, trunk, data, microgrid.start(), terminal_cuts(microgrid), risk or Risk()
    )
    return ScenarioProgram(microgrid, two_stage, distinct, leaves, chain, slot)


def _span(leaves: Ints, stays: Bools, trunk: int, slots: int, scenario: int) -> tuple[int, int]:
    """First and last + 1 node of a scenario's chain."""
    lengths = np.where(stays, 0, slots - leaves)
    start = trunk + int(lengths[:scenario].sum())
    return start, start + int(lengths[scenario])


def _trunk_and_branches(
    case: Case, distinct: DistinctScenarios, leaves: Ints, trunk: int
) -> tuple[Tree, Ints, Ints]:
    """The tree, the slot of every node, and the number of every scenario's chain."""
    stays = leaves >= case.slots
    chance, names = distinct.probability, [case.slot_label(t) for t in range(case.slots)]
    staying = [chance[leaves > t].sum() for t in range(trunk)]
    parent, slot, weight = [np.arange(trunk) - 1], [np.arange(trunk)], [np.array(staying)]
    labels, chain, number, n = names[:trunk], np.full(distinct.n, -1), 0, trunk
    for k in np.flatnonzero(~stays):
        length = case.slots - int(leaves[k])
        parent.append(np.concatenate([[leaves[k] - 1], n + np.arange(length - 1)]))
        slot.append(np.arange(leaves[k], case.slots))
        weight.append(np.full(length, chance[k]))
        labels += [f"{name}{IN}scenario {distinct.number[k]}" for name in names[leaves[k] :]]
        chain[k] = number
        number, n = number + 1, n + length
    joined = np.concatenate(parent)
    tree = Tree(joined, np.concatenate(weight), np.zeros(n, np.intp), tuple(labels))
    return tree, np.concatenate(slot), chain


def _check_common(case: Case, distinct: DistinctScenarios, leaves: Ints, common_slots: int) -> None:
    first = int(leaves.min())
    if not 0 <= common_slots < case.slots or common_slots > first:
        k = int(leaves.argmin())
        raise UsageError(
            f"{common_slots} common slots; allowed: 0 to {min(first, case.slots - 1)}, because "
            f"scenario {distinct.number[k]} has an outage of its own from slot {first} on",
            hint="leave it out: each scenario then leaves when its own outage shows",
        )
