r"""Few integers and modes of a linear program, branched on from one warm basis.

A tree search (Land and Doig 1960): the relaxation is solved; where an integer is broken or a mode
is two at once, one side is tried and then the other, each by bounds alone, so that the dual simplex
method goes on from the basis before. What costs no less than the best point so far is left. For a
controller's handful of binaries that is a few pivots, where a solver of large mixed-integer
programs spends milliseconds before it begins. Depth first, the nearer side first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import SolverError
from resilience.models.backends.base import INFEASIBLE, Solution
from resilience.models.backends.highs import Highs
from resilience.models.program.standard import Vectors
from resilience.models.structures import UnrolledStructure
from resilience.models.structures.base import Mode
from resilience.tolerances import INTEGRALITY_TOLERANCE

MAX_NODES = 20_000
MODE_TOLERANCE = 1e-7  # of the scaled violation of a mode


@dataclass(frozen=True)
class _Branch:
    """Vectors of a node of the search, and what it cannot cost less than."""

    vectors: Vectors
    bound: float


class Branching:
    """Solves a linear program with some of its columns integer and some structures in one mode.

    Args:
        solver: holds the program, all integers and modes relaxed.
        integers: columns that are to be integer.
        modes: structures whose elements are to be in one mode each.
        gap: share of the objective by which a point may miss the optimum.
        gap_abs: the same in $.
    """

    def __init__(
        self,
        solver: Highs,
        integers: Ints,
        modes: Sequence[UnrolledStructure[Mode]] = (),
        *,
        gap: float = 1e-9,
        gap_abs: float = 1e-9,
    ) -> None:
        self.solver, self.integers = solver, integers
        self.modes, self.gap, self.gap_abs = tuple(modes), gap, gap_abs

    def solve(self, vectors: Vectors) -> Solution:
        """The best point within the gap; its bound is that of the search.

        Raises:
            SolverError: more nodes than `MAX_NODES`.
        """
        best, bound, stack = INFEASIBLE, np.inf, [_Branch(vectors, -np.inf)]
        for _ in range(MAX_NODES):
            if not stack:
                return best if best.z is None else replace(best, bound=min(bound, best.objective))
            branch = stack.pop()
            allowed = best.objective - max(self.gap_abs, self.gap * abs(best.objective))
            if best.z is not None and branch.bound >= allowed:
                bound = min(bound, branch.bound)
                continue
            self.solver.update(branch.vectors)
            solution = self.solver.solve()
            if solution.z is None:
                continue
            if best.z is not None and solution.objective >= allowed:
                bound = min(bound, solution.objective)
                continue
            sides = self._sides(solution.z, branch.vectors)
            if sides is None:
                best = solution
            else:
                stack += [_Branch(side, solution.objective) for side in reversed(sides)]
        raise SolverError(
            f"a search over {len(self.integers)} integers did not end within {MAX_NODES} nodes",
            hint="fewer switchable lines, blocks or committed units at once, or `solve`",
        )

    def _sides(self, z: Floats, vectors: Vectors) -> tuple[Vectors, Vectors] | None:
        """Two branches of a point, the nearer one first; None where everything holds."""
        off = np.abs(z[self.integers] - np.round(z[self.integers]))
        if off.size and off.max() > INTEGRALITY_TOLERANCE:
            column = self.integers[[int(np.argmax(off))]]
            below = np.floor(z[column])
            down, up = replace(vectors), replace(vectors)
            down.upper, up.lower = vectors.upper.copy(), vectors.lower.copy()
            down.upper[column], up.lower[column] = below, below + 1.0
            return (down, up) if z[column[0]] - below[0] < 0.5 else (up, down)
        for mode in self.modes:
            violation = mode.violation(z)
            k = int(np.argmax(violation))
            if violation[k] > MODE_TOLERANCE:
                columns = mode.columns[:, k]
                first, second = mode.structure.sides(columns, z[columns])
                return _closed(vectors, first), _closed(vectors, second)
        return None


def _closed(vectors: Vectors, columns: Ints) -> Vectors:
    """The vectors with columns at zero."""
    return vectors.fixed(columns, np.zeros(len(columns)))
