"""`lp` and `milp`: HiGHS on copperplate or LinDistFlow, binaries only where they are needed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.backends.base import NOTHING, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
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
    worst_violation,
)
from resilience.models.methods.conic import relaxation, with_all_held
from resilience.models.methods.explain import conflict, infeasible, no_plan
from resilience.models.methods.large import (
    exceeded_discs,
    first_discs,
    is_large,
    is_loaded,
    with_discs,
)
from resilience.models.methods.start import any_point, has_switches, with_switches_held
from resilience.models.methods.tidy import with_least_circulation
from resilience.models.methods.trees import better_switches
from resilience.models.program.gate import cost_scale, gap
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Cone, Disc, Discs
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

Rows = tuple[sp.csr_array, Floats]
MAX_ROUNDS = 30  # tangents alone converge in about nine
START_SHARE = 0.25  # of the time that remains, for a first point without switching
EXCHANGE_SHARE = 0.1  # likewise, for trees that exchanges improve


@dataclass
class LinearSearch:
    """What is held so far, and what is proven.

    Attributes:
        program: what to solve.
        options: when to stop.
        deadline: when time is up.
        integer: which integers are held.
        modes: for the index of each structure with modes, the elements (n,) that have binaries.
        bound: lower bound, $.
        best: the best plan so far.
        polygons: for the index of each structure of discs, the elements (n,) that have polygons.
        last: the last large linear program that was solved.
        relaxation: the linear program without integers, where it was solved.
        rows: tangents of discs, G z <= h, where the polygons around them were exceeded.
    """

    program: CaseProgram
    options: MethodOptions
    deadline: Deadline
    integer: Literal["all", "none"]
    modes: dict[int, Bools] = field(default_factory=dict)
    bound: float = -np.inf
    best: Solution = NOTHING
    polygons: dict[int, Bools] = field(init=False)
    last: Highs | None = None
    relaxation: Solution = NOTHING
    rows: list[Rows] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.polygons = first_discs(self.program.standard)

    def gap_of(self, plan: Solution) -> float:
        """Relative gap of a plan; inf without one."""
        return gap(plan.objective, self.bound, cost_scale(self.program.vectors))

    @property
    def gap(self) -> float:
        """Relative gap of the best plan."""
        return self.gap_of(self.best)

    @property
    def seconds(self) -> float:
        """Seconds for one more solve: to the hard stop as long as there is nothing to show."""
        deadline = self.deadline
        return deadline.final_s if self.best.z is None else deadline.remaining_s

    def solver(self, vectors: Vectors, discs: Discs = "outer") -> Highs:
        """HiGHS with what is held so far; it has yet to be told its time."""
        standard = self.program.standard
        lowered = lower(
            standard, integer=self.integer, modes=self.modes, discs=discs, polygons=self.polygons
        )
        rows = None
        if discs == "outer" and self.rows:
            blocks, right = zip(*self.rows, strict=True)
            rows = sp.vstack(blocks, format="csr"), np.concatenate(right)
        solver = Highs(lowered, rows=rows, gap=self.options.gap / 2)
        solver.update(vectors)
        if not solver.is_mip and is_large(standard):
            self._start(solver)
        return solver

    def _start(self, solver: Highs) -> None:
        """From where the last such program ended, or else node by node."""
        if self.last is None or not solver.start_as(self.last):
            solver.start_node_by_node()
        self.last = solver

    def solve(self, solver: Highs, seconds: float) -> Solution:
        """What a solver finds in that many seconds; nothing where none are left."""
        if seconds <= 0.0:
            return NOTHING
        solver.time_limit = seconds
        return solver.solve()

    def hold(self, z: Floats, broken: dict[int, Bools]) -> bool:
        """Holds from now on what z breaks; False when there is nothing new to hold."""
        standard = self.program.standard
        loose = bool(fractional(standard, z).any())
        if loose:
            self.integer = "all"
        for k, elements in broken.items():
            self.modes[k] = self.modes.get(k, np.zeros(len(elements), bool)) | elements
        exceeded = _disc_tangents(standard, z)
        self.rows += exceeded
        self.hold_discs(z)
        return loose or bool(broken) or bool(exceeded)

    def hold_discs(self, z: Floats) -> bool:
        """Gives every disc that z exceeds its polygon; False where all of them have one."""
        new = exceeded_discs(self.program.standard, z, self.polygons)
        self.polygons = with_discs(self.polygons, new)
        return bool(new)

    def within(self, vectors: Vectors) -> Solution:
        """The best point with polygons within the discs, of all discs that it would exceed."""
        while True:
            plan = self.solve(self.solver(vectors, "inner"), self.seconds)
            if plan.z is None or not self.hold_discs(plan.z):
                return plan


def lp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Relaxes every mode and integer, tests the answer, and adds binaries only where it fails."""
    return _solve(program, options, "none")


