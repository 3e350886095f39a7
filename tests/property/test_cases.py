"""What holds for every microgrid, tried on random ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, note

from resilience.models.backends.base import Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.microgrid import Physics
from resilience.models.program.referee import audit, settle
from resilience.models.structures import Mode, Split
from resilience.testing import case_optimum, small_case
from tests.property.random_cases import dearer, documents, number, quick

TOLERANCE = 1e-5
FLAT: tuple[Physics, ...] = ("copperplate", "lindistflow")


def solve(backend: Any, problem: CaseProgram) -> Solution:
    backend.update(problem.vectors)
    return backend.solve()


def exact(problem: CaseProgram, **options: Any) -> Solution:
    return solve(Highs(problem.standard, gap=0.0, **options), problem)


def breaks(problem: CaseProgram, found: Solution) -> dict[str, float]:
    """What the referee finds wrong, by name."""
    z = settle(problem.standard, found.point, problem.vectors)
    worst = audit(problem.standard, z, problem.vectors).worst
    return {name: value for name, value in worst.items() if value > TOLERANCE}


@pytest.mark.parametrize("physics", FLAT)
@quick
@given(documents())
def test_a_relaxation_costs_at_most_what_the_exact_model_costs(
    physics: Physics, document: dict[str, Any]
) -> None:
    problem = horizon(small_case(**document), physics)
    found = exact(problem)
    assume(found.status == "optimal")
    loose = Highs(lower(problem.standard, integer="none", modes={}))
    assert solve(loose, problem).objective <= found.objective + 1e-7
    conic = solve(Conic(problem.standard), problem)
    assert conic.bound <= found.objective + 1e-7
    assert conic.objective <= found.objective + 1e-5


@quick
@given(documents(blocks=False, memory=False))
def test_the_cone_relaxation_is_below_the_ac_equations(document: dict[str, Any]) -> None:
    document["generator"] = []
    problem = horizon(small_case(**document), "distflow")
    bound = solve(Conic(problem.standard), problem)
    solver = NLP(problem.standard)
    solver.start_from(bound.point)
    found = solve(solver, problem)
    assume(found.status == "optimal")
    note(f"bound {bound.bound}, AC {found.objective}")
    assert bound.bound <= found.objective + 1e-6
    modes = {s.name for s in problem.standard.structures_of(Split).values()}
    assert set(breaks(problem, found)) <= modes


@pytest.mark.parametrize("physics", FLAT)
@quick
@given(documents())
def test_pyomo_and_direct_highs_agree_and_the_referee_accepts_both(
    physics: Physics, document: dict[str, Any]
) -> None:
    problem = horizon(small_case(**document), physics)
    direct, oracle = exact(problem), solve(Pyomo(problem.standard, gap=0.0), problem)
    assert direct.status == oracle.status
    assume(direct.status == "optimal")
    assert direct.objective == pytest.approx(oracle.objective, rel=1e-6, abs=1e-6)
    assert breaks(problem, direct) == {}
    assert breaks(problem, oracle) == {}


@quick
@given(documents())
def test_the_referee_accepts_what_conic_and_nlp_hold(document: dict[str, Any]) -> None:
    problem = horizon(small_case(**document), "lindistflow")
    modes = {s.name for s in problem.standard.structures_of(Mode).values()}
    for backend in (Conic, NLP):
        found = solve(backend(problem.standard), problem)
        assume(found.z is not None)
        assert set(breaks(problem, found)) <= modes | {"integrality"}


@quick
@given(documents(), number(0.1, 10))
def test_scaling_all_prices_scales_the_cost(document: dict[str, Any], factor: float) -> None:
    once = exact(horizon(small_case(**document), "copperplate"))
    assume(once.status == "optimal")
    more = exact(horizon(dearer(document, factor), "copperplate"))
    assert more.objective == pytest.approx(factor * once.objective, rel=1e-6, abs=1e-6)


@quick
@given(documents(memory=False))
def test_more_outage_never_lowers_the_cost(document: dict[str, Any]) -> None:
    # Without minimum times, which an outage lifts, and without voltages, which it sets free.
    buses, slots = document["buses"], document["slots"]
    assume(buses > 1)
    last = f"{buses - 1}-{buses}"
    steps = [[], [f"{last}@01:00-02:00"], [f"{last}@00:00-{slots:02d}:00"]]
    if buses > 2:
        steps.append([f"{k}-{k + 1}@00:00-{slots:02d}:00" for k in range(1, buses)])
    costs = [
        case_optimum(small_case(**{**document, "outages": outages})).objective for outages in steps
    ]
    assert (np.diff(costs) >= -1e-6).all(), costs
