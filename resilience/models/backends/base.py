"""What every solver is to us: something that takes vectors and gives values and a proven bound."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from resilience.models.algebra import Floats, Ints
from resilience.models.standard import Vectors

Status = Literal["optimal", "feasible", "infeasible", "none"]


@dataclass(frozen=True)
class Duals:
    """Multipliers in the Lagrangian  c'z + rows'(A z - b) - sum_k cones[k] . structure_k(z)."""

    rows: Floats
    cones: dict[int, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class Solution:
    """What a backend found.

    Attributes:
        status: optimal (within tolerance), feasible (stopped early), infeasible, or none found.
        z: (columns,) values, None where there are none.
        objective: $ at z, or inf.
        bound: proven lower bound in $ for the problem as the backend holds it, or -inf.
        state_price: (states,) $ per unit of each state at the start.
    """

    status: Status
    z: Floats | None
    objective: float
    bound: float
    duals: Duals | None = None
    state_price: Floats | None = None

    @property
    def point(self) -> Floats:
        """The values; only to be asked where there are some."""
        if self.z is None:
            raise ValueError("this solution has no point")
        return self.z


NOTHING = Solution("none", None, np.inf, -np.inf)


class Backend(Protocol):
    """A solver that is built once and re-solved by changing vectors."""

    exact: frozenset[str]

    def update(self, vectors: Vectors) -> None:
        """Takes new bounds, right-hand sides and costs."""

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """future cost of leaf `node` >= alpha + beta @ state, for alpha (k,), beta (k, states)."""

    def solve(self) -> Solution:
        """Solves what was last given to `update`."""


def leaf_rows(states: Ints, future: int, beta: Floats) -> tuple[Ints, Floats]:
    """Columns and coefficients (k, states + 1) of the rows  beta @ state - future <= -alpha."""
    columns = np.append(states, future)
    return columns, np.hstack([beta, -np.ones((len(beta), 1))])
