"""The shape of the future: nodes with a parent, a probability and a duration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resilience.models.algebra import Floats, Ints, Labels


@dataclass(frozen=True)
class Tree:
    """Nodes in an order in which every parent comes before its children.

    Attributes:
        parent: (nodes,) index of the node before, -1 for a root.
        probability: (nodes,) unconditional; those of the leaves add up to 1.
        stage: (nodes,) which of the stages handed to `unroll` the node is an instance of.
        labels: a name per node, the time of its slot.
    """

    parent: Ints
    probability: Floats
    stage: Ints
    labels: Labels

    def __post_init__(self) -> None:
        if (self.parent >= np.arange(self.n)).any():
            raise ValueError("every node of a tree must come after its parent")
        total = self.probability[self.leaves].sum()
        if not np.isclose(total, 1.0):
            raise ValueError(f"the leaves of a tree have total probability {total}, not 1")

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
    """future cost >= alpha + sum(beta[name] * state[name]) at the end of every leaf, in $."""

    alpha: float
    beta: dict[str, Floats]
