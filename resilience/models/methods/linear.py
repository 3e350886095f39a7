"""`lp` and `milp`: HiGHS on copperplate or LinDistFlow, binaries only where they are needed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.backends.base import NOTHING, Solution, Status
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    OUT_OF_TIME,
    Deadline,
    MethodOptions,
    MethodResult,
    broken_modes,
    fractional,
    gap,
    idle_columns,
    with_integers_held,
    worst_violation,
)
from resilience.models.methods.explain import conflict, infeasible, no_plan
from resilience.models.methods.start import any_point, has_switches, with_switches_held
from resilience.models.methods.tidy import with_least_circulation
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Cone, Disc, Discs
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

Rows = tuple[sp.csr_array, Floats]
MAX_ROUNDS = 30  # tangents alone converge in about nine


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
        rows: tangents of discs, G z <= h, where the polygons around them were exceeded.
    """

    program: CaseProgram
    options: MethodOptions
    deadline: Deadline
    integer: Literal["all", "none"]
    modes: dict[int, Bools] = field(default_factory=dict)
    bound: float = -np.inf
    best: Solution = NOTHING
    rows: list[Rows] = field(default_factory=list)

    @property
    def gap(self) -> float:
        """Relative gap of the best plan."""
        return gap(self.best.objective, self.bound)

    @property
    def late(self) -> bool:
        """Whether time is up."""
        return self.deadline.remaining_s <= 0

    def solver(self, vectors: Vectors, discs: Discs = "outer", share: float = 1.0) -> Highs:
        """HiGHS with what is held so far and a share of the time that remains."""
        standard = self.program.standard
        lowered = lower(standard, integer=self.integer, modes=self.modes, discs=discs)
        seconds = max(share * self.deadline.remaining_s, 1.0)
        rows = None
        if discs == "outer" and self.rows:
            blocks, right = zip(*self.rows, strict=True)
            rows = sp.vstack(blocks, format="csr"), np.concatenate(right)
        solver = Highs(lowered, rows=rows, time_limit=seconds, gap=self.options.gap / 2)
        solver.update(vectors)
        return solver

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
        return loose or bool(broken) or bool(exceeded)


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
    search = LinearSearch(program, options, Deadline(options.time_limit), integer)
    if integer == "all" and standard.integer.any():
        with phase("linear program", "bound"):
            search.bound = _relaxed_bound(search)
    for k in range(MAX_ROUNDS):
        with phase("linear program", f"round {k + 1}"):
            relaxed = _relaxed(search)
            broken = broken_modes(standard, relaxed.point)
            plan = _plan(search, relaxed, broken)
        if plan.objective < search.best.objective:
            search.best = plan
        enough = search.gap <= options.gap or (search.late and search.best.z is not None)
        if enough or not search.hold(relaxed.point, broken):
            break
    return _answer(search, relaxed)


def _relaxed_bound(search: LinearSearch) -> float:
    """The bound of the linear relaxation, for a tree search that ends without a better one."""
    relaxed = replace(search, integer="none", modes={})
    solver = relaxed.solver(search.program.vectors)
    return solver.certified_bound(solver.solve())


def _relaxed(search: LinearSearch) -> Solution:
    """The optimum of what is held so far with polygons around the discs; its bound is kept."""
    program = search.program
    solver = search.solver(program.vectors)
    if solver.is_mip and has_switches(program):
        unswitched = search.solver(with_switches_held(program), share=0.25).solve()
        if unswitched.z is not None:
            solver.start_from(unswitched.z)
    relaxed = solver.solve()
    if relaxed.status == "infeasible":
        raise infeasible(program, conflict(program, solver))
    bound = relaxed.bound if solver.is_mip else solver.certified_bound(relaxed)
    search.bound = max(search.bound, bound)
    if relaxed.z is None and solver.is_mip:
        relaxed = any_point(program, solver.lowered)
    if relaxed.z is None:
        raise no_plan(program, "HiGHS", search.options)
    return relaxed


def _plan(search: LinearSearch, relaxed: Solution, broken: dict[int, Bools]) -> Solution:
    """A point that holds everything: the relaxed one if it does, else the best with its integers
    and modes and with polygons within the discs, else the best within them, else nothing.
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
    plan = search.solver(vectors, "inner").solve()
    if plan.z is None and exceeded and not broken:
        plan = search.solver(program.vectors, "inner").solve()
    sound = plan.z is not None and not broken_modes(standard, plan.z)
    return replace(plan, status=relaxed.status) if sound else NOTHING


def _answer(search: LinearSearch, relaxed: Solution) -> MethodResult:
    notes, options = [], search.options
    best = relaxed if search.best.z is None else search.best
    if search.modes:
        number = sum(int(elements.sum()) for elements in search.modes.values())
        notes.append(f"{number} mode binaries were needed")
    if search.gap > options.gap:
        notes.append(OUT_OF_TIME)
    status: Status = "optimal" if search.gap <= options.gap else "feasible"
    with phase("tie-break"):
        best = with_least_circulation(search.program, best)
    best = replace(best, status=status)
    return MethodResult.from_solution(search.program, best, search.bound, notes)


def _disc_tangents(standard: Standard, z: Floats) -> list[Rows]:
    """Rows G z <= h that hold wherever a disc holds and touch it nearest to z, if z exceeds it."""
    rows = []
    for unrolled in standard.structures_of(Disc).values():
        exceeded = np.flatnonzero(unrolled.violation(z) > RELAXATION_TOLERANCE)
        if len(exceeded):
            rows.append(unrolled.structure.tangents(unrolled.elements(exceeded), z))
    return rows
