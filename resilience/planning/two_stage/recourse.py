"""What the second stage costs from given states, and its slopes: one warm HiGHS for all chains.

Chains of the same steps share a program that is solved again and again by changing bounds, at first
from the basis of the chain before, later from the chain's own. A chain that begins in the midst of
it has the steps before held at zero and their rows let go. Chains lie in the order given, cut into
a fixed number of parts with a solver each, so that parts may be solved side by side and the result
does not depend on how many are.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.methods.explain import grouped
from resilience.models.program.dual_bound import safe_cut
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Discs
from resilience.planning.two_stage.two_stage import ScenarioBranch, TwoStage

PARTS = 4  # solvers side by side, whatever the number of workers
CHAINS_OF_A_PART = 16  # fewer are not worth a cold start
SHOWN = 6  # names of conflicting rows in an error
FIELDS = ("cost", "lower", "upper", "row_lower", "row_upper")


@dataclass(frozen=True)
class Second:
    """The second stage at some states.

    Attributes:
        cost: (chains,) $.
        alpha, beta: (chains,), (chains, states) cuts: cost >= alpha + beta @ state, everywhere.
        points: values of every chain in the columns of its program; steps before it are zero.
    """

    cost: Floats
    alpha: Floats
    beta: Floats
    points: list[Floats]


@dataclass
class _BranchProgram:
    """A program of one kind of chain, and the numbers of the first chain that fills it."""

    standard: Standard
    base: Vectors
    first_column: Ints
    first_row: Ints

    def frozen(self, v: Vectors, offset: int) -> None:
        """Holds the steps before `offset` at zero, in place."""
        s = self.standard.n_states
        own = slice(s + 1, self.first_column[offset])
        rows = slice(0, self.first_row[offset])
        for array in (v.cost, v.lower, v.upper):
            array[:s] = array[own] = 0.0
        v.row_lower[rows], v.row_upper[rows] = -np.inf, np.inf


@dataclass(frozen=True)
class _Given:
    """One chain in numbers: how its vectors differ from its program's, and where it begins."""

    chain: ScenarioBranch
    link: Ints
    now_price: Floats
    offset: float
    differs: dict[str, tuple[Ints, Floats]] = field(repr=False)


