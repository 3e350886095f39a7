r"""What a little more of anything would cost: the multipliers of a plan's rows.

Where integers and modes are as a plan has them, what remains is convex but for the cones of
distflow, which are closed at its optimum, or else solved as they are by Ipopt. The derivative of
the least cost by the right side of a row is the negative of the row's multiplier $y$ in

$$ L = c^\top z + y^\top (A z - b) + \dots $$

It is one of two where the plan stands at a corner, as where demand meets what a cheap unit can
give: what a little more costs, what a little less saves, or anything between.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from resilience.arrays import Floats
from resilience.errors import SolverError
from resilience.models.backends.base import Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import (
    broken_modes,
    idle_columns,
    is_off_ac,
    with_integers_held,
)
from resilience.models.methods.conic import relaxation
from resilience.models.methods.units import rescaled
from resilience.models.program.standard import Vectors
from resilience.models.program.units import Units
from resilience.models.structures import SecondOrder

PRICE_S = 60.0
"""For all solves behind the prices of a plan."""
HINT = "a plan on lindistflow or copperplate has the prices of a simpler model"


def row_prices(program: CaseProgram, z: Floats, seconds: float = PRICE_S) -> Floats:
    """(rows,) $ by which the least cost rises per unit of a row's right side.

    Args:
        program: what was solved.
        z: (columns,) a plan, whose integers are held, and whose modes where they have to be.
        seconds: that all solves together may take.

    Raises:
        SolverError: a solver found no optimum in time.
    """
    units = Units.of_program(program.standard, program.vectors)
    inner, scale, rows = rescaled(program, units)
    stop = time.perf_counter() + seconds
    y = _multipliers(inner, z / scale, lambda: max(stop - time.perf_counter(), 0.0))
    return 0.0 - y * rows * units.cost


def _multipliers(program: CaseProgram, z: Floats, seconds: Callable[[], float]) -> Floats:
    standard, vectors = program.standard, with_integers_held(program, z)
    while True:
        solution = _convex(program, vectors, seconds())
        if solution.z is None or solution.duals is None:
            raise SolverError(
                "no optimum was found beside the plan's integers, so there are no prices",
                hint=HINT,
            )
        broken = broken_modes(standard, solution.z)
        if broken:
            vectors = vectors.fixed(*idle_columns(standard, z, broken))
        elif is_off_ac(standard, solution.z):
            solution = _nonlinear(program, z, vectors, seconds())
            broken = broken_modes(standard, solution.point)
            if not broken:
                break
            vectors = vectors.fixed(*idle_columns(standard, z, broken))
        else:
            break
    assert solution.duals is not None
    return solution.duals.rows[: standard.n_rows]


def _convex(program: CaseProgram, vectors: Vectors, seconds: float) -> Solution:
    """The optimum with modes relaxed, by HiGHS where all is linear."""
    if program.standard.structures_of(SecondOrder):
        return relaxation(program, vectors, seconds=seconds)
    solver = Highs(lower(program.standard, integer="none", modes={}), time_limit=seconds)
    solver.update(vectors)
    return solver.solve()


def _nonlinear(program: CaseProgram, z: Floats, vectors: Vectors, seconds: float) -> Solution:
    solver = NLP(program.standard, time_limit=seconds)
    solver.update(vectors)
    solver.start_from(z)
    solution = solver.solve()
    if solution.z is None:
        raise SolverError(
            "Ipopt found no optimum of the AC equations beside the plan, so there are no prices",
            hint=HINT,
        )
    return solution
