"""LinDistFlow on ieee33: building 96 slots, and re-solving windows of 8, HiGHS against Pyomo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.row import Row, below, ratio, timed
from resilience.case import Case, load_case
from resilience.models.backends.base import Backend, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import Lowered, lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.program.standard import Standard, Values

WINDOW = 8
AGREEMENT = 1e-6
TURNS = 3


def relaxed(standard: Standard) -> Lowered:
    """The linear program: integers and modes left out, discs as polygons."""
    return lower(standard, integer="none", modes={})


def build(case: Case, backend: type[Highs] | type[Pyomo]) -> Backend:
    """From a case to a model that is ready to be solved."""
    program = horizon(case)
    solver = backend(relaxed(program.standard))
    solver.update(program.vectors)
    return solver


def building() -> Iterator[Row]:
    case = load_case("ieee33")
    for backend in (Highs, Pyomo):
        build(case, backend)  # imports
    fast, slow = [], []
    for _ in range(3):
        fast += [timed(build, case, Highs)[0] for _ in range(5)]
        slow.append(timed(build, case, Pyomo)[0])
    yield ratio("build 96 slots, highs over pyomo", slow, fast, 50.0)


def windows(day: CaseProgram, window: Standard, order: np.ndarray) -> list[tuple[Values, Values]]:
    """Data and states of windows that begin at the slots `order`, as a controller meets them.

    Demand and PV differ from the forecast by up to 5 %, and so does the storage from the plan.
    """
    rng = np.random.default_rng(0)
    highs, energy = Highs(relaxed(window)), day.x0["ess.energy"]
    after = window.columns("ess.energy")[:, 0]
    starts: list[tuple[Values, Values]] = []
    for first in order:
        data = {k: v[:, first : first + WINDOW] for k, v in day.data.items()}
        for name in ("load.demand", "pv.available"):
            data[name] = data[name] * rng.uniform(0.95, 1.0, data[name].shape)
        x0 = dict(day.x0) | {"ess.energy": energy * rng.uniform(0.95, 1.0, len(energy))}
        starts.append((data, x0))
        energy = _again(highs, window, data, x0).point[after]
    return starts


def resolving() -> Iterator[Row]:
    case = load_case("ieee33")
    day, window = horizon(case), horizon(case.replace(slots=WINDOW)).standard
    firsts = np.arange(case.slots - WINDOW)
    for name, order, min_ratio in (
        ("8 slots through the day", firsts, 10.0),
        ("8 slots in random order", np.random.default_rng(0).permutation(firsts), None),
    ):
        fast, slow = _race(window, windows(day, window, order))
        yield ratio(f"re-solve, {name}, highs over pyomo", slow, fast, min_ratio)
        yield below(f"re-solve, {name}, highs", 1e3 * float(np.median(fast)), 2.0, "ms")


def _race(
    standard: Standard, starts: list[tuple[Values, Values]]
) -> tuple[list[float], list[float]]:
    """Seconds per window of warm HiGHS and of the persistent Pyomo solver, in turns of a day.

    Raises:
        AssertionError: their optima differ.
    """
    lowered = relaxed(standard)
    highs, pyomo = Highs(lowered, duals=False), Pyomo(lowered)
    for solver in (highs, pyomo):
        _again(solver, standard, *starts[0])  # cold
    fast, slow = [], []
    for _ in range(TURNS):
        ours = [timed(_again, highs, standard, *start) for start in starts]
        theirs = [timed(_again, pyomo, standard, *start) for start in starts]
        for k, ((fast_s, our), (slow_s, their)) in enumerate(zip(ours, theirs, strict=True)):
            fast.append(fast_s)
            slow.append(slow_s)
            apart = abs(our.objective - their.objective) / (1.0 + abs(their.objective))
            assert apart <= AGREEMENT, f"window {k}: {our.objective} and {their.objective}"
    return fast, slow


def _again(solver: Backend, standard: Standard, data: Values, x0: Values) -> Solution:
    solver.update(standard.vectors(data, x0))
    return solver.solve()