class Recourse:
    """The second stage of a two-stage program.

    Args:
        two: the program.
        holds: per chain, columns of its program to hold at zero (modes to keep to).
        discs: polygons within the discs or around them.
        workers: threads.
    """

    def __init__(
        self,
        two: TwoStage,
        *,
        holds: dict[int, Ints] | None = None,
        discs: Discs = "outer",
        workers: int = 1,
    ) -> None:
        self.two, self.workers, self.holds = two, workers, holds or {}
        self._programs = [self._program(k) for k in range(len(two.programs))]
        self._given = [self._numbers(chain) for chain in two.chains]
        lowered = [lower(p, integer="none", modes={}, discs=discs) for p in two.programs]
        self._transposed = [sp.csr_array(program.a.T) for program in lowered]
        count = max(min(PARTS, len(two.chains) // CHAINS_OF_A_PART), 1)
        cuts = np.linspace(0, len(two.chains), count + 1).astype(int)
        self._parts = [range(a, b) for a, b in pairwise(cuts)]
        self._solvers = [[Highs(program) for program in lowered] for _ in self._parts]
        # A chain's own last basis is a few pivots away; that of its neighbour, some hundred.
        self._bases: list[Any] = [None] * len(two.chains)

    def at(self, states: Floats) -> Second:
        """Solves every chain from its state, (chains, states).

        Raises:
            InfeasibleError: a scenario has no recourse there; it is named.
            SolverError: a solver stopped without an answer.
        """
        n = len(self._given)
        found: list[tuple[float, float, Floats, Floats]] = [None] * n  # type: ignore[list-item]

        def solve(part: int) -> None:
            for k in self._parts[part]:
                found[k] = self._solved(k, self._solvers[part], states[k])

        if self.workers > 1 and len(self._parts) > 1:
            with ThreadPoolExecutor(self.workers) as pool:
                list(pool.map(solve, range(len(self._parts))))
        else:
            for part in range(len(self._parts)):
                solve(part)
        cost, alpha, beta, points = zip(*found, strict=True) if n else ((), (), (), ())
        width = len(states[0]) if n else 0
        return Second(np.array(cost), np.array(alpha), np.reshape(beta, (n, width)), list(points))

    def _program(self, k: int) -> _BranchProgram:
        standard = self.two.programs[k]
        longest = next(c for c in self.two.chains if c.program == k and c.offset == 0)
        heads = np.empty((standard.tree.n, 2), np.intp)
        for stage in standard.copies:
            heads[stage.nodes, 0] = stage.own_columns[:, 0]
            heads[stage.nodes, 1] = stage.rows[:, 0]
        base = standard.vectors(self.two.data_of(longest.nodes), _nothing(standard))
        return _BranchProgram(standard, base, heads[:, 0], heads[:, 1])

    def _numbers(self, chain: ScenarioBranch) -> _Given:
        """What distinguishes a chain from the longest of its program, in its own steps."""
        program, standard = self._programs[chain.program], self.two.programs[chain.program]
        at = np.zeros(standard.tree.n, np.intp)
        at[: chain.offset] = chain.nodes[0]
        at[chain.offset :] = chain.nodes
        data = self.two.data_of(at)
        v = standard.vectors(data, _nothing(standard))
        column, row = program.first_column[chain.offset], program.first_row[chain.offset]
        differs = {}
        for name in FIELDS:
            new, old = getattr(v, name), getattr(program.base, name)
            where = np.flatnonzero(new != old)
            where = where[where >= (row if name.startswith("row") else column)]
            differs[name] = where, new[where]
        now, offset = _constants(standard, data, chain.offset)
        before = chain.offset - 1
        link = standard.state_columns(before) if chain.offset else np.arange(standard.n_states)
        return _Given(chain, link, now, offset, differs)

    def _vectors(self, k: int, state: Floats) -> Vectors:
        given = self._given[k]
        program = self._programs[given.chain.program]
        arrays = {name: getattr(program.base, name).copy() for name in FIELDS}
        for name, (where, values) in given.differs.items():
            arrays[name][where] = values
        v = Vectors(offset=given.offset, **arrays)
        program.frozen(v, given.chain.offset)
        v.lower[given.link] = v.upper[given.link] = state
        v.cost[given.link] = given.now_price
        held = self.holds.get(k)
        if held is not None:
            v.lower[held] = v.upper[held] = 0.0
        return v

    def _solved(
        self, k: int, solvers: list[Highs], state: Floats
    ) -> tuple[float, float, Floats, Floats]:
        given = self._given[k]
        solver, v = solvers[given.chain.program], self._vectors(k, state)
        if self._bases[k] is not None:
            solver.resume_at(self._bases[k])
        solver.update(v)
        found = solver.solve()
        self._bases[k] = solver.basis()
        if found.z is None or found.status != "optimal":
            raise self._none(k, solver, found)
        assert found.duals is not None
        whole = solver.lowered.vectors(v)
        transposed = self._transposed[given.chain.program]
        alpha, beta = safe_cut(transposed, whole, found.duals.rows, given.link)
        if not np.isfinite(alpha):
            alpha = found.objective - float(beta @ state)
        return found.objective, alpha, beta, found.z

    def _none(self, k: int, solver: Highs, found: Solution) -> InfeasibleError | SolverError:
        label = self.two.tree.labels[self._given[k].chain.nodes[0]]
        if found.status != "infeasible":
            return SolverError(f"HiGHS found no recourse from {label!r} on", hint="report the case")
        names = grouped(solver.conflict())
        return InfeasibleError(
            f"there is no recourse from {label!r} on; in conflict: "
            + (", ".join(names[:SHOWN]) or "no small set of rows could be named"),
            hint="let PV be curtailed, or solve the extensive form, which steers clear of it",
        )


def _nothing(standard: Standard) -> dict[str, Floats]:
    return {name: np.zeros(len(at)) for name, at in standard.initial.items()}


def _constants(standard: Standard, data: dict[str, Floats], start: int) -> tuple[Floats, float]:
    """Prices of the states that the step `start` begins with, and what the steps from it on cost
    whatever is done, in $.
    """
    offset, now_price = 0.0, np.zeros(standard.n_states)
    for stage in standard.copies:
        d = standard.stacked_data(data, stage)
        offset += float(stage.form.offsets(d)[stage.nodes >= start].sum())
        first = np.flatnonzero(stage.nodes == start)
        if len(first):
            now_price = stage.form.prices(d[:, first])[: stage.form.n_now, 0]
    return now_price, offset
