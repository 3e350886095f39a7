"""What the second stage costs from some states, and its slopes: one warm HiGHS for all branches.

Branches of the same steps share a program that is solved again and again by changing bounds, at
first from the basis of the branch before, later from the branch's own. A branch that begins in the
midst of it has the steps before held at zero and their rows let go. Branches lie in the order of
the tree, cut into a fixed number of batches with a solver each, so that batches may be solved side
by side and the result does not depend on how many are. Where it is said on which states a branch
depends, it is solved once for each of their values.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import OutOfTimeError, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.highs_model import Basis
from resilience.models.backends.lower import lower
from resilience.models.methods.explain import grouped
from resilience.models.program.dual_bound import safe_cut
from resilience.models.program.standard import Standard, Vectors, reach
from resilience.models.structures import Discs
from resilience.planning.two_stage.two_stage import ScenarioBranch, TwoStage

BATCHES = 4  # solvers side by side, whatever the number of workers
BRANCHES_OF_A_BATCH = 16  # fewer are not worth a cold start
MAX_LISTED = 6  # names of conflicting rows in an error
FIELDS = ("cost", "lower", "upper", "row_lower", "row_upper")


@dataclass(frozen=True)
class SecondStage:
    """The second stage at some states.

    Attributes:
        cost: (branches,) $.
        alpha: (branches,) $, constants of cuts: cost >= alpha + beta @ state, everywhere.
        beta: (branches, states) their slopes, $ per unit of each state.
        points: values of every branch in the columns of its program; steps before it are zero.
            Empty where answers are remembered: they would fill any memory.
    """

    cost: Floats
    alpha: Floats
    beta: Floats
    points: list[Floats]


@dataclass(frozen=True)
class _BranchSolution:
    """One branch, solved: cost in $, its cut, and its point; see `SecondStage`."""

    cost: float
    alpha: float
    beta: Floats
    point: Floats


@dataclass
class _BranchProgram:
    """A program of one kind of branch.

    Attributes:
        standard: the program.
        base: the numbers of the first branch that fills it.
        first_column: (steps,) first column that each step has for itself.
        first_row: (steps,) first row of each step.
    """

    standard: Standard
    base: Vectors
    first_column: Ints
    first_row: Ints

    def freeze(self, v: Vectors, offset: int) -> None:
        """Holds the steps before `offset` at zero, in place."""
        s = self.standard.n_states
        columns = slice(s + 1, self.first_column[offset])
        rows = slice(0, self.first_row[offset])
        for array in (v.cost, v.lower, v.upper):
            array[:s] = array[columns] = 0.0
        v.row_lower[rows], v.row_upper[rows] = -np.inf, np.inf


@dataclass(frozen=True)
class _BranchNumbers:
    """How the vectors of a branch differ from its program's, and where it begins.

    Attributes:
        branch: the branch.
        link: (states,) columns that hold the states it begins with.
        now_price: (states,) prices of these columns.
        offset: $ that its steps cost whatever is done.
        differs: by field of `Vectors`, places and values.
    """

    branch: ScenarioBranch
    link: Ints
    now_price: Floats
    offset: float
    differs: dict[str, tuple[Ints, Floats]] = field(repr=False)


class Recourse:
    """The second stage of a two-stage program.

    Args:
        two_stage: the program.
        idle: by the index of a branch, columns of its program to hold at zero (modes to keep to).
        discs: polygons within the discs or around them.
        workers: threads.
        seconds: says how many are left for one solve.
    """

    def __init__(
        self,
        two_stage: TwoStage,
        *,
        idle: Mapping[int, Ints] | None = None,
        discs: Discs = "outer",
        workers: int = 1,
        seconds: Callable[[], float] = lambda: np.inf,
    ) -> None:
        self.two_stage, self.workers, self.idle = two_stage, workers, dict(idle or {})
        self.seconds = seconds
        self._programs = [self._program(k) for k in range(len(two_stage.programs))]
        self._numbers = [self._branch_numbers(branch) for branch in two_stage.branches]
        lowered = [lower(p, integer="none", modes={}, discs=discs) for p in two_stage.programs]
        self._transposed = [sp.csr_array(program.a.T) for program in lowered]
        n = len(two_stage.branches)
        count = max(min(BATCHES, n // BRANCHES_OF_A_BATCH), 1)
        self._batches = [range(a, b) for a, b in pairwise(np.linspace(0, n, count + 1).astype(int))]
        self._solvers = [[Highs(program) for program in lowered] for _ in self._batches]
        # A branch's own last basis is a few pivots away; that of its neighbour, some hundred.
        self._bases: list[Basis | None] = [None] * n
        self._known: list[dict[bytes, _BranchSolution]] = [{} for _ in range(n)]

    def hold(self, columns: Mapping[int, Ints]) -> None:
        """Holds these columns of some branches' programs at zero from now on, and no
        others of these branches.
        """
        self.idle |= columns

    def solve(self, states: Floats, only: Collection[int] | None = None) -> SecondStage:
        """Solves every branch, or `only` some, in order, from its state, (branches, states).

        Raises:
            InfeasibleError: a scenario has no recourse there; it is named.
            OutOfTimeError: too few seconds are left for all of them.
            SolverError: a solver stopped without an answer.
        """

        def solve_batch(k: int) -> list[_BranchSolution]:
            return [
                self._remembered(b, self._solvers[k], states[b])
                for b in self._batches[k]
                if only is None or b in only
            ]

        batches = range(len(self._batches))
        if self.workers > 1 and len(batches) > 1:
            with ThreadPoolExecutor(self.workers) as pool:
                solutions = [s for batch in pool.map(solve_batch, batches) for s in batch]
        else:
            solutions = [s for k in batches for s in solve_batch(k)]
        n, width = len(solutions), states.shape[1] if solutions else 0
        return SecondStage(
            np.array([s.cost for s in solutions]),
            np.array([s.alpha for s in solutions]),
            np.reshape([s.beta for s in solutions], (n, width)),
            [s.point for s in solutions],
        )

    def floors(self, states: Floats) -> Floats:
        """(branches,) $ that each costs at least, whatever is built; other states as they are.

        Raises:
            As `solve`.
        """
        floors = np.empty(len(states))
        for k, batch in enumerate(self._batches):
            for b in batch:
                numbers = self._numbers[b]
                form = self.two_stage.programs[numbers.branch.program].form
                v, (built, lowest, highest, *_) = self._vectors(b, states[b]), form.design_numbers
                v.lower[built], v.upper[built] = lowest, highest
                solution = self._answer(b, self._solvers[k], v)
                alpha, beta = self._cut(numbers, self._solvers[k], v, solution)
                low, _ = reach(beta, v.lower[numbers.link], v.upper[numbers.link])
                floors[b] = alpha + low
        return floors

    def _remembered(self, k: int, solvers: list[Highs], state: Floats) -> _BranchSolution:
        """A branch at a state, solved where nothing that it depends on is as once before."""
        matters = self.two_stage.matters
        if matters is None:
            return self._solved(k, solvers, state)
        key, answers = state[matters[k]].tobytes(), self._known[k]
        if key not in answers:
            answer, idle = self._solved(k, solvers, state), ~matters[k]
            # The cut is to be as sharp wherever the branch costs the same.
            alpha, beta = answer.alpha + float(answer.beta[idle] @ state[idle]), answer.beta.copy()
            beta[idle] = 0.0
            answers[key] = _BranchSolution(answer.cost, alpha, beta, np.empty(0))
        return answers[key]

    def _program(self, k: int) -> _BranchProgram:
        standard = self.two_stage.programs[k]
        branches = self.two_stage.branches
        longest = next(b for b in branches if b.program == k and b.offset == 0)
        first_column, first_row = np.empty((2, standard.tree.n), np.intp)
        for stage in standard.copies:
            first_column[stage.nodes] = stage.own_columns[:, 0]
            first_row[stage.nodes] = stage.rows[:, 0]
        base = standard.vectors(self.two_stage.data_of(longest.nodes), _zero_states(standard))
        return _BranchProgram(standard, base, first_column, first_row)

    def _branch_numbers(self, branch: ScenarioBranch) -> _BranchNumbers:
        """What distinguishes a branch from the longest of its program, in its own steps."""
        program, standard = self._programs[branch.program], self.two_stage.programs[branch.program]
        nodes = np.zeros(standard.tree.n, np.intp)
        nodes[: branch.offset] = branch.nodes[0]
        nodes[branch.offset :] = branch.nodes
        data = self.two_stage.data_of(nodes)
        v = standard.vectors(data, _zero_states(standard))
        column, row = program.first_column[branch.offset], program.first_row[branch.offset]
        differs = {}
        for name in FIELDS:
            new, base = getattr(v, name), getattr(program.base, name)
            where = np.flatnonzero(new != base)
            where = where[where >= (row if name.startswith("row") else column)]
            differs[name] = where, new[where]
        now_price, offset = _now_price_and_offset(standard, data, branch.offset)
        before = branch.offset - 1
        link = standard.state_columns(before) if branch.offset else np.arange(standard.n_states)
        return _BranchNumbers(branch, link, now_price, offset, differs)

    def _vectors(self, k: int, state: Floats) -> Vectors:
        numbers = self._numbers[k]
        program = self._programs[numbers.branch.program]
        arrays = {name: getattr(program.base, name).copy() for name in FIELDS}
        for name, (where, values) in numbers.differs.items():
            arrays[name][where] = values
        v = Vectors(offset=numbers.offset, **arrays)
        program.freeze(v, numbers.branch.offset)
        v.lower[numbers.link] = v.upper[numbers.link] = state
        v.cost[numbers.link] = numbers.now_price
        idle = self.idle.get(k)
        if idle is not None:
            v.lower[idle] = v.upper[idle] = 0.0
        return v

    def _solved(self, k: int, solvers: list[Highs], state: Floats) -> _BranchSolution:
        numbers, v = self._numbers[k], self._vectors(k, state)
        solution = self._answer(k, solvers, v)
        alpha, beta = self._cut(numbers, solvers, v, solution)
        if not np.isfinite(alpha):
            alpha = solution.objective - float(beta @ state)
        assert solution.z is not None
        return _BranchSolution(solution.objective, alpha, beta, solution.z)

    def _cut(
        self, numbers: _BranchNumbers, solvers: list[Highs], v: Vectors, solution: Solution
    ) -> tuple[float, Floats]:
        """Constant and slopes of the cut that a branch's multipliers make."""
        assert solution.duals is not None
        solver = solvers[numbers.branch.program]
        transposed = self._transposed[numbers.branch.program]
        return safe_cut(transposed, solver.lowered.vectors(v), solution.duals.rows, numbers.link)

    def _answer(self, k: int, solvers: list[Highs], v: Vectors) -> Solution:
        """The optimum of a branch, from the basis that it had last."""
        numbers, basis = self._numbers[k], self._bases[k]
        solver = solvers[numbers.branch.program]
        if basis is not None:
            solver.resume_at(basis)
        solver.update(v)
        solver.time_limit = self.seconds()
        if solver.time_limit <= 0.0:
            raise OutOfTimeError("no time was left for some scenarios")
        solution = solver.solve()
        self._bases[k] = solver.basis()
        if solution.z is None or solution.status != "optimal" or solution.duals is None:
            raise self._no_recourse(k, solver, solution)
        return solution

    def _no_recourse(
        self, k: int, solver: Highs, solution: Solution
    ) -> InfeasibleError | SolverError:
        if solver.model.is_out_of_time:
            return OutOfTimeError("some scenarios took longer than the time that was left")
        label = self.two_stage.tree.labels[self._numbers[k].branch.nodes[0]]
        if solution.status != "infeasible":
            return SolverError(f"HiGHS found no recourse from {label!r} on", hint="report the case")
        names = grouped(solver.conflict())
        return InfeasibleError(
            f"there is no recourse from {label!r} on; in conflict: "
            + (", ".join(names[:MAX_LISTED]) or "no small set of rows could be named"),
            hint="let PV be curtailed, or solve the extensive form, which steers clear of it",
        )


def _zero_states(standard: Standard) -> dict[str, Floats]:
    return {name: np.zeros(len(columns)) for name, columns in standard.initial.items()}


def _now_price_and_offset(
    standard: Standard, data: dict[str, Floats], start: int
) -> tuple[Floats, float]:
    """Prices of the states that the step `start` begins with, and what the steps from it on cost
    whatever is done, in $. What is built has its price in all of them.
    """
    offset, now_price = 0.0, np.zeros(standard.n_states)
    for stage in standard.copies:
        d = standard.stacked_data(data, stage)
        offset += float(stage.form.offsets(d)[stage.nodes >= start].sum())
        first = np.flatnonzero(stage.nodes == start)
        if len(first):
            now_price = now_price + stage.form.prices(d[:, first])[: stage.form.n_now, 0]
        built = stage.form.design_numbers[0]
        if len(built):
            later = stage.form.prices(d[:, stage.nodes > start])
            now_price[built] += later[built].sum(axis=1)
    return now_price, offset