def milp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Holds all integers from the start; modes get their binaries where the answer needs them."""
    return _solve(program, options, "all")


def _solve(
    program: CaseProgram, options: MethodOptions, integer: Literal["all", "none"]
) -> MethodResult:
    standard = program.standard
    if standard.structures_of(Cone):
        raise UsageError(
            "linear methods cannot hold the cones of distflow; allowed: copperplate, lindistflow",
            hint="use --method socp, nlp, minlp or exact with --physics distflow",
        )
    search = LinearSearch(program, options, options.deadline(), integer)
    if integer == "all" and standard.integer.any():
        with phase("linear program", "bound"):
            search.bound = _relaxed_bound(search)
    relaxed, reason = NOTHING, OUT_OF_ROUNDS
    for k in range(MAX_ROUNDS):
        with phase("linear program", f"round {k + 1}"):
            point = _relaxed(search)
            if point.z is None:
                reason = OUT_OF_TIME
                break
            relaxed = point
            broken = broken_modes(standard, relaxed.point)
            plan = _plan(search, relaxed, broken)
        if plan.objective < search.best.objective:
            search.best = plan
        if search.gap <= options.gap:
            break
        if search.deadline.late:
            reason = OUT_OF_TIME
            break
        if not search.hold(relaxed.point, broken):
            reason = NOTHING_NEW
            break
    if search.best.z is None and search.deadline.late:
        search.best = _any_plan(search)
    return _answer(search, relaxed, reason)


def _relaxed_bound(search: LinearSearch) -> float:
    """The bound of the linear relaxation, for a tree search that ends without a better one."""
    relaxed = replace(search, integer="none", modes={})
    solver = relaxed.solver(search.program.vectors)
    search.relaxation = search.solve(solver, search.seconds)
    return solver.certified_bound(search.relaxation)


def _relaxed(search: LinearSearch) -> Solution:
    """The optimum of what is held so far with polygons around the discs; its bound is kept.

    Nothing where time ended the search for it.
    """
    program = search.program
    solver = search.solver(program.vectors)
    if solver.is_mip and has_switches(program):
        start = _switched_start(search)
        if start.z is not None:
            solver.start_from(start.z)
    seconds = search.deadline.remaining_s if solver.is_mip else search.seconds
    relaxed = search.solve(solver, seconds)
    if relaxed.status == "infeasible":
        raise infeasible(program, conflict(program, solver))
    bound = relaxed.bound if solver.is_mip else solver.certified_bound(relaxed)
    search.bound = max(search.bound, bound)
    if relaxed.z is None and not search.deadline.late:
        raise no_plan(program, "HiGHS", search.options, late=False)
    return relaxed


def _switched_start(search: LinearSearch) -> Solution:
    """The better of two plans: with switches as at the start, and with the trees that exchanges
    make of the relaxation, or of that plan.
    """
    program, deadline = search.program, search.deadline
    unswitched = search.solver(with_switches_held(program))
    start = search.solve(unswitched, START_SHARE * deadline.remaining_s)
    z = start.z if search.relaxation.z is None else search.relaxation.z
    if z is None:
        return start
    closed = better_switches(program, z, EXCHANGE_SHARE * deadline.remaining_s)
    if closed is None:
        return start
    columns = program.standard.columns("line.closed")
    exchanged = search.solver(program.vectors.fixed(columns.ravel(), closed.ravel()))
    trial = search.solve(exchanged, START_SHARE * deadline.remaining_s)
    return min(start, trial, key=lambda solution: solution.objective)


def _plan(search: LinearSearch, relaxed: Solution, broken: dict[int, Bools]) -> Solution:
    """A point that holds everything: the relaxed one if it does, else the best with its integers
    and modes and with polygons within the discs, else the best within them, else nothing.

    Where polygons within the discs cost more than the gap, or where many discs bind, the discs
    themselves are held, as cones.
    """
    program, standard, z = search.program, search.program.standard, relaxed.point
    if fractional(standard, z).any():
        return NOTHING
    exceeded = worst_violation(standard, z, Disc) > RELAXATION_TOLERANCE
    if not broken and not exceeded:
        return relaxed
    vectors = with_integers_held(program, z)
    for modes in (search.modes, broken):
        vectors = vectors.fixed(*idle_columns(standard, z, modes))
    search.hold_discs(z)
    loaded = exceeded and is_loaded(standard, search.polygons)
    plan = _on_discs(search, vectors) if loaded else NOTHING
    if plan.z is not None:
        return plan
    plan = search.within(vectors)
    if plan.z is None and exceeded and not broken:
        plan = search.within(program.vectors)
    if plan.z is None or broken_modes(standard, plan.z):
        plan = NOTHING
    if exceeded and not loaded and search.gap_of(plan) > search.options.gap:
        plan = min(plan, _on_discs(search, vectors), key=lambda solution: solution.objective)
    return plan


def _on_discs(search: LinearSearch, vectors: Vectors) -> Solution:
    """The best point for these vectors on the discs themselves, modes held, or nothing.

    Its bound counts where the vectors are the program's own, nothing held.
    """
    program = search.program
    on_discs = relaxation(program, vectors, seconds=search.seconds, discs=search.polygons)
    if on_discs.z is None:
        return NOTHING
    if vectors is program.vectors:
        search.bound = max(search.bound, on_discs.bound)
    return with_all_held(program, on_discs, vectors, lambda: search.seconds)


def _any_plan(search: LinearSearch) -> Solution:
    """Where time is up and nothing was found: a plan for any integers, or nothing.

    Integers are sought without modes and with polygons around the discs, as those within and the
    binaries of modes make the search many times longer.
    """
    program, standard = search.program, search.program.standard
    with phase("linear program", "any plan"):
        lowered = lower(standard, modes={}, discs="outer", polygons=search.polygons)
        chosen = any_point(program, lowered, search.deadline.final_s)
        if chosen.z is None:
            return NOTHING
        return _plan(search, chosen, broken_modes(standard, chosen.z))


def _answer(search: LinearSearch, relaxed: Solution, reason: str) -> MethodResult:
    best = relaxed if search.best.z is None else search.best
    if best.z is None:
        raise no_plan(search.program, "HiGHS", search.options, late=True)
    notes = []
    if search.modes:
        number = sum(int(elements.sum()) for elements in search.modes.values())
        notes.append(f"{number} mode binaries were needed")
    if not is_loaded(search.program.standard, search.polygons):
        # A plan on the discs has no polygons to move in.
        with phase("tie-break"):
            best = with_least_circulation(search.program, best, search.deadline.final_s / 2)
    result = MethodResult.from_solution(
        search.program, best, search.bound, search.options.gap, reason, notes
    )
    if result.relaxed and reason not in result.notes:
        # Of a relaxation the gap may be none, and still it is not what was looked for.
        result.notes.append(reason)
    return result


def _disc_tangents(standard: Standard, z: Floats) -> list[Rows]:
    """Rows G z <= h that hold wherever a disc holds and touch it nearest to z, if z exceeds it."""
    rows = []
    for unrolled in standard.structures_of(Disc).values():
        exceeded = np.flatnonzero(unrolled.violation(z) > RELAXATION_TOLERANCE)
        if len(exceeded):
            rows.append(unrolled.structure.tangents(unrolled.elements(exceeded), z))
    return rows
