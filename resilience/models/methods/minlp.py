"""`minlp`: a plan that satisfies the AC equations, the proven bound, and the gap between them.

Outer approximation (Duran & Grossmann 1986) of the branch-flow model:

1. SOCP with all binaries relaxed: the first bound, and tangents of all cones at its point. Without
   cones, any commitment at all: a first plan. Switches begin as branch exchange has them, and
   where there is nothing else to decide, branch and bound over trees (`trees`) comes next. In a
   mesh, rows on cliques of its loops, as long as they raise the bound and the gap is not small
   enough.
2. MILP over the tangents so far, integers exact, cones relaxed: a commitment, and its dual bound is
   a bound for every commitment that was not cut off.
3. Commitment fixed: SOCP, and Ipopt from its point where a cone stayed open: a plan.
4. Tangents at the plan are added; a commitment that cannot be improved on is cut off, its own
   bound kept; back to 2 until the gap is small enough or time is up.

The price on losses that closes cones is used for plans only, never for bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower, tangents
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    NOTHING_NEW,
    OUT_OF_ROUNDS,
    OUT_OF_TIME,
    Deadline,
    MethodOptions,
    MethodResult,
    broken_modes,
    fractional,
    idle_columns,
    with_integers_held,
)
from resilience.models.methods.conic import relaxation, root, tightened, with_all_held
from resilience.models.methods.explain import infeasible, no_plan
from resilience.models.methods.large import exceeded_discs, first_discs, with_discs
from resilience.models.methods.start import any_point, has_switches
from resilience.models.methods.trees import TreeBranching, better_switches, can_branch
from resilience.models.program.gate import cost_scale, gap
from resilience.models.program.standard import Vectors
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

MAX_ROUNDS = 20
EXCHANGE_SHARE = 0.2  # of the time that remains that a search for trees may take
MILP_SHARE = 0.5  # of the time that remains that one MILP may take


@dataclass
class ConicSearch:
    """What is known so far.

    Attributes:
        program: what to solve.
        options: when to stop.
        deadline: when time is up.
        bound: lower bound for the whole problem.
        floor: lower bound for the commitments that were cut off.
        best: the best plan so far.
        modes: for the index of each structure with modes, the elements (n,) that need binaries.
        discs: for the index of each structure of discs, the elements (n,) that the MILPs hold.
        rows: tangents of cones and no-good cuts, as G z <= h.
        milp_share: of the time that remains that one MILP may take; all of it once one has ended
            without a point.
        starved: whether even that ended without one.
    """

    program: CaseProgram
    options: MethodOptions
    deadline: Deadline
    bound: float = -np.inf
    floor: float = np.inf
    best: Solution = NOTHING
    modes: dict[int, Bools] = field(default_factory=dict)
    discs: dict[int, Bools] = field(init=False)
    rows: list[tuple[sp.csr_array, Floats]] = field(default_factory=list)
    milp_share: float = MILP_SHARE
    starved: bool = False

    def __post_init__(self) -> None:
        self.discs = first_discs(self.program.standard)

    def gap_of(self, plan: Solution, bound: float | None = None) -> float:
        """Relative gap of a plan to a bound, that of the whole if omitted; inf without a plan."""
        lowest = self.bound if bound is None else bound
        return gap(plan.objective, lowest, cost_scale(self.program.vectors))

    @property
    def gap(self) -> float:
        """Relative gap of the best plan."""
        return self.gap_of(self.best)

    @property
    def done(self) -> bool:
        """Whether the gap wanted is reached, or time is up."""
        return self.gap <= self.options.gap or self.deadline.late

    def seconds(self) -> float:
        """Seconds for one more solve: to the hard stop as long as there is nothing to show."""
        deadline = self.deadline
        return deadline.final_s if self.best.z is None else deadline.remaining_s

    @property
    def n_modes(self) -> int:
        """How many modes have binaries."""
        return sum(int(elements.sum()) for elements in self.modes.values())

    def learn(self, bound: float) -> None:
        """Takes a bound for all commitments that are not cut off."""
        self.bound = max(self.bound, min(bound, self.floor))

    def hold_discs(self, z: Floats) -> bool:
        """Lets the MILPs hold every disc that z exceeds; False where they hold all of them."""
        new = exceeded_discs(self.program.standard, z, self.discs)
        self.discs = with_discs(self.discs, new)
        return bool(new)

    def exclude(self, z: Floats, bound: float) -> None:
        """Cuts a commitment off whose own bound is known: at least one integer must differ."""
        standard = self.program.standard
        columns = np.flatnonzero(standard.integer)
        ones = np.round(z[columns]) > 0.5
        entries = np.where(ones, 1.0, -1.0), (np.zeros(len(columns), np.intp), columns)
        self.rows.append(
            (sp.csr_array(entries, shape=(1, standard.n_columns)), np.array([ones.sum() - 1.0]))
        )
        self.floor = min(self.floor, max(bound, self.bound))


def minlp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """See the module's docstring.

    Raises:
        InfeasibleError: naming what is in conflict.
        SolverError: no plan was found in time.
    """
    search = ConicSearch(program, options, options.deadline())
    begin(search)
    if not search.done and can_branch(program.in_mw):
        branch(search)
    reason = OUT_OF_ROUNDS
    for k in range(MAX_ROUNDS):
        if search.done:
            break
        if not _round(search, k + 1):
            reason = NOTHING_NEW
            break
    late = search.deadline.late or search.starved
    if search.best.z is None:
        raise no_plan(program, "minlp", options, late=late)
    return MethodResult.from_solution(
        program, search.best, search.bound, options.gap, OUT_OF_TIME if late else reason
    )


def begin(search: ConicSearch) -> None:
    """The first bound, and the first plan.

    Raises:
        InfeasibleError: naming what is in conflict.
        SolverError: the relaxation was not solved.
    """
    program, options = search.program, search.options
    first = root(program, options, search.deadline)
    search.bound = first.bound
    _begin_at(search, first)
    tighter = tightened(
        program,
        first,
        options,
        search.deadline,
        lambda bound: search.gap_of(search.best, bound) <= options.gap,
    )
    if tighter is not first:
        search.learn(tighter.bound)
        if not search.done:
            _begin_at(search, tighter)


def _begin_at(search: ConicSearch, relaxed: Solution) -> None:
    """Tangents at a point of the relaxation, and a plan from it."""
    program, z = search.program, relaxed.point
    search.rows.append(tangents(program.standard, z))
    if not fractional(program.standard, z).any():
        _plan(search, relaxed, with_integers_held(program, z), z)
    elif search.best.z is None:
        _start(search, relaxed)


def _start(search: ConicSearch, first: Solution) -> None:
    """A first plan, from any commitment, with the best trees that exchanges make of the relaxation.

    Its tangents would slow the MILP more than they help.
    """
    program = search.program
    if has_switches(program) and _exchange(search, first.point):
        return
    _commit(search, None)


def _exchange(search: ConicSearch, z: Floats) -> bool:
    """Plans with better trees for the powers at z, and for those of each plan; False without any.

    Other devices may do something else with other trees, so it is done again as long as it helps.
    """
    program, tried = search.program, set[bytes]()
    while search.seconds() > 0.0:
        with phase("branch exchange"):
            closed = better_switches(program, z, EXCHANGE_SHARE * search.seconds())
        if closed is None or closed.tobytes() in tried:
            break
        tried.add(closed.tobytes())
        before = search.best.objective
        columns = program.standard.columns("line.closed")
        _commit(search, program.vectors.fixed(columns.ravel(), closed.ravel()))
        if search.best.objective >= before:
            break
        z = search.best.point
    return search.best.z is not None


def branch(search: ConicSearch) -> None:
    """Branch and bound over the trees of switches, where there is nothing else to decide."""
    program, dollars = search.program, search.program.cost_unit
    columns = program.standard.columns("line.closed").ravel()

    def cutoff() -> float:
        best = search.best.objective
        return np.inf if best == np.inf else dollars * (best - 0.5 * search.options.gap * abs(best))

    branching = TreeBranching(program.in_mw, lambda: search.deadline.remaining_s)
    with phase("branch and bound", "trees"):
        for bound, closed in branching.leaves(cutoff):
            search.floor = min(search.floor, bound / dollars)
            _commit(search, program.vectors.fixed(columns, closed.ravel().astype(float)))
    search.learn(min(branching.bound / dollars, search.best.objective))


def _commit(search: ConicSearch, switched: Vectors | None) -> None:
    """A plan from any commitment at all, switches as `switched` holds them, or as at the start."""
    program = search.program
    with phase("commitment", "any"):
        lowered = lower(program.standard, modes={}, discs="outer", polygons=search.discs)
        chosen = any_point(program, lowered, search.seconds(), switched)
    if chosen.status == "infeasible":
        raise infeasible(program)
    if chosen.z is None:
        return
    vectors = with_integers_held(program, chosen.point)
    with phase("conic program"):
        relaxed = relaxation(program, vectors, seconds=search.seconds())
    if relaxed.z is not None:
        _plan(search, relaxed, vectors, chosen.point)


def _round(search: ConicSearch, k: int) -> bool:
    """One MILP and one plan; False when nothing new can come."""
    if not search.program.standard.integer.any() and not search.modes:
        return False
    before = search.bound
    with phase("commitment", f"round {k}, gap {100 * search.gap:.2f} %"):
        master = _commitment(search)
    search.learn(master.bound)
    if master.status == "none":
        search.starved = search.milp_share == 1.0
        search.milp_share = 1.0
        return not search.starved
    tighter = master.z is not None and search.hold_discs(master.z)
    if not search.done and _try(search, master):
        return True
    return tighter or search.bound > before + 1e-9 * abs(before)


def _commitment(search: ConicSearch) -> Solution:
    """The MILP over all tangents so far: its point, and a bound for what is not cut off."""
    lowered = lower(
        search.program.standard, modes=search.modes, discs="outer", polygons=search.discs
    )
    cliques = search.program.cliques
    rows_so_far = [*search.rows, *([] if cliques is None else [cliques.rows])]
    g = sp.vstack([rows for rows, _ in rows_so_far], format="csr")
    h = np.concatenate([right for _, right in rows_so_far])
    seconds = search.milp_share * search.deadline.remaining_s
    if seconds <= 0.0:
        return NOTHING
    solver = Highs(lowered, rows=(g, h), gap=search.options.gap / 2, time_limit=seconds)
    solver.update(search.program.vectors)
    return solver.solve()


def _try(search: ConicSearch, master: Solution) -> bool:
    """The plan for one commitment; False when there is none to try, or nothing came of it.

    One that is no better than the best plan and asks for no more modes is cut off, whatever its
    relaxation still promises: it has been tried, and its bound stays in force.
    """
    program, standard = search.program, search.program.standard
    before, n_modes = search.best.objective, search.n_modes
    if master.status == "infeasible" and search.floor == np.inf and search.best.z is None:
        raise infeasible(program)
    if master.z is None:
        return False
    search.rows.append(tangents(standard, master.point, -RELAXATION_TOLERANCE))
    vectors = with_integers_held(program, master.point)
    with phase("conic program"):
        relaxed = relaxation(program, vectors, seconds=search.seconds())
    if relaxed.z is not None:
        search.rows.append(tangents(standard, relaxed.point))
        _plan(search, relaxed, vectors, master.point)
    if search.best.objective < before - 1e-9 * abs(before) or search.n_modes > n_modes:
        return True
    if standard.integer.any():
        search.exclude(master.point, relaxed.bound)
    return bool(standard.integer.any())


def _plan(search: ConicSearch, relaxed: Solution, vectors: Vectors, z: Floats) -> None:
    """Turns a point of the relaxation for fixed integers into a plan that satisfies everything.

    Modes with binaries are held as they are in z. Others get one where holding them costs much.
    """
    program, standard = search.program, search.program.standard
    point = relaxed
    if search.modes:
        vectors = vectors.fixed(*idle_columns(standard, z, search.modes))
        point = relaxation(program, vectors, seconds=search.seconds())
    plan = NOTHING
    if point.z is not None:
        plan = with_all_held(program, point, vectors, search.seconds)
    if search.gap_of(plan, relaxed.bound) > search.options.gap / 2:
        rounded = relaxed.point if point.z is None else point.point
        for k, elements in broken_modes(standard, rounded).items():
            search.modes[k] = search.modes.get(k, np.zeros(len(elements), bool)) | elements
    if plan.objective < search.best.objective:
        search.best = plan
