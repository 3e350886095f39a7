"""`lp` and `milp`: HiGHS on copperplate or LinDistFlow, binaries only where they are needed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.backends.base import NOTHING, Solution, Status
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Discs, lower
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    LATE,
    Deadline,
    MethodOptions,
    MethodResult,
    fractional,
    gap,
    rounded,
    sides,
    violated,
    widest,
)
from resilience.models.methods.explain import conflict, infeasible, no_plan
from resilience.models.methods.start import any_point, mended, switches
from resilience.models.methods.tidy import tidied
from resilience.models.program.referee import structure_violations
from resilience.models.program.standard import Standard, Vectors
from resilience.progress import phase
from resilience.tolerances import RELAXATION_TOLERANCE

Rows = tuple[sp.csr_array, Floats]
ROUNDS = 30  # tangents alone converge in about nine


@dataclass
class LinearSearch:
    """Which columns are held integer so far, which modes have binaries, and what is proven.

    `rows` are tangents of discs, G z <= h, where the polygons around them were exceeded.
    """

    program: CaseProgram
    options: MethodOptions
    clock: Deadline
    integer: Bools
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
        return self.clock.left <= 0

    def solver(self, vectors: Vectors, discs: Discs = "outer", share: float = 1.0) -> Highs:
        """HiGHS with what is held so far and a share of the time left."""
        standard = self.program.standard
        lowered = lower(standard, integer=self.integer, exact=self.modes, discs=discs)
        seconds = max(share * self.clock.left, 1.0)
        rows = None
        if discs == "outer" and self.rows:
            blocks, right = zip(*self.rows, strict=True)
            rows = sp.vstack(blocks, format="csr"), np.concatenate(right)
        solver = Highs(lowered, rows=rows, time_limit=seconds, gap=self.options.gap / 2)
        solver.update(vectors)
        return solver

    def tightened(self, z: Floats, broken: dict[int, Bools]) -> bool:
        """Holds what z breaks; False when there is nothing new to hold."""
        standard = self.program.standard
        loose = bool(fractional(standard, z).any())
        if loose:
            self.integer = standard.integer
        for k, elements in broken.items():
            self.modes[k] = self.modes.get(k, np.zeros(len(elements), bool)) | elements
        exceeded = _disc_tangents(standard, z)
        self.rows += exceeded
        return loose or bool(broken) or bool(exceeded)


def lp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Relaxes every mode and integer, tests the answer, and adds binaries only where it fails."""
    return _solve(program, options, np.zeros(program.standard.n_columns, bool))


def milp(program: CaseProgram, options: MethodOptions) -> MethodResult:
    """Holds all integers from the start; modes get their binaries where the answer needs them."""
    return _solve(program, options, program.standard.integer)


def _solve(program: CaseProgram, options: MethodOptions, integer: Bools) -> MethodResult:
    standard = program.standard
    if any(s.kind == "cone" for s in standard.structures):
        raise UsageError(
            "linear methods cannot hold the cones of distflow; allowed: copperplate, lindistflow",
            hint="use --method socp, nlp, minlp or exact with --physics distflow",
        )
    search = LinearSearch(program, options, Deadline(options.time_limit), integer)
    if integer.any():
        with phase("linear program", "bound"):
            search.bound = _relaxed_bound(search)
    for k in range(ROUNDS):
        with phase("linear program", f"round {k + 1}"):
            found = _relaxed(search)
            broken = violated(standard, found.point)
            plan = _plan(search, found, broken)
        if plan.objective < search.best.objective:
            search.best = plan
        enough = search.gap <= options.gap or (search.late and search.best.z is not None)
        if enough or not search.tightened(found.point, broken):
            break
    return _answer(search, found)


def _relaxed_bound(search: LinearSearch) -> float:
    """The bound of the linear relaxation, for a tree search that ends without a better one."""
    relaxed = replace(search, integer=search.integer & False, modes={})
    solver = relaxed.solver(search.program.vectors)
    return solver.certified_bound(solver.solve())


def _relaxed(search: LinearSearch) -> Solution:
    """The optimum of what is held so far with polygons around the discs; its bound is kept."""
    program = search.program
    solver = search.solver(program.vectors)
    if solver.is_mip and switches(program):
        unswitched = search.solver(mended(program), share=0.25).solve()
        if unswitched.z is not None:
            solver.start_from(unswitched.z)
    found = solver.solve()
    if found.status == "infeasible":
        raise infeasible(program, conflict(program, solver))
    bound = found.bound if solver.is_mip else solver.certified_bound(found)
    search.bound = max(search.bound, bound)
    if found.z is None and solver.is_mip:
        found = any_point(program, solver.lowered)
    if found.z is None:
        raise no_plan(program, "HiGHS", search.options)
    return found


def _plan(search: LinearSearch, found: Solution, broken: dict[int, Bools]) -> Solution:
    """A point that holds everything: `found` if it does, else the best with its integers and modes
    and with polygons within the discs, else the best within them, else nothing.
    """
    program, standard = search.program, search.program.standard
    if fractional(standard, found.point).any():
        return NOTHING
    exceeded = widest(standard, found.point, "disc") > RELAXATION_TOLERANCE
    if not broken and not exceeded:
        return found
    held = rounded(program, found.point)
    for modes in (search.modes, broken):
        held = held.fixed(*sides(standard, found.point, modes))
    plan = search.solver(held, "inner").solve()
    if plan.z is None and exceeded and not broken:
        plan = search.solver(program.vectors, "inner").solve()
    sound = plan.z is not None and not violated(standard, plan.z)
    return replace(plan, status=found.status) if sound else NOTHING


def _answer(search: LinearSearch, found: Solution) -> MethodResult:
    notes, options = [], search.options
    best = found if search.best.z is None else search.best
    if search.modes:
        number = sum(int(elements.sum()) for elements in search.modes.values())
        notes.append(f"{number} mode binaries were needed")
    if search.gap > options.gap:
        notes.append(LATE)
    status: Status = "optimal" if search.gap <= options.gap else "feasible"
    with phase("tie-break"):
        best = tidied(search.program, best)
    return MethodResult.of(search.program, replace(best, status=status), search.bound, notes)


def _disc_tangents(standard: Standard, z: Floats) -> list[Rows]:
    """Rows G z <= h that hold wherever a disc holds and touch it nearest to z, if z exceeds it."""
    found = []
    for disc in standard.structures:
        if disc.kind != "disc":
            continue
        at = np.flatnonzero(structure_violations(disc, z) > RELAXATION_TOLERANCE)
        if not len(at):
            continue
        values = np.array(disc.values(z))[:, at]
        normals = values / np.linalg.norm(values, axis=0)
        block = sum(m[at].multiply(n[:, None]) for m, n in zip(disc.matrices, normals, strict=True))
        right = disc.limits[0][at] - sum(
            c[at] * n for c, n in zip(disc.consts, normals, strict=True)
        )
        found.append((sp.csr_array(block), right))
    return found
