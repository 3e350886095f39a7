r"""Two-stage programs: a trunk of decisions common to all scenarios, and a branch for each of them.

$$ \min_x \; \rho\left(c(x) + Q_s(x)\right), \qquad
   Q_s(x) = \min_y \left\{ q_s^\top y : W y = h_s - T x,\ y \le u_s \right\} $$

The trunk is what is decided now: it runs on as long as nothing has told one scenario from another.
A scenario leaves it at the end of some node, with the state that the trunk has there, and from then
on knows its own future. `tree` holds the trunk first, then branch by branch, so the same program is
solved in one piece (`extensive`) or cut at the trunk (`resilience.planning.two_stage.lshaped`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.gate import cost_scale
from resilience.models.program.risk import Risk
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll

IN = " in "
"""Between the time of a node and the scenario it belongs to, in the labels of a tree."""


@dataclass(frozen=True)
class ScenarioBranch:
    """The second stage of a scenario.

    Attributes:
        trunk_node: node of the trunk at whose end it begins, -1: at the start.
        nodes: (steps,) its nodes in the tree.
        probability: of the scenario.
        program: which of `TwoStage.programs` holds it.
        offset: the first of that program's nodes that belongs to it.
    """

    trunk_node: int
    nodes: Ints
    probability: float
    program: int
    offset: int


@dataclass(frozen=True)
class TwoStage:
    """A trunk and its branches, with all their data.

    Attributes:
        stages: as `unroll` takes them.
        tree: nodes 0 .. trunk - 1 are a chain from the start, and behind it every scenario is a
            chain of its own.
        trunk: number of nodes that are decided in common, at least one.
        data: by name, (labels, nodes of the tree).
        x0: by name, (labels,) states at the start.
        cuts: worth of the states at the end.
        risk: the objective over the scenarios.
        matters: (branches, states) states on which the cost of a branch depends; None: on all.
        falls: (branches,) whether more of what is built never costs a branch more; None: nobody
            knows.
    """

    stages: Sequence[Stage]
    tree: Tree
    trunk: int
    data: Mapping[str, Floats]
    x0: Mapping[str, Floats]
    cuts: Sequence[Cut] = ()
    risk: Risk = field(default_factory=Risk)
    matters: Bools | None = None
    falls: Bools | None = None

    def __post_init__(self) -> None:
        parent, m = self.tree.parent, self.trunk
        children = np.bincount(parent[m:][parent[m:] >= m] - m)
        if m < 1 or (parent[:m] != np.arange(m) - 1).any() or (children > 1).any():
            raise ValueError(
                f"nodes 0 to {m - 1} must be a chain, and every node behind it have one child"
            )

    @cached_property
    def staying(self) -> float:
        """Probability that nothing ever leaves the trunk."""
        last = self.trunk - 1
        return float(self.tree.probability[last]) if last in self.tree.leaves else 0.0

    @property
    def share(self) -> Floats:
        """(trunk nodes,) probability of being on the trunk in that node."""
        return self.tree.probability[: self.trunk]

    @cached_property
    def _nodes(self) -> list[Ints]:
        """Nodes of every branch."""
        m, parent = self.trunk, self.tree.parent
        heads = [k for k in range(m, self.tree.n) if parent[k] < m]
        child = np.full(self.tree.n, -1)
        behind = np.flatnonzero(parent >= m)
        child[parent[behind]] = behind
        branches = []
        for head in heads:
            nodes = [head]
            while child[nodes[-1]] >= 0:
                nodes.append(int(child[nodes[-1]]))
            branches.append(np.array(nodes))
        return branches

    @cached_property
    def _kinds(self) -> tuple[list[tuple[int, ...]], list[int]]:
        """Stage sequences no one of which ends another, and which of them ends in each branch's."""
        sequences = [tuple(self.tree.stage[nodes].tolist()) for nodes in self._nodes]
        kinds: list[tuple[int, ...]] = []
        for sequence in sorted(set(sequences), key=len, reverse=True):
            if not any(longer[-len(sequence) :] == sequence for longer in kinds):
                kinds.append(sequence)
        ends = {
            s: next(k for k, longer in enumerate(kinds) if longer[-len(s) :] == s)
            for s in set(sequences)
        }
        return kinds, [ends[s] for s in sequences]

    @cached_property
    def branches(self) -> list[ScenarioBranch]:
        """The scenarios, in the order of the tree."""
        kinds, program = self._kinds
        return [
            ScenarioBranch(
                int(self.tree.parent[nodes[0]]),
                nodes,
                float(self.tree.probability[nodes[0]]),
                k,
                len(kinds[k]) - len(nodes),
            )
            for nodes, k in zip(self._nodes, program, strict=True)
        ]

    @cached_property
    def first(self) -> Standard:
        """The trunk as a program of its own."""
        labels = self.tree.labels[: self.trunk]
        return _chain(self.stages, self.tree.stage[: self.trunk], labels, self.cuts)

    @cached_property
    def programs(self) -> list[Standard]:
        """One program per kind of branch: those of other lengths begin in its midst."""
        kinds, _ = self._kinds
        return [
            _chain(self.stages, np.array(kind), self._labels(k), self.cuts)
            for k, kind in enumerate(kinds)
        ]

    def _labels(self, program: int) -> list[str]:
        """Labels of a program's steps, without the name of a scenario."""
        longest = next(b for b in self.branches if b.program == program and b.offset == 0)
        return [self.tree.labels[node].partition(IN)[0] for node in longest.nodes]

    @cached_property
    def cost_scale(self) -> float:
        """The most that one quantity can cost in any scenario, $: see `gate.cost_scale`.

        Scenarios differ in their lines, which cost nothing: the trunk and the longest branch of
        every kind tell.
        """
        vectors = [self.first.vectors(self.first_data, self.x0)]
        for branch in self.branches:
            if branch.offset == 0:
                program = self.programs[branch.program]
                empty = {name: np.zeros(len(columns)) for name, columns in program.initial.items()}
                vectors.append(program.vectors(self.data_of(branch.nodes), empty))
        return max(map(cost_scale, vectors))

    @property
    def first_data(self) -> dict[str, Floats]:
        """Data of the trunk, (labels, trunk nodes)."""
        return self.data_of(np.arange(self.trunk))

    def data_of(self, nodes: Ints) -> dict[str, Floats]:
        """Data of some nodes, (labels, nodes)."""
        return {name: values[:, nodes] for name, values in self._wide.items()}

    @cached_property
    def _wide(self) -> dict[str, Floats]:
        """Data with a column for every node."""
        wide = {}
        for name, values in self.data.items():
            array = np.asarray(values, float)
            array = array if array.ndim == 2 else array[:, None]
            wide[name] = np.broadcast_to(array, (len(array), self.tree.n))
        return wide

    def extensive_form(self) -> Standard:
        """Trunk and branches in one program."""
        return unroll(self.stages, self.tree, self.cuts)


def _chain(
    stages: Sequence[Stage], kind: Ints, labels: Sequence[str], cuts: Sequence[Cut]
) -> Standard:
    needed, stage = np.unique(kind, return_inverse=True)
    n = len(kind)
    tree = Tree(np.arange(n) - 1, np.ones(n), stage.ravel(), tuple(labels))
    return unroll([stages[k] for k in needed], tree, cuts)
