"""The shape of the future: nodes with a parent, a probability and a duration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Labels


@dataclass(frozen=True)
class Tree:
    """Nodes in an order in which every parent comes before its children.

    Attributes:
        parent: (nodes,) index of the node before, -1 for a root.
        probability: (nodes,) unconditional: those of the leaves add up to 1, and those of a node's
            children to its own.
        stage: (nodes,) which of the stages handed to `unroll` the node is an instance of.
        labels: a name per node, no two alike: the time of its slot, and where needed its scenario.
    """

    parent: Ints
    probability: Floats
    stage: Ints
    labels: Labels

    def __post_init__(self) -> None:
        sizes = {len(self.parent), len(self.probability), len(self.stage), len(self.labels)}
        if len(sizes) > 1:
            raise ValueError(f"a tree of {self.n} nodes has arrays of lengths {sorted(sizes)}")
        if len(set(self.labels)) < self.n:
            raise ValueError("two nodes of a tree have the same label; names would be ambiguous")
        if (self.parent >= np.arange(self.n)).any() or (self.parent < -1).any():
            raise ValueError("every node of a tree must come after its parent, a root has -1")
        self._check_probability()

    def _check_probability(self) -> None:
        total = self.probability[self.leaves].sum()
        if (self.probability < 0.0).any() or not np.isclose(total, 1.0):
            raise ValueError(f"the leaves of a tree have total probability {total}, not 1")
        child = self.parent >= 0
        below = np.zeros(self.n)
        below[self.leaves] = self.probability[self.leaves]
        np.add.at(below, self.parent[child], self.probability[child])
        wrong = np.flatnonzero(~np.isclose(below, self.probability))
        if len(wrong):
            k = wrong[0]
            raise ValueError(
                f"node {self.labels[k]!r} has probability {self.probability[k]:g}, "
                f"its children {below[k]:g}"
            )

    @property
    def n(self) -> int:
        """Number of nodes."""
        return len(self.parent)

    @property
    def leaves(self) -> Ints:
        """Nodes without children, in order."""
        inner = np.zeros(self.n, bool)
        inner[self.parent[self.parent >= 0]] = True
        return np.flatnonzero(~inner)

    @classmethod
    def chain(cls, labels: Sequence[str]) -> Tree:
        """A deterministic horizon: one node after the other, all of the first stage."""
        n = len(labels)
        return cls(np.arange(n) - 1, np.ones(n), np.zeros(n, np.intp), tuple(labels))


@dataclass(frozen=True)
class Cut:
    """future cost >= alpha + sum(beta[name] * state[name]) at the end of every leaf.

    Attributes:
        alpha: $.
        beta: by name of a state, (labels,) $ per unit.
    """

    alpha: float
    beta: dict[str, Floats]
